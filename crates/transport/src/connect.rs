//! Calling a server.

use crate::tls::{TlsError, client_config};
use crate::{Connection, Fingerprint, TransportSettings, socket};
use quinn::{ConnectionError, EndpointConfig, TokioRuntime, TransportErrorCode};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::{Arc, OnceLock};
use std::time::Duration;
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

/// How much later each further address of a host is tried, while the earlier ones are still waited for (RFC 8305).
const NEXT_ADDRESS_AFTER: Duration = Duration::from_millis(250);
/// QUIC's number for the TLS alert `no_application_protocol` (RFC 9001 section 4.8, RFC 7301 section 3.2).
const NO_APPLICATION_PROTOCOL: u8 = 120;
/// TLS wants a name. The certificate is known by its fingerprint, so that no name is looked at.
const SERVER_NAME: &str = "localhost";

/// Why there is no connection.
#[derive(Debug, thiserror::Error)]
pub enum ConnectError {
    /// The host's name leads nowhere.
    #[error("cannot find {server}: {source}; expected HOST:PORT")]
    Resolve {
        /// As it was given.
        server: String,
        /// What the system said.
        source: io::Error,
    },
    /// The host's name is known but has no address.
    #[error("{server} has no address")]
    NoAddress {
        /// As it was given.
        server: String,
    },
    /// There is no socket to call with.
    #[error("cannot open a UDP socket to reach {address}: {source}")]
    Socket {
        /// Where it was to lead.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// Nobody answered.
    #[error(
        "no answer from {address} within {timeout_ms} ms: is the server running there, and does every firewall let \
         UDP port {} through?",
        address.port()
    )]
    TimedOut {
        /// Where it was looked for.
        address: SocketAddr,
        /// How long it was waited for, in milliseconds.
        timeout_ms: u128,
    },
    /// Somebody else answered.
    #[error(
        "the server at {address} shows a certificate with fingerprint {found}, expected {expected}: it is another \
         server, or it has a new identity"
    )]
    WrongFingerprint {
        /// Where it is.
        address: SocketAddr,
        /// The one that was pinned.
        expected: Fingerprint,
        /// The one that was shown.
        found: Fingerprint,
    },
    /// The server speaks something else.
    #[error("the server at {address} does not speak {asked:?}: it has another version, or is no such server")]
    WrongProtocol {
        /// Where it is.
        address: SocketAddr,
        /// What was asked for (ALPN).
        asked: String,
    },
    /// The server does not want to.
    #[error("the server at {address} refused the connection: {reason}")]
    Refused {
        /// Where it is.
        address: SocketAddr,
        /// The application's code, where it gave one.
        code: Option<u64>,
        /// The reason that it gave.
        reason: String,
    },
    /// The handshake failed for another reason.
    #[error("the handshake with {address} failed: {source}")]
    Handshake {
        /// Where the server is.
        address: SocketAddr,
        /// What QUIC or TLS said.
        source: ConnectionError,
    },
    /// TLS cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] TlsError),
}

/// Connects to `server` (host and port), which must hold the pinned certificate's key and speak `protocol` (ALPN).
/// Where the host has several addresses, the first that answers is taken. To be called inside of a tokio runtime.
///
/// # Errors
/// If the host is not found, does not answer in time, is somebody else, speaks something else, or refuses.
pub async fn connect(
    server: &str,
    pinned: Fingerprint,
    protocol: &[u8],
    settings: &TransportSettings,
) -> Result<Connection, ConnectError> {
    let addresses = tokio::net::lookup_host(server)
        .await
        .map_err(|source| ConnectError::Resolve { server: server.to_owned(), source })?;
    let mut attempts = JoinSet::new();
    for (address, delay) in addresses.zip(0..) {
        let (protocol, settings) = (protocol.to_vec(), settings.clone());
        attempts.spawn(async move {
            sleep(delay * NEXT_ADDRESS_AFTER).await;
            connect_to(address, pinned, &protocol, settings).await
        });
    }
    let mut failure = None;
    while let Some(attempt) = attempts.join_next().await {
        match attempt {
            Ok(Ok(connection)) => return Ok(connection),
            // An answer says more than none.
            Ok(Err(error)) if failure.is_none() || !matches!(error, ConnectError::TimedOut { .. }) => {
                failure = Some(error);
            }
            Ok(Err(_)) => {}
            Err(error) => {
                if let Ok(panic) = error.try_into_panic() {
                    std::panic::resume_unwind(panic);
                }
            }
        }
    }
    Err(failure.unwrap_or_else(|| ConnectError::NoAddress { server: server.to_owned() }))
}

async fn connect_to(
    address: SocketAddr,
    pinned: Fingerprint,
    protocol: &[u8],
    settings: TransportSettings,
) -> Result<Connection, ConnectError> {
    let found = Arc::new(OnceLock::new());
    let mut config = quinn::ClientConfig::new(client_config(pinned, &[protocol], found.clone())?);
    config.transport_config(settings.to_quinn(0));
    let any: IpAddr =
        if address.is_ipv4() { Ipv4Addr::UNSPECIFIED.into() } else { Ipv6Addr::UNSPECIFIED.into() };
    let socket_error = |source| ConnectError::Socket { address, source };
    let socket = socket::bind((any, 0).into(), settings.socket_buffer_bytes).map_err(socket_error)?;
    let endpoint = quinn::Endpoint::new(EndpointConfig::default(), None, socket, Arc::new(TokioRuntime))
        .map_err(socket_error)?;
    let failed = |source| match found.get() {
        Some(found) => ConnectError::WrongFingerprint { address, expected: pinned, found: *found },
        None => failure(address, protocol, &settings, source),
    };
    let connecting = endpoint
        .connect_with(config, address, SERVER_NAME)
        .map_err(|error| socket_error(io::Error::new(io::ErrorKind::InvalidInput, error)))?;
    let quinn = timeout(settings.handshake_timeout, connecting)
        .await
        .unwrap_or(Err(ConnectionError::TimedOut))
        .map_err(failed)?;
    // The server allows one such stream from the beginning, so that this does not wait.
    let control = quinn.open_bi().await.map_err(failed)?;
    Ok(Connection::calling(quinn, endpoint, control, settings))
}

fn failure(
    address: SocketAddr,
    protocol: &[u8],
    settings: &TransportSettings,
    source: ConnectionError,
) -> ConnectError {
    match source {
        ConnectionError::TimedOut => {
            ConnectError::TimedOut { address, timeout_ms: settings.handshake_timeout.as_millis() }
        }
        ConnectionError::ConnectionClosed(close)
            if close.error_code == TransportErrorCode::crypto(NO_APPLICATION_PROTOCOL) =>
        {
            ConnectError::WrongProtocol { address, asked: String::from_utf8_lossy(protocol).into_owned() }
        }
        ConnectionError::ConnectionClosed(close)
            if close.error_code == TransportErrorCode::CONNECTION_REFUSED =>
        {
            let reason = "it has too many callers at this moment".to_owned();
            ConnectError::Refused { address, code: None, reason }
        }
        ConnectionError::ApplicationClosed(close) => ConnectError::Refused {
            address,
            code: Some(close.error_code.into_inner()),
            reason: String::from_utf8_lossy(&close.reason).into_owned(),
        },
        source => ConnectError::Handshake { address, source },
    }
}
