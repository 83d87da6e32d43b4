//! A server and a client on loopback.

use std::time::Duration;
use tokio::time::timeout;
use transport::{Connection, Event, Fingerprint, Identity, ServerEndpoint, TransportSettings, connect};

pub(crate) const PROTOCOL: &[u8] = b"test/1";
/// After this long a test is taken for stuck. No test takes a hundredth of it on an idle machine.
const STUCK: Duration = Duration::from_secs(60);

pub(crate) struct Server {
    pub(crate) endpoint: ServerEndpoint,
    pub(crate) fingerprint: Fingerprint,
    pub(crate) address: String,
}

pub(crate) fn server(settings: &TransportSettings) -> Server {
    let identity = Identity::ephemeral().expect("there is randomness");
    let endpoint = ServerEndpoint::bind(([127, 0, 0, 1], 0).into(), &identity, &[PROTOCOL], settings)
        .expect("there is a free port");
    let address = endpoint.local_addr().expect("it is bound").to_string();
    Server { endpoint, fingerprint: identity.fingerprint(), address }
}

/// A patient end: a loaded machine must not look like a broken network.
pub(crate) fn settings() -> TransportSettings {
    TransportSettings {
        max_idle_timeout: Duration::from_secs(60),
        handshake_timeout: Duration::from_secs(60),
        ..TransportSettings::default()
    }
}

pub(crate) fn receiving(max_streams: u32, max_bytes: usize) -> TransportSettings {
    TransportSettings {
        max_idle_timeout: Duration::from_secs(60),
        handshake_timeout: Duration::from_secs(60),
        ..TransportSettings::receiving(max_streams, max_bytes)
    }
}

impl Server {
    /// A client and the server's end of its connection.
    pub(crate) async fn pair(&self, settings: &TransportSettings) -> (Connection, Connection) {
        let (client, server) = tokio::join!(
            connect(&self.address, self.fingerprint, PROTOCOL, settings),
            self.endpoint.accept()
        );
        (client.expect("the server answers"), server.expect("the endpoint is open"))
    }

    /// Waits until no connection holds memory any more.
    pub(crate) async fn is_empty(&self) {
        within(async {
            while self.endpoint.open_connections() > 0 {
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        })
        .await;
    }
}

pub(crate) async fn within<T>(future: impl Future<Output = T>) -> T {
    timeout(STUCK, future).await.expect("the test is stuck")
}

pub(crate) async fn next(connection: &mut Connection) -> Event {
    within(connection.next_event()).await
}

/// Collects control bytes until there are `length` of them.
pub(crate) async fn control(connection: &mut Connection, length: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    while bytes.len() < length {
        match next(connection).await {
            Event::Control(piece) => bytes.extend_from_slice(&piece),
            other => panic!("expected control bytes, found {other:?}"),
        }
    }
    bytes
}

/// The end of a connection, whatever comes before it: by whom, with which code, and why.
pub(crate) async fn end(connection: &mut Connection) -> (bool, Option<u64>, String) {
    loop {
        if let Event::Closed { by_peer, code, reason } = next(connection).await {
            return (by_peer, code, reason);
        }
    }
}
