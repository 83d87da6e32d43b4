//! What is said arrives.

use crate::common::{control, end, next, receiving, server, settings, within};
use std::time::Duration;
use transport::{Event, TransportSettings};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn control_datagrams_and_streams_arrive() {
    let server = server(&settings());
    let (mut client, mut called) = server.pair(&receiving(8, 1 << 20)).await;
    assert_eq!(client.protocol().as_deref(), Some(&b"test/1"[..]));

    client.send_control(&b"hello"[..]).unwrap();
    assert_eq!(control(&mut called, 5).await, b"hello");
    called.send_control(&b"wel"[..]).unwrap();
    called.send_control(&b"come"[..]).unwrap();
    assert_eq!(control(&mut client, 7).await, b"welcome");

    // Loopback loses nothing while nothing else is sent.
    client.send_datagram(&b"pose"[..]);
    assert_eq!(next(&mut called).await, Event::Datagram(b"pose"[..].into()));
    called.send_datagram(&b"pong"[..]);
    assert_eq!(next(&mut client).await, Event::Datagram(b"pong"[..].into()));

    let frame = vec![7; 300_000];
    called.send_stream(1, frame.clone(), 1).unwrap();
    assert_eq!(next(&mut client).await, Event::Stream { bytes: frame });
    let empty = Vec::new();
    called.send_stream(2, empty.clone(), 2).unwrap();
    assert_eq!(next(&mut client).await, Event::Stream { bytes: empty });

    let statistics = called.statistics();
    assert!(statistics.bytes_sent > 300_000 && statistics.rtt > Duration::ZERO, "{statistics:?}");
    assert_eq!((statistics.datagrams_sent, statistics.datagrams_too_large), (1, 0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_said_before_the_peer_listens_is_kept() {
    let server = server(&settings());
    let (mut client, mut called) = server.pair(&settings()).await;
    // The control stream is the client's; the server's end does not even know of it yet.
    called.send_control(&b"early"[..]).unwrap();
    client.send_control(&b"x"[..]).unwrap();
    assert_eq!(control(&mut called, 1).await, b"x");
    assert_eq!(control(&mut client, 5).await, b"early");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_large_control_message_arrives_whole_and_in_order() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    let message: Vec<u8> = (0..900_000_u32).map(|i| (i % 251) as u8).collect();
    let (head, tail) = message.split_at(100_000);
    client.send_control(head.to_vec()).unwrap();
    client.send_control(tail.to_vec()).unwrap();
    assert_eq!(control(&mut called, message.len()).await, message);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_event_is_not_lost_when_nobody_waits_for_it_any_more() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    let message: Vec<u8> = (0..200_000_u32).map(|i| (i % 251) as u8).collect();
    client.send_control(message.clone()).unwrap();
    let mut received = Vec::new();
    within(async {
        while received.len() < message.len() {
            // Every wait is given up, at once or in the middle.
            tokio::select! {
                biased;
                event = called.next_event() => match event {
                    Event::Control(piece) => received.extend_from_slice(&piece),
                    other => panic!("expected control bytes, found {other:?}"),
                },
                () = tokio::task::yield_now() => {}
            }
        }
    })
    .await;
    assert_eq!(received, message);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_close_lets_the_last_words_through_and_says_why() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    client.send_control(&b"goodbye"[..]).unwrap();
    let ((), last) = tokio::join!(client.close(7, "that was all"), async {
        let words = control(&mut called, 7).await;
        (words, end(&mut called).await)
    });
    assert_eq!(last, (b"goodbye".to_vec(), (true, Some(7), "that was all".to_owned())));
    assert_eq!(end(&mut called).await.1, Some(7), "the end stays the end");
    drop(called);
    server.is_empty().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_last_words_of_a_server_are_heard_after_its_close() {
    let server = server(&settings());
    let (mut client, mut called) = server.pair(&receiving(8, 1 << 20)).await;
    client.send_control(&b"x"[..]).unwrap();
    control(&mut called, 1).await;
    called.send_control(&b"goodbye"[..]).unwrap();
    called.close(3, "enough").await;
    // Nothing was read until now.
    assert_eq!(control(&mut client, 7).await, b"goodbye");
    assert_eq!(end(&mut client).await, (true, Some(3), "enough".to_owned()));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_closed_endpoint_tells_every_peer_and_accepts_nobody() {
    let server = server(&settings());
    let (mut first, _called) = server.pair(&settings()).await;
    let (mut second, _called_too) = server.pair(&settings()).await;
    server.endpoint.close(1, "shutting down").await;
    for client in [&mut first, &mut second] {
        assert_eq!(end(client).await, (true, Some(1), "shutting down".to_owned()));
    }
    assert!(within(server.endpoint.accept()).await.is_none());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_dropped_connection_is_closed() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    drop(client);
    let (by_peer, _, reason) = end(&mut called).await;
    assert!(by_peer && reason == "dropped", "{reason}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_host_name_is_resolved() {
    let server = server(&settings());
    let port = server.endpoint.local_addr().unwrap().port();
    // Where this name has an IPv6 address too, nobody answers there.
    let name = format!("localhost:{port}");
    let patient = settings();
    let (client, called) = tokio::join!(
        transport::connect(&name, server.fingerprint, crate::common::PROTOCOL, &patient),
        server.endpoint.accept()
    );
    assert_eq!(client.unwrap().remote_address().port(), port);
    assert!(called.is_some());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thousand_connections_leave_nothing_behind() {
    let server = server(&settings());
    // A close that waits for nobody, as a client in a hurry does it.
    let hasty = TransportSettings { close_grace: Duration::ZERO, ..settings() };
    for round in 0..1000 {
        let (client, mut called) = server.pair(&hasty).await;
        if round % 2 == 0 {
            client.send_control(&b"x"[..]).unwrap();
        }
        client.close(0, "goodbye").await;
        assert_eq!(end(&mut called).await.1, Some(0));
    }
    server.is_empty().await;
}
