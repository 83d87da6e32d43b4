//! Coming, going, and the server's own end.

use end_to_end::{Bystander, TestServer, Viewer, settings, subject, threads, until, within};
use headset::{Headset, HeadsetError, HeadsetEvent};
use server::{Settings, StartError};
use session::ClosedBy;
use std::time::Instant;
use transport::{BindError, ConnectError};
use wire::CloseCode;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn one_headset_too_many_is_turned_away_until_a_seat_is_free() {
    let room = TestServer::start(subject(), "{}", Settings { max_headsets: 2, ..settings() });
    let bystander = Bystander::join(&room).await;
    let second = Viewer::join(&room, "second").await;
    for _ in 0..10 {
        let third = room.headset("third");
        let (code, reason) = match Headset::connect(&third, room.pool(), Instant::now()).await {
            Ok(mut headset) => match within("the refusal", headset.next_event()).await {
                HeadsetEvent::Disconnected(end) => {
                    assert_eq!(end.by, ClosedBy::Peer, "{end:?}");
                    (Some(end.code), end.reason)
                }
                other => panic!("expected a refusal, found {other:?}"),
            },
            // The refusal was faster than the headset's hello.
            Err(HeadsetError::Connect(ConnectError::Refused { code, reason, .. })) => {
                (code.and_then(CloseCode::from_value), reason)
            }
            Err(error) => panic!("expected a refusal, found {error}"),
        };
        assert_eq!(code, Some(CloseCode::TooManyHeadsets), "{reason}");
        assert!(reason.contains("2 headsets are connected"), "{reason}");
    }
    second.leave().await;
    until("a seat is free", || room.server.seats().len() == 1).await;
    let mut third = Viewer::join(&room, "third").await;
    third.frame_after(2).await;
    third.leave().await;
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_stops_says_goodbye_and_leaves_port_and_threads() {
    let room = TestServer::start(subject(), "{}", settings());
    let address = room.address();
    let mut viewers = [Viewer::join(&room, "one").await, Viewer::join(&room, "two").await];
    for viewer in &mut viewers {
        viewer.frame_after(3).await;
    }
    room.shutdown().await;
    for viewer in &mut viewers {
        match viewer.notice("the goodbye").await {
            HeadsetEvent::Disconnected(end) => {
                assert_eq!((end.by, end.code), (ClosedBy::Peer, CloseCode::ShuttingDown), "{end:?}");
                assert_eq!(end.reason, "the server shuts down");
            }
            other => panic!("expected a goodbye, found {other:?}"),
        }
    }
    let left: Vec<_> =
        threads().into_iter().filter(|name| name == "render" || name.starts_with("encode")).collect();
    assert!(left.is_empty(), "threads are left: {left:?}");

    let again = TestServer::start(subject(), "{}", Settings { listen: address, ..settings() });
    assert_eq!(again.address(), address);
    let mut viewer = Viewer::join(&again, "again").await;
    viewer.frame_after(3).await;
    viewer.leave().await;
    again.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_server_that_is_dropped_is_gone_for_its_headsets_too() {
    let room = TestServer::start(subject(), "{}", settings());
    let mut viewer = Viewer::join(&room, "viewer").await;
    viewer.frame_after(1).await;
    drop(room);
    match viewer.notice("the end").await {
        HeadsetEvent::Disconnected(end) => assert_ne!(end.by, ClosedBy::Us, "{end:?}"),
        other => panic!("expected the end, found {other:?}"),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_port_in_use_is_named_and_what_to_do() {
    let room = TestServer::start(subject(), "{}", settings());
    let bystander = Bystander::join(&room).await;
    let address = room.address();
    match room.another(Settings { listen: address, ..settings() }) {
        Err(error @ StartError::Bind(BindError::InUse { .. })) => {
            let text = error.to_string();
            assert!(text.contains(&format!("UDP port {} is in use", address.port())), "{text}");
            assert!(text.contains("another port"), "{text}");
        }
        other => panic!("expected a port in use, found {other:?}"),
    }
    bystander.was_not_harmed().await;
    room.shutdown().await;
}
