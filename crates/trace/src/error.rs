//! What can be wrong with a trace.

use std::fmt;
use std::path::PathBuf;

/// Where in a file something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line, from 1.
    Line(usize),
    /// A pose of a list, from 1: for files that have all in one line.
    Pose(usize),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(number) => write!(f, "line {number}"),
            Self::Pose(number) => write!(f, "pose {number}"),
        }
    }
}

/// Why a trace could not be read.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The file could not be read.
    #[error("cannot read the trace {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The file is too long.
    #[error("{name}: longer than {limit} bytes, which is the limit for a trace")]
    TooLong {
        /// The trace.
        name: String,
        /// The limit in bytes.
        limit: u64,
    },
    /// There are too many poses.
    #[error("{name}, {place}: more than {limit} poses, which is the limit for a trace")]
    TooManyPoses {
        /// The trace.
        name: String,
        /// Where the first one too many is.
        place: Place,
        /// The limit.
        limit: usize,
    },
    /// The file is no text.
    #[error("{name}: byte {offset} is not UTF-8 text, expected a trace (CSV, JSON or numbers)")]
    NotText {
        /// The trace.
        name: String,
        /// Where text ends.
        offset: usize,
    },
    /// The file is in no known format.
    #[error(
        "{name}: begins with \"{found}\", expected an eye-pair CSV (\"ViewIndex,...\"), a motion capture \
         ({{\"camera\":{{\"poses\":...), TUM numbers (\"t x y z qx qy qz qw\") or JSON lines ({{\"time_secs\":...)"
    )]
    UnknownFormat {
        /// The trace.
        name: String,
        /// Its beginning.
        found: String,
    },
    /// Something stands where another thing should.
    #[error("{name}, {place}: found \"{found}\", expected {expected}")]
    Unexpected {
        /// The trace.
        name: String,
        /// Where.
        place: Place,
        /// What stands there.
        found: String,
        /// What should.
        expected: &'static str,
    },
    /// JSON that does not parse, or has other fields. The source names line and column.
    #[error("{name}: {source}, expected {expected}")]
    Json {
        /// The trace.
        name: String,
        /// What should be there.
        expected: &'static str,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// A pose is none.
    #[error("{name}, {place}: {source}")]
    Pose {
        /// The trace.
        name: String,
        /// Where.
        place: Place,
        /// What is wrong with it.
        source: spatial::PoseError,
    },
    /// A time is no number, or more than ten years from the first pose.
    #[error("{name}, {place}: time {time_secs} s, expected a number within ten years of the first")]
    Time {
        /// The trace.
        name: String,
        /// Where.
        place: Place,
        /// The time as read.
        time_secs: f64,
    },
    /// Time runs backwards.
    #[error("{name}, {place}: time {time_secs} s after {previous_secs} s, expected a later one")]
    Backwards {
        /// The trace.
        name: String,
        /// Where.
        place: Place,
        /// The time as read.
        time_secs: f64,
        /// The time before.
        previous_secs: f64,
    },
    /// There is no pose.
    #[error("{name}: holds no pose")]
    Empty {
        /// The trace.
        name: String,
    },
}

/// At most 40 characters of what was found, for a message.
pub(crate) fn excerpt(found: &str) -> String {
    const MOST: usize = 40;
    let printable = |c: char| if c.is_control() { ' ' } else { c };
    let mut excerpt: String = found.chars().take(MOST).map(printable).collect();
    if found.chars().nth(MOST).is_some() {
        excerpt.push('…');
    }
    excerpt
}
