//! Plain libzmq: PUB and SUB with default options.

use anyhow::Result;

use super::end::{Incoming, Outgoing, Place};
use crate::clock;
use crate::payload::{Maker, Numbered, number_in_frames};

/// A PUB at the broker's port for publishers.
pub(crate) fn connect_publisher(sub_port: u16) -> Result<zmq::Socket> {
    let socket = zmq::Context::new().socket(zmq::PUB)?;
    socket.set_linger(500)?;
    socket.connect(&format!("tcp://127.0.0.1:{sub_port}"))?;
    Ok(socket)
}

/// A SUB at the broker's port for listeners.
fn subscribe(topic: &str, pub_port: u16) -> Result<zmq::Socket> {
    let socket = zmq::Context::new().socket(zmq::SUB)?;
    socket.set_linger(0)?;
    socket.set_subscribe(topic.as_bytes())?;
    socket.connect(&format!("tcp://127.0.0.1:{pub_port}"))?;
    Ok(socket)
}

/// The frames of the next message.
fn receive(socket: &zmq::Socket) -> Result<Vec<zmq::Message>> {
    let mut frames = vec![socket.recv_msg(0)?];
    while socket.get_rcvmore()? {
        frames.push(socket.recv_msg(0)?);
    }
    Ok(frames)
}

pub(super) struct Out {
    socket: zmq::Socket,
    topic: Vec<u8>,
    message: Numbered,
    next: Vec<zmq::Message>,
}

impl Out {
    pub(super) fn new(maker: &Maker, place: &Place) -> Result<Self> {
        let socket = connect_publisher(place.sub_port)?;
        let message = maker.frames(&place.topic)?;
        Ok(Self { socket, topic: place.topic.as_bytes().to_vec(), message, next: Vec::new() })
    }
}

impl Outgoing for Out {
    fn prepare(&mut self, seq: u32) -> Result<()> {
        let (header, body) = self.message.number_frames(seq);
        let frames = [Some(self.topic.clone()), header, Some(body)];
        self.next = frames.into_iter().flatten().map(zmq::Message::from).collect();
        Ok(())
    }

    fn send(&mut self) -> Result<()> {
        let last = self.next.len().saturating_sub(1);
        for (index, frame) in std::mem::take(&mut self.next).into_iter().enumerate() {
            self.socket.send(frame, if index < last { zmq::SNDMORE } else { 0 })?;
        }
        Ok(())
    }
}

pub(super) fn incoming(place: &Place) -> Result<Incoming> {
    let (socket, kind) = (subscribe(&place.topic, place.pub_port)?, place.payload);
    Ok(Box::new(move || {
        let frames = receive(&socket)?;
        let received = clock::now();
        let frames: Vec<&[u8]> = frames.iter().map(|frame| &**frame).collect();
        Ok((number_in_frames(kind, &frames)?, received))
    }))
}
