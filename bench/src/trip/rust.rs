//! Bare RustDDS there and back, reliable, keep last 10, as services on it have it.

use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr};
use std::time::{Duration, Instant};

use anyhow::Result;
use rustdds::mio1::{Events, Interest, Poll, Token};
use rustdds::no_key::{
    DataWriter, Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter, SimpleDataReader,
};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder,
    RepresentationIdentifier, TopicKind,
};

use super::{Far, Near, Place, message, number_of, service, set_number};

/// Passes bodies on, with the encapsulation header in front on this side.
struct Bare;

/// Copies a body.
#[derive(Clone)]
struct Copied;

impl SerializerAdapter<Vec<u8>> for Bare {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Vec<u8>) -> Result<bytes::Bytes, Infallible> {
        Ok(bytes::Bytes::copy_from_slice(message.get(4..).unwrap_or_default()))
    }
}

impl DeserializerAdapter<Vec<u8>> for Bare {
    type Error = Infallible;
    type Decoded = Vec<u8>;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE]
    }

    fn transform_decoded(decoded: Vec<u8>) -> Vec<u8> {
        decoded
    }
}

impl DefaultDecoder<Vec<u8>> for Bare {
    type Decoder = Copied;
    const DECODER: Copied = Copied;
}

impl Decode<'_, Vec<u8>> for Copied {
    type Error = Infallible;

    fn decode_bytes(
        self,
        body: &[u8],
        _encoding: RepresentationIdentifier,
    ) -> Result<Vec<u8>, Infallible> {
        Ok([&[0, 1, 0, 0], body].concat())
    }
}

/// A writer one way and a reader the other.
pub(super) struct End {
    writer: DataWriter<Vec<u8>, Bare>,
    reader: SimpleDataReader<Vec<u8>, Bare>,
    poll: Poll,
    events: Events,
    message: Vec<u8>,
    /// Endpoints are dead without it.
    _participant: DomainParticipant,
}

fn qos() -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable {
            max_blocking_time: rustdds::Duration::from_millis(500),
        })
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: 10 })
        .build()
}

impl End {
    pub(super) fn near(place: &Place) -> Result<Self> {
        let (request, _) = service::sizes(place.trip.load)?;
        Self::new(place, ("ping", "pong"), request)
    }

    pub(super) fn far(place: &Place) -> Result<Self> {
        let (_, reply) = service::sizes(place.trip.load)?;
        Self::new(place, ("pong", "ping"), reply)
    }

    fn new(place: &Place, (written, read): (&str, &str), size: usize) -> Result<Self> {
        let dds = DomainParticipantBuilder::new(u16::try_from(place.domain)?)
            .with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)])
            .build()?;
        let qos = qos();
        let topic = |name: &str| {
            dds.create_topic(name.to_owned(), "Bare".to_owned(), &qos, TopicKind::NoKey)
        };
        let (written, read) = (topic(written)?, topic(read)?);
        let subscriber = dds.create_subscriber(&QosPolicies::qos_none())?;
        let publisher = dds.create_publisher(&QosPolicies::qos_none())?;
        let mut reader = subscriber.create_simple_datareader_no_key(&read, Some(qos.clone()))?;
        let writer = publisher.create_datawriter_no_key(&written, Some(qos.clone()))?;
        let poll = Poll::new()?;
        poll.registry().register(&mut reader, Token(0), Interest::READABLE)?;
        let events = Events::with_capacity(4);
        let message = message(size, place.trip.way.mapping());
        Ok(Self { writer, reader, poll, events, message, _participant: dds })
    }

    fn write(&mut self, number: u32) -> Result<()> {
        set_number(&mut self.message, number);
        // Its error holds the message, which is not to be printed.
        self.writer
            .write(self.message.clone(), None)
            .map_err(|error| anyhow::anyhow!("writing on RustDDS: {error}"))
    }

    /// The next number, if one is there.
    fn take(&mut self) -> Result<Option<u32>> {
        let taken = self.reader.try_take_one()?;
        Ok(taken.and_then(|sample| number_of(&sample.into_value())))
    }

    /// Sleeps until something arrives, at most `patience`.
    fn sleep(&mut self, patience: Duration) -> Result<()> {
        match self.poll.poll(&mut self.events, Some(patience)) {
            Err(error) if error.kind() != std::io::ErrorKind::Interrupted => {
                return Err(error.into());
            }
            _ => {}
        }
        self.reader.drain_read_notifications();
        Ok(())
    }
}

impl Near for End {
    fn call(&mut self, number: u32, patience: Duration) -> Result<bool> {
        self.write(number)?;
        let until = Instant::now() + patience;
        loop {
            while let Some(taken) = self.take()? {
                if taken == number {
                    return Ok(true);
                }
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(false);
            }
            self.sleep(left)?;
        }
    }
}

impl Far for End {
    fn serve(&mut self, patience: Duration) -> Result<()> {
        while let Some(number) = self.take()? {
            self.write(number)?;
        }
        self.sleep(patience)
    }
}
