//! Modes from Wrapyfi's configuration files.
//!
//! ```text
//!   Camera:                              class, by its bare name
//!     read: publish                      one mode for all instances
//!     show: [publish, null, listen]      one for each, in the order in which they are made
//! ```

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};

use super::config::{Configuration, Entry};
use super::mode::{Mode, Modes};
use wrapyfi_engine::{ConfigError, MAX_CONFIG_BYTES, Problem, Reading, Spanned};

type File = BTreeMap<String, Option<BTreeMap<String, Spanned<Written>>>>;

impl Configuration {
    /// Reads a file as `ConfigManager` does.
    ///
    /// ```
    /// use wrapyfi_core::communicator::Configuration;
    /// let text = "Camera:\n  read: [publish, null]\n";
    /// assert!(Configuration::from_yaml(text, "camera.yml").is_ok());
    /// let error = Configuration::from_yaml("Camera:\n  read: pubish\n", "camera.yml").unwrap_err();
    /// assert!(error.to_string().starts_with("camera.yml:2:"));
    /// assert!(error.to_string().contains("did you mean `publish`?"));
    /// ```
    ///
    /// # Errors
    /// When an entry is wrong; the error names its line. `file` is the name of the file in errors.
    pub fn from_yaml(text: &str, file: &str) -> Result<Self, ConfigError> {
        let read = Reading::<Option<File>>::new(text, &|_| None).whole(file)?;
        let classes = read.unwrap_or_default().into_iter().map(|(class, methods)| {
            let entries = methods.unwrap_or_default().into_iter().map(|(method, modes)| Entry {
                method,
                place: format!("{file}:{}", modes.referenced.line()),
                modes: modes.value.0,
            });
            (class, entries.collect())
        });
        Ok(Self(classes.collect()))
    }

    /// Reads a file, or every `.yml` and `.yaml` file of a folder in the order of their names.
    ///
    /// # Errors
    /// When a file cannot be read, or an entry is wrong.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        let mut whole = Self::default();
        for file in files(path)? {
            let name = file.display().to_string();
            // A file that is too large for a configuration is refused before it is read.
            let size = std::fs::metadata(&file).map_err(|error| unreadable(&file, &error))?.len();
            let size = usize::try_from(size).unwrap_or(usize::MAX);
            if size > MAX_CONFIG_BYTES {
                return Err(ConfigError { file: name, problems: vec![Problem::too_large(size)] });
            }
            let text = std::fs::read_to_string(&file).map_err(|error| unreadable(&file, &error))?;
            whole.extend(Self::from_yaml(&text, &name)?);
        }
        Ok(whole)
    }
}

fn unreadable(path: &Path, error: &std::io::Error) -> ConfigError {
    let problem = Problem { position: None, message: format!("cannot be read: {error}") };
    ConfigError { file: path.display().to_string(), problems: vec![problem] }
}

fn files(path: &Path) -> Result<Vec<PathBuf>, ConfigError> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(|error| unreadable(path, &error))? {
        let file = entry.map_err(|error| unreadable(path, &error))?.path();
        let is_yaml = file.extension().is_some_and(|end| end == "yml" || end == "yaml");
        if is_yaml && file.is_file() {
            found.push(file);
        }
    }
    found.sort();
    Ok(found)
}

/// A mode, or a list of modes.
struct Written(Modes);

/// A mode, or null.
struct OneWritten(Mode);

impl<'de> Deserialize<'de> for OneWritten {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let word = Option::<String>::deserialize(deserializer)?;
        match word {
            None => Ok(Self(Mode::None)),
            Some(word) => word.parse().map(Self).map_err(de::Error::custom),
        }
    }
}

impl<'de> Deserialize<'de> for Written {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WrittenVisitor)
    }
}

struct WrittenVisitor;

impl<'de> Visitor<'de> for WrittenVisitor {
    type Value = Written;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a mode ({}), null, or a list of them", Mode::ALL.map(Mode::name).join(", "))
    }

    fn visit_str<E: de::Error>(self, word: &str) -> Result<Written, E> {
        word.parse().map(|mode| Written(Modes::All(mode))).map_err(E::custom)
    }

    fn visit_unit<E: de::Error>(self) -> Result<Written, E> {
        Ok(Written(Modes::All(Mode::None)))
    }

    fn visit_none<E: de::Error>(self) -> Result<Written, E> {
        self.visit_unit()
    }

    fn visit_some<D: Deserializer<'de>>(self, inner: D) -> Result<Written, D::Error> {
        inner.deserialize_any(self)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut members: A) -> Result<Written, A::Error> {
        let mut modes = Vec::new();
        while let Some(OneWritten(mode)) = members.next_element()? {
            modes.push(mode);
        }
        Ok(Written(Modes::ByInstance(modes)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn modes(text: &str) -> Vec<(String, Modes)> {
        let read = Configuration::from_yaml(text, "x.yml").unwrap();
        read.of("A").iter().map(|entry| (entry.method.clone(), entry.modes.clone())).collect()
    }

    #[test]
    fn a_file_of_wrapyfi_is_read_as_it_is() {
        let text = "A:\n  one: \"publish\"\n  two: [\"publish\", null, \"listen\"]\n  three: null\n  \
                    four: ~\n  five: none\nB:\n  one: listen\nC:\n";
        let found = modes(text);
        let by_instance = Modes::ByInstance(vec![Mode::Publish, Mode::None, Mode::Listen]);
        let expected = [
            ("five", Modes::All(Mode::None)),
            ("four", Modes::All(Mode::None)),
            ("one", Modes::All(Mode::Publish)),
            ("three", Modes::All(Mode::None)),
            ("two", by_instance),
        ];
        assert_eq!(found, expected.map(|(name, modes)| (name.to_owned(), modes)));
        assert_eq!(modes(""), []);
    }

    #[test]
    fn faults_have_their_line() {
        let error = |text| Configuration::from_yaml(text, "x.yml").unwrap_err().to_string();
        // A method may have the name of a setting of a bridge.
        let text = error("A:\n  timeout_ms: lissten\n  depth: 5\n");
        assert!(!text.contains("write for example"), "{text}");
        let text = error("A:\n  one: publish\n  two: lissten\n");
        assert!(text.starts_with("x.yml:3:"), "{text}");
        assert!(text.contains("did you mean `listen`?"), "{text}");
        let text = error("A:\n  one: [publish, 7x]\n");
        assert!(text.starts_with("x.yml:2:") && text.contains("\"7x\" is no mode"), "{text}");
        let text = error("A: publish\n");
        assert!(text.starts_with("x.yml:1:"), "{text}");
        let text = error("A:\n  one: {mode: publish}\n");
        assert!(text.starts_with("x.yml:2:") && text.contains("list of them"), "{text}");
        assert!(error("A:\n  one: publish\n  one: listen\n").starts_with("x.yml:3:"));
        assert!(error(&" ".repeat(MAX_CONFIG_BYTES + 1)).contains("1048576"));
    }

    #[test]
    fn a_folder_is_read_in_the_order_of_its_names() {
        let folder = std::env::temp_dir().join(format!("wrapyfi_config_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("b.yaml"), "A:\n  one: listen\n").unwrap();
        std::fs::write(folder.join("a.yml"), "A:\n  one: publish\n").unwrap();
        std::fs::write(folder.join("c.txt"), ":").unwrap();
        let read = Configuration::load(&folder).unwrap();
        std::fs::remove_dir_all(&folder).unwrap();
        let found: Vec<_> = read.of("A").iter().map(|entry| entry.modes.clone()).collect();
        assert_eq!(found, [Modes::All(Mode::Publish), Modes::All(Mode::Listen)]);
        let error = Configuration::load(Path::new("/none/at/all.yml")).unwrap_err().to_string();
        assert!(error.starts_with("/none/at/all.yml: cannot be read"), "{error}");
    }
}
