//! Types as `--type` names them.

use wrapyfi_data::types::{MessageType, ServiceKind};

/// A type as `--type` names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TypeName {
    /// One that routes carry.
    Known(MessageType),
    /// Another ROS type, by its full name: `geometry_msgs/msg/Twist`.
    Ros(String),
}

impl std::str::FromStr for TypeName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = match text.parse() {
            Ok(known) => return Ok(Self::Known(known)),
            Err(error) => format!("{error}, or any ROS type"),
        };
        of_ros(text, "msg", &expected).map(Self::Ros)
    }
}

/// Type of a service as `--type` names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceName(pub String);

impl std::str::FromStr for ServiceName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<ServiceKind>() {
            Ok(kind) => Ok(Self(kind.ros_type().to_owned())),
            Err(error) => of_ros(text, "srv", &format!("{error}, or any ROS type")).map(Self),
        }
    }
}

/// The full name of a ROS type, `package/msg/Name` or `package/srv/Name`; what was `expected`, where it is none.
fn of_ros(text: &str, kind: &str, expected: &str) -> Result<String, String> {
    match text.split('/').collect::<Vec<_>>()[..] {
        [package, of, name] if of == kind && !package.is_empty() && !name.is_empty() => {
            Ok(text.to_owned())
        }
        [package, name] if !package.is_empty() && !name.is_empty() => {
            Err(format!("{expected}: did you mean {package}/{kind}/{name}?"))
        }
        _ => Err(format!("{expected} as package/{kind}/Name")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_known_or_ros() {
        assert_eq!("Image".parse(), Ok(TypeName::Known(MessageType::Image)));
        let twist = "geometry_msgs/msg/Twist";
        assert_eq!(twist.parse(), Ok(TypeName::Ros(twist.to_owned())));
        let error = "geometry_msgs/Twist".parse::<TypeName>().unwrap_err();
        assert!(error.contains("did you mean geometry_msgs/msg/Twist?"), "{error}");
        let error = "Twist".parse::<TypeName>().unwrap_err();
        assert!(error.contains("did you mean `geometry_msgs/msg/Twist`?"), "{error}");
        assert!("a/srv/B".parse::<TypeName>().is_err());
    }

    #[test]
    fn services_have_short_names_too() {
        let name = |text: &str| text.parse::<ServiceName>().map(|name| name.0);
        assert_eq!(name("NativeObject").unwrap(), "wrapyfi_msgs/srv/NativeObjectService");
        assert_eq!(name("std_srvs/srv/SetBool").unwrap(), "std_srvs/srv/SetBool");
        let error = name("std_srvs/SetBool").unwrap_err();
        assert!(error.contains("did you mean std_srvs/srv/SetBool?"), "{error}");
        let error = name("SetBool").unwrap_err();
        assert!(error.contains("did you mean `std_srvs/srv/SetBool`?"), "{error}");
        assert!(name("std_msgs/msg/String").is_err());
    }
}
