//! A bottle and an image as YARP sends them: written, read, shown.
//!
//! ```text
//!   cargo run -p wrapyfi_yarp --example payloads
//! ```

// The printed text is the purpose of this program.
#![allow(clippy::print_stdout)]

use std::error::Error;

use bytes::Bytes;
use wrapyfi_yarp::sig::{Image, PixelCode, Rows, Stamp};
use wrapyfi_yarp::{Bottle, Dialect, Value, WireLimits};

fn main() -> Result<(), Box<dyn Error>> {
    let limits = WireLimits::default();

    // A command to a motor of an iCub, from its parts.
    let mut command = Bottle::new();
    command.push(Value::vocab("set"));
    command.push(Value::vocab("pos"));
    command.push(2);
    command.push(10.5);
    for dialect in [Dialect::V3, Dialect::V4] {
        let bytes = Bytes::from(command.encode(dialect)?);
        let (read, used) = Bottle::decode(&bytes, dialect, &limits)?;
        println!("{dialect}: {used} bytes: {}", read.to_text());
        // The other dialect does not take it for something else: it says what is wrong.
        if let Err(error) = Bottle::decode_whole(&bytes, dialect.other(), &limits) {
            println!("    as {}: {error}", dialect.other());
        }
    }

    // Two rows of three pixels, without padding between them.
    let pixels: Vec<u8> = (0..18).collect();
    let image = Image::from_packed(PixelCode::Rgb, 3, 2, pixels.into())?;
    let payload = Bytes::from(image.encode(Rows::Announced)?);
    let read = Image::decode(&payload, Rows::Announced, &limits)?;
    println!(
        "{} x {} pixels {}, {} bytes from row to row",
        read.header().width,
        read.header().height,
        read.header().pixel,
        read.header().stride
    );
    for row in read.rows() {
        println!("    {row:?}");
    }
    let (bottle, _) = Bottle::decode(&payload, Dialect::V3, &limits)?;
    println!("the same bytes as a bottle: {}", bottle.to_text());

    let stamp = Stamp { count: 42, time_s: 1_700_000_000.5 };
    println!("its envelope: {}", stamp.to_envelope());
    Ok(())
}
