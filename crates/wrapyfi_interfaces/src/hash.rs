//! REP-2016 type hashes: `RIHS01_` and the SHA-256 of a type description, which ROS 2 nodes
//! announce with every endpoint and compare with their own.

use hmac_sha256::Hash;

use crate::description::{IndividualTypeDescription, TypeDescription};

/// Hash of a type, for instance `RIHS01_df668c74…6b1a18`.
pub fn type_hash(description: &TypeDescription) -> String {
    let digest = Hash::hash(hashed_text(description).as_bytes());
    let digits: Vec<String> = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("RIHS01_{}", digits.concat())
}

/// The text that is hashed: JSON as Python's `json.dumps` spaces it, in the order of the
/// interface definition, without default values and constants.
pub fn hashed_text(description: &TypeDescription) -> String {
    let referenced: Vec<_> =
        description.referenced_type_descriptions.iter().map(individual).collect();
    format!(
        "{{\"type_description\": {}, \"referenced_type_descriptions\": [{}]}}",
        individual(&description.type_description),
        referenced.join(", ")
    )
}

/// All strings in it are names of ROS types and fields, which need no escapes in JSON.
fn individual(description: &IndividualTypeDescription) -> String {
    let fields: Vec<_> = description
        .fields
        .iter()
        .map(|field| {
            format!(
                "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {}, \
                 \"string_capacity\": {}, \"nested_type_name\": \"{}\"}}}}",
                field.name,
                field.type_id,
                field.capacity,
                field.string_capacity,
                field.nested_type_name
            )
        })
        .collect();
    format!("{{\"type_name\": \"{}\", \"fields\": [{}]}}", description.type_name, fields.join(", "))
}
