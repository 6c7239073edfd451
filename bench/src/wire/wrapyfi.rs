//! Our library as a program uses it: payloads in, payloads out, coding included.

use anyhow::Result;
use wrapyfi_data::types::Payload;
use wrapyfi_endpoint::{Context, Middleware as _, PublishError, Publisher};
use wrapyfi_zeromq::{BrokerMode, ZeroMq, ZeroMqConfig};

use super::end::{Incoming, LOOK, Outgoing, Place};
use crate::clock;
use crate::payload::{Kind, Maker, compress, decompress, number_in_payload, number_payload};

fn start(place: &Place) -> Result<ZeroMq> {
    let config = ZeroMqConfig {
        pub_port: place.pub_port,
        sub_port: place.sub_port,
        broker: BrokerMode::Foreign,
        ..ZeroMqConfig::default()
    };
    Ok(ZeroMq::start(&config)?)
}

pub(super) struct Out {
    // Before what it came from: dropped in this order.
    publisher: Box<dyn Publisher>,
    _zeromq: ZeroMq,
    maker: Maker,
    kind: Kind,
    next: Payload,
}

impl Out {
    pub(super) fn new(maker: Maker, place: &Place) -> Result<Self> {
        let zeromq = start(place)?;
        let publisher = zeromq.open_publisher(&maker.spec(&place.topic), &Context::default())?;
        let next = maker.payload(0);
        Ok(Self { publisher, _zeromq: zeromq, maker, kind: place.payload, next })
    }
}

impl Outgoing for Out {
    fn prepare(&mut self, seq: u32) -> Result<()> {
        match self.kind {
            // A camera gives pixels: what makes a file of them is coding, and counts.
            Kind::VgaJpeg => self.next = self.maker.uncoded(seq)?,
            // As a raw publisher's message is numbered: the processor time of making another is no publisher's.
            _ => number_payload(&mut self.next, seq),
        }
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        if self.kind == Kind::VgaJpeg {
            self.next = compress(self.next.clone())?;
        }
        match self.publisher.publish(&self.next) {
            // Before the sink is there, as libzmq's PUB has it; what is lost later is counted.
            Ok(_) | Err(PublishError::NoConsumer(_)) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}

pub(super) fn incoming(place: &Place) -> Result<Incoming> {
    let (zeromq, context, kind) = (start(place)?, Context::default(), place.payload);
    let mut listener = zeromq.open_listener(&Maker::new(kind)?.spec(&place.topic), &context)?;
    Ok(Box::new(move || {
        // Captured, because the listener ends with its middleware.
        let _stays_open = &zeromq;
        loop {
            if let Some(sample) = listener.take()? {
                let mut payload = sample.payload;
                if kind == Kind::VgaJpeg {
                    payload = decompress(payload)?;
                }
                let received = clock::now();
                return Ok((number_in_payload(&payload)?, received));
            }
            context.wake.wait(LOOK);
        }
    }))
}
