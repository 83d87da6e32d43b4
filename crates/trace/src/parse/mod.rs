//! Telling the formats apart, and what they share.

mod eye_pairs;
pub(crate) mod json_lines;
mod motion_capture;
mod tum;

use crate::error::excerpt;
use crate::{LARGEST_FILE_BYTES, Place, Trace, TraceError};
use spatial::{DQuat, DVec3, Pose};

/// What a trace was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// CSV with one row for each eye (the EyeNavGS recordings).
    EyePairs,
    /// JSON of A-Frame's motion capture.
    MotionCapture,
    /// Lines of eight numbers, as the TUM RGB-D benchmark has them.
    Tum,
    /// Our own: one JSON object a line.
    JsonLines,
    /// None: it was made by code.
    Synthetic,
}

pub(crate) fn parse(name: &str, bytes: &[u8]) -> Result<Trace, TraceError> {
    if bytes.len() as u64 > LARGEST_FILE_BYTES {
        return Err(TraceError::TooLong { name: name.to_owned(), limit: LARGEST_FILE_BYTES });
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| TraceError::NotText { name: name.to_owned(), offset: error.valid_up_to() })?;
    // A byte order mark, as spreadsheets write it.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    match recognised(text) {
        Some(Format::EyePairs) => eye_pairs::parse(name, text),
        Some(Format::MotionCapture) => motion_capture::parse(name, text),
        Some(Format::Tum) => tum::parse(name, text),
        Some(Format::JsonLines) => json_lines::parse(name, text),
        Some(Format::Synthetic) | None => {
            let Some(first) = first_line(text) else {
                return Err(TraceError::Empty { name: name.to_owned() });
            };
            Err(TraceError::UnknownFormat { name: name.to_owned(), found: excerpt(first) })
        }
    }
}

/// The format, by the first line that says something.
fn recognised(text: &str) -> Option<Format> {
    let first = first_line(text)?;
    if first.starts_with(eye_pairs::FIRST_COLUMN) {
        Some(Format::EyePairs)
    } else if first.starts_with('{') {
        let own = first.contains(json_lines::FIRST_FIELD);
        Some(if own { Format::JsonLines } else { Format::MotionCapture })
    } else if first.split_ascii_whitespace().all(|field| field.parse::<f64>().is_ok()) {
        Some(Format::Tum)
    } else {
        None
    }
}

/// The first line that is neither empty nor a comment.
fn first_line(text: &str) -> Option<&str> {
    text.lines().map(str::trim).find(|line| !line.is_empty() && !line.starts_with('#'))
}

/// A pose from numbers that a file gave.
fn pose(name: &str, place: Place, position_m: DVec3, orientation: DQuat) -> Result<Pose, TraceError> {
    Pose::checked(position_m, orientation).map_err(|source| TraceError::Pose {
        name: name.to_owned(),
        place,
        source,
    })
}

fn number(name: &str, place: Place, field: &str) -> Result<f64, TraceError> {
    field.trim().parse().map_err(|_| TraceError::Unexpected {
        name: name.to_owned(),
        place,
        found: excerpt(field),
        expected: "a number",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_told_apart_by_content() {
        let check = |text, expected| assert_eq!(recognised(text), expected, "{text:?}");
        check("ViewIndex,FOV1\n0,1", Some(Format::EyePairs));
        check("{\"camera\":{\"poses\":[", Some(Format::MotionCapture));
        check("{\n  \"camera\": {", Some(Format::MotionCapture));
        check("\n{\"time_secs\": 0, ", Some(Format::JsonLines));
        check("# time x y z\n# more\n1.5 0 0 0 0 0 0 1", Some(Format::Tum));
        check("nan 0 0", Some(Format::Tum));
        check("hello", None);
        check("# only a comment", None);
        check("", None);
    }

    #[test]
    fn what_is_no_trace_says_how_it_begins() {
        let error = |bytes: &[u8]| parse("x", bytes).unwrap_err();
        assert!(
            error(b"PK\x03\x04 not a trace").to_string().starts_with("x: begins with \"PK   not a trace\"")
        );
        assert!(matches!(error(b""), TraceError::Empty { .. }));
        assert!(matches!(error(b"\n  \n# nothing\n"), TraceError::Empty { .. }));
        assert!(matches!(error(b"1 2 3 \xff"), TraceError::NotText { offset: 6, .. }));
        let long = vec![b' '; LARGEST_FILE_BYTES as usize + 1];
        assert!(matches!(error(&long), TraceError::TooLong { .. }));
    }
}
