//! Objects that a plug-in of the user's own crate makes.

use std::any::Any;
use std::fmt;
use std::sync::Arc;

/// A value that a plug-in outside this crate decodes to, when none of the types here fits.
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{ForeignObject, PluginObject, Value};
///
/// #[derive(Debug, PartialEq)]
/// struct Pose { x: f64, y: f64 }
/// impl PluginObject for Pose {
///     fn key(&self) -> &str { "Pose2D" }
/// }
///
/// let value = Value::Object(ForeignObject::new(Pose { x: 1.0, y: 2.0 }));
/// assert_eq!(value.as_object::<Pose>(), Some(&Pose { x: 1.0, y: 2.0 }));
/// ```
pub trait PluginObject: Any + fmt::Debug + Send + Sync {
    /// Key of the plug-in that encodes the object.
    fn key(&self) -> &str;
}

/// A shared [`PluginObject`].
///
/// ```
/// # mod wrapyfi_core { pub use wrapyfi_data::types; }
/// use wrapyfi_core::types::{ForeignObject, PluginObject};
///
/// #[derive(Debug, PartialEq)]
/// struct Pose(f64, f64);
/// impl PluginObject for Pose {
///     fn key(&self) -> &str { "Pose2D" }
/// }
///
/// let object = ForeignObject::new(Pose(1.0, 2.0));
/// assert_eq!((object.key(), object.get::<Pose>()), ("Pose2D", Some(&Pose(1.0, 2.0))));
/// assert_eq!(object, object.clone());
/// ```
#[derive(Debug, Clone)]
pub struct ForeignObject {
    object: Arc<dyn PluginObject>,
    equal: fn(&dyn Any, &dyn Any) -> bool,
}

impl ForeignObject {
    /// Shares an object of the user's type.
    pub fn new<T: PluginObject + PartialEq>(object: T) -> Self {
        Self {
            object: Arc::new(object),
            equal: |a, b| match (a.downcast_ref::<T>(), b.downcast_ref::<T>()) {
                (Some(a), Some(b)) => a == b,
                _ => false,
            },
        }
    }

    /// Key of the plug-in that encodes the object.
    pub fn key(&self) -> &str {
        self.object.key()
    }

    /// The object, if it is a `T`.
    pub fn get<T: PluginObject>(&self) -> Option<&T> {
        (&*self.object as &dyn Any).downcast_ref()
    }
}

impl PartialEq for ForeignObject {
    fn eq(&self, other: &Self) -> bool {
        (self.equal)(&*self.object as &dyn Any, &*other.object as &dyn Any)
    }
}
