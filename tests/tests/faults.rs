//! Peers that are not what they should be: each is told why it has to go, and nobody else notices.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use end_to_end::{
    Bystander, Cable, REFRESH_HZ, RawPeer, TestServer, Viewer, device, in_front, settings, subject, until,
    within,
};
use headset::{Headset, HeadsetEvent, HeadsetSettings};
use server::Settings;
use session::{ClosedBy, Disconnection};
use std::time::{Duration, Instant};
use transport::{ConnectError, Identity, TransportSettings};
use wire::{ClientDatagram, ClientMessage, ClientStatistics, CloseCode, Hello, PoseSample};

fn room() -> TestServer {
    TestServer::start(subject(), "{}", settings())
}

/// A room with somebody in it who is to notice nothing.
async fn room_with_bystander() -> (TestServer, Bystander) {
    let room = room();
    let bystander = Bystander::join(&room).await;
    (room, bystander)
}

/// A control message of any bytes.
fn prefixed(body: &[u8]) -> Vec<u8> {
    let length = u32::try_from(body.len()).unwrap();
    [&length.to_le_bytes(), body].concat()
}

fn body_of(message: &ClientMessage) -> Vec<u8> {
    message.encode().unwrap().split_off(4)
}

/// How a headset is turned away.
async fn turned_away(room: &TestServer, settings: &HeadsetSettings) -> Disconnection {
    let mut headset =
        within("a connection", Headset::connect(settings, room.pool(), Instant::now())).await.unwrap();
    match within("the end", headset.next_event()).await {
        HeadsetEvent::Disconnected(disconnection) => disconnection,
        other => panic!("expected to be turned away, found {other:?}"),
    }
}

#[track_caller]
fn assert_turned_away(found: &Disconnection, code: CloseCode, reason: &str) {
    assert_eq!((found.by, found.code), (ClosedBy::Peer, code), "{found:?}");
    assert!(found.reason.contains(reason), "expected '{reason}' in {found:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_speaks_another_protocol_or_looks_for_another_server_is_told_so() {
    let (room, bystander) = room_with_bystander().await;
    let address = room.address().to_string();
    let connect = async |fingerprint, protocol: &[u8]| {
        let settings = TransportSettings::receiving(1, 1);
        within("an answer", transport::connect(&address, fingerprint, protocol, &settings)).await
    };
    match connect(room.fingerprint(), b"holocast/2").await {
        Err(error @ ConnectError::WrongProtocol { .. }) => {
            assert!(error.to_string().contains("does not speak \"holocast/2\""), "{error}");
        }
        other => panic!("expected another protocol, found {other:?}"),
    }
    let other = Identity::ephemeral().unwrap().fingerprint();
    match connect(other, wire::ALPN).await {
        Err(error @ ConnectError::WrongFingerprint { .. }) => {
            let (expected, found) = (other.to_string(), room.fingerprint().to_string());
            assert!(error.to_string().contains(&expected) && error.to_string().contains(&found), "{error}");
        }
        other => panic!("expected another server, found {other:?}"),
    }
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_who_knows_the_pairing_code_sees() {
    let room =
        TestServer::start(subject(), "{}", Settings { pairing_code: Some("482913".into()), ..settings() });
    let with = |code: &str| HeadsetSettings { pairing_code: code.into(), ..room.headset("guest") };
    let mut inside = Viewer::join_as(&room, &with("482913"), |_| in_front()).await;
    inside.frame_after(0).await;
    for (code, reason) in [("", "no pairing code"), ("482914", "wrong pairing code"), ("4829130", "wrong")] {
        let end = turned_away(&room, &with(code)).await;
        assert_turned_away(&end, CloseCode::NotPaired, reason);
        assert!(!end.reason.contains("482913"), "the reason tells the code: {}", end.reason);
    }
    inside.frame_after(3).await;
    inside.leave().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_guesses_pairing_codes_is_soon_not_heard_even_with_the_right_one() {
    let room =
        TestServer::start(subject(), "{}", Settings { pairing_code: Some("482913".into()), ..settings() });
    let with = |code: &str| HeadsetSettings { pairing_code: code.into(), ..room.headset("guest") };
    let mut inside = Viewer::join_as(&room, &with("482913"), |_| in_front()).await;
    inside.frame_after(0).await;
    for guess in 0..5 {
        let end = turned_away(&room, &with(&format!("00000{guess}"))).await;
        assert_turned_away(&end, CloseCode::NotPaired, "wrong pairing code");
    }
    for code in ["000005", "482913"] {
        let end = turned_away(&room, &with(code)).await;
        assert_turned_away(&end, CloseCode::NotPaired, "too many wrong pairing codes");
    }
    inside.frame_after(3).await;
    inside.leave().await;
    room.is_empty().await;
    room.shutdown().await;
}

/// What is said on the control stream instead of a hello.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_no_hello_is_answered_with_code_and_reason() {
    let (room, bystander) = room_with_bystander().await;
    let hello = RawPeer::hello();
    let of_version_2 = ClientMessage::Hello(Hello { version: 2, ..hello.clone() });
    let unreadable_version_9 = [&[0, 0, 0, 0, 9, 0], &[0xff; 20][..]].concat();
    let whole = body_of(&ClientMessage::Hello(hello));
    let scene = ClientMessage::ChangeScene { request_id: 0, scene_json: "{}".into() };
    let too_large = u32::try_from(wire::MAX_CONTROL_BYTES).unwrap() + 1;
    for (what, bytes, code, reason) in [
        (
            "version 2",
            of_version_2.encode().unwrap(),
            CloseCode::BadVersion,
            "protocol version is 2, expected 1",
        ),
        (
            "version 9, with an unreadable rest",
            prefixed(&unreadable_version_9),
            CloseCode::BadVersion,
            "protocol version is 9, expected 1",
        ),
        ("garbage", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n".to_vec(), CloseCode::BadMessage, "at most 262144"),
        ("a garbled body", prefixed(&[0xee; 40]), CloseCode::BadMessage, "is no variant of ClientMessage"),
        ("an empty body", prefixed(&[]), CloseCode::BadMessage, "ends after 0 bytes"),
        ("half a hello", prefixed(&whole[..whole.len() / 2]), CloseCode::BadMessage, "ends after"),
        (
            "a hello and more",
            prefixed(&[&whole[..], &[0; 3]].concat()),
            CloseCode::BadMessage,
            "is complete after",
        ),
        (
            "a message that announces too much",
            too_large.to_le_bytes().to_vec(),
            CloseCode::BadMessage,
            "has 262145 bytes, expected at most 262144",
        ),
        (
            "a scene before a hello",
            scene.encode().unwrap(),
            CloseCode::BadMessage,
            "first message is not a hello",
        ),
    ] {
        let peer = RawPeer::connect(&room).await;
        peer.say_bytes(bytes);
        let ending = peer.ending().await;
        println!("{what}: {ending:?}");
        ending.assert_is(code, reason);
    }
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

/// What is said after the welcome.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_no_message_ends_a_session_with_code_and_reason() {
    let (room, bystander) = room_with_bystander().await;
    let hello = ClientMessage::Hello(RawPeer::hello()).encode().unwrap();
    let statistics = body_of(&ClientMessage::Statistics(ClientStatistics::default()));
    for (what, bytes, reason) in [
        ("a second hello", hello, "second hello"),
        ("garbage", vec![0xff; 100], "at most 262144"),
        ("half a message", prefixed(&statistics[..statistics.len() - 1]), "ends after"),
        (
            "a text that is none",
            prefixed(&[&[1, 0, 0, 0, 7, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0], &[0xff][..]].concat()),
            "UTF-8",
        ),
    ] {
        let mut peer = RawPeer::connect(&room).await;
        peer.be_welcomed().await;
        let pose = peer.pose(0);
        peer.send_pose(pose);
        peer.frames(1).await;
        peer.say_bytes(bytes);
        let ending = peer.ending().await;
        println!("{what}: {ending:?}");
        ending.assert_is(CloseCode::BadMessage, reason);
    }
    let pose = ClientDatagram::Pose(RawPeer::pose_of(0, 0)).encode();
    for (what, datagram, reason) in [
        ("an empty datagram", vec![], "ends after 0 bytes"),
        ("a garbled datagram", vec![0xee; 30], "is no variant of ClientDatagram"),
        ("half a pose", pose[..pose.len() / 2].to_vec(), "ends after"),
        ("a pose and more", [&pose[..], &[1]].concat(), "is complete after"),
    ] {
        let mut peer = RawPeer::connect(&room).await;
        // Before the hello, a datagram is worth nothing and harms nobody: it may have overtaken it.
        peer.connection.send_datagram(datagram.clone());
        until("the datagram has come", || {
            let seats = room.server.seats();
            seats.iter().any(|seat| seat.device.is_none() && seat.counters.datagrams_early == 1)
        })
        .await;
        peer.be_welcomed().await;
        peer.connection.send_datagram(datagram);
        let ending = peer.ending().await;
        println!("{what}: {ending:?}");
        ending.assert_is(CloseCode::BadMessage, reason);
    }
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_says_nothing_or_stops_in_the_middle_of_a_hello_has_to_go_after_a_while() {
    let (room, bystander) = room_with_bystander().await;
    let (silent, halting) = (RawPeer::connect(&room).await, RawPeer::connect(&room).await);
    let hello = ClientMessage::Hello(RawPeer::hello()).encode().unwrap();
    halting.say_bytes(hello[..hello.len() - 1].to_vec());
    let (silent, halting) = tokio::join!(silent.ending(), halting.ending());
    for ending in [silent, halting] {
        // A peer whose control stream was never used hears of the end by the close alone.
        assert_eq!(ending.code, Some(CloseCode::Idle), "{ending:?}");
        assert_eq!(ending.reason, "no hello within 5000 ms");
    }
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_headset_that_cannot_be_served_is_told_which_number_is_wrong() {
    let (room, bystander) = room_with_bystander().await;
    let quarter_turn = std::f32::consts::FRAC_PI_2;
    type Spoil = fn(&mut wire::DeviceDescription, f32);
    let cases: [(&str, Spoil, &str); 11] = [
        ("0° wide", |d, _| (d.eyes[0].fov.left_rad, d.eyes[0].fov.right_rad) = (0.0, 0.0), "spans 0.000°"),
        ("180° wide", |d, q| (d.eyes[1].fov.left_rad, d.eyes[1].fov.right_rad) = (-q, q), "edge at -90.00°"),
        ("180° high", |d, q| (d.eyes[1].fov.up_rad, d.eyes[1].fov.down_rad) = (q, -q), "at most 85°"),
        ("inside out", |d, _| (d.eyes[0].fov.left_rad, d.eyes[0].fov.right_rad) = (0.3, -0.3), "left eye"),
        ("no angle", |d, _| d.eyes[0].fov.up_rad = f32::NAN, "left eye"),
        (
            "an eye without a direction",
            |d, _| d.eyes[1].head_from_eye.orientation_xyzw = [0.0; 4],
            "length 0",
        ),
        ("an eye nowhere", |d, _| d.eyes[1].head_from_eye.position_m[2] = f32::INFINITY, "right eye"),
        ("odd pixels", |d, _| d.eye_width_px = 97, "97×64"),
        ("more pixels than are coded", |d, _| (d.eye_width_px, d.eye_height_px) = (4096, 4096), "8192"),
        ("no rate", |d, _| d.refresh_hz = f32::NAN, "refresh rate"),
        ("a long name", |d, _| d.name = "x".repeat(65), "at most 64"),
    ];
    for (what, spoil, reason) in cases {
        let mut description = device("spoilt").to_wire();
        spoil(&mut description, quarter_turn);
        let peer = RawPeer::connect(&room).await;
        peer.say(&ClientMessage::Hello(Hello { device: description, ..RawPeer::hello() }));
        let ending = peer.ending().await;
        println!("{what}: {ending:?}");
        ending.assert_is(CloseCode::BadDevice, reason);
    }
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

/// Poses whose numbers are none, and what is wrong with them.
fn impossible_poses(mut pose: impl FnMut() -> PoseSample) -> Vec<(PoseSample, &'static str)> {
    let mut with = |position_m: [f32; 3], orientation_xyzw: [f32; 4]| {
        let good = pose();
        PoseSample { world_from_head: wire::Pose { position_m, orientation_xyzw }, ..good }
    };
    let (here, straight) = ([0.0, 1.5, -1.0], [0.0, 0.0, 0.0, 1.0]);
    vec![
        (with([f32::NAN, 0.0, 0.0], straight), "position"),
        (with([0.0, f32::NEG_INFINITY, 0.0], straight), "position"),
        (with([0.0, 0.0, 3.0e38], straight), "position"),
        (with(here, [0.0, 0.0, 0.0, 0.0]), "length 0"),
        (with(here, [0.0, 0.0, 0.0, 2.0]), "length 2"),
        (with(here, [1.0e30, 0.0, 0.0, 1.0]), "length"),
        (with(here, [f32::NAN, 0.0, 0.0, 1.0]), "orientation"),
        (with(here, [0.0, f32::INFINITY, 0.0, 0.0]), "orientation"),
    ]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn poses_that_are_none_make_no_frame_and_too_many_of_them_end_the_session() {
    let (room, bystander) = room_with_bystander().await;
    let mut peer = RawPeer::connect(&room).await;
    let session = peer.be_welcomed().await.session_id;
    let counters = || room.seat(session).unwrap().counters;
    let bad = impossible_poses(|| peer.pose(0));
    let count = bad.len() as u64;
    for (pose, _) in &bad {
        peer.send_pose(*pose);
    }
    until("all bad poses have come", || counters().poses_invalid == count).await;
    assert_eq!((counters().poses_taken, counters().frames_begun), (0, 0), "a frame was made for no pose");
    // A good one is as good as ever.
    let good = peer.pose(1_000);
    peer.send_pose(good);
    peer.frames(1).await;
    assert_eq!(counters().poses_taken, 1);

    for (pose, what) in bad {
        let mut peer = RawPeer::connect(&room).await;
        peer.be_welcomed().await;
        // Some may get lost on the way, as datagrams do.
        for _ in 0..200 {
            peer.send_pose(pose);
        }
        let ending = peer.ending().await;
        println!("{ending:?}");
        ending.assert_is(CloseCode::BadMessage, "100 invalid poses in a row");
        assert!(ending.reason.contains(what), "expected '{what}' in {ending:?}");
    }
    drop(peer);
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_hundred_thousand_poses_make_no_more_frames_than_were_asked_for() {
    let (room, bystander) = room_with_bystander().await;
    let mut viewer = Viewer::join(&room, "flood").await;
    viewer.frame_after(5).await;
    let others = room.server.seats();
    let session = others.iter().find(|seat| seat.device.as_deref() == Some("flood")).unwrap().session;
    let counters = || room.seat(session).unwrap().counters;
    let begun = Instant::now();
    let before = counters();
    for i in 0..100_000 {
        let now = viewer.headset.clock().now();
        viewer.headset.send_pose(now, now + viewer.lead, &in_front()).unwrap();
        if i % 50 == 0 {
            // What has come is taken, nothing is waited for.
            while let Ok(event) = tokio::time::timeout(Duration::ZERO, viewer.headset.next_event()).await {
                assert!(
                    !matches!(event, HeadsetEvent::Disconnected(_) | HeadsetEvent::Undecodable { .. }),
                    "{event:?}"
                );
            }
        }
    }
    let after = counters();
    let secs = begun.elapsed().as_secs_f64();
    let frames = after.frames_begun - before.frames_begun;
    let taken = after.poses_taken - before.poses_taken;
    println!("{taken} poses were taken in {secs:.2} s, {frames} frames made");
    // Far more than one a frame; how many of them come through is the network's business.
    assert!(taken > 10 * frames.max(30), "{taken} poses taken, {frames} frames");
    // One and a half may have been saved up before, and a session earns 2 % more, to work a delay off.
    let most = secs * 1.02 * f64::from(REFRESH_HZ) + 1.5;
    assert!(frames as f64 <= most, "{frames} frames in {secs:.2} s, expected at most {most:.1}");
    viewer.headset.goodbye();
    drop(viewer);
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_does_not_read_its_frames_is_closed_as_stalled() {
    let (room, bystander) = room_with_bystander().await;
    let mut peer = RawPeer::connect(&room).await;
    let session = peer.be_welcomed().await.session_id;
    // It goes on sending poses, so that it is not idle, and never takes a frame.
    let begun = Instant::now();
    while room.seat(session).is_some() {
        assert!(begun.elapsed() < end_to_end::PATIENCE, "it still has its seat");
        let pose = peer.pose(u64::try_from(begun.elapsed().as_micros()).unwrap());
        peer.send_pose(pose);
        tokio::time::sleep(Duration::from_millis(33)).await;
    }
    let ending = peer.ending().await;
    println!("{ending:?}");
    ending.assert_is(CloseCode::Stalled, "none was completed for 5000 ms");
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn who_vanishes_without_a_word_leaves_its_seat_after_the_idle_time() {
    let (room, bystander) = room_with_bystander().await;
    let cable = Cable::to(room.address()).await;
    let by_cable = HeadsetSettings::new(cable.address().to_string(), room.fingerprint(), device("vanishing"));
    let mut viewer = Viewer::join_as(&room, &by_cable, |_| in_front()).await;
    viewer.frame_after(5).await;
    assert_eq!(room.server.seats().len(), 2);
    cable.cut();
    // The headset finds out by itself as well.
    match viewer.notice("the silence").await {
        HeadsetEvent::Disconnected(end) => {
            println!("{end:?}");
            assert_ne!(end.by, ClosedBy::Peer, "{end:?}");
            assert_eq!(end.code, CloseCode::Idle, "{end:?}");
        }
        other => panic!("expected the end, found {other:?}"),
    }
    until("its seat is free", || room.server.seats().len() == 1).await;
    bystander.was_not_harmed().await;
    room.is_empty().await;
    room.shutdown().await;
}
