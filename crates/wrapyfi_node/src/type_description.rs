//! The service `~/get_type_description`: definitions of the types that a node uses.
//!
//! ```text
//!   TypeStore ─▶ ResolvedType ─▶ add ─┐                      ┌─▶ description, sources
//!                                     ▼                      │
//!   name, RIHS01 hash ─▶ answer ─▶ TypeDescriptions ─────────┴─▶ why not
//! ```
//!
//! A type counts as used as long as an endpoint of the node has it: each adds it when it opens and
//! removes it when it closes.

use std::collections::BTreeMap;

use wrapyfi_interfaces::store::{ResolveError, ResolvedType, TypeStore};
use wrapyfi_interfaces::type_description_interfaces::msg::{TypeDescription, TypeSource};
use wrapyfi_interfaces::type_description_interfaces::srv::{
    GetTypeDescription_Request, GetTypeDescription_Response,
};

/// The types a node uses.
///
/// ```
/// use wrapyfi_node::type_description::TypeDescriptions;
/// use wrapyfi_interfaces::store::TypeStore;
/// use wrapyfi_interfaces::type_description_interfaces::srv::GetTypeDescription_Request;
///
/// let mut types = TypeDescriptions::default();
/// let hash = types.add_named(&mut TypeStore::generated(), "std_msgs/msg/String")?;
/// let request = GetTypeDescription_Request {
///     type_name: "std_msgs/msg/String".into(),
///     type_hash: hash,
///     include_type_sources: false,
/// };
/// let answer = types.answer(&request);
/// assert_eq!(answer.type_description.type_description.fields[0].name, "data");
/// # Ok::<(), wrapyfi_interfaces::store::ResolveError>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct TypeDescriptions {
    /// Types in use, by hash and name.
    types: BTreeMap<(String, String), Known>,
}

#[derive(Debug, Clone)]
struct Known {
    /// Number of endpoints that have the type.
    users: usize,
    description: TypeDescription,
    sources: Vec<TypeSource>,
}

impl TypeDescriptions {
    /// Name of the service behind that of the node.
    pub const SERVICE: &'static str = "get_type_description";

    /// Number of requests and replies that nodes keep of the service.
    pub const DEPTH: u32 = 10;

    /// Adds a type that an endpoint has, and the texts that define it, where they are known.
    /// Returns its hash.
    pub fn add(&mut self, resolved: &ResolvedType, sources: Vec<TypeSource>) -> String {
        let hash = resolved.type_hash();
        let known =
            self.types.entry((hash.clone(), resolved.name().to_string())).or_insert_with(|| {
                Known { users: 0, description: resolved.description().into(), sources }
            });
        known.users = known.users.saturating_add(1);
        hash
    }

    /// Finds a type by name, for instance `std_msgs/msg/String` or `std_srvs/srv/SetBool`, and adds
    /// it with its texts. Returns its hash.
    ///
    /// # Errors
    /// When its definition is not found or cannot be read.
    pub fn add_named(&mut self, store: &mut TypeStore, name: &str) -> Result<String, ResolveError> {
        let resolved = store.resolve_name(name)?;
        let sources = store.sources(&resolved)?;
        Ok(self.add(&resolved, sources))
    }

    /// Forgets one use of a type; the last one forgets the type.
    pub fn remove(&mut self, name: &str, hash: &str) {
        let key = (hash.to_owned(), name.to_owned());
        if let Some(known) = self.types.get_mut(&key) {
            known.users = known.users.saturating_sub(1);
            if known.users == 0 {
                self.types.remove(&key);
            }
        }
    }

    /// Answers a request. A type that the node does not use is refused in the words of ROS 2.
    pub fn answer(&self, request: &GetTypeDescription_Request) -> GetTypeDescription_Response {
        let refused = |reason: &str| GetTypeDescription_Response {
            failure_reason: reason.to_owned(),
            ..GetTypeDescription_Response::default()
        };
        let Some(hash) = hash(&request.type_hash) else {
            return refused("Failed to parse type hash");
        };
        let Some(known) = self.types.get(&(hash, request.type_name.clone())) else {
            return refused("Type not currently in use by this node");
        };
        GetTypeDescription_Response {
            successful: true,
            failure_reason: String::new(),
            type_description: known.description.clone(),
            type_sources: match request.include_type_sources {
                true => known.sources.clone(),
                false => Vec::new(),
            },
            extra_information: Vec::new(),
        }
    }
}

/// Normalises a REP-2016 hash to version 1 in lower case; `None` for any other text.
fn hash(text: &str) -> Option<String> {
    let digits = text.strip_prefix("RIHS01_")?;
    let hex = digits.len() == 64 && digits.bytes().all(|byte| byte.is_ascii_hexdigit());
    hex.then(|| format!("RIHS01_{}", digits.to_ascii_lowercase()))
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::Message as _;

    use super::*;
    use crate::test_data::{self, RMWS};
    use wrapyfi_interfaces::parser::{Dialect, TypeName};

    const STRING: &str = "std_msgs/msg/String";

    /// Types that the recorded node knew, its text included.
    fn recorded_types(rmw: &str) -> TypeDescriptions {
        let recorded = test_data::group(rmw, "get_type_description");
        let text = recorded
            .iter()
            .filter(|(topic, _)| topic.ends_with("Reply"))
            .filter_map(|(_, cdr)| GetTypeDescription_Response::decode(cdr, 1 << 16).ok())
            .find_map(|reply| reply.type_sources.into_iter().next())
            .unwrap()
            .raw_file_contents;
        let name = TypeName::parse(Dialect::Ros2, STRING).unwrap();
        let resolved = ResolvedType::from_text(Dialect::Ros2, &name, &text).unwrap();
        let source = TypeSource {
            type_name: STRING.into(),
            encoding: "msg".into(),
            raw_file_contents: text,
        };
        let mut types = TypeDescriptions::default();
        types.add(&resolved, vec![source]);
        types
    }

    #[test]
    fn every_request_gets_the_recorded_reply() {
        for rmw in RMWS {
            let types = recorded_types(rmw);
            let recorded = test_data::group(rmw, "get_type_description");
            assert_eq!(recorded.len(), 8);
            for exchange in recorded.chunks(2) {
                let [(_, request), (_, recorded)] = exchange else { panic!("{exchange:?}") };
                let request = GetTypeDescription_Request::decode(request, 1 << 16).unwrap();
                let reply = types.answer(&request).encode();
                let recorded = test_data::clean::<GetTypeDescription_Response>(rmw, recorded);
                assert_eq!(test_data::padded(&reply.to_bytes()), recorded, "{rmw} {request:?}");
            }
        }
    }

    fn ask(types: &TypeDescriptions, name: &str, hash: &str) -> GetTypeDescription_Response {
        types.answer(&GetTypeDescription_Request {
            type_name: name.to_owned(),
            type_hash: hash.to_owned(),
            include_type_sources: true,
        })
    }

    #[test]
    fn name_and_hash_must_both_be_right() {
        let mut types = TypeDescriptions::default();
        let hash = types.add_named(&mut TypeStore::generated(), STRING).unwrap();
        let reason = |name: &str, hash: &str| ask(&types, name, hash).failure_reason;
        assert_eq!(reason(STRING, &hash), "");
        assert_eq!(
            reason(STRING, &hash.replace("RIHS01_", "rihs01_")),
            "Failed to parse type hash"
        );
        let upper = format!("RIHS01_{}", hash["RIHS01_".len()..].to_uppercase());
        assert_eq!(reason(STRING, &upper), "");
        for bad in ["", "RIHS01_", &hash[..70], &format!("{hash}0"), &hash.replace("01_", "02_")] {
            assert_eq!(reason(STRING, bad), "Failed to parse type hash", "{bad}");
        }
        let unused = "Type not currently in use by this node";
        assert_eq!(reason("std_msgs/msg/Header", &hash), unused);
        let zeros = format!("RIHS01_{}", "0".repeat(64));
        assert_eq!(reason(STRING, &zeros), unused);
    }

    #[test]
    fn a_type_stays_as_long_as_somebody_uses_it() {
        let mut store = TypeStore::generated();
        let mut types = TypeDescriptions::default();
        let hash = types.add_named(&mut store, "std_srvs/srv/SetBool").unwrap();
        assert_eq!(types.add_named(&mut store, "std_srvs/srv/SetBool").unwrap(), hash);
        let answer = ask(&types, "std_srvs/srv/SetBool", &hash);
        assert!(answer.successful);
        assert_eq!(answer.type_description.referenced_type_descriptions.len(), 5);
        assert_eq!(answer.type_sources.len(), 6);
        types.remove("std_srvs/srv/SetBool", &hash);
        assert!(ask(&types, "std_srvs/srv/SetBool", &hash).successful);
        types.remove("std_srvs/srv/SetBool", &hash);
        assert!(!ask(&types, "std_srvs/srv/SetBool", &hash).successful);
        types.remove("std_srvs/srv/SetBool", &hash);
        assert!(types.add_named(&mut store, "nowhere/msg/Thing").is_err());
    }
}
