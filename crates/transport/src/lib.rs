//! One QUIC connection as a pump: control bytes, datagrams and whole streams go in at one end and come out at the
//! other as [`Event`]s.
//!
//! - A server has an [`Identity`], a self-signed certificate that is made at its first start. A client knows the
//!   server by the certificate's [`Fingerprint`] and trusts nothing else.
//! - [`ServerEndpoint::bind`] listens and [`connect`] calls; both give a [`Connection`].
//! - Whoever owns a [`Connection`] calls [`Connection::next_event`] in a loop. Nothing is read from the network faster
//!   than that: what waits, waits in QUIC's own windows, and the peer is slowed down or, for datagrams, the oldest are
//!   dropped.
//! - Sending never waits. Every queue has a bound in [`TransportSettings`], and a full one says so.
//! - A dropped [`Connection`] is closed and leaves nothing behind.
//!
//! This crate does not know what the bytes mean: no message, no session, no picture.

mod connect;
mod connection;
mod control;
mod endpoint;
mod fingerprint;
mod identity;
mod settings;
mod socket;
mod statistics;
mod streams;
mod tls;

pub use connect::{ConnectError, connect};
pub use connection::{Connection, Event};
pub use control::SendControlError;
pub use endpoint::{BindError, ServerEndpoint};
pub use fingerprint::{Fingerprint, FingerprintError};
pub use identity::{Identity, IdentityError};
pub use settings::TransportSettings;
pub use statistics::Statistics;
pub use streams::SendStreamError;
pub use tls::TlsError;

/// The bytes of control and datagram events, re-exported so that the crates above agree on one version.
pub use bytes::Bytes;
