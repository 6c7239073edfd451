//! Writing and reading of whole pieces.

use std::io::{self, IoSlice};

use bytes::BytesMut;
use tokio::net::TcpStream;

/// Writes all parts, in as few calls as the socket takes.
///
/// Not cancel-safe: how much was written is lost with the future.
pub(super) async fn write_all(stream: &TcpStream, parts: &[&[u8]]) -> io::Result<()> {
    let mut slices: Vec<IoSlice<'_>> = parts.iter().map(|part| IoSlice::new(part)).collect();
    let mut rest = &mut slices[..];
    // Takes empty parts off the front, so that 0 bytes written means a closed socket.
    IoSlice::advance_slices(&mut rest, 0);
    while !rest.is_empty() {
        match stream.try_write_vectored(rest) {
            Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
            Ok(count) => IoSlice::advance_slices(&mut rest, count),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => stream.writable().await?,
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Reads what is there, at least a byte; 0 at the end. Cancel-safe.
pub(super) async fn read(stream: &TcpStream, buffer: &mut BytesMut) -> io::Result<usize> {
    loop {
        match stream.try_read_buf(buffer) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => stream.readable().await?,
            read => return read,
        }
    }
}
