//! Lines of `t x y z qx qy qz qw`: seconds, metres, unit quaternion.

use super::{Format, number, pose};
use crate::error::excerpt;
use crate::trace::Collector;
use crate::{Place, Trace, TraceError};
use spatial::{DQuat, DVec3};

pub(super) fn parse(name: &str, text: &str) -> Result<Trace, TraceError> {
    let mut collector = Collector::new(name);
    for (line, number_of_line) in text.lines().zip(1..) {
        let (place, line) = (Place::Line(number_of_line), line.trim());
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let Ok(fields) = <[&str; 8]>::try_from(fields) else {
            return Err(TraceError::Unexpected {
                name: name.to_owned(),
                place,
                found: excerpt(line),
                expected: "eight numbers: t x y z qx qy qz qw",
            });
        };
        let mut numbers = [0.0; 8];
        for (value, field) in numbers.iter_mut().zip(fields) {
            *value = number(name, place, field)?;
        }
        let [time_secs, x, y, z, qx, qy, qz, qw] = numbers;
        let pose = pose(name, place, DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw))?;
        collector.push(place, time_secs, pose)?;
    }
    collector.finish(Format::Tum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_numbers_and_passes_over_comments() {
        let text = "# timestamp tx ty tz qx qy qz qw\n\n1305031102.175 1.3405 0.6266 1.6575 0 0.7071 0 0.7071\n\
                    1305031102.211\t1.3303 0.6256 1.6464 0 0 0 -1\n";
        let trace = parse("x", text).unwrap();
        assert_eq!(trace.poses().len(), 2);
        assert!((trace.duration_secs() - 0.036).abs() < 1e-6);
        assert!((trace.poses()[0].pose.orientation.length() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| parse("x", text).unwrap_err().to_string();
        assert_eq!(
            error("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0"),
            "x, line 2: found \"1 0 0 0 0 0 0\", expected eight numbers: t x y z qx qy qz qw"
        );
        assert_eq!(error("0 0 0 zero 0 0 0 1"), "x, line 1: found \"zero\", expected a number");
        assert!(error("0 0 0 nan 0 0 0 1").contains("line 1: pose position"));
        assert!(error("nan 0 0 0 0 0 0 1").contains("line 1: time NaN s"));
        assert!(error("0 0 0 0 0 0 0 0").contains("orientation has length 0"));
        assert!(error("0 0 0 0 0 0 0 2").contains("orientation has length 2"));
        assert!(error("1 0 0 0 0 0 0 1\n0 0 0 0 0 0 0 1").contains("line 2: time 0 s after 1 s"));
    }
}
