//! Every queue has an end.

use crate::common::{control, end, next, receiving, server, settings, within};
use std::collections::HashSet;
use std::time::Duration;
use transport::{Event, SendControlError, SendStreamError, TransportSettings};

/// Waits until a connection has no stream under way.
async fn all_streams_done(connection: &transport::Connection) {
    within(async {
        while connection.statistics().streams_under_way > 0 {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    })
    .await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_peer_that_never_reads_its_streams_costs_a_bounded_number() {
    let server = server(&TransportSettings { max_outgoing_streams: 4, ..settings() });
    let (mut client, called) = server.pair(&receiving(100, 1 << 20)).await;
    let mut taken = 0;
    // The client's windows let some through, but what it has not taken in is never more than four streams.
    for id in 0..200 {
        match called.send_stream(id, vec![1; 1 << 20], id as i32) {
            Ok(()) => taken += 1,
            Err(error) => assert_eq!(error, SendStreamError::TooMany { max: 4 }),
        }
    }
    let statistics = called.statistics();
    assert!(statistics.streams_under_way <= 4 && statistics.stream_bytes_under_way <= 4 << 20);
    assert_eq!(statistics.streams_refused, 200 - taken);
    assert!((4..200).contains(&taken));
    for _ in 0..taken {
        assert!(matches!(next(&mut client).await, Event::Stream { bytes } if bytes.len() == 1 << 20));
    }
    all_streams_done(&called).await;
    called.send_stream(1000, vec![1; 10], 0).unwrap();
    assert_eq!(next(&mut client).await, Event::Stream { bytes: vec![1; 10] });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn bytes_under_way_are_bounded_but_one_stream_may_always_go() {
    let server = server(&TransportSettings { max_outgoing_bytes: 1000, ..settings() });
    let (mut client, called) = server.pair(&receiving(0, 1 << 20)).await;
    // The client lets no stream begin.
    called.send_stream(1, vec![1; 2000], 1).unwrap();
    assert_eq!(
        called.send_stream(2, vec![1; 1], 1),
        Err(SendStreamError::TooMuch { under_way: 2000, bytes: 1, max: 1000 })
    );
    assert!(called.reset_stream(1));
    all_streams_done(&called).await;
    assert!(!called.reset_stream(1));
    called.send_stream(2, vec![1; 600], 1).unwrap();
    assert_eq!(called.send_stream(2, vec![1; 1], 1), Err(SendStreamError::NameTaken { id: 2 }));
    // It was never opened, and so the client hears nothing of it.
    drop(called);
    end(&mut client).await;
}

// One thread: what is sent meanwhile is no more than a few turns' worth.
#[tokio::test]
async fn a_reset_is_seen_with_the_first_bytes() {
    let server = server(&settings());
    let window = TransportSettings { stream_receive_window_bytes: 10_000, ..receiving(4, 20 << 20) };
    let (mut client, called) = server.pair(&window).await;
    let bytes: Vec<u8> = (0..10_000_000_u32).map(|i| (i % 251) as u8).collect();
    called.send_stream(5, bytes.clone(), 1).unwrap();
    // Until some of it has come; ten megabytes in pieces of ten kilobytes take far longer than that.
    within(async {
        while client.statistics().bytes_received < 50_000 {
            tokio::select! {
                biased;
                event = client.next_event() => panic!("no event yet, found {event:?}"),
                () = tokio::task::yield_now() => {}
            }
        }
    })
    .await;
    assert!(called.reset_stream(5));
    assert_eq!(next(&mut client).await, Event::StreamReset { part: bytes[..64].to_vec(), code: 0 });
    all_streams_done(&called).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stream_that_is_too_long_is_told_and_the_next_is_read() {
    let server = server(&settings());
    let (mut client, called) = server.pair(&receiving(4, 1000)).await;
    called.send_stream(1, vec![1; 1001], 1).unwrap();
    assert_eq!(next(&mut client).await, Event::StreamTooLarge { max: 1000 });
    all_streams_done(&called).await;
    called.send_stream(2, vec![1; 1000], 1).unwrap();
    assert_eq!(next(&mut client).await, Event::Stream { bytes: vec![1; 1000] });
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn more_streams_than_the_peer_allows_wait_for_their_turn() {
    let server = server(&settings());
    let (mut client, called) = server.pair(&receiving(2, 1 << 20)).await;
    for id in 0..20_u8 {
        called.send_stream(id.into(), vec![id; 50_000], id.into()).unwrap();
    }
    let mut seen = HashSet::new();
    for _ in 0..20 {
        match next(&mut client).await {
            Event::Stream { bytes } => assert!(bytes.len() == 50_000 && seen.insert(bytes[0])),
            other => panic!("expected a stream, found {other:?}"),
        }
    }
    all_streams_done(&called).await;
}

// One thread: both streams are handed over before the first packet leaves.
#[tokio::test]
async fn a_newer_stream_overtakes_an_older_one() {
    let server = server(&settings());
    let windows = TransportSettings { receive_window_bytes: 16 << 20, ..receiving(8, 8 << 20) };
    let windows = TransportSettings { stream_receive_window_bytes: 8 << 20, ..windows };
    let (mut client, called) = server.pair(&windows).await;
    for round in 0..5_u8 {
        let id = u64::from(round) * 2;
        called.send_stream(id, vec![2 * round; 2 << 20], i32::from(round) * 2).unwrap();
        called.send_stream(id + 1, vec![2 * round + 1; 2 << 20], i32::from(round) * 2 + 1).unwrap();
        for expected in [2 * round + 1, 2 * round] {
            match next(&mut client).await {
                Event::Stream { bytes } => assert_eq!(bytes[0], expected),
                other => panic!("expected a stream, found {other:?}"),
            }
        }
        all_streams_done(&called).await;
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_peer_that_does_not_read_control_has_stalled() {
    let server = server(&TransportSettings { max_control_backlog_bytes: 100_000, ..settings() });
    let (mut client, mut called) = server.pair(&settings()).await;
    client.send_control(&b"x"[..]).unwrap();
    control(&mut called, 1).await;
    // The client's window takes some; then the queue fills.
    let mut sent = 0;
    let error = loop {
        match called.send_control(vec![0; 10_000]) {
            Ok(()) => sent += 10_000,
            Err(error) => break error,
        }
        assert!(sent < 50_000_000, "there is no bound");
        tokio::task::yield_now().await;
    };
    assert!(matches!(error, SendControlError::Stalled { max: 100_000, .. }), "{error:?}");
    // Nothing of what was taken is lost.
    assert_eq!(control(&mut client, sent).await.len(), sent);
    // What is larger than the bound goes if nothing waits.
    within(async {
        while called.send_control(vec![0; 300_000]).is_err() {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    })
    .await;
    assert_eq!(control(&mut client, 300_000).await.len(), 300_000);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_flood_of_datagrams_breaks_nothing() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    let flood = tokio::spawn(async move {
        for i in 0..100_000_u32 {
            client.send_datagram(i.to_le_bytes().to_vec());
            if i % 100 == 99 {
                tokio::task::yield_now().await;
            }
        }
        client.send_datagram(vec![0; 70_000]);
        client.send_control(&b"done"[..]).unwrap();
        client
    });
    let mut last = None;
    loop {
        match next(&mut called).await {
            Event::Datagram(bytes) => last = Some(u32::from_le_bytes(bytes[..].try_into().unwrap())),
            Event::Control(bytes) if bytes == b"done"[..] => break,
            other => panic!("unexpected {other:?}"),
        }
    }
    let client = flood.await.unwrap();
    let statistics = client.statistics();
    assert_eq!((statistics.datagrams_sent, statistics.datagrams_too_large), (100_000, 1));
    assert!(last.is_some());
    drop(client);
    end(&mut called).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn streams_of_a_peer_that_may_not_open_any_are_not_opened() {
    let server = server(&settings());
    let (client, mut called) = server.pair(&settings()).await;
    client.send_stream(1, vec![1; 10], 0).unwrap();
    client.send_control(&b"x"[..]).unwrap();
    assert_eq!(control(&mut called, 1).await, b"x");
    assert_eq!(client.statistics().streams_under_way, 1);
}
