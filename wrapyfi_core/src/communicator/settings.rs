//! Options of a method as the settings of its endpoints.
//!
//! ```text
//!   encoding = "rgb8", qos = "latched", load_torch_device = "cpu" ─▶ Encoding, QosPreset, Plugins
//! ```

use wrapyfi_data::Limits;
use wrapyfi_data::plugin::{DeviceMaps, DeviceOption, Plugins};
use wrapyfi_data::types::{DataType, Encoding, Map};
use wrapyfi_endpoint::QosPreset;
use wrapyfi_endpoint::function_action::{FEEDBACK, POLL, POLL_MS, UNTIL};
use wrapyfi_endpoint::method::{OptionError, OptionValue, Options};

/// Options that only some middlewares have, in the form in which they read them.
pub(super) fn for_middlewares(options: &Options) -> Result<Map, OptionError> {
    let mut map = Map::new();
    for name in ["carrier", "out_topic_connect", FEEDBACK, POLL, UNTIL] {
        if let Some(text) = options.text(name)? {
            map.insert(name, text);
        }
    }
    if let Some(every) = options.number::<i64>(POLL_MS)? {
        map.insert(POLL_MS, every);
    }
    if let Some(persistent) = options.switch("persistent")? {
        map.insert("persistent", persistent);
    }
    // The program at the other end of YARP counts as Wrapyfi's, unless the option says otherwise.
    let told = options.part("yarp_kwargs")?.switch("wrapyfi_images")?;
    map.insert("wrapyfi_images", told.unwrap_or(true));
    Ok(map)
}

/// Error of a ROS message without a type.
pub(super) fn untyped() -> OptionError {
    OptionError::new("message_type", "not given", "the type of the message, as package/msg/Type")
}

pub(super) fn other_kind(
    name: &str,
    found: &dyn std::fmt::Display,
    wanted: DataType,
) -> OptionError {
    OptionError::new(name, found, format!("a type that carries {wanted}"))
}

pub(super) fn is_jpg(options: &Options) -> Result<bool, OptionError> {
    match options.get("jpg") {
        // A dict holds settings of Wrapyfi's encoder, and means JPEG.
        Some(OptionValue::Map(_)) => Ok(true),
        _ => Ok(options.switch("jpg")?.unwrap_or(false)),
    }
}

/// Quality of JPEG in Wrapyfi's settings of the encoder, where it is written. The other settings
/// choose between libraries of Python.
pub(super) fn jpeg_quality(options: &Options) -> Result<Option<u8>, OptionError> {
    let Some(OptionValue::Map(settings)) = options.get("jpg") else { return Ok(None) };
    for (name, value) in settings.iter() {
        if !["quality", "encoder", "logging_level"].contains(&name) {
            let wanted = "quality, encoder or logging_level";
            return Err(OptionError::new(&format!("jpg({name})"), value, wanted));
        }
    }
    let wanted = "a whole number from 0 to 100";
    match settings.get("quality") {
        None | Some(OptionValue::Nothing) => Ok(None),
        // OpenCV takes 0 for the least there is, which is 1.
        Some(OptionValue::Integer(quality @ 0..=100)) => Ok(Some((*quality).clamp(1, 100) as u8)),
        Some(other) => Err(OptionError::new("quality", other, wanted)),
    }
}

pub(super) fn limits(options: &Options) -> Result<Limits, OptionError> {
    let mib = options.number::<usize>("max_message_mib")?;
    Ok(match mib {
        Some(mib) => Limits { message_bytes: mib.saturating_mul(Limits::MIB), ..Limits::default() },
        None => Limits::default(),
    })
}

pub(super) fn qos(options: &Options) -> Result<Option<QosPreset>, OptionError> {
    let Some(word) = options.text("qos")? else { return Ok(None) };
    let wanted = "default, sensor_data or latched";
    let preset = QosPreset::from_name(word).map(Some);
    preset.ok_or_else(|| OptionError::new("qos", format_args!("{word:?}"), wanted))
}

pub(super) fn color_order(options: &Options) -> Result<Encoding, OptionError> {
    match options.text("encoding")? {
        None | Some("bgr8") => Ok(Encoding::Bgr8),
        Some("rgb8") => Ok(Encoding::Rgb8),
        Some(other) => Err(OptionError::new("encoding", format_args!("{other:?}"), "bgr8 or rgb8")),
    }
}

/// Adds the device maps of the options to the plug-ins.
pub(super) fn plugins(plugins: &Plugins, options: &Options) -> Result<Plugins, OptionError> {
    let mut maps = Vec::new();
    for (name, value) in options.iter() {
        let is_load = name.starts_with("load_") && name.ends_with("_device");
        let is_map = name.starts_with("map_") && name.ends_with("_devices");
        match value {
            OptionValue::Text(device) if is_load => {
                maps.push((name, DeviceOption::Load(device.clone())));
            }
            OptionValue::Map(devices) if is_map => {
                let pairs = devices.iter().map(|(from, to)| match to {
                    OptionValue::Text(to) => Ok((from.to_owned(), to.clone())),
                    other => Err(OptionError::new(name, other, "devices by device")),
                });
                maps.push((name, DeviceOption::Map(pairs.collect::<Result<_, _>>()?)));
            }
            _ => {}
        }
    }
    if maps.is_empty() {
        return Ok(plugins.clone());
    }
    let maps = DeviceMaps::from_options(maps).map_err(|error| {
        let (name, wanted) = ("load_…_device or map_…_devices", format!("other devices: {error}"));
        OptionError::new(name, "not usable", wanted)
    })?;
    Ok(plugins.clone().with_devices(maps))
}
