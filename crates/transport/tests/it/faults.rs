//! Wrong peers, wrong addresses, peers that are gone.

use crate::common::{PROTOCOL, control, end, server, settings, within};
use std::net::UdpSocket;
use std::time::Duration;
use transport::{
    BindError, ConnectError, Identity, SendControlError, SendStreamError, ServerEndpoint, TransportSettings,
    connect,
};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn another_certificate_is_not_trusted_and_both_fingerprints_are_told() {
    let server = server(&settings());
    let other = Identity::ephemeral().unwrap().fingerprint();
    let error = within(connect(&server.address, other, PROTOCOL, &settings())).await.unwrap_err();
    assert!(matches!(error, ConnectError::WrongFingerprint { expected, found, .. }
        if expected == other && found == server.fingerprint));
    let text = error.to_string();
    assert!(text.contains(&other.to_string()) && text.contains(&server.fingerprint.to_string()), "{text}");
    server.is_empty().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn another_protocol_is_refused_by_name() {
    let server = server(&settings());
    let error = within(connect(&server.address, server.fingerprint, b"other/2", &settings())).await;
    let error = error.unwrap_err();
    assert!(matches!(&error, ConnectError::WrongProtocol { asked, .. } if asked == "other/2"), "{error:?}");
    server.is_empty().await;
    // The next one is served.
    server.pair(&settings()).await;
}

#[tokio::test]
async fn a_port_in_use_is_said_to_be() {
    let server = server(&settings());
    let identity = Identity::ephemeral().unwrap();
    let address = server.endpoint.local_addr().unwrap();
    let error = ServerEndpoint::bind(address, &identity, &[PROTOCOL], &settings()).unwrap_err();
    assert!(matches!(error, BindError::InUse { .. }), "{error:?}");
    assert!(error.to_string().contains(&format!("UDP port {} is in use", address.port())), "{error}");
}

#[tokio::test]
async fn an_address_of_another_machine_cannot_be_listened_on() {
    let identity = Identity::ephemeral().unwrap();
    // TEST-NET-1, RFC 5737: nobody's.
    let address = "192.0.2.1:0".parse().unwrap();
    let error = ServerEndpoint::bind(address, &identity, &[PROTOCOL], &settings()).unwrap_err();
    assert!(matches!(error, BindError::NotOurs { .. }), "{error:?}");
}

#[tokio::test]
async fn nobody_there_is_told_after_a_while() {
    let silent = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = silent.local_addr().unwrap().to_string();
    let hasty =
        TransportSettings { handshake_timeout: Duration::from_millis(50), ..TransportSettings::default() };
    let fingerprint = Identity::ephemeral().unwrap().fingerprint();
    let error = within(connect(&address, fingerprint, PROTOCOL, &hasty)).await.unwrap_err();
    assert!(matches!(error, ConnectError::TimedOut { timeout_ms: 50, .. }), "{error:?}");
    assert!(error.to_string().contains(&address), "{error}");
}

#[tokio::test]
async fn an_address_that_is_none_is_told() {
    let fingerprint = Identity::ephemeral().unwrap().fingerprint();
    for server in ["no-port", "host.invalid:1", ":::"] {
        let error = within(connect(server, fingerprint, PROTOCOL, &settings())).await.unwrap_err();
        assert!(matches!(error, ConnectError::Resolve { .. }), "{server}: {error:?}");
        assert!(error.to_string().contains(server), "{error}");
    }
}

#[test]
fn a_peer_that_vanishes_is_noticed() {
    let runtime =
        || tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let (here, there) = (runtime(), runtime());
    let hasty =
        TransportSettings { max_idle_timeout: Duration::from_secs(2), ..TransportSettings::default() };
    let server = here.block_on(async { server(&hasty) });
    let (address, fingerprint) = (server.address.clone(), server.fingerprint);
    let patient = settings();
    let client = there.spawn(async move { connect(&address, fingerprint, PROTOCOL, &patient).await });
    let mut called = here.block_on(within(server.endpoint.accept())).unwrap();
    // With its runtime, the client loses its socket before it can say a word.
    let client = here.block_on(client).unwrap().unwrap();
    there.shutdown_background();
    let (by_peer, code, reason) = here.block_on(end(&mut called));
    assert_eq!((by_peer, code), (false, None));
    assert!(reason.contains("within 2000 ms"), "{reason}");
    assert_eq!(called.send_control(&b"x"[..]), Err(SendControlError::Closed));
    assert_eq!(called.send_stream(1, &b"x"[..], 1), Err(SendStreamError::Closed));
    drop((client, called));
    here.block_on(server.is_empty());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn garbage_on_the_port_disturbs_nobody() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    // All lengths and first bytes: short and long headers, version negotiation, initial packets.
    for i in 0..4000_u32 {
        let length = 1 + (i * 37 % 1400) as usize;
        let mut packet: Vec<u8> = (0..length as u32).map(|j| (i * 31 + j * j * 7) as u8).collect();
        packet[0] = i as u8;
        // A full buffer of the socket is no failure of the test.
        let _ = socket.send_to(&packet, &server.address);
    }
    client.send_control(&b"still here"[..]).unwrap();
    assert_eq!(control(&mut called, 10).await, b"still here");
    drop((client, called));
    server.is_empty().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn peers_that_nobody_accepts_are_refused_in_the_end() {
    let server = server(&TransportSettings { max_handshakes: 2, ..settings() });
    let calls: Vec<_> = (0..20)
        .map(|_| {
            let (address, fingerprint) = (server.address.clone(), server.fingerprint);
            tokio::spawn(async move { connect(&address, fingerprint, PROTOCOL, &settings()).await })
        })
        .collect();
    let mut connections = Vec::new();
    for call in calls {
        match within(call).await.unwrap() {
            Ok(connection) => connections.push(connection),
            Err(error) => assert!(matches!(error, ConnectError::Refused { code: None, .. }), "{error:?}"),
        }
    }
    // Eight wait to be accepted, two are still in their handshake's place.
    assert!((1..=10).contains(&connections.len()), "{} got through", connections.len());
    for _ in &connections {
        assert!(within(server.endpoint.accept()).await.is_some());
    }
    server.pair(&settings()).await;
}
