//! Why a file is not a volume.

use volume::{GridError, VolumeError};

/// Why a file could not be loaded. `file` is its path, or its name where it came as bytes.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file is missing or may not be read.
    #[error("{file}: cannot be read: {source}")]
    Unreadable {
        /// The file.
        file: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// The content is of no format that is read here.
    #[error(
        "{file}: not a volume: expected DICOM, NIfTI, NRRD, MetaImage, a slice atlas (PNG) or a JSON header, found {found}"
    )]
    UnknownFormat {
        /// The file.
        file: String,
        /// What its first bytes look like.
        found: String,
    },
    /// A field of a header has a value that cannot be.
    #[error("{file}: {field}: expected {expected}, found {found}")]
    Field {
        /// The file.
        file: String,
        /// The field as its format names it, such as `dim[2]`.
        field: String,
        /// What would be accepted.
        expected: String,
        /// What is there.
        found: String,
    },
    /// A JSON file is not JSON, lacks a field, or has one that is not known.
    #[error("{file}: not the JSON expected: {}", printable(.source))]
    Json {
        /// The file.
        file: String,
        /// Field, line and column.
        source: serde_json::Error,
    },
    /// The data end early.
    #[error("{file}: truncated: expected {expected} bytes of {what}, found {found}")]
    Truncated {
        /// The file.
        file: String,
        /// What ends early.
        what: &'static str,
        /// Bytes that the header promises.
        expected: u64,
        /// Bytes that are there, decompressed if the file is compressed.
        found: u64,
    },
    /// A file of raw voxels has another size than its header says.
    #[error("{file}: expected {expected} bytes as its header says, found {found}")]
    FileSize {
        /// The file of voxels.
        file: String,
        /// Bytes that the header promises.
        expected: u64,
        /// Bytes of the file.
        found: u64,
    },
    /// Compressed data are damaged, or could not be read to their end.
    #[error("{file}: damaged {what}: {reason}")]
    Damaged {
        /// The file.
        file: String,
        /// What is damaged: `gzip data`, `PNG`.
        what: &'static str,
        /// What the decoder says.
        reason: String,
    },
    /// The volume is larger than is allowed.
    #[error("{file}: {what} takes {found} bytes, allowed are {allowed}")]
    TooLarge {
        /// The file.
        file: String,
        /// What is too large.
        what: &'static str,
        /// Bytes that it would take.
        found: u128,
        /// Bytes that may be taken, [`crate::LoadOptions::max_bytes`] or less.
        allowed: u64,
    },
    /// The system has no memory for a volume that is allowed.
    #[error("{file}: no memory for {bytes} bytes of voxels")]
    NoMemory {
        /// The file.
        file: String,
        /// Bytes asked for.
        bytes: u64,
    },
    /// A folder has images of several patients. Who they are is not said.
    #[error(
        "{file}: images of one patient are expected, found those of {found}; they can be loaded by force"
    )]
    SeveralPatients {
        /// The folder.
        file: String,
        /// Patients.
        found: usize,
    },
    /// A header names a file outside its own folder.
    #[error("{file}: {field}: expected a file in the header's folder or below it, found {found:?}")]
    OutsideFolder {
        /// The header.
        file: String,
        /// The field that names the other file.
        field: &'static str,
        /// The name as it stands there.
        found: String,
    },
    /// Dimensions, spacing or transform do not make a grid.
    #[error("{file}: {field}: {source}")]
    Grid {
        /// The file.
        file: String,
        /// Where the geometry comes from: `sform`, `qform`, `spacing_mm`.
        field: &'static str,
        /// Why not.
        source: GridError,
    },
    /// The channels do not make a volume.
    #[error("{file}: {source}")]
    Volume {
        /// The file.
        file: String,
        /// Why not.
        source: VolumeError,
    },
}

impl LoadError {
    /// The error without the file's name, which the caller has said.
    pub(crate) fn what(&self) -> String {
        match self {
            Self::Field { field, expected, found, .. } => {
                format!("{field}: expected {expected}, found {found}")
            }
            other => other.to_string(),
        }
    }

    /// A field whose value cannot be.
    pub(crate) fn field(
        file: &str,
        field: impl Into<String>,
        expected: impl Into<String>,
        found: &(impl ToString + ?Sized),
    ) -> Self {
        Self::Field {
            file: file.to_owned(),
            field: field.into(),
            expected: expected.into(),
            found: found.to_string(),
        }
    }
}

/// A message that may quote the file, without what would steer a terminal.
fn printable(message: &impl ToString) -> String {
    message.to_string().replace(char::is_control, "\u{fffd}")
}
