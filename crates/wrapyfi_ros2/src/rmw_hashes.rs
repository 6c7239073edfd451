//! Types and their hashes as rmw has them: a hash is bytes, where it is a text elsewhere.

use std::fmt::Write as _;

use wrapyfi_data::types::RosType;
use wrapyfi_interfaces::description::TypeDescription;
use wrapyfi_interfaces::store::TypeStore;
use wrapyfi_rmw::{TypeHash, TypeInfo};

/// Prefix of a hash of version 1, by REP-2016.
const HASH_BEGINS: &str = "RIHS01_";

/// A type for rmw, with its fields where the middleware looks at them and this program has a definition with that hash.
pub(super) fn type_info<'a>(name: &'a str, hash: Option<&str>) -> TypeInfo<'a> {
    let is_asked = wrapyfi_rmw::implementation().is_ok_and(|it| it == "rmw_cyclonedds_cpp");
    let description = hash.filter(|_| is_asked).and_then(|hash| described(name, hash));
    TypeInfo { name, hash: hash.and_then(hash_from_text), description }
}

fn described(name: &str, hash: &str) -> Option<&'static TypeDescription> {
    let known = RosType::known(name, hash).or_else(|| {
        let generated = TypeStore::generated().resolve_name(name).ok()?;
        RosType::new(&generated).ok().filter(|it| it.type_hash() == hash)
    });
    known.map(|it| it.resolved().description())
}

pub(super) fn hash_from_text(text: &str) -> Option<TypeHash> {
    let digits = text.strip_prefix(HASH_BEGINS).filter(|digits| digits.len() == 64)?;
    let mut hash = [0; 32];
    for (byte, pair) in hash.iter_mut().zip(digits.as_bytes().chunks_exact(2)) {
        *byte = u8::from_str_radix(std::str::from_utf8(pair).ok()?, 16).ok()?;
    }
    Some(hash)
}

pub(super) fn hash_to_text(hash: &TypeHash) -> String {
    let mut text = HASH_BEGINS.to_owned();
    for byte in hash {
        // Writing to a string does not fail.
        _ = write!(text, "{byte:02x}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts of services are types as well.
    #[test]
    fn a_type_of_this_program_has_its_fields() {
        use wrapyfi_interfaces::std_srvs::srv::SetBool;
        use wrapyfi_interfaces::{Message, Service};
        fn fields<M: Message>() -> Option<usize> {
            Some(described(M::ROS_TYPE, M::TYPE_HASH)?.type_description.fields.len())
        }
        assert_eq!(fields::<wrapyfi_interfaces::std_msgs::msg::Header>(), Some(2));
        assert_eq!(fields::<<SetBool as Service>::Response>(), Some(2));
        assert!(described("a/msg/B", "RIHS01_").is_none());
    }

    #[test]
    fn hashes_are_texts_and_bytes() {
        let text = format!("RIHS01_{}", "0f".repeat(32));
        assert_eq!(hash_from_text(&text).as_ref().map(hash_to_text), Some(text));
        for wrong in ["", "RIHS01_", "RIHS02_00", &format!("RIHS01_{}", "zz".repeat(32))] {
            assert_eq!(hash_from_text(wrong), None);
        }
    }
}
