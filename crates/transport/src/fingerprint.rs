//! What a client knows a server by.

use sha2::{Digest, Sha256};
use std::fmt;

/// Bytes of a SHA-256 hash.
const LENGTH: usize = 32;

/// The SHA-256 hash of a certificate's DER bytes, as `openssl x509 -fingerprint -sha256` prints it.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Fingerprint([u8; LENGTH]);

/// Why a text is no fingerprint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FingerprintError {
    /// A character is neither a hexadecimal digit nor something that stands between two.
    #[error("fingerprint has {found:?} at character {position}, expected hexadecimal digits and colons")]
    Digit {
        /// The character.
        found: char,
        /// Which one it is, from 1.
        position: usize,
    },
    /// Too many digits or too few.
    #[error("fingerprint has {found} hexadecimal digits, expected {expected} (SHA-256)")]
    Length {
        /// Digits in the text.
        found: usize,
        /// Digits of a fingerprint.
        expected: usize,
    },
}

impl Fingerprint {
    /// The fingerprint of a certificate, given as DER.
    #[must_use]
    pub fn of_certificate(der: &[u8]) -> Self {
        Self(Sha256::digest(der).into())
    }

    /// Reads 64 hexadecimal digits of either case. Colons, dashes and white space between them are passed over.
    ///
    /// # Errors
    /// If there is anything else, or not 64 digits.
    pub fn parse(text: &str) -> Result<Self, FingerprintError> {
        let mut digits = Vec::with_capacity(2 * LENGTH);
        for (index, found) in text.chars().enumerate() {
            match found.to_digit(16) {
                Some(digit) => digits.push(digit as u8),
                None if found == ':' || found == '-' || found.is_whitespace() => {}
                None => return Err(FingerprintError::Digit { found, position: index + 1 }),
            }
        }
        if digits.len() != 2 * LENGTH {
            return Err(FingerprintError::Length { found: digits.len(), expected: 2 * LENGTH });
        }
        Ok(Self(std::array::from_fn(|i| digits[2 * i] << 4 | digits[2 * i + 1])))
    }
}

impl std::str::FromStr for Fingerprint {
    type Err = FingerprintError;

    fn from_str(text: &str) -> Result<Self, FingerprintError> {
        Self::parse(text)
    }
}

impl fmt::Display for Fingerprint {
    /// `AB:CD:…`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, byte) in self.0.iter().enumerate() {
            write!(f, "{}{byte:02X}", if i == 0 { "" } else { ":" })?;
        }
        Ok(())
    }
}

impl fmt::Debug for Fingerprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Fingerprint({self})")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn it_is_the_hash_that_everybody_knows() {
        // SHA-256 of "abc", FIPS 180-4.
        assert_eq!(
            Fingerprint::of_certificate(b"abc").to_string(),
            "BA:78:16:BF:8F:01:CF:EA:41:41:40:DE:5D:AE:22:23:B0:03:61:A3:96:17:7A:9C:B4:10:FF:61:F2:00:15:AD"
        );
    }

    #[test]
    fn what_is_no_fingerprint_is_said() {
        let check = |text: &str, expected: &str| {
            assert_eq!(Fingerprint::parse(text).unwrap_err().to_string(), expected);
        };
        check("", "fingerprint has 0 hexadecimal digits, expected 64 (SHA-256)");
        check("AB:CD", "fingerprint has 4 hexadecimal digits, expected 64 (SHA-256)");
        check(&"a".repeat(65), "fingerprint has 65 hexadecimal digits, expected 64 (SHA-256)");
        check("AB:CG", "fingerprint has 'G' at character 5, expected hexadecimal digits and colons");
        check("ÄB", "fingerprint has 'Ä' at character 1, expected hexadecimal digits and colons");
    }

    proptest! {
        #[test]
        fn case_and_colons_do_not_matter(bytes in any::<[u8; 32]>()) {
            let fingerprint = Fingerprint(bytes);
            let text = fingerprint.to_string();
            for variant in [
                text.clone(), text.to_lowercase(), text.replace(':', ""), text.replace(':', " "),
                format!(" {}\n", text.replace(':', "-")),
            ] {
                prop_assert_eq!(Fingerprint::parse(&variant), Ok(fingerprint));
            }
        }

        #[test]
        fn no_text_is_too_strange(text in any::<String>()) {
            let _ = Fingerprint::parse(&text);
        }
    }
}
