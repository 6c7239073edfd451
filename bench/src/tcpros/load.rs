//! Messages that go from ROS 1 to ROS 2, and the place of their number in either form.

use anyhow::{Context as _, Result};

use crate::payload::BASE;
use crate::ros1;

/// A message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, clap::ValueEnum)]
#[value(rename_all = "kebab-case")]
pub(crate) enum Load {
    /// An image of 1920 x 1080, three bytes a pixel: 6.2 MB.
    Image,
    /// 10 transforms.
    Tf,
    /// A text; 200 bytes with its size.
    Text,
}

impl Load {
    /// Name on the command line and in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Tf => "tf",
            Self::Text => "text",
        }
    }

    /// Title of the load, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::Image => "1920x1080 RGB (6.2 MB)",
            Self::Tf => "10 transforms",
            Self::Text => "text of 200 bytes",
        }
    }

    /// Type in ROS 1.
    pub(crate) fn ros1_type(self) -> &'static str {
        match self {
            Self::Image => "sensor_msgs/Image",
            Self::Tf => "tf2_msgs/TFMessage",
            Self::Text => "std_msgs/String",
        }
    }

    /// Type in ROS 2.
    pub(crate) fn ros2_type(self) -> &'static str {
        match self {
            Self::Image => "sensor_msgs/msg/Image",
            Self::Tf => "tf2_msgs/msg/TFMessage",
            Self::Text => "std_msgs/msg/String",
        }
    }

    /// Type that a route for the load is configured with: a string by its type is a native object.
    pub(crate) fn route_type(self) -> &'static str {
        if self == Self::Text { "Text" } else { self.ros2_type() }
    }

    /// Message 0 in ROS 1.
    fn bytes(self) -> Vec<u8> {
        match self {
            Self::Image => ros1::image(1920, 1080),
            Self::Tf => ros1::transforms(10),
            Self::Text => {
                [&196_u32.to_le_bytes()[..], BASE.to_string().as_bytes(), &[b'x'; 186]].concat()
            }
        }
    }

    /// Offset of the number in ROS 1: seconds of a stamp, or ten digits. A stamp of the first
    /// message inside has the length of the list before it, and each header its own number.
    fn at(self) -> usize {
        match self {
            Self::Image | Self::Text => 4,
            Self::Tf => 8,
        }
    }

    /// The same in CDR with its encapsulation, which has no number in headers.
    fn at_in_cdr(self) -> usize {
        match self {
            Self::Image => 4,
            Self::Tf | Self::Text => 8,
        }
    }

    /// Number of a message of ROS 1.
    pub(crate) fn number(self, message: &[u8]) -> Result<u32> {
        self.read(message.get(self.at()..))
    }

    /// Number of a message in CDR.
    pub(crate) fn number_in_cdr(self, message: &[u8]) -> Result<u32> {
        self.read(message.get(self.at_in_cdr()..))
    }

    fn read(self, from: Option<&[u8]>) -> Result<u32> {
        let from = from.context("a message that ends before its number")?;
        let number = if self == Self::Text {
            str::from_utf8(from.get(..10).context("a text without a number")?)?.parse()?
        } else {
            u32::from_le_bytes(from.get(..4).context("a stamp that is cut")?.try_into()?)
        };
        number.checked_sub(BASE).with_context(|| format!("{number} is no number of a message"))
    }
}

/// A message with its size before it, as TCPROS has it.
pub(crate) struct Framed {
    load: Load,
    pub(crate) bytes: Vec<u8>,
}

impl Framed {
    /// Message 0.
    pub(crate) fn new(load: Load) -> Result<Self> {
        let message = load.bytes();
        let size = u32::try_from(message.len())?;
        let mut framed = Self { load, bytes: [&size.to_le_bytes()[..], &message].concat() };
        framed.number(0);
        Ok(framed)
    }

    /// Gives it a number.
    pub(crate) fn number(&mut self, seq: u32) {
        let number = BASE + seq;
        let digits = number.to_string();
        let stamp = number.to_le_bytes();
        let bytes: &[u8] = if self.load == Load::Text { digits.as_bytes() } else { &stamp };
        let at = 4 + self.load.at();
        if let Some(place) = self.bytes.get_mut(at..at + bytes.len()) {
            place.copy_from_slice(bytes);
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum as _;
    use wrapyfi_interfaces::ros1::{Options, Rules, Types};
    use wrapyfi_interfaces::store::TypeStore;

    use super::*;

    #[test]
    fn numbers_stand_in_both_forms() {
        let mut types = Types::new(Rules::built_in(), TypeStore::empty());
        for &load in Load::value_variants() {
            let mut framed = Framed::new(load).unwrap();
            framed.number(123_456);
            let message = &framed.bytes[4..];
            assert_eq!(load.number(message).unwrap(), 123_456, "{load:?}");
            let definition = types.definition(load.ros1_type()).unwrap();
            let plan = types.plan(&definition).unwrap();
            let mut cdr = vec![0, 1, 0, 0];
            plan.to_cdr(message, &Options::default(), &mut cdr).unwrap();
            // Some plans write the encapsulation themselves.
            let cdr = if load.number_in_cdr(&cdr).is_ok() { cdr } else { cdr[4..].to_vec() };
            assert_eq!(load.number_in_cdr(&cdr).unwrap(), 123_456, "{load:?}");
        }
    }

    #[test]
    fn sizes_are_those_that_are_promised() {
        assert_eq!(Framed::new(Load::Text).unwrap().bytes.len(), 4 + 200);
        assert!(Framed::new(Load::Image).unwrap().bytes.len() > 6_000_000);
    }
}
