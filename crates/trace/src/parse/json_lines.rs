//! Our own format: one JSON object a line. `docs/trace-format.md` describes it.

use super::{Format, pose};
use crate::error::excerpt;
use crate::trace::Collector;
use crate::{Place, Trace, TraceError};
use serde::{Deserialize, Serialize};
use spatial::{DQuat, DVec3, PoseAt};

/// What a line has, and no other format's first line.
pub(super) const FIRST_FIELD: &str = "\"time_secs\"";

#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Line {
    time_secs: f64,
    position_m: [f64; 3],
    orientation_xyzw: [f64; 4],
}

pub(super) fn parse(name: &str, text: &str) -> Result<Trace, TraceError> {
    let mut collector = Collector::new(name);
    for (line, number) in text.lines().zip(1..) {
        let place = Place::Line(number);
        if line.trim().is_empty() {
            continue;
        }
        let Ok(Line { time_secs, position_m, orientation_xyzw }) = serde_json::from_str(line) else {
            return Err(TraceError::Unexpected {
                name: name.to_owned(),
                place,
                found: excerpt(line),
                expected: "an object with time_secs, position_m [x, y, z] and orientation_xyzw [x, y, z, w]",
            });
        };
        let pose = pose(name, place, DVec3::from_array(position_m), DQuat::from_array(orientation_xyzw))?;
        collector.push(place, time_secs, pose)?;
    }
    collector.finish(Format::JsonLines)
}

pub(crate) fn write(poses: &[PoseAt]) -> String {
    let mut text = String::new();
    for PoseAt { time_secs, pose } in poses {
        let line = Line {
            time_secs: *time_secs,
            position_m: pose.position_m.to_array(),
            orientation_xyzw: pose.orientation.to_array(),
        };
        // Numbers in fixed arrays: there is nothing that serde_json could refuse.
        text.push_str(&serde_json::to_string(&line).unwrap_or_default());
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use spatial::Pose;

    #[test]
    fn errors_name_the_line() {
        let good = r#"{"time_secs":0,"position_m":[0,1.6,0],"orientation_xyzw":[0,0,0,1]}"#;
        let check = |line: &str, expected: &str| {
            let error = parse("x", &format!("{good}\n\n{line}")).unwrap_err().to_string();
            assert!(error.starts_with("x, line 3: ") && error.contains(expected), "{error}");
        };
        let fields = "expected an object with time_secs";
        check(r#"{"time_secs":1,"position_m":[0,1.6],"orientation_xyzw":[0,0,0,1]}"#, fields);
        check(r#"{"time_secs":1,"position_m":[0,1.6,0],"orientation_xyzw":[0,0,0,1],"more":1}"#, fields);
        check(r#"{"time_secs":1,"position_m":[0,1.6,0],"orient"#, fields);
        check(r#"{"time_secs":NaN,"position_m":[0,1.6,0],"orientation_xyzw":[0,0,0,1]}"#, fields);
        check(r#"{"time_secs":1,"position_m":[0,1e9,0],"orientation_xyzw":[0,0,0,1]}"#, "farther than");
        check(r#"{"time_secs":1,"position_m":[0,0,0],"orientation_xyzw":[0,0,0,0]}"#, "has length 0");
        check(
            r#"{"time_secs":-1,"position_m":[0,0,0],"orientation_xyzw":[0,0,0,1]}"#,
            "expected a later one",
        );
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back(
            steps in prop::collection::vec(0.001..10.0f64, 0..20),
            x in -100.0..100.0f64,
            turn in -3.0..3.0f64,
        ) {
            let mut time_secs = 0.0;
            let mut collector = Collector::new("x");
            for step in std::iter::once(&0.0).chain(&steps) {
                time_secs += step;
                let orientation = DQuat::from_rotation_y(turn * time_secs).normalize();
                let pose = Pose { position_m: DVec3::new(x, time_secs, -x), orientation };
                collector.push(Place::Line(1), time_secs, pose).unwrap();
            }
            let trace = collector.finish(Format::JsonLines).unwrap();
            let back = parse("x", &trace.to_json_lines()).unwrap();
            prop_assert_eq!(back.poses().len(), trace.poses().len());
            for (a, b) in back.poses().iter().zip(trace.poses()) {
                prop_assert_eq!(a.time_secs, b.time_secs);
                prop_assert_eq!(a.pose.position_m, b.pose.position_m);
                prop_assert!(a.pose.angle_to(&b.pose) < 1e-15);
            }
        }
    }
}
