//! Cases of the benchmark: the ways, and the payloads on each.

use crate::payload::Kind::{self, Audio, F32Mib, FullHdRgb, Small, U8Rgb200, VgaJpeg, VgaRgb};
use crate::worker::Order;

/// The way of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Way {
    /// PUB, our broker, SUB; encoded beforehand.
    RawZmq,
    /// CDR writer, CDR reader; encoded beforehand.
    RawDds,
    /// Raw PUB, our broker, bridge, CDR reader.
    ZmqToRos,
    /// CDR writer, bridge, our broker, raw SUB.
    RosToZmq,
    /// Raw PUB, our broker, the least possible bridge, CDR reader.
    RelayToRos,
    /// CDR writer, the least possible bridge, our broker, raw SUB.
    RelayToZmq,
    /// Our publisher, our broker, our listener; coding included.
    RustHop,
    /// Our publisher, our broker, bridge, our broker, our listener; coded at every station.
    RustForward,
    /// Python Wrapyfi: publisher, its broker, listener.
    PythonHop,
    /// Python Wrapyfi: publisher, its broker, forwarding script, its broker, listener.
    PythonForward,
}

impl Way {
    /// All of them.
    pub(crate) const ALL: [Self; 10] = [
        Self::RawZmq,
        Self::RawDds,
        Self::RelayToRos,
        Self::ZmqToRos,
        Self::RelayToZmq,
        Self::RosToZmq,
        Self::PythonHop,
        Self::RustHop,
        Self::PythonForward,
        Self::RustForward,
    ];

    /// Name in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::RawZmq => "raw-zmq",
            Self::RawDds => "raw-dds",
            Self::ZmqToRos => "zmq-to-ros",
            Self::RosToZmq => "ros-to-zmq",
            Self::RelayToRos => "relay-to-ros",
            Self::RelayToZmq => "relay-to-zmq",
            Self::RustHop => "rust-hop",
            Self::RustForward => "rust-forward",
            Self::PythonHop => "python-hop",
            Self::PythonForward => "python-forward",
        }
    }

    /// Title of the way, for people.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::RawZmq => "raw ZeroMQ hop (PUB, broker, SUB)",
            Self::RawDds => "raw CycloneDDS hop (CDR)",
            Self::ZmqToRos => "bridge ZeroMQ to ROS 2",
            Self::RosToZmq => "bridge ROS 2 to ZeroMQ",
            Self::RelayToRos => "minimal relay ZeroMQ to ROS 2",
            Self::RelayToZmq => "minimal relay ROS 2 to ZeroMQ",
            Self::RustHop => "our library, one hop with coding",
            Self::RustForward => "our bridge, ZeroMQ to ZeroMQ, with coding",
            Self::PythonHop => "Python Wrapyfi, one hop with coding",
            Self::PythonForward => "Python Wrapyfi, forwarded, with coding",
        }
    }

    /// True where Python Wrapyfi is needed.
    pub(crate) fn is_python(self) -> bool {
        matches!(self, Self::PythonHop | Self::PythonForward)
    }

    /// Payloads that the way is measured with.
    fn payloads(self) -> &'static [Kind] {
        match self {
            Self::RawZmq | Self::RawDds | Self::ZmqToRos | Self::RosToZmq => {
                &[Small, Audio, VgaJpeg, VgaRgb, FullHdRgb]
            }
            Self::RelayToRos | Self::RelayToZmq => &[VgaJpeg, VgaRgb, FullHdRgb],
            _ => &[Small, Audio, U8Rgb200, VgaJpeg, F32Mib, VgaRgb, FullHdRgb],
        }
    }

    /// True where a message is coded at the ends, as a program of a user does.
    fn is_coded(self) -> bool {
        self.is_python() || matches!(self, Self::RustHop | Self::RustForward)
    }
}

/// One payload on one way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Case {
    pub(crate) way: Way,
    pub(crate) payload: Kind,
}

impl Case {
    /// Every case, those with one payload next to each other: they are compared.
    pub(crate) fn all() -> Vec<Self> {
        let kinds = [Small, Audio, U8Rgb200, VgaJpeg, F32Mib, VgaRgb, FullHdRgb];
        let mut all = Vec::new();
        for payload in kinds {
            let ways = Way::ALL.into_iter().filter(|way| way.payloads().contains(&payload));
            all.extend(ways.map(|way| Self { way, payload }));
        }
        all
    }

    /// `way/payload`.
    pub(crate) fn name(self) -> String {
        format!("{}/{}", self.way.name(), self.payload.name())
    }

    /// True where a target is made of it. How the scheduler places the processes of a turn decides
    /// more than how many messages the turn has, so these have many short turns.
    pub(crate) fn is_judged(self) -> bool {
        match self.payload {
            VgaRgb | VgaJpeg => !self.way.is_coded(),
            U8Rgb200 => matches!(self.way, Way::PythonHop | Way::RustHop),
            _ => false,
        }
    }

    /// Messages at a fixed rate, low enough that Python keeps up where both are measured.
    pub(crate) fn paced(self) -> Order {
        let coded = self.way.is_coded();
        match self.payload {
            _ if self.is_judged() => Order::Paced { count: 25, hz: 50.0 },
            FullHdRgb if coded => Order::Paced { count: 12, hz: 8.0 },
            VgaRgb | VgaJpeg | F32Mib if coded => Order::Paced { count: 24, hz: 20.0 },
            FullHdRgb => Order::Paced { count: 30, hz: 30.0 },
            _ => Order::Paced { count: 50, hz: 50.0 },
        }
    }

    /// Messages as fast as a few unacknowledged ones allow. Fewer than any queue on the way holds,
    /// so that nothing is dropped.
    pub(crate) fn window(self) -> Order {
        let count = match (self.payload, self.way.is_python()) {
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
    fn what_the_targets_are_made_of_is_judged() {
        let judged: Vec<String> =
            Case::all().into_iter().filter(|case| case.is_judged()).map(Case::name).collect();
        let named = |name: &str| judged.iter().filter(|judged| judged.ends_with(name)).count();
        // Two raw hops, two relays, the bridge both ways; and the two hops of the array.
        assert_eq!((named("/vga-rgb"), named("/vga-jpeg"), named("/u8-rgb200")), (6, 6, 2));
        assert_eq!(judged.len(), 14);
    }
}
