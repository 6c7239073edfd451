//! The types of what ports send, which YARP does not announce.
//!
//! ```text
//!   promised   the port says yarp/image (frameGrabber),    ─┐
//!              or is registered under carrier mjpeg         │
//!   by name    …/state:o, …/cam/…, …Image:o (conventions)   ├─▶ Discovered::type_name
//!   heard      its first message (first_message)           ─┘
//! ```

use wrapyfi_yarp::port::{PayloadKind, PortPayload as Bytewise};
use wrapyfi_yarp::sig::{ImageHeader, Sound, Vector};
use wrapyfi_yarp::{Bottle, Dialect, WireLimits};

use super::first_message::FirstMessages;
use super::payload;
use wrapyfi_endpoint::pattern::NamePattern;

/// Type that ports promise which are registered under carrier mjpeg.
pub(super) const FILES: &str = "image/jpeg";
/// Type of a vector of which nothing more is known.
const NUMBERS: &str = "std_msgs/msg/Float64MultiArray";
const SCAN: &str = "sensor_msgs/msg/LaserScan";

/// Ports whose names tell what they send.
///
/// ```
/// use wrapyfi_yarp_endpoint::Convention;
/// let usual = Convention::usual();
/// let joints = usual.iter().find(|one| one.names.matches("/icub/head/state:o")).unwrap();
/// assert_eq!(joints.message_type, "sensor_msgs/msg/JointState");
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Convention {
    /// Whole names of ports, without their first slash.
    pub names: NamePattern,
    /// Type of a topic, as routes name it.
    pub message_type: String,
}

impl Convention {
    /// Ports whose names match a regular expression send messages of a type.
    ///
    /// # Errors
    /// The fault of the expression.
    pub fn new(names: &str, message_type: &str) -> Result<Self, String> {
        Ok(Self { names: NamePattern::new(names)?, message_type: message_type.to_owned() })
    }

    /// Conventions of the iCub and of YARP's own devices.
    pub fn usual() -> Vec<Self> {
        let usual = [
            ("(.*/)?state(Ext)?:o", "sensor_msgs/msg/JointState"),
            ("(.*/)?inertial(:o)?", "sensor_msgs/msg/Imu"),
            ("(.*/)?FT:o", "geometry_msgs/msg/WrenchStamped"),
            ("(.*/)?tf:o", "tf2_msgs/msg/TFMessage"),
            ("(.*/)?\\w*[lL]aser\\w*:o", SCAN),
            ("(.*/)?odometry:o", "nav_msgs/msg/Odometry"),
            ("clock", payload::CLOCK),
            ("(.*/)?cams?/[^:]*(:o)?", "Image"),
            ("(.*/)?\\w*([iI]mage|[iI]mg):o", "Image"),
        ];
        usual.into_iter().filter_map(|(names, kind)| Self::new(names, kind).ok()).collect()
    }
}

/// Types of the ports of a network, from conventions of names and from first messages.
#[derive(Debug)]
pub(super) struct Types {
    conventions: Vec<Convention>,
    pub(super) heard: FirstMessages,
}

impl Types {
    pub(super) fn new(conventions: Vec<Convention>) -> Self {
        Self { conventions, heard: FirstMessages::default() }
    }

    /// The type of what a port sends, as routes name it. `number` is that of its entry, `promised` what
    /// its program has promised.
    pub(super) fn of(&self, port: &str, number: u64, promised: Option<&str>) -> Option<String> {
        let by_name = || {
            let found = self.conventions.iter().find(|one| one.names.matches(port));
            found.map(|one| one.message_type.clone())
        };
        match promised {
            Some("yarp/image") => Some("Image".to_owned()),
            Some("yarp/sound") => Some("AudioChunk".to_owned()),
            Some(FILES) => Some("CompressedImage".to_owned()),
            Some("yarp/vector") => by_name().or_else(|| Some(NUMBERS.to_owned())),
            _ => by_name().or_else(|| self.heard.type_of(port, number).map(str::to_owned)),
        }
    }
}

/// The type of a message, by its bytes; none where they do not decide: an empty list may be anything.
pub(super) fn of_message(message: &Bytewise, limits: &WireLimits) -> Option<&'static str> {
    let bytes = &message.bytes;
    if message.kind == PayloadKind::Raw {
        return Some("CompressedImage");
    }
    if ImageHeader::read(bytes, limits).is_ok() {
        return Some("Image");
    }
    let dialects = [Dialect::V3, Dialect::V4];
    if dialects.iter().any(|dialect| Sound::decode(bytes, *dialect, limits).is_ok()) {
        return Some("AudioChunk");
    }
    // The code and the count of a list, before its elements.
    let elements = bytes.len().checked_sub(8).filter(|&length| length > 0)?;
    let is_vector = dialects.iter().any(|dialect| {
        let read = Vector::<f64>::decode(bytes, *dialect, limits);
        read.is_ok_and(|numbers| numbers.0.len() * 8 == elements)
    });
    let is_scan = || {
        dialects.iter().any(|dialect| {
            let read = Bottle::decode_whole(bytes, *dialect, limits);
            read.is_ok_and(|bottle| payload::is_scan(&bottle))
        })
    };
    Some(match is_vector {
        true => NUMBERS,
        false if is_scan() => SCAN,
        false => "NativeObject",
    })
}

#[cfg(test)]
mod tests {
    use wrapyfi_yarp::sig::{Image, PixelCode, Rows};

    use super::*;

    fn type_of(bytes: Vec<u8>) -> Option<&'static str> {
        of_message(&Bytewise::object(bytes), &WireLimits::default())
    }

    #[test]
    fn messages_show_what_they_are() {
        let pixels = vec![7; 4 * 2 * 3];
        let rgb = PixelCode::Rgb;
        let image = Image::from_packed(rgb, 4, 2, pixels.into()).unwrap();
        assert_eq!(type_of(image.encode(Rows::Announced).unwrap()), Some("Image"));
        assert_eq!(
            of_message(&Bytewise::raw(vec![0xff, 0xd8]), &WireLimits::default()),
            Some("CompressedImage")
        );
        for dialect in [Dialect::V3, Dialect::V4] {
            let sound = Sound::from_interleaved(&[1, 2, 3, 4], 2, 44_100).unwrap();
            assert_eq!(type_of(sound.encode(dialect).unwrap()), Some("AudioChunk"), "{dialect:?}");
            let vector = Vector(vec![1.0, 2.0]).encode(dialect).unwrap();
            assert_eq!(type_of(vector), Some(NUMBERS), "{dialect:?}");
            let words = Bottle::from(vec!["x".into(), 1.5.into()]).encode(dialect).unwrap();
            assert_eq!(type_of(words), Some("NativeObject"), "{dialect:?}");
            let scan = |text: &str| {
                let bottle = Bottle::from_text(text.as_bytes(), &WireLimits::default()).unwrap();
                bottle.encode(dialect).unwrap()
            };
            assert_eq!(type_of(scan("0.0 360.0 0.1 8.0 (1.5 2.5) 0")), Some(SCAN), "{dialect:?}");
            for other in ["0.0 360.0 0.1 8.0 (1.5 x) 0", "0 360 0.1 8.0 (1.5) 0", "0.0 (1.5) 0"] {
                assert_eq!(type_of(scan(other)), Some("NativeObject"), "{other}");
            }
            let nothing = Bottle::new().encode(dialect).unwrap();
            assert_eq!(type_of(nothing), None, "{dialect:?}");
        }
        assert_eq!(type_of(Vec::new()), None);
    }

    #[test]
    fn names_go_before_messages_and_promises_before_names() {
        let types = Types::new(Convention::usual());
        for (port, promised, wanted) in [
            ("/icub/head/state:o", None, Some("sensor_msgs/msg/JointState")),
            ("/icub/head/stateExt:o", None, Some("sensor_msgs/msg/JointState")),
            ("/icub/head/state:o", Some("yarp/vector"), Some("sensor_msgs/msg/JointState")),
            ("/icub/cam/left", None, Some("Image")),
            ("/icubSim/cam/left/rgbImage:o", None, Some("Image")),
            ("/depthCamera/depthImage:o", None, Some("Image")),
            ("/viewer/img:o", None, Some("Image")),
            ("/grabber", Some("yarp/image"), Some("Image")),
            ("/grabber", Some("yarp/vector"), Some(NUMBERS)),
            ("/grabber", Some("yarp/bottle"), None),
            ("/icub/cam/left", Some(FILES), Some("CompressedImage")),
            ("/icub/inertial", None, Some("sensor_msgs/msg/Imu")),
            ("/icub/inertial/raw", None, None),
            ("/icub/left_arm/FT:o", None, Some("geometry_msgs/msg/WrenchStamped")),
            ("/server/tf:o", None, Some("tf2_msgs/msg/TFMessage")),
            ("/laser:o", None, Some(SCAN)),
            ("/cer/laserFront:o", None, Some(SCAN)),
            ("/baseControl/odometry:o", None, Some("nav_msgs/msg/Odometry")),
            ("/baseControl/odometer:o", None, None),
            ("/clock", None, Some("rosgraph_msgs/msg/Clock")),
            ("/wall/clock", None, None),
            ("/estate:o", None, None),
            ("/camera/info:o", None, None),
        ] {
            assert_eq!(types.of(port, 1, promised).as_deref(), wanted, "{port} {promised:?}");
        }
        let own = Types::new(vec![Convention::new("my/.*", "Text").unwrap()]);
        assert_eq!(own.of("/my/words", 1, None).as_deref(), Some("Text"));
        assert_eq!(own.of("/icub/cam/left", 1, None), None);
        assert!(Convention::new("(", "Text").is_err());
    }
}
