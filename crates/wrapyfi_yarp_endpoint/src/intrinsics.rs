//! The calibration that cameras tell, and the names of the ports that it takes.
//!
//! ```text
//!   /depthCamera/rgbImage:o, depthImage:o ─▶ /depthCamera/rpc:i     rgbdSensor_nws_yarp
//!   /icub/cam/left                        ─▶ /icub/cam/left/rpc     frameGrabber_nws_yarp
//!      [visr] [get] [intp]        ─▶  [visr] [intp] [is] ((focalLengthX 512) …)       pictures
//!      [visd] [get] [intp]        ─▶  [visd] [intp] [is] ((focalLengthX 512) …)       depth
//!   of YARP 4: getRgbIntrinsicParamRPC, getDepthIntrinsicParamRPC
//!
//!   /depthCamera/rgbImage:camera_info, /icub/cam/left:camera_info     the topics; no program has such ports
//! ```
//!
//! A topic of `CameraInfo` is read from the port of its pictures, which have its stamp and its size. So that a bridge can
//! have it beside the picture, it is found under a name of its own; in ROS 2 that is
//! `/depthCamera/rgbImage/camera_info`, where rviz looks for it beside `/depthCamera/rgbImage/o`.

use wrapyfi_yarp::{Bottle, Dialect, Value};

/// ROS type of a calibration.
pub(super) const CAMERA_INFO: &str = "sensor_msgs/msg/CameraInfo";
/// ROS's name for the usual lens.
const PLUMB_BOB: &str = "plumb_bob";
/// Ending of the name of a topic of calibrations.
const INFO: &str = ":camera_info";
/// Endings of the names of picture ports that share their device's port for requests.
const SHARED: [&str; 2] = ["/rgbImage:o", "/depthImage:o"];

/// The calibration of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Intrinsics {
    /// Focal length along x and y, in pixels.
    pub focal: [f64; 2],
    /// Point in which the optical axis meets the picture, in pixels.
    pub center: [f64; 2],
    /// Model of the lens, as ROS names it.
    pub model: String,
    /// Parameters of the lens: k1, k2, t1, t2, k3.
    pub distortion: [f64; 5],
}

/// The port whose pictures a topic of calibrations is about.
pub(super) fn picture_of(topic: &str) -> Option<String> {
    let base = topic.strip_suffix(INFO)?;
    Some(if base.ends_with("Image") { format!("{base}:o") } else { base.to_owned() })
}

/// The topic of the calibrations of a port of pictures; none where its name cannot tell it.
pub(super) fn topic_of(picture: &str) -> Option<String> {
    let base = picture.strip_suffix(":o").unwrap_or(picture);
    let topic = format!("{base}{INFO}");
    (picture_of(&topic).as_deref() == Some(picture)).then_some(topic)
}

/// The port that tells the calibration of a port of pictures.
pub(super) fn requests(picture: &str) -> String {
    match SHARED.iter().find_map(|end| picture.strip_suffix(end)) {
        Some(device) => format!("{device}/rpc:i"),
        None => format!("{picture}/rpc"),
    }
}

/// The question for the calibration of a port of pictures.
pub(super) fn question(picture: &str, dialect: Dialect) -> Bottle {
    let is_depth = picture.ends_with("/depthImage:o");
    let values = match (dialect, is_depth) {
        (Dialect::V3, _) => {
            let device = if is_depth { "visd" } else { "visr" };
            [device, "get", "intp"].map(Value::vocab).into()
        }
        (Dialect::V4, true) => vec!["getDepthIntrinsicParamRPC".into()],
        (Dialect::V4, false) => vec!["getRgbIntrinsicParamRPC".into()],
    };
    Bottle { values }
}

impl Intrinsics {
    /// The calibration in the answer of a camera.
    ///
    /// # Errors
    /// The property that is missing or unusable.
    pub(super) fn of(answer: &Bottle) -> Result<Self, String> {
        let lists = answer.values.iter().filter_map(Value::as_list);
        let parameters = lists.into_iter().find(|list| list.find("focalLengthX").is_some());
        let parameters = parameters.ok_or_else(|| {
            let text: String = answer.to_text().chars().take(80).collect();
            format!("it answered {text:?}, without a calibration")
        })?;
        let number = |name: &str| parameters.find(name).and_then(Value::as_f64);
        let needed = |name: &str| {
            let number = number(name).filter(|number| number.is_finite());
            number.ok_or_else(|| format!("its calibration has no {name}"))
        };
        let model = parameters.find("distortionModel").and_then(Value::as_str).unwrap_or("none");
        let distortion =
            ["k1", "k2", "t1", "t2", "k3"].map(|name| number(name).unwrap_or_default());
        // A lens without distortion is one with zeros. ROS's programs refuse models that they do not know.
        let model = if matches!(model, "none" | "") { PLUMB_BOB } else { model };
        Ok(Self {
            focal: [needed("focalLengthX")?, needed("focalLengthY")?],
            center: [needed("principalPointX")?, needed("principalPointY")?],
            model: model.to_owned(),
            distortion,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_pictures_and_calibrations_belong_together() {
        for (picture, topic, rpc) in [
            ("/d435/rgbImage:o", "/d435/rgbImage:camera_info", "/d435/rpc:i"),
            ("/d435/depthImage:o", "/d435/depthImage:camera_info", "/d435/rpc:i"),
            ("/icub/cam/left", "/icub/cam/left:camera_info", "/icub/cam/left/rpc"),
        ] {
            assert_eq!(topic_of(picture).as_deref(), Some(topic));
            assert_eq!(picture_of(topic).as_deref(), Some(picture));
            assert_eq!(requests(picture), rpc);
        }
        for other in ["/viewer/img:o", "/myImage"] {
            assert_eq!(topic_of(other), None, "{other}");
        }
        assert_eq!(picture_of("/icub/cam/left/camera_info"), None);
    }

    #[test]
    fn answers_of_cameras_are_read() {
        let read = |text: &str| {
            let answer = Bottle::from_text(text.as_bytes(), &wrapyfi_yarp::WireLimits::default());
            Intrinsics::of(&answer.unwrap())
        };
        let told =
            "(focalLengthX 512) (focalLengthY 510.5) (principalPointX 235) (principalPointY 231)";
        let lens = "(distortionModel plumb_bob) (k1 0.5) (k2 0.25) (t1 1) (t2 2) (k3 3)";
        let wanted = Intrinsics {
            focal: [512.0, 510.5],
            center: [235.0, 231.0],
            model: "plumb_bob".to_owned(),
            distortion: [0.5, 0.25, 1.0, 2.0, 3.0],
        };
        assert_eq!(read(&format!("[visr] [intp] [is] ({told} {lens})")), Ok(wanted.clone()));
        assert_eq!(read(&format!("([ok]) ({told} {lens})")), Ok(wanted.clone()), "of YARP 4");
        let plain = Intrinsics { distortion: [0.0; 5], ..wanted.clone() };
        assert_eq!(read(&format!("[visd] [intp] [is] ({told})")), Ok(plain));
        let fish = lens.replace("plumb_bob", "FishEye");
        let fish_eye = Intrinsics { model: "FishEye".to_owned(), ..wanted };
        assert_eq!(read(&format!("[visr] [intp] [is] ({told} {fish})")), Ok(fish_eye));
        for (answer, why) in [
            ("[fail]".to_owned(), "without a calibration"),
            ("[is] ((focalLengthX 5))".to_owned(), "no focalLengthY"),
        ] {
            let error = read(&answer).unwrap_err();
            assert!(error.contains(why), "{error}");
        }
    }
}
