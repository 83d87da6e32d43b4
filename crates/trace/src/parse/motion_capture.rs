//! JSON of A-Frame's motion capture: positions in metres, three.js Euler angles in degrees, milliseconds.
//!
//! three.js and WebVR have OpenXR's axes: +Y up, and a camera that looks along its -Z. So only the angles are
//! converted: their order YXZ means a turn about Y, then about the turned X, then about the turned Z.

use super::{Format, pose};
use crate::trace::Collector;
use crate::{Place, Trace, TraceError};
use serde::Deserialize;
use spatial::{DQuat, DVec3};

#[derive(Deserialize)]
struct Recording {
    camera: Camera,
}

#[derive(Deserialize)]
struct Camera {
    poses: Vec<RecordedPose>,
}

#[derive(Deserialize)]
struct RecordedPose {
    position: Vector,
    rotation: Vector,
    timestamp: f64,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

pub(super) fn parse(name: &str, text: &str) -> Result<Trace, TraceError> {
    let recording: Recording = serde_json::from_str(text).map_err(|source| TraceError::Json {
        name: name.to_owned(),
        expected: "a motion capture: {\"camera\": {\"poses\": [{\"position\": {x, y, z}, \"rotation\": {x, y, z}, \
                   \"timestamp\": ms}, …]}}",
        source,
    })?;
    let mut collector = Collector::new(name);
    for (recorded, number) in recording.camera.poses.iter().zip(1..) {
        let place = Place::Pose(number);
        let Vector { x, y, z } = recorded.position;
        let pose = pose(name, place, DVec3::new(x, y, z), orientation(&recorded.rotation))?;
        collector.push(place, recorded.timestamp / 1000.0, pose)?;
    }
    collector.finish(Format::MotionCapture)
}

fn orientation(degrees: &Vector) -> DQuat {
    DQuat::from_rotation_y(degrees.y.to_radians())
        * DQuat::from_rotation_x(degrees.x.to_radians())
        * DQuat::from_rotation_z(degrees.z.to_radians())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_turn_about_y_then_x_then_z() {
        // Turned a quarter to the left and then up by 30°: looks along -X and up. Tilting changes nothing about that.
        let ahead = orientation(&Vector { x: 30.0, y: 90.0, z: 77.0 }) * DVec3::NEG_Z;
        let (sin, cos) = 30f64.to_radians().sin_cos();
        assert!((ahead - DVec3::new(-cos, sin, 0.0)).length() < 1e-12, "{ahead}");
    }

    #[test]
    fn errors_name_the_pose_or_the_line_and_column() {
        let file = |poses: &str| format!(r#"{{"camera":{{"poses":[{poses}]}}}}"#);
        let pose = |x: &str, ms: f64| {
            format!(
                r#"{{"position":{{"x":{x},"y":1,"z":0}},"rotation":{{"x":0,"y":0,"z":0}},"timestamp":{ms}}}"#
            )
        };
        let error = |text: &str| parse("x", text).unwrap_err();
        let far = file(&[pose("0", 1.0), pose("1e9", 2.0)].join(","));
        assert!(error(&far).to_string().starts_with("x, pose 2: pose position"), "{}", error(&far));
        let back = file(&[pose("0", 2.0), pose("0", 1.0)].join(","));
        assert!(error(&back).to_string().contains("pose 2: time 0.001 s after 0.002 s"));
        let whole = file(&pose("0", 1.0));
        assert_eq!(parse("x", &whole).unwrap().poses().len(), 1);
        for length in 1..whole.len() {
            assert!(matches!(error(&whole[..length]), TraceError::Json { .. }), "cut at {length}");
        }
        assert!(error(r#"{"camera":{}}"#).to_string().contains("missing field `poses` at line 1 column"));
        assert!(matches!(error(&file("")), TraceError::Empty { .. }));
    }
}
