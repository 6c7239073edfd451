//! Folder of a node's keys, by `ROS_SECURITY_*`.
//!
//! rcl reads the same variables. It is not linked: where a middleware cannot be loaded it ends the program before
//! `main` begins.

use std::path::{Path, PathBuf};

use super::Fault;

/// Variable that asks for keys, and operation of the fault where there are none.
pub(crate) const KEYS: &str = "ROS_SECURITY_ENABLE";

/// The keys that a node uses.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Keys {
    pub(crate) folder: PathBuf,
    /// True when participants without keys are refused.
    pub(crate) enforced: bool,
}

impl Keys {
    /// Keys of an enclave; `None` where security is off, or is not enforced and there are none.
    pub(crate) fn from_environment(
        enclave: &str,
        variable: impl Fn(&str) -> Option<String>,
    ) -> Result<Option<Self>, Fault> {
        let is = |name: &str, wanted: &str| variable(name).is_some_and(|value| value == wanted);
        if !is(KEYS, "true") {
            return Ok(None);
        }
        let enforced = is("ROS_SECURITY_STRATEGY", "Enforce");
        let told = |name: &str| variable(name).filter(|value| !value.is_empty());
        let enclave = told("ROS_SECURITY_ENCLAVE_OVERRIDE").unwrap_or_else(|| enclave.to_owned());
        let folder = told("ROS_SECURITY_KEYSTORE").map(|keystore| {
            Path::new(&keystore).join("enclaves").join(enclave.trim_start_matches('/'))
        });
        match folder {
            Some(folder) if folder.is_dir() => Ok(Some(Self { folder, enforced })),
            folder if enforced => {
                let keystore = told("ROS_SECURITY_KEYSTORE");
                let at = keystore.as_deref().unwrap_or("KEYSTORE");
                let reason = match &folder {
                    Some(folder) => format!("there are no keys in {}", folder.display()),
                    None => "ROS_SECURITY_KEYSTORE is not set".to_owned(),
                };
                let mut remedy = vec![];
                if !keystore.as_ref().is_some_and(|it| Path::new(it).is_dir()) {
                    remedy.push(format!("`ros2 security create_keystore {at}`"));
                }
                remedy.push(format!("`ros2 security create_enclave {at} {enclave}`"));
                if keystore.is_none() {
                    remedy.push("`export ROS_SECURITY_KEYSTORE=KEYSTORE`".to_owned());
                }
                let remedy = remedy.join(", ");
                Err(Fault::new(
                    KEYS,
                    format!(
                        "{reason}, and ROS_SECURITY_STRATEGY=Enforce: {remedy}; or unset {KEYS}"
                    ),
                ))
            }
            _ => Ok(None),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(variables: &[(&str, &str)]) -> Result<Option<Keys>, String> {
        let value = |name: &str| {
            let found = variables.iter().find(|(known, _)| *known == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        Keys::from_environment("/lab/arm", value).map_err(|fault| fault.to_string())
    }

    #[test]
    fn keys_are_those_of_the_enclave() {
        let store = std::env::temp_dir().join(format!("wrapyfi_keys_{}", std::process::id()));
        let folder = store.join("enclaves/lab/arm");
        std::fs::create_dir_all(&folder).unwrap();
        let store_text = store.display().to_string();
        let on = ("ROS_SECURITY_ENABLE", "true");
        let at = ("ROS_SECURITY_KEYSTORE", store_text.as_str());
        let enforced = ("ROS_SECURITY_STRATEGY", "Enforce");
        let other = ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/other");
        assert_eq!(keys(&[at]), Ok(None));
        let found = |enforced| Ok(Some(Keys { folder: folder.clone(), enforced }));
        assert_eq!(keys(&[on, at]), found(false));
        assert_eq!(keys(&[on, at, enforced]), found(true));
        assert_eq!(keys(&[on, at, other]), Ok(None));
        let said = keys(&[on, at, enforced, other]).unwrap_err();
        assert!(said.starts_with("ROS_SECURITY_ENABLE: there are no keys in "), "{said}");
        let create = format!("`ros2 security create_enclave {store_text} /other`");
        assert!(said.contains(&create) && !said.contains("create_keystore"), "{said}");
        let said = keys(&[on, enforced]).unwrap_err();
        for words in [
            "ROS_SECURITY_KEYSTORE is not set",
            "`ros2 security create_keystore KEYSTORE`",
            "`ros2 security create_enclave KEYSTORE /lab/arm`",
            "`export ROS_SECURITY_KEYSTORE=KEYSTORE`",
        ] {
            assert!(said.contains(words), "{words}: {said}");
        }
        std::fs::remove_dir_all(store).unwrap();
    }
}
