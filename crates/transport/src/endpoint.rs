//! Where a server listens.

use crate::connection::shortened;
use crate::tls::{TlsError, server_config};
use crate::{Connection, Identity, TransportSettings, socket};
use quinn::{EndpointConfig, TokioRuntime, VarInt};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use tokio::sync::{Mutex, Semaphore, mpsc};
use tokio::time::timeout;

/// Connections that wait to be accepted beside the handshakes.
const ACCEPT_QUEUE: usize = 8;

/// Why a server does not listen.
#[derive(Debug, thiserror::Error)]
pub enum BindError {
    /// Somebody else does.
    #[error(
        "cannot listen on {address}: UDP port {} is in use, perhaps by another server that runs already; \
         stop that one, or listen on another port (0 takes a free one)",
        address.port()
    )]
    InUse {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// The system does not let it.
    #[error("cannot listen on {address}: {source}")]
    Socket {
        /// Where it was to listen.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// There is no address of this machine to listen on.
    #[error("cannot listen on {address}: this machine has no such address; 0.0.0.0 takes all that it has")]
    NotOurs {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// TLS cannot be set up.
    #[error("cannot set up TLS: {0}")]
    Tls(#[from] TlsError),
}

/// A server's UDP port. Handshakes are done in the background, some at a time.
#[derive(Debug)]
pub struct ServerEndpoint {
    endpoint: quinn::Endpoint,
    accepted: Mutex<mpsc::Receiver<Connection>>,
    settings: TransportSettings,
}

impl ServerEndpoint {
    /// Listens on `address` for peers that speak one of `protocols` (ALPN, the best first). To be called inside of a
    /// tokio runtime.
    ///
    /// # Errors
    /// If the port is in use, or is not to be had.
    pub fn bind(
        address: SocketAddr,
        identity: &Identity,
        protocols: &[&[u8]],
        settings: &TransportSettings,
    ) -> Result<Self, BindError> {
        let mut config = quinn::ServerConfig::with_crypto(server_config(identity, protocols)?);
        config
            .transport_config(settings.to_quinn(1))
            // What waits before its handshake has begun is bounded too.
            .max_incoming(2 * settings.max_handshakes);
        let bind_error = |source: io::Error| match source.kind() {
            io::ErrorKind::AddrInUse => BindError::InUse { address },
            io::ErrorKind::AddrNotAvailable => BindError::NotOurs { address },
            _ => BindError::Socket { address, source },
        };
        let socket = socket::bind(address, settings.socket_buffer_bytes).map_err(bind_error)?;
        let endpoint =
            quinn::Endpoint::new(EndpointConfig::default(), Some(config), socket, Arc::new(TokioRuntime))
                .map_err(bind_error)?;
        let (sender, accepted) = mpsc::channel(ACCEPT_QUEUE);
        tokio::spawn(accept_all(endpoint.clone(), settings.clone(), sender));
        Ok(Self { endpoint, accepted: Mutex::new(accepted), settings: settings.clone() })
    }

    /// The next peer whose handshake is done; `None` once the endpoint is closed. Cancel-safe.
    pub async fn accept(&self) -> Option<Connection> {
        self.accepted.lock().await.recv().await
    }

    /// Where it listens: the port that was asked for, or the free one that was found.
    ///
    /// # Errors
    /// If the system does not say.
    pub fn local_addr(&self) -> io::Result<SocketAddr> {
        self.endpoint.local_addr()
    }

    /// Connections that hold memory here: those that live, and for a moment those that have ended.
    #[must_use]
    pub fn open_connections(&self) -> usize {
        self.endpoint.open_connections()
    }

    /// Closes the port and every connection, telling the peers `code` and `reason`, and waits a moment for them to
    /// hear of it. Whatever is to be said on a control stream must have been said before.
    pub async fn close(&self, code: u64, reason: &str) {
        self.endpoint.close(VarInt::from_u64(code).unwrap_or(VarInt::MAX), shortened(reason).as_bytes());
        let _ = timeout(self.settings.close_grace, self.endpoint.wait_idle()).await;
    }
}

impl Drop for ServerEndpoint {
    fn drop(&mut self) {
        // Ends the accepting task too.
        self.endpoint.close(VarInt::from_u32(0), b"dropped");
    }
}

async fn accept_all(
    endpoint: quinn::Endpoint,
    settings: TransportSettings,
    sender: mpsc::Sender<Connection>,
) {
    let handshakes = Arc::new(Semaphore::new(settings.max_handshakes));
    while let Some(incoming) = endpoint.accept().await {
        let peer = incoming.remote_address();
        let incoming =
            if handshakes.available_permits() <= settings.max_handshakes / 2 && incoming.may_retry() {
                // A flood comes from addresses that are not the sender's own: they cannot answer.
                match incoming.retry() {
                    Ok(()) => continue,
                    Err(error) => error.into_incoming(),
                }
            } else {
                incoming
            };
        let Ok(permit) = handshakes.clone().try_acquire_owned() else {
            tracing::warn!(%peer, max = settings.max_handshakes, "refused: too many handshakes at a time");
            incoming.refuse();
            continue;
        };
        let (settings, sender) = (settings.clone(), sender.clone());
        tokio::spawn(async move {
            if let Some(connection) = shake_hands(incoming, settings).await {
                // Nobody accepts any more: the connection is dropped, and so closed.
                let _ = sender.send(connection).await;
            }
            drop(permit);
        });
    }
}

async fn shake_hands(incoming: quinn::Incoming, settings: TransportSettings) -> Option<Connection> {
    let peer = incoming.remote_address();
    let result = match incoming.accept() {
        Ok(connecting) => timeout(settings.handshake_timeout, connecting).await,
        Err(error) => Ok(Err(error)),
    };
    match result {
        Ok(Ok(quinn)) => return Some(Connection::called(quinn, settings)),
        Ok(Err(error)) => tracing::info!(%peer, %error, "handshake failed"),
        Err(_) => {
            let timeout_ms = settings.handshake_timeout.as_millis();
            tracing::info!(%peer, timeout_ms, "handshake took too long");
        }
    }
    None
}
