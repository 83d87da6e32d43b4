//! From value to bytes and back: fixed-width little-endian, all bytes used, never more memory than the limit.

use bincode::config::{Configuration, Fixint, Limit, LittleEndian};
use bincode::{Decode, Encode};

/// What is being encoded or decoded, for the error's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A message on the control stream.
    ControlMessage,
    /// A QUIC datagram.
    Datagram,
    /// The header of a frame.
    FrameHeader,
    /// The picture of a frame.
    AccessUnit,
    /// The whole content of a frame's stream.
    FrameStream,
}

impl std::fmt::Display for What {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::ControlMessage => "control message",
            Self::Datagram => "datagram",
            Self::FrameHeader => "frame header",
            Self::AccessUnit => "access unit",
            Self::FrameStream => "frame stream",
        })
    }
}

/// Why a value has no bytes in this protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The value is larger than the peer must accept.
    #[error("{what} has {bytes} bytes, expected at most {max}")]
    TooLarge {
        /// What was encoded.
        what: What,
        /// Its size in bytes.
        bytes: usize,
        /// The limit in bytes.
        max: usize,
    },
    /// The depth grid's distances do not fill its columns and rows for two eyes.
    #[error("depth grid has {found} distances, expected 2 × {columns} × {rows}")]
    DepthGridSize {
        /// Columns of one eye.
        columns: u16,
        /// Rows of one eye.
        rows: u16,
        /// Distances present.
        found: usize,
    },
    /// The header states another length than the access unit has.
    #[error("frame header states an access unit of {stated} bytes, found {found}")]
    AccessUnitLength {
        /// What the header says.
        stated: u32,
        /// The access unit's length in bytes.
        found: usize,
    },
}

/// Why bytes are no value of this protocol.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// There are more bytes than the protocol allows, or the bytes announce more.
    #[error("{what} has {bytes} bytes, expected at most {max}")]
    TooLarge {
        /// What was decoded.
        what: What,
        /// Bytes present or announced.
        bytes: usize,
        /// The limit in bytes.
        max: usize,
    },
    /// A text or a list announces more content than the limit of its message.
    #[error("{what} announces content beyond its limit of {max} bytes")]
    BeyondLimit {
        /// What was decoded.
        what: What,
        /// The limit in bytes.
        max: usize,
    },
    /// The bytes end too early.
    #[error("{what} ends after {found} bytes, expected at least {missing} more")]
    Truncated {
        /// What was decoded.
        what: What,
        /// Bytes present.
        found: usize,
        /// Bytes that are missing at least.
        missing: usize,
    },
    /// There are bytes left when the value is complete.
    #[error("{what} is complete after {used} bytes, found {found}")]
    Trailing {
        /// What was decoded.
        what: What,
        /// Bytes that the value takes.
        used: usize,
        /// Bytes present.
        found: usize,
    },
    /// A discriminant names no known variant.
    #[error("{what}: {found} is no variant of {type_name}")]
    UnknownVariant {
        /// What was decoded.
        what: What,
        /// The type in question.
        type_name: &'static str,
        /// The discriminant found.
        found: u32,
    },
    /// A truth value is neither 0 nor 1.
    #[error("{what}: a truth value is {found}, expected 0 or 1")]
    BadBool {
        /// What was decoded.
        what: What,
        /// The byte found.
        found: u8,
    },
    /// A text is not UTF-8.
    #[error("{what}: a text is not UTF-8 after its first {valid_up_to} bytes")]
    BadText {
        /// What was decoded.
        what: What,
        /// Bytes of the text that are fine.
        valid_up_to: usize,
    },
    /// The depth grid's distances do not fill its columns and rows for two eyes.
    #[error("depth grid has {found} distances, expected 2 × {columns} × {rows}")]
    DepthGridSize {
        /// Columns of one eye.
        columns: u16,
        /// Rows of one eye.
        rows: u16,
        /// Distances present.
        found: usize,
    },
    /// The header states another length than the access unit has.
    #[error("frame header states an access unit of {stated} bytes, found {found}")]
    AccessUnitLength {
        /// What the header says.
        stated: u32,
        /// Bytes present after the header.
        found: usize,
    },
    /// Anything else that the decoder found wrong.
    #[error("{what} is malformed")]
    Malformed {
        /// What was decoded.
        what: What,
    },
}

fn config<const MAX: usize>() -> Configuration<LittleEndian, Fixint, Limit<MAX>> {
    bincode::config::standard().with_little_endian().with_fixed_int_encoding().with_limit::<MAX>()
}

/// The bytes of `value`, appended to `out`. Returns how many.
pub(crate) fn append<const MAX: usize>(
    what: What,
    value: &impl Encode,
    out: &mut Vec<u8>,
) -> Result<usize, EncodeError> {
    let before = out.len();
    bincode::encode_into_std_write(value, out, config::<MAX>())
        .expect("plain numbers, texts and lists written to memory cannot fail");
    let bytes = out.len() - before;
    if bytes > MAX {
        out.truncate(before);
        return Err(EncodeError::TooLarge { what, bytes, max: MAX });
    }
    Ok(bytes)
}

/// The value of which `bytes` are all the bytes.
pub(crate) fn decode_all<const MAX: usize, T: Decode<()>>(
    what: What,
    bytes: &[u8],
) -> Result<T, DecodeError> {
    let found = bytes.len();
    if found > MAX {
        return Err(DecodeError::TooLarge { what, bytes: found, max: MAX });
    }
    match bincode::decode_from_slice::<T, _>(bytes, config::<MAX>()) {
        Ok((value, used)) if used == found => Ok(value),
        Ok((_, used)) => Err(DecodeError::Trailing { what, used, found }),
        Err(error) => Err(typed::<MAX>(what, found, &error)),
    }
}

fn typed<const MAX: usize>(what: What, found: usize, error: &bincode::error::DecodeError) -> DecodeError {
    use bincode::error::DecodeError as Theirs;
    match *error {
        Theirs::UnexpectedEnd { additional } => DecodeError::Truncated { what, found, missing: additional },
        Theirs::LimitExceeded | Theirs::OutsideUsizeRange(_) => DecodeError::BeyondLimit { what, max: MAX },
        Theirs::UnexpectedVariant { type_name, found, .. } => {
            DecodeError::UnknownVariant { what, type_name, found }
        }
        Theirs::InvalidBooleanValue(found) => DecodeError::BadBool { what, found },
        Theirs::Utf8 { inner } => DecodeError::BadText { what, valid_up_to: inner.valid_up_to() },
        _ => DecodeError::Malformed { what },
    }
}
