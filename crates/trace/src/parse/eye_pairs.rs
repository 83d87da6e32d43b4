//! CSV with one row for each eye: the EyeNavGS recordings (Ding et al. 2025, arXiv 2506.02380), made with a Quest Pro.
//!
//! What the data show, and thus what is done here:
//! - The right eye lies from the left one along the head's own +X, and both have one orientation: axes as in OpenXR
//!   (right-handed, +Y up, looking along -Z). The head is the middle between the eyes.
//! - Positions are in units of the scene that was looked at: the same adults' eyes are 63 mm apart in one recording
//!   and 80 mm in another, whose scene is 1.25 times as large. So positions are scaled to eyes 63.5 mm apart.
//! - World axes are the scene's, and scenes are tilted: by 13° in one recording and by 89° in another. The tilt is
//!   not in the file. So the trace is levelled: the mean of where the head's top points becomes up. For those two
//!   recordings that is 5.6° and 1.8° from the tilt that the data set's scene list gives.

use super::{Format, number, pose};
use crate::error::excerpt;
use crate::trace::Collector;
use crate::{Place, Trace, TraceError};
use spatial::{DQuat, DVec3, Pose};

/// What the file begins with.
pub(super) const FIRST_COLUMN: &str = "ViewIndex";

/// Columns that are read, by name.
const COLUMNS: [&str; 9] = [
    FIRST_COLUMN,
    "PositionX",
    "PositionY",
    "PositionZ",
    "QuaternionX",
    "QuaternionY",
    "QuaternionZ",
    "QuaternionW",
    "Timestamp",
];

/// Mean distance between the pupils of adults (Dodgson 2004, "Variation and extrema of human interpupillary distance").
const EYE_DISTANCE_M: f64 = 0.0635;
/// Eyes nearer than this are no measure of a scene's size.
const LEAST_EYE_DISTANCE: f64 = 1e-3;

/// One row: an eye.
struct Eye {
    right: bool,
    pose: Pose,
    time_secs: f64,
}

pub(super) fn parse(name: &str, text: &str) -> Result<Trace, TraceError> {
    let mut lines =
        text.lines().zip(1..).map(|(line, n)| (line.trim(), Place::Line(n))).filter(|(l, _)| !l.is_empty());
    let Some((header, header_place)) = lines.next() else {
        return Err(TraceError::Empty { name: name.to_owned() });
    };
    let columns = columns(name, header_place, header)?;

    let mut collector = Collector::new(name);
    let (mut distances, mut pairs) = (0.0, 0);
    while let Some((line, place)) = lines.next() {
        let left = eye(name, place, line, &columns)?;
        let unpaired = |place, line: &str| TraceError::Unexpected {
            name: name.to_owned(),
            place,
            found: excerpt(line),
            expected: "rows in pairs: ViewIndex 0 (left eye), then 1 (right eye)",
        };
        if left.right {
            return Err(unpaired(place, line));
        }
        let Some((right_line, right_place)) = lines.next() else {
            return Err(unpaired(place, line));
        };
        let right = eye(name, right_place, right_line, &columns)?;
        if !right.right {
            return Err(unpaired(right_place, right_line));
        }
        distances += left.pose.position_m.distance(right.pose.position_m);
        pairs += 1;
        // The right eye's time is that of its drawing; its pose is of the left one's moment.
        collector.push(place, left.time_secs, left.pose.interpolated(&right.pose, 0.5))?;
    }
    let mut trace = collector.finish(Format::EyePairs)?;
    let distance = distances / f64::from(pairs);
    if distance > LEAST_EYE_DISTANCE {
        trace.scale(EYE_DISTANCE_M / distance);
    }
    Ok(trace.levelled())
}

/// Where each of [`COLUMNS`] is.
fn columns(name: &str, place: Place, header: &str) -> Result<[usize; 9], TraceError> {
    let mut columns = [0; 9];
    for (column, wanted) in columns.iter_mut().zip(COLUMNS) {
        *column = header.split(',').position(|title| title.trim() == wanted).ok_or_else(|| {
            TraceError::Unexpected {
                name: name.to_owned(),
                place,
                found: excerpt(header),
                expected: "the columns ViewIndex, PositionX to Z, QuaternionX to W and Timestamp",
            }
        })?;
    }
    Ok(columns)
}

fn eye(name: &str, place: Place, line: &str, columns: &[usize; 9]) -> Result<Eye, TraceError> {
    let fields: Vec<&str> = line.split(',').collect();
    let mut numbers = [0.0; 9];
    for (value, &column) in numbers.iter_mut().zip(columns) {
        let field = fields.get(column).ok_or_else(|| TraceError::Unexpected {
            name: name.to_owned(),
            place,
            found: excerpt(line),
            expected: "as many fields as the first line names",
        })?;
        *value = number(name, place, field)?;
    }
    let [view, x, y, z, qx, qy, qz, qw, time_ms] = numbers;
    let pose = pose(name, place, DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw))?;
    Ok(Eye { right: view != 0.0, pose, time_secs: time_ms / 1000.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEADER: &str =
        "ViewIndex,PositionX,PositionY,PositionZ,QuaternionX,QuaternionY,QuaternionZ,QuaternionW,Timestamp";

    fn read(rows: &[&str]) -> Result<Trace, TraceError> {
        parse("x", &format!("{HEADER}\n{}", rows.join("\n")))
    }

    #[test]
    fn the_head_is_the_middle_of_the_eyes_in_metres() {
        // A scene twice as large as the room.
        let rows =
            ["0,1,3,0,0,0,0,1,0", "1,1.127,3,0,0,0,0,1,6", "0,1,3,2,0,0,0,1,28", "1,1.127,3,2,0,0,0,1,33"];
        let trace = read(&rows).unwrap();
        let [first, second] = trace.poses() else { panic!("{} poses", trace.poses().len()) };
        assert!((second.time_secs - 0.028).abs() < 1e-12);
        let moved = second.pose.position_m - first.pose.position_m;
        assert!((moved - DVec3::new(0.0, 0.0, 1.0)).length() < 1e-9, "{moved}");
        assert!((first.pose.position_m - DVec3::new(1.0635, 3.0, 0.0) / 2.0).length() < 1e-9);
    }

    #[test]
    fn a_tilted_scene_is_levelled() {
        // Lying on its side: the head's top points along +X.
        let rows = ["0,0,0,0,0,0,-0.7071,0.7071,0", "1,0,-0.0635,0,0,0,-0.7071,0.7071,6"];
        let trace = read(&rows).unwrap();
        let up = trace.poses()[0].pose.orientation * DVec3::Y;
        assert!((up - DVec3::Y).length() < 1e-9, "{up}");
    }

    #[test]
    fn rows_that_are_no_pair_are_refused() {
        let (left, right) = ("0,0,0,0,0,0,0,1,0", "1,0.06,0,0,0,0,0,1,6");
        let pairs = "expected rows in pairs";
        let check = |rows: &[&str], line: usize, expected: &str| {
            let error = read(rows).unwrap_err().to_string();
            assert!(error.starts_with(&format!("x, line {line}: ")) && error.contains(expected), "{error}");
        };
        check(&[right], 2, pairs);
        check(&[left, left], 3, pairs);
        check(&[left, right, left], 4, pairs);
        check(&[left, "1,0.06,0,0,0"], 3, "expected as many fields as the first line names");
        check(&["0,0,here,0,0,0,0,1,0", right], 2, "found \"here\", expected a number");
        check(&["0,0,0,0,0,0,0,0,0", right], 2, "orientation has length 0");
        check(&[left, "1,nan,0,0,0,0,0,1,6"], 3, "pose position");
    }

    #[test]
    fn a_file_without_rows_or_columns_is_refused() {
        assert!(matches!(read(&[]), Err(TraceError::Empty { .. })));
        let error = parse("x", "ViewIndex,PositionX\n0,1").unwrap_err().to_string();
        assert!(error.contains("line 1: found \"ViewIndex,PositionX\", expected the columns"), "{error}");
    }
}
