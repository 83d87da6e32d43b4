//! What can go wrong with a report.

/// A broken rule of a run's frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckError {
    /// A frame names more or fewer stages than the run.
    #[error("headset {headset}, frame {frame}: {found} stages, expected {expected}")]
    StageCount {
        /// The headset's name.
        headset: String,
        /// The frame's number.
        frame: u64,
        /// Stages of the frame.
        found: usize,
        /// Stages of the run.
        expected: usize,
    },
    /// A frame's stages do not sum to its whole.
    #[error(
        "headset {headset}, frame {frame}: stages sum to {sum_us} µs, pose to decoded is {pose_to_decoded_us} µs"
    )]
    Sum {
        /// The headset's name.
        headset: String,
        /// The frame's number.
        frame: u64,
        /// Sum of its stages, in microseconds.
        sum_us: i128,
        /// From pose to decoded picture, in microseconds.
        pose_to_decoded_us: i64,
    },
}

/// Why bytes are not a report.
#[derive(Debug, thiserror::Error)]
pub enum JsonError {
    /// Not JSON, or a field is missing or of the wrong kind.
    #[error("not a report: {0}")]
    Malformed(#[from] serde_json::Error),
    /// A report of another format.
    #[error("report format {found:?}, expected {expected:?}")]
    Format {
        /// What the report says that it is.
        found: String,
        /// What this program reads.
        expected: &'static str,
    },
}

/// Why a table of frames could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CsvError {
    /// Writing or reading failed.
    #[error("table of frames: {0}")]
    Io(#[from] std::io::Error),
    /// A field does not fit its column.
    #[error("table of frames, line {line}, column {column}: {found:?} is no {expected}")]
    Field {
        /// Line number, from 1 for the header.
        line: usize,
        /// The column's name.
        column: String,
        /// The field as it stands.
        found: String,
        /// What the column holds.
        expected: &'static str,
    },
    /// A line has more or fewer fields than the header.
    #[error("table of frames, line {line}: {found} fields, expected {expected}")]
    Width {
        /// Line number, from 1 for the header.
        line: usize,
        /// Fields in the line.
        found: usize,
        /// Columns in the header.
        expected: usize,
    },
    /// A column is missing, or stands elsewhere.
    #[error("table of frames: column {at} is {found:?}, expected {expected:?}")]
    Header {
        /// The column's number, from 1.
        at: usize,
        /// The column's name as it stands.
        found: String,
        /// The name that was expected; `*_us` for a stage.
        expected: String,
    },
    /// A frame has more or fewer stages than the run names.
    #[error("headset {headset}, frame {frame}: {found} stages, expected {expected}")]
    StageCount {
        /// The headset's name.
        headset: String,
        /// The frame's number.
        frame: u64,
        /// Stages of the frame.
        found: usize,
        /// Stages of the run.
        expected: usize,
    },
}
