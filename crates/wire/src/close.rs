//! Why a connection ends.

use bincode::{Decode, Encode};

/// Why a connection ends: the application error code of the QUIC close, and the code of a [`crate::Goodbye`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Encode, Decode)]
#[cfg_attr(test, derive(serde::Serialize, serde::Deserialize))]
#[repr(u32)]
pub enum CloseCode {
    /// The headset or the server has done what it came for.
    Goodbye = 0,
    /// The server is being stopped.
    ShuttingDown = 1,
    /// The peers speak different versions.
    BadVersion = 2,
    /// A message could not be decoded, came at the wrong time, or held numbers that mean nothing.
    BadMessage = 3,
    /// The device description is one that cannot be served.
    BadDevice = 4,
    /// The pairing code is missing or wrong.
    NotPaired = 5,
    /// The server serves as many headsets as it may.
    TooManyHeadsets = 6,
    /// The peer takes part in the conversation but does not read its frames.
    Stalled = 7,
    /// Nothing has come from the peer for too long.
    Idle = 8,
    /// Something broke that is not the peer's fault.
    Internal = 9,
}

impl CloseCode {
    /// All codes, in the order of their values.
    pub const ALL: [Self; 10] = [
        Self::Goodbye,
        Self::ShuttingDown,
        Self::BadVersion,
        Self::BadMessage,
        Self::BadDevice,
        Self::NotPaired,
        Self::TooManyHeadsets,
        Self::Stalled,
        Self::Idle,
        Self::Internal,
    ];

    /// The value that travels.
    #[must_use]
    pub fn value(self) -> u32 {
        self as u32
    }

    /// The code of a value that came from the peer; `None` where this version knows no such code.
    #[must_use]
    pub fn from_value(value: u64) -> Option<Self> {
        Self::ALL.into_iter().find(|code| u64::from(code.value()) == value)
    }
}

impl std::fmt::Display for CloseCode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Goodbye => "goodbye",
            Self::ShuttingDown => "server shutting down",
            Self::BadVersion => "bad version",
            Self::BadMessage => "bad message",
            Self::BadDevice => "bad device description",
            Self::NotPaired => "not paired",
            Self::TooManyHeadsets => "too many headsets",
            Self::Stalled => "stalled",
            Self::Idle => "idle",
            Self::Internal => "internal error",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_comes_back_from_its_value() {
        for (value, code) in CloseCode::ALL.into_iter().enumerate() {
            assert_eq!(code.value() as usize, value);
            assert_eq!(CloseCode::from_value(value as u64), Some(code));
        }
        assert_eq!(CloseCode::from_value(10), None);
        assert_eq!(CloseCode::from_value(1 << 32), None);
    }
}
