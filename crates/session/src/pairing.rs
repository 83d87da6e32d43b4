//! What a headset must know to see.

use std::fmt;

/// A pairing code. What is debugged ends in logs: there it is not told.
#[derive(Clone, PartialEq, Eq)]
pub struct PairingCode(String);

impl PairingCode {
    /// The code itself, to be sent or compared.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl<T: Into<String>> From<T> for PairingCode {
    fn from(code: T) -> Self {
        Self(code.into())
    }
}

impl fmt::Debug for PairingCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_empty() { "none" } else { "secret" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_debugged_tells_that_there_is_a_code_and_not_which() {
        assert_eq!(format!("{:?}", Some(PairingCode::from("482913"))), "Some(secret)");
        assert_eq!(format!("{:?}", PairingCode::from("")), "none");
    }
}
