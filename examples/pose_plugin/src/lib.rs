//! Example: objects of your own behind a plug-in key of your own.
//!
//! ```text
//!   Python: Pose2D(1.0, 2.0, 0.5)  ◀── {"__wrapyfi__": ["Pose2D", 1.0, 2.0, 0.5]} ──▶  Rust: Pose2D
//!           python/plugins/pose2d.py                                                   this crate
//! ```
//!
//! Three things make a plug-in: a type, [`PluginObject`] to tie it to its key, and [`Plugin`] to
//! read and write the parts behind the key. [`Plugins::with`](wrapyfi_core::plugin::Plugins::with)
//! adds it where topics are opened or routes are made.

use wrapyfi_core::plugin::{Body, Part, Plugin, PluginError, Unpacking};
use wrapyfi_core::types::{ForeignObject, PluginObject, Value};

/// Name of the plug-in's class in Python, and so its key on the wire.
const KEY: &str = "Pose2D";

/// Position of a robot on the floor, and its heading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose2D {
    /// Metres to the front.
    pub x_m: f64,
    /// Metres to the left.
    pub y_m: f64,
    /// Heading in radians, counter-clockwise.
    pub heading_rad: f64,
}

impl Pose2D {
    /// The pose on the other side of the x axis.
    #[must_use]
    pub fn mirrored(self) -> Self {
        Self { y_m: -self.y_m, heading_rad: -self.heading_rad, ..self }
    }
}

impl PluginObject for Pose2D {
    fn key(&self) -> &str {
        KEY
    }
}

/// The plug-in of [`Pose2D`].
#[derive(Debug, Clone, Copy)]
pub struct PosePlugin;

impl Plugin for PosePlugin {
    fn key(&self) -> &str {
        KEY
    }

    fn decode(&self, body: &Body<'_>, _context: &Unpacking<'_>) -> Result<Value, PluginError> {
        // The arriving parts are a stranger's: each is checked, and a wrong one is named.
        let number = |part| {
            let value = body.value(part)?.as_f64();
            value.filter(|n| n.is_finite()).ok_or_else(|| body.expected(part, "a finite number"))
        };
        let pose = Pose2D { x_m: number(0)?, y_m: number(1)?, heading_rad: number(2)? };
        Ok(ForeignObject::new(pose).into())
    }

    fn encode(&self, value: &Value) -> Result<Vec<Part>, PluginError> {
        let pose: &Pose2D =
            value.as_object().ok_or_else(|| PluginError::not_mine("pose", value))?;
        Ok([pose.x_m, pose.y_m, pose.heading_rad].map(|n| Part::Value(n.into())).into())
    }
}

#[cfg(test)]
mod tests {
    use wrapyfi_core::Limits;
    use wrapyfi_core::codec::json;
    use wrapyfi_core::plugin::{Plugins, standard};

    use super::*;

    fn plugins() -> Plugins {
        standard().with(PosePlugin)
    }

    #[test]
    fn a_pose_returns_from_its_text() {
        let pose = Pose2D { x_m: 1.0, y_m: -2.0, heading_rad: 0.5 };
        let value = Value::List(vec![ForeignObject::new(pose).into()]);
        let text = json::encode(&value, &plugins()).unwrap();
        assert_eq!(text, br#"[{"__wrapyfi__": ["Pose2D", 1.0, -2.0, 0.5]}]"#);
        let again = json::decode(&text.into(), &Limits::default(), &plugins()).unwrap();
        assert_eq!(again, value);
        assert_eq!(again.as_items().unwrap()[0].as_object::<Pose2D>(), Some(&pose));
    }

    #[test]
    fn a_wrong_pose_travels_on_and_says_why() {
        let text = r#"{"at": {"__wrapyfi__": ["Pose2D", 1.0, "left", 0.5]}}"#;
        let value = json::decode(&text.into(), &Limits::default(), &plugins()).unwrap();
        let refusals: Vec<_> = value.refusals().map(|(_, reason)| reason.to_owned()).collect();
        assert_eq!(
            refusals,
            [
                "Pose2D at $.at: part 1 is malformed: something that is no text should be there, it is text"
            ]
        );
        assert_eq!(json::encode(&value, &plugins()).unwrap(), text.as_bytes());
    }

    #[test]
    fn without_the_plugin_the_object_is_carried_but_cannot_be_made() {
        let text = r#"{"__wrapyfi__": ["Pose2D", 1.0, 2.0, 0.5]}"#;
        let value = json::decode(&text.into(), &Limits::default(), &standard()).unwrap();
        assert_eq!(json::encode(&value, &standard()).unwrap(), text.as_bytes());
        let pose = Pose2D { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        let error =
            json::encode(&ForeignObject::new(pose).into(), &standard()).unwrap_err().to_string();
        assert!(error.contains("\"Pose2D\"") && error.contains("register that plug-in"), "{error}");
    }
}
