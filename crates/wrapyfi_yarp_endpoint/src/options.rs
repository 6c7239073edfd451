//! Options of routes, topics and services that only YARP has.
//!
//! ```text
//!   options: { carrier: fast_tcp, joints: [neck, eye] }  ─▶ Map ─▶ YarpOptions
//! ```
//!
//! Options that are not listed here belong to the other end of a route and are left alone.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::str::FromStr;
use std::sync::Arc;

use wrapyfi_yarp::Dialect;
use wrapyfi_yarp::wire::Carrier;

use super::intrinsics::Intrinsics;
use super::joint_limits::{JointLimits, Range};
use wrapyfi_data::types::{Map, Value};
use wrapyfi_endpoint::{OpenError, Peers, ServiceSpec, TopicSpec};
use wrapyfi_yarp::port::Admission;

/// Names of the options that are read here: what a configuration may write.
pub const OPTIONS: &[&str] = &[
    "base",
    "board",
    "bottle",
    "carrier",
    "child_frame_id",
    "command",
    "control",
    "degrees",
    "dialect",
    "frame_id",
    Peers::FROM,
    "joints",
    "limits",
    "out_topic_connect",
    "packed_rows",
    "persistent",
    "port",
    "prismatic",
    "sensor",
    Peers::TO,
    "wrapyfi_images",
];

/// Options that are about what ports send to us.
pub const SOURCE_OPTIONS: &[&str] = &["child_frame_id", "frame_id", "sensor"];
/// Options that are about what we send to ports.
pub const DESTINATION_OPTIONS: &[&str] = &["base", "control", "out_topic_connect"];

/// BottleFormat of native objects in bottles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BottleFormat {
    /// One string of JSON, as Wrapyfi writes it. Other bottles are read, too.
    #[default]
    Json,
    /// One string that is itself, other bottles as lists: what programs other than Wrapyfi's send. Written as
    /// [`BottleFormat::Json`].
    Plain,
    /// The values themselves: lists, numbers, words.
    Bottle,
    /// Pairs of key and value, as YARP's `Property` writes itself: dicts.
    Property,
}

/// Meaning of the numbers that are sent to a control board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumString)]
#[strum(serialize_all = "snake_case")]
pub enum Control {
    /// Targets that joints go to on the board's own trajectory: `[poss]`.
    Position,
    /// Positions that joints take at once: `[dpos]`.
    PositionDirect,
    /// Velocities of joints: `[vmos]`.
    Velocity,
    /// Torques or forces: `[dtqs]`.
    Torque,
}

/// BottleFormat in which a mobile base takes velocities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, strum::EnumString)]
#[strum(serialize_all = "snake_case")]
pub enum BaseCommand {
    /// Three numbers, along x and y and about z: `MobileBaseVelocity`.
    Velocity,
    /// Command as the ports of baseControl read it: `3 x y θ 100.0`.
    Control,
}

/// Kind of motion of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Rotation about an axis: degrees or radians.
    Revolute,
    /// Sliding along an axis: metres.
    Prismatic,
}

/// Settings of one YARP topic or service. Each has a default.
///
/// ```
/// use wrapyfi_data::types::{Map, MessageType, Value};
/// use wrapyfi_endpoint::TopicSpec;
/// use wrapyfi_yarp_endpoint::options::{Control, YarpOptions};
/// let options = Map::from([("carrier", Value::from("udp")), ("control", "velocity".into())]);
/// let spec = TopicSpec { options, ..TopicSpec::new("/arm/command:i", MessageType::NativeObject) };
/// let options = YarpOptions::of_topic(&spec)?;
/// assert_eq!((options.carrier.as_deref(), options.control), (Some("udp"), Some(Control::Velocity)));
/// # Ok::<(), wrapyfi_endpoint::OpenError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct YarpOptions {
    /// `carrier`: of connections that we ask for; Wrapyfi's default is `tcp`. Qualifiers may follow
    /// (`tcp+recv.priority`).
    pub carrier: Option<String>,
    /// `persistent`: whether the name server keeps the connection (true, as Wrapyfi); otherwise we
    /// connect and connect again ourselves.
    pub persistent: bool,
    /// `out_topic_connect`: where a publisher connects itself to; nowhere unless given.
    pub out_topic_connect: Option<String>,
    /// `port`: the name of our own port, so that `yarp connect` finds it; made up unless given.
    pub port: Option<String>,
    /// `joints`: names of the joints of a `state:o` or a `command:i`, in its order; what the control
    /// board tells unless given.
    pub joints: Vec<String>,
    /// Kinds of the joints, as the control board tells them; no option. Empty where it has not told.
    pub axes: Vec<Axis>,
    /// Ranges of the joints, as the control board tells them; no option.
    pub limits: Arc<JointLimits>,
    /// `control`: what the numbers for a control board are: `position`, `position_direct`, `velocity` or
    /// `torque`. Unless given, what a message has: positions, else velocities, else efforts.
    pub control: Option<Control>,
    /// Calibration that the camera has told; no option.
    pub intrinsics: Option<Intrinsics>,
    /// `board`: whether the name is that of a control board whose ports are ours, for a robot of ROS 2 (false).
    pub board: bool,
    /// `prismatic`: names of the joints of our board that slide; the others turn.
    pub prismatic: Vec<String>,
    /// `limits`: least and greatest position of joints of our board, in YARP's units.
    pub ranges: BTreeMap<String, Range>,
    /// `base`: how the mobile base takes velocities, `velocity` or `control`. Unless given, a `Twist` is pairs of
    /// field and value, as any message.
    pub base: Option<BaseCommand>,
    /// `sensor`: which sensor of each list of `measures:o` is meant, counted from 0 (0).
    pub sensor: usize,
    /// `degrees`: whether angles are in degrees on YARP's side (true); they are radians in ROS.
    pub degrees: bool,
    /// `dialect`: how our port writes bottles, and how the peer's replies are read: `v3` or `v4`; that
    /// of the configuration unless given. Messages of either are read.
    pub dialect: Option<Dialect>,
    /// `packed_rows`: whether rows of images lie as Wrapyfi has them, without the padding that
    /// their header announces (false).
    pub packed_rows: bool,
    /// `wrapyfi_images`: whether the peer is Python Wrapyfi, whose images have packed rows and call
    /// every order of colours `rgb` (false).
    pub wrapyfi_images: bool,
    /// `bottle`: `true`, `false` (JSON) or `property`; unset or `auto`, native objects are JSON where Wrapyfi sends
    /// them, and the services of ROS plain bottles.
    pub bottle: Option<BottleFormat>,
    /// `bottle: auto`: bottles, unless a function of Wrapyfi is behind the port that is called; what is
    /// answered has the format of what was asked.
    pub finds_format: bool,
    /// `command`: the words that begin every request, as text (`[set] [pos]`).
    pub command: Option<String>,
    /// `frame_id`: coordinate frame of what is received: YARP names none.
    pub frame_id: String,
    /// `child_frame_id`: coordinate frame of the base that an odometry is of.
    pub child_frame_id: String,
    /// `from_peers`: names and addresses of the programs whose messages a listener takes; all unless given.
    pub from_peers: Option<Peers>,
    /// `to_peers`: names and addresses of the ports that a publisher sends to; all unless given.
    pub to_peers: Option<Peers>,
}

impl Default for YarpOptions {
    fn default() -> Self {
        Self {
            carrier: None,
            persistent: true,
            out_topic_connect: None,
            port: None,
            joints: Vec::new(),
            axes: Vec::new(),
            limits: Arc::default(),
            control: None,
            intrinsics: None,
            board: false,
            prismatic: Vec::new(),
            ranges: BTreeMap::new(),
            base: None,
            sensor: 0,
            degrees: true,
            dialect: None,
            packed_rows: false,
            wrapyfi_images: false,
            bottle: None,
            finds_format: false,
            command: None,
            frame_id: String::new(),
            child_frame_id: String::new(),
            from_peers: None,
            to_peers: None,
        }
    }
}

impl YarpOptions {
    /// The options of a topic.
    ///
    /// # Errors
    /// [`OpenError::InvalidOption`] for the first one whose value cannot be used.
    pub fn of_topic(spec: &TopicSpec) -> Result<Self, OpenError> {
        Self::read(&spec.options, &spec.topic)
    }

    /// The options of a service.
    ///
    /// # Errors
    /// As [`YarpOptions::of_topic`].
    pub fn of_service(spec: &ServiceSpec) -> Result<Self, OpenError> {
        Peers::none(&spec.options, "yarp", &spec.service)?;
        Self::read(&spec.options, &spec.service)
    }

    /// Test of a port of ours for the programs of a list.
    pub(super) fn admission(peers: Option<&Peers>) -> Option<Admission> {
        let peers = peers?.clone();
        Some(Admission::new(move |name, address| peers.admits(name, address)))
    }

    /// These options with the format that was found, where they leave it to be.
    pub(super) fn with_found(&self, format: BottleFormat) -> Cow<'_, Self> {
        if !self.finds_format || self.bottle.is_some() {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { bottle: Some(format), ..self.clone() })
    }

    /// Angles of YARP as ROS has them.
    pub(super) fn radians<const N: usize>(&self, angles: [f64; N]) -> [f64; N] {
        if self.degrees { angles.map(f64::to_radians) } else { angles }
    }

    /// Angles of ROS as YARP has them.
    pub(super) fn degrees<const N: usize>(&self, angles: [f64; N]) -> [f64; N] {
        if self.degrees { angles.map(f64::to_degrees) } else { angles }
    }

    /// True when YARP has degrees where ROS has radians for this joint.
    pub(super) fn has_degrees(&self, joint: usize) -> bool {
        self.degrees && self.axes.get(joint) != Some(&Axis::Prismatic)
    }

    /// True when pictures go out as files, by the carrier `mjpeg`.
    pub(super) fn sends_files(&self) -> bool {
        brings_files(self.carrier())
    }

    /// The carrier, where nothing is known of the other end.
    pub(super) fn carrier(&self) -> &str {
        self.carrier.as_deref().unwrap_or("tcp")
    }

    /// The same, of messages that go out as files of carrier `mjpeg`, or do not.
    pub(super) fn sending_files(&self, files: bool) -> Self {
        let carrier = if files { "mjpeg" } else { "tcp" };
        Self { carrier: Some(carrier.to_owned()), ..self.clone() }
    }

    /// Reads `options` of the topic or service `name`.
    fn read(options: &Map, name: &str) -> Result<Self, OpenError> {
        let mut read = Self::default();
        for (key, value) in options.iter() {
            let Some(key) = key.as_str() else { continue };
            read.set(key, value).map_err(|wanted| OpenError::InvalidOption {
                middleware: "yarp",
                topic: name.to_owned(),
                option: key.to_owned(),
                found: as_text(value),
                wanted: wanted.to_owned(),
            })?;
        }
        Ok(read)
    }

    /// Takes one option; what it must be, where it is not.
    fn set(&mut self, key: &str, value: &Value) -> Result<(), &'static str> {
        const SWITCH: &str = "true or false";
        const PORT: &str = "the name of a port, which begins with / and has no blanks";
        match key {
            "base" => self.base = Some(meant(value).ok_or("velocity or control")?),
            "board" => self.board = value.as_bool().ok_or(SWITCH)?,
            "bottle" if value.as_str() == Some("auto") => self.finds_format = true,
            "bottle" => self.bottle = Some(format(value).ok_or("true, false, property or auto")?),
            "carrier" => {
                let carrier = value.as_str().filter(|text| is_carrier(text));
                let wanted = "tcp, fast_tcp, udp, mcast, text, text_ack, mjpeg or unix_stream";
                self.carrier = Some(carrier.ok_or(wanted)?.to_owned());
            }
            "child_frame_id" => {
                value.as_str().ok_or("a text")?.clone_into(&mut self.child_frame_id);
            }
            Peers::FROM => self.from_peers = Some(Peers::read(value)?),
            Peers::TO => self.to_peers = Some(Peers::read(value)?),
            "command" => {
                let text = value.as_str().filter(|text| !text.trim().is_empty());
                self.command = Some(text.ok_or("words as text, such as \"[set] [pos]\"")?.into());
            }
            "control" => {
                let wanted = "position, position_direct, velocity or torque";
                self.control = Some(meant(value).ok_or(wanted)?);
            }
            "degrees" => self.degrees = value.as_bool().ok_or(SWITCH)?,
            "dialect" => self.dialect = Some(meant(value).ok_or("v3 (YARP 3) or v4 (YARP 4)")?),
            "frame_id" => value.as_str().ok_or("a text")?.clone_into(&mut self.frame_id),
            "joints" => self.joints = names(value).ok_or("a list of different names")?,
            "limits" => {
                let wanted =
                    "the least and greatest position by joint, such as { elbow: [0, 120] }";
                self.ranges = ranges(value).ok_or(wanted)?;
            }
            "out_topic_connect" => self.out_topic_connect = Some(port(value).ok_or(PORT)?),
            "packed_rows" => self.packed_rows = value.as_bool().ok_or(SWITCH)?,
            "persistent" => self.persistent = value.as_bool().ok_or(SWITCH)?,
            "port" => self.port = Some(port(value).ok_or(PORT)?),
            "prismatic" => self.prismatic = names(value).ok_or("a list of different names")?,
            "sensor" => {
                let number = value.as_i64().and_then(|number| usize::try_from(number).ok());
                self.sensor = number.ok_or("the number of a sensor, counted from 0")?;
            }
            "wrapyfi_images" => self.wrapyfi_images = value.as_bool().ok_or(SWITCH)?,
            _ => {}
        }
        Ok(())
    }
}

/// Checks the value of an option.
///
/// # Errors
/// The values that the option must have, where it has another.
pub fn check_option(option: &str, value: &Value) -> Result<(), String> {
    let wanted = |wanted| format!("option {option} is {}, it must be {wanted}", as_text(value));
    YarpOptions::default().set(option, value).map_err(wanted)
}

/// True when a carrier, with its qualifiers, brings pictures as files.
pub(super) fn brings_files(carrier: &str) -> bool {
    carrier.split('+').next() == Some("mjpeg")
}

fn format(value: &Value) -> Option<BottleFormat> {
    match value {
        Value::Bool(true) => Some(BottleFormat::Bottle),
        Value::Bool(false) => Some(BottleFormat::Json),
        Value::Str(text) if text == "property" => Some(BottleFormat::Property),
        _ => None,
    }
}

/// Meaning of a word.
fn meant<T: FromStr>(word: &Value) -> Option<T> {
    word.as_str()?.parse().ok()
}

fn is_carrier(text: &str) -> bool {
    // Qualifiers stand behind it, as in `tcp+recv.…`.
    let bare = text.split('+').next().unwrap_or(text);
    bare.parse::<Carrier>().is_ok() && !text.chars().any(char::is_whitespace)
}

fn port(value: &Value) -> Option<String> {
    let name = value.as_str()?;
    let valid = name.starts_with('/') && name.len() > 1 && !name.chars().any(char::is_whitespace);
    valid.then(|| name.to_owned())
}

fn ranges(value: &Value) -> Option<BTreeMap<String, Range>> {
    let Value::Map(joints) = value else { return None };
    let number = |value: &Value| value.as_f64().or_else(|| Some(value.as_i64()? as f64));
    let range = |(joint, range): (&Value, &Value)| {
        let [least, most] = range.as_items()? else { return None };
        let range = (number(least)?, number(most)?);
        (range.0 < range.1).then_some((joint.as_str()?.to_owned(), range))
    };
    joints.iter().map(range).collect()
}

fn names(value: &Value) -> Option<Vec<String>> {
    let mut names: Vec<String> = Vec::new();
    for name in value.as_items()? {
        let name = name.as_str().filter(|name| !name.is_empty())?;
        if names.iter().any(|known| known == name) {
            return None;
        }
        names.push(name.to_owned());
    }
    Some(names)
}

/// A value as it was written, short.
fn as_text(value: &Value) -> String {
    match value {
        Value::Bool(value) => value.to_string(),
        Value::Int(value) => value.to_string(),
        Value::Float(value) => value.to_string(),
        Value::Str(text) => format!("{:?}", text.chars().take(80).collect::<String>()),
        Value::List(items) if items.len() <= 16 => {
            format!("[{}]", items.iter().map(as_text).collect::<Vec<_>>().join(", "))
        }
        Value::List(items) => format!("a list of {}", items.len()),
        other => format!("a {}", other.kind()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wrapyfi_data::types::{MessageType, ServiceKind};

    fn read(options: Map) -> Result<YarpOptions, OpenError> {
        let spec = TopicSpec { options, ..TopicSpec::new("/t", MessageType::NativeObject) };
        YarpOptions::of_topic(&spec)
    }

    #[test]
    fn every_option_is_read() {
        assert_eq!(read(Map::new()).unwrap(), YarpOptions::default());
        let joints: Value = ["neck", "eye"].into_iter().collect();
        let options = Map::from([
            ("carrier", Value::from("fast_tcp+recv.priority")),
            ("persistent", false.into()),
            ("out_topic_connect", "/viewer".into()),
            ("port", "/bridge/head".into()),
            ("joints", joints),
            ("board", true.into()),
            ("prismatic", Value::List(vec!["eye".into()])),
            ("limits", Map::from([("neck", Value::List(vec![(-30).into(), 22.5.into()]))]).into()),
            ("degrees", false.into()),
            ("dialect", "v4".into()),
            ("packed_rows", true.into()),
            ("wrapyfi_images", true.into()),
            ("bottle", "property".into()),
            ("command", "[set] [pos]".into()),
            ("control", "position_direct".into()),
            ("sensor", 2.into()),
            ("frame_id", "head".into()),
            ("base", "control".into()),
            ("child_frame_id", "base".into()),
            (Peers::FROM, Value::List(vec!["/cam".into()])),
            (Peers::TO, Value::List(vec!["10.0.0.*".into()])),
        ]);
        assert_eq!(options.len(), OPTIONS.len());
        assert!(OPTIONS.iter().all(|name| options.get(name).is_some()));
        let wanted = YarpOptions {
            carrier: Some("fast_tcp+recv.priority".into()),
            persistent: false,
            out_topic_connect: Some("/viewer".into()),
            port: Some("/bridge/head".into()),
            joints: vec!["neck".into(), "eye".into()],
            axes: Vec::new(),
            limits: Arc::default(),
            control: Some(Control::PositionDirect),
            intrinsics: None,
            board: true,
            prismatic: vec!["eye".into()],
            ranges: BTreeMap::from([("neck".to_owned(), (-30.0, 22.5))]),
            base: Some(BaseCommand::Control),
            sensor: 2,
            degrees: false,
            dialect: Some(Dialect::V4),
            packed_rows: true,
            wrapyfi_images: true,
            bottle: Some(BottleFormat::Property),
            finds_format: false,
            command: Some("[set] [pos]".into()),
            frame_id: "head".into(),
            child_frame_id: "base".into(),
            from_peers: Some(Peers::read(&Value::List(vec!["/cam".into()])).unwrap()),
            to_peers: Some(Peers::read(&Value::List(vec!["10.0.0.*".into()])).unwrap()),
        };
        assert_eq!(read(options.clone()).unwrap(), wanted);
        let spec = ServiceSpec { options, ..ServiceSpec::new("/s", ServiceKind::NativeObject) };
        let refused = YarpOptions::of_service(&spec).unwrap_err().to_string();
        assert!(refused.contains(Peers::FROM), "{refused}");
    }

    #[test]
    fn values_that_cannot_be_used_are_told_what_may_be_written() {
        let repeated: Value = ["neck", "neck"].into_iter().collect();
        for (option, value, wanted) in [
            ("carrier", Value::from("tpc"), "option carrier of \"/t\" is \"tpc\", it must be tcp,"),
            ("carrier", "tcp /x".into(), "it must be tcp,"),
            ("persistent", 1.into(), "is 1, it must be true or false"),
            ("degrees", "yes".into(), "is \"yes\", it must be true or false"),
            ("dialect", 4.into(), "is 4, it must be v3 (YARP 3) or v4 (YARP 4)"),
            ("port", "bridge".into(), "must be the name of a port, which begins with /"),
            ("out_topic_connect", "/a b".into(), "must be the name of a port"),
            ("joints", repeated, "is [\"neck\", \"neck\"], it must be a list of different names"),
            ("joints", "neck".into(), "it must be a list"),
            ("bottle", 3.into(), "must be true, false, property or auto"),
            ("command", " ".into(), "must be words as text"),
            ("control", "speed".into(), "must be position, position_direct, velocity or torque"),
            ("base", "fast".into(), "must be velocity or control"),
            ("child_frame_id", 3.into(), "must be a text"),
            ("sensor", (-1).into(), "must be the number of a sensor"),
            ("frame_id", 3.into(), "must be a text"),
            ("board", "/arm".into(), "must be true or false"),
            ("limits", Map::from([("neck", 3)]).into(), "must be the least and greatest position"),
        ] {
            let error = read(Map::from([(option, value)])).unwrap_err().to_string();
            assert!(error.contains(wanted), "{error}");
        }
    }

    #[test]
    fn options_of_others_are_left_alone() {
        assert_eq!(read(Map::from([("depth", 5)])).unwrap(), YarpOptions::default());
    }
}
