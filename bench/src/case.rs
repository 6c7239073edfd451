//! Cases of the benchmark: the ways, and the payloads on each.

use clap::ValueEnum;
use wrapyfi_interfaces::named;

use crate::payload::Kind::{
    self, Audio, F32Mib, FileMib, FullHdRgb, Small, U8Rgb200, VgaJpeg, VgaRgb,
};
use crate::payload::name;
use crate::python::Library;
use crate::worker::Order;

named! {
    /// The way of a message; those that are compared stand next to each other.
    #[derive(PartialOrd, Ord, ValueEnum)]
    pub(crate) enum Way {
        /// PUB, our broker, SUB; encoded beforehand.
        RawZmq => "raw ZeroMQ hop (PUB, broker, SUB)",
        /// Our publisher, our broker, SUB.
        OurPublisher => "our publisher, broker, SUB",
        /// CDR writer, CDR reader; encoded beforehand.
        RawDds => "raw CycloneDDS hop (CDR)",
        /// Raw PUB, our broker, bridge, CDR reader.
        ZmqToRos => "bridge ZeroMQ to ROS 2",
        /// CDR writer, bridge, our broker, raw SUB.
        RosToZmq => "bridge ROS 2 to ZeroMQ",
        /// Python Wrapyfi: publisher, its broker, listener.
        PythonHop => "Python Wrapyfi, one hop with coding",
        /// The same script on the package `wrapyfi_rs`.
        PackageHop => "wrapyfi_rs, one hop with coding",
        /// Our publisher, our broker, our listener; coding included.
        RustHop => "our library, one hop with coding",
        /// Python Wrapyfi: publisher, its broker, forwarding script, its broker, listener.
        PythonForward => "Python Wrapyfi, forwarded, with coding",
        /// Our publisher, our broker, bridge, our broker, our listener; coded at every station.
        RustForward => "our bridge, ZeroMQ to ZeroMQ, with coding",
    }
    /// Title of the way, for people.
    pub fn title;
}

impl Way {
    /// The library of Python that the way is through.
    pub(crate) fn library(self) -> Option<Library> {
        match self {
            Self::PythonHop | Self::PythonForward => Some(Library::Wrapyfi),
            Self::PackageHop => Some(Library::Package),
            _ => None,
        }
    }

    /// True where the program `wrapyfi` has a bridge in it.
    pub(crate) fn is_bridged(self) -> bool {
        matches!(self, Self::ZmqToRos | Self::RosToZmq | Self::RustForward)
    }

    /// Area to which its figures belong.
    pub(crate) fn area(self) -> &'static str {
        match self {
            Self::RawDds | Self::ZmqToRos | Self::RosToZmq => "ros2",
            Self::PackageHop => "package",
            _ => "zeromq",
        }
    }

    /// Payloads that the way is measured with.
    fn payloads(self) -> &'static [Kind] {
        match self {
            Self::RawZmq => &[Small, Audio, VgaJpeg, VgaRgb, FileMib, FullHdRgb],
            Self::OurPublisher => &[Small, FileMib],
            Self::RawDds | Self::ZmqToRos | Self::RosToZmq => {
                &[Small, Audio, VgaJpeg, VgaRgb, FullHdRgb]
            }
            _ => &[Small, Audio, U8Rgb200, VgaJpeg, F32Mib, VgaRgb, FullHdRgb],
        }
    }

    /// True where a message is coded at the ends, as a program of a user does.
    fn is_coded(self) -> bool {
        self.library().is_some() || matches!(self, Self::RustHop | Self::RustForward)
    }
}

/// One payload on one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Case {
    pub(crate) payload: Kind,
    pub(crate) way: Way,
    /// True where broker and bridge are of the other program, `--against`.
    pub(crate) is_other: bool,
}

impl Case {
    /// Every case, those that are compared next to each other; where there is another program, once more on that.
    pub(crate) fn all(with_other: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for &payload in Kind::value_variants() {
            let ways = Way::value_variants().iter().copied();
            for way in ways.filter(|way| way.payloads().contains(&payload)) {
                all.push(Self { payload, way, is_other: false });
                if with_other && (way.is_bridged() || way == Way::RawZmq) {
                    all.push(Self { payload, way, is_other: true });
                }
            }
        }
        all
    }

    /// `way/payload`, as `--only` has it.
    pub(crate) fn name(self) -> String {
        let other = if self.is_other { "@other" } else { "" };
        format!("{}/{}{other}", name(&self.way), name(&self.payload))
    }

    /// Messages at a fixed rate, low enough that Python keeps up where both are measured.
    pub(crate) fn paced(self) -> Order {
        let (count, hz) = match (self.payload, self.way.is_coded()) {
            (FullHdRgb, true) => (12, 8.0),
            (FullHdRgb, false) => (30, 30.0),
            (VgaRgb | VgaJpeg | F32Mib, true) => (24, 20.0),
            _ => (30, 50.0),
        };
        Order::Paced { count, hz }
    }

    /// Messages as fast as a few unacknowledged ones allow. Fewer than any queue on the way holds,
    /// so that nothing is dropped.
    pub(crate) fn window(self) -> Order {
        if self.payload == Small && !self.way.is_coded() {
            return Order::Window { count: 60_000, inflight: 64 };
        }
        let count = match (self.payload, self.way.library().is_some()) {
            (FileMib, _) => 300,
            (Small | Audio, _) => 400,
            (VgaJpeg, _) if self.way.is_coded() => 30,
            (U8Rgb200 | VgaJpeg, false) => 200,
            (U8Rgb200, true) | (F32Mib | VgaRgb, false) => 80,
            (F32Mib | VgaRgb, true) => 30,
            (FullHdRgb, false) => 24,
            _ => 8,
        };
        Order::Window { count, inflight: 4 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_have_names_of_their_own_and_the_other_program_its_share_of_them() {
        let (alone, both) = (Case::all(false), Case::all(true));
        let names: std::collections::BTreeSet<String> = both.iter().map(|it| it.name()).collect();
        assert_eq!(names.len(), both.len());
        assert!(
            names.contains("zmq-to-ros/vga-rgb@other") && names.contains("our-publisher/small")
        );
        let others = both.iter().filter(|it| it.is_other).count();
        assert_eq!((both.len() - alone.len(), others), (23, 23));
    }
}
