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
