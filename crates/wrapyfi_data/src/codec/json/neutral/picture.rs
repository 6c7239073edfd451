//! `["picture", {…}]`: pixels or a file as a tensor, and beside it what they are.
//!
//! ```text
//!   {"encoding": "rgb8", "width": 3, "height": 2, "data": tensor uint8 (2, 3, 3)}
//!   {"format": "png", "data": tensor uint8 (bytes of the file)}
//!   and "mode" where Pillow's is another than the encoding tells: {"encoding": "mono8", "mode": "1", …},
//!   {"encoding": "mono8", "mode": "P", …}, {"encoding": "8UC4", "mode": "CMYK", …}
//! ```

use crate::codec::picture::{INKS, layout};
use crate::types::{
    CompressedFormat, Dtype, Encoding, Image, Map, Picture, Pixels, RawPixels, Stamp, Tensor, Value,
};

/// Name that ROS has for four channels without meaning.
const CHANNELS: &str = "8UC4";

pub(super) fn write(picture: &Picture) -> Result<Value, String> {
    let mut body = Map::new();
    let tensor = match &picture.image.pixels {
        Pixels::Raw(raw) => {
            let inks = picture.mode.as_deref() == Some(INKS);
            body.insert("encoding", if inks { CHANNELS } else { raw.encoding.name() });
            body.insert("width", raw.width);
            body.insert("height", raw.height);
            let (dtype, shape) = layout(raw);
            Tensor::new(dtype, shape, raw.to_dense().data)
        }
        Pixels::Compressed { format, data } => {
            body.insert("format", format.name());
            Tensor::new(Dtype::U8, [data.len()], data.clone())
        }
    };
    if let Some(mode) = &picture.mode {
        body.insert("mode", mode.as_str());
    }
    body.insert("data", tensor.map_err(|error| error.to_string())?);
    Ok(body.into())
}

pub(super) fn read(body: &Value) -> Result<Picture, String> {
    let map = body.as_map().ok_or_else(|| format!("a {}, no dict", body.kind()))?;
    let data = map.get("data").and_then(Value::as_tensor).ok_or("data is no tensor")?;
    let mode = match map.get("mode") {
        None | Some(Value::Null) => None,
        Some(_) => Some(super::text(map, "mode")?),
    };
    let pixels = match map.get("format") {
        Some(_) => file(map, data)?,
        None => raw(map, data, mode.as_deref() == Some(INKS))?.into(),
    };
    Ok(Picture { image: Image::new(Stamp::default(), pixels), mode })
}

fn file(map: &Map, data: &Tensor) -> Result<Pixels, String> {
    let name = super::text(map, "format")?;
    let known = [CompressedFormat::Jpeg, CompressedFormat::Png];
    let format = known.into_iter().find(|format| format.name() == name);
    let format = format.ok_or_else(|| format!("format {name:?} is neither jpeg nor png"))?;
    if data.dtype() != Dtype::U8 || data.shape().len() != 1 {
        let (dtype, shape) = (data.dtype(), data.shape());
        return Err(format!(
            "data is {dtype} of shape {shape:?}, a file is uint8 of one dimension"
        ));
    }
    Ok(Pixels::Compressed { format, data: data.data().clone() })
}

fn raw(map: &Map, data: &Tensor, inks: bool) -> Result<RawPixels, String> {
    let name = super::text(map, "encoding")?;
    let known = if inks { Some(Encoding::Rgba8) } else { Encoding::from_name(&name) };
    let encoding = known.ok_or_else(|| {
        format!("encoding {name:?} is none of {:?}", Encoding::ALL.map(Encoding::name))
    })?;
    let extent = |key: &str| {
        let extent = map.get(key).and_then(Value::as_i64).and_then(|it| u32::try_from(it).ok());
        extent.ok_or_else(|| format!("{key} is no number from 0 to {}", u32::MAX))
    };
    let raw = RawPixels::dense(extent("width")?, extent("height")?, encoding, data.data().clone())
        .map_err(|error| error.to_string())?;
    let (dtype, shape) = layout(&raw);
    if (data.dtype(), data.shape()) != (dtype, &*shape) {
        return Err(format!(
            "data is {} of shape {:?}, the fields say {dtype} of shape {shape:?}",
            data.dtype(),
            data.shape()
        ));
    }
    Ok(raw)
}
