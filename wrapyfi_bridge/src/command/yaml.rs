//! A message for people, as `ros2 topic echo` shows it: YAML with long arrays cut short.

use anyhow::Context as _;
use serde::ser::{Serialize, SerializeMap as _, Serializer};
use wrapyfi_interfaces::dynamic::{DynamicMessage, DynamicValue};

/// Elements of an array that are shown, as `ros2 topic echo` does.
const SHOWN: usize = 128;

/// The message as YAML, with a line `---` behind it.
pub(crate) fn text(message: &DynamicMessage) -> anyhow::Result<String> {
    let options = serde_saphyr::ser_options! {
        // Else `y` would be quoted, which YAML 1.1 takes for a boolean.
        yaml_12: true,
        no_lang_directive: true,
        prefer_block_scalars: false,
    };
    let yaml = serde_saphyr::to_string_with_options(&Short(message), options);
    Ok(format!("{}---", yaml.context("cannot print")?))
}

struct Short<'a>(&'a DynamicMessage);

impl Serialize for Short<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut fields = serializer.serialize_map(None)?;
        for (name, value) in self.0.fields() {
            match value {
                DynamicValue::Message(message) => fields.serialize_entry(name, &Short(message))?,
                DynamicValue::Messages(messages) => {
                    let shown: Vec<_> = messages.iter().take(SHOWN).map(Short).collect();
                    fields.serialize_entry(name, &Cut { shown, more: messages.len() > SHOWN })?;
                }
                DynamicValue::Texts(texts) => {
                    let shown: Vec<_> = texts.iter().take(SHOWN).collect();
                    fields.serialize_entry(name, &Cut { shown, more: texts.len() > SHOWN })?;
                }
                DynamicValue::Primitives(values) if values.len() > SHOWN => {
                    let shown = serde_json::to_value(values.prefix(SHOWN));
                    let shown = shown.ok().and_then(|shown| shown.as_array().cloned());
                    let shown = shown.unwrap_or_default();
                    fields.serialize_entry(name, &Cut { shown, more: true })?;
                }
                other => fields.serialize_entry(name, other)?,
            }
        }
        fields.end()
    }
}

/// The first elements of a sequence, and dots where there are more.
struct Cut<T> {
    shown: Vec<T>,
    more: bool,
}

impl<T: Serialize> Serialize for Cut<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeSeq as _;
        let mut items = serializer.serialize_seq(None)?;
        for item in &self.shown {
            items.serialize_element(item)?;
        }
        if self.more {
            items.serialize_element("...")?;
        }
        items.end()
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use wrapyfi_interfaces::parser::{Dialect, TypeName};
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    fn message(definition: &str, value: &serde_json::Value) -> DynamicMessage {
        let name = TypeName::parse(Dialect::Ros2, "demo_msgs/msg/Demo").unwrap();
        let mut store = TypeStore::empty();
        store.add_definition(&name, definition).unwrap();
        let plan = store.resolve(&name).unwrap().plan().unwrap();
        plan.from_json(value, 1 << 20).unwrap()
    }

    #[test]
    fn fields_stand_as_ros_shows_them() {
        let value = json!({"y": 1.5, "on": true, "text": "no: \"quotes\"", "list": [1, 2]});
        let shown =
            text(&message("float64 y\nbool on\nstring text\nint32[] list\n", &value)).unwrap();
        assert_eq!(shown, "y: 1.5\non: true\ntext: \"no: \\\"quotes\\\"\"\nlist:\n- 1\n- 2\n---");
    }

    #[test]
    fn long_arrays_are_cut() {
        let value = json!({"data": vec![7; 500], "names": vec!["a"; 130]});
        let shown = text(&message("uint8[] data\nstring[] names\n", &value)).unwrap();
        assert_eq!(shown.lines().filter(|line| *line == "- 7").count(), SHOWN);
        assert_eq!(shown.lines().filter(|line| *line == "- a").count(), SHOWN);
        assert_eq!(shown.matches("...").count(), 2, "{shown}");
    }
}
