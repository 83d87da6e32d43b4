//! How a session ends.

use wire::CloseCode;

/// Who ended the session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClosedBy {
    /// This end, because it was asked to or because the peer broke a rule.
    Us,
    /// The peer, with a goodbye or by closing the connection.
    Peer,
    /// The network: the connection broke without a word.
    Network,
}

/// How a session ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disconnection {
    /// Who ended it.
    pub by: ClosedBy,
    /// Why, for programs.
    pub code: CloseCode,
    /// Why, for people: what was expected and what was found.
    pub reason: String,
}

/// Longest reason that is sent or kept, in bytes: it has to fit a log line and the packet that closes the connection.
const MAX_REASON_BYTES: usize = 512;

/// The reason, cut at a character's end if it is too long.
pub(crate) fn bounded_reason(reason: &str) -> String {
    let mut end = reason.len().min(MAX_REASON_BYTES);
    while !reason.is_char_boundary(end) {
        end -= 1;
    }
    reason[..end].to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_is_cut_at_a_characters_end() {
        assert_eq!(bounded_reason("expected 1"), "expected 1");
        assert_eq!(bounded_reason(&"é".repeat(400)), "é".repeat(256));
        assert_eq!(bounded_reason(&format!("a{}", "é".repeat(400))).len(), 511);
    }
}
