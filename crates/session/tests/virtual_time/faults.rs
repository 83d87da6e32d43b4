//! Peers that are broken, gone, or hostile.

use crate::world::*;
use netsim::LinkSettings;
use session::*;
use std::time::{Duration, Instant};
use wire::{ClientDatagram, ClientMessage, CloseCode, Feedback, Hello, PoseSample};

/// A server that expects a pairing code, and what it says to a peer that sends these bytes first.
fn answer_to(control: &[u8]) -> ServerSession {
    let settings = ServerSettings { pairing_code: Some("482913".into()), ..ServerSettings::default() };
    let mut server = ServerSession::new(server_time(0), settings);
    server.handle_control(server_time(1_000), control);
    server
}

fn hello(change: impl FnOnce(&mut Hello)) -> Vec<u8> {
    let mut hello = Hello {
        version: wire::PROTOCOL_VERSION,
        pairing_code: "482913".to_owned(),
        device: device().to_wire(),
    };
    change(&mut hello);
    ClientMessage::Hello(hello).encode().expect("a small hello")
}

#[track_caller]
fn check_refusal(control: &[u8], code: CloseCode, reason: &str) {
    let mut server = answer_to(control);
    assert!(server.is_closed());
    assert_eq!(
        server.poll_event(),
        Some(ServerEvent::Disconnected(Disconnection { by: ClosedBy::Us, code, reason: reason.to_owned() }))
    );
    assert!(
        matches!(server.poll_transmit(server_time(3_000)), Some(ServerTransmit::Control(_))),
        "a goodbye"
    );
    assert_eq!(
        server.poll_transmit(server_time(3_000)),
        Some(ServerTransmit::Close { code, reason: reason.to_owned() })
    );
    assert_eq!(
        (server.poll_transmit(server_time(3_000)), server.poll_event(), server.poll_timeout()),
        (None, None, None)
    );
    assert!(server.begin_frame(server_time(2_000)).is_none(), "nothing is rendered");
}

/// A server with a headset that is welcome.
fn connected() -> ServerSession {
    let mut server = answer_to(&hello(|_| {}));
    assert!(matches!(server.poll_event(), Some(ServerEvent::Connected { .. })));
    let terms = StreamTerms {
        width_px: 640,
        height_px: 180,
        refresh_hz: 60.0,
        bitrate_bps: 5_000_000,
        codec: "avc1.42C01F".to_owned(),
    };
    server.welcome(server_time(2_000), &terms);
    assert!(
        matches!(server.poll_transmit(server_time(3_000)), Some(ServerTransmit::Control(_))),
        "a welcome"
    );
    server
}

fn pose(sequence: u64, at_us: u64) -> PoseSample {
    PoseSample {
        sequence,
        sampled_at_us: at_us,
        display_at_us: at_us + 50_000,
        world_from_head: wire::Pose { position_m: [0.0, 1.6, 0.0], orientation_xyzw: [0.0, 0.0, 0.0, 1.0] },
    }
}

fn encode(ticket: &FrameTicket, reference: Reference) -> EncodedFrame<'static> {
    let at = ticket.begun_at;
    let times =
        RenderTimes { render_started: at, rendered: at, converted: at, encode_started: at, encoded: at };
    EncodedFrame {
        access_unit: &[1, 2, 3],
        reference,
        scene_revision: 0,
        time_step: 0,
        times,
        quality: wire::Quality::default(),
        depth: wire::DepthGrid::default(),
    }
}

/// Gives the server a pose and lets it make a frame; returns its number.
fn make_frame(
    server: &mut ServerSession,
    now_us: u64,
    sequence: u64,
    reference: Reference,
) -> (u64, FrameFate) {
    server.handle_datagram(server_time(now_us), &ClientDatagram::Pose(pose(sequence, now_us)).encode());
    let ticket = server.begin_frame(server_time(now_us)).expect("a frame is due");
    let number = ticket.number;
    let frame = encode(&ticket, reference);
    (number, server.frame_encoded(server_time(now_us), ticket, frame).expect("a small frame"))
}

#[test]
fn a_wrong_version_is_told_both_versions() {
    let reason = "protocol version is 2, expected 1";
    check_refusal(&hello(|hello| hello.version = 2), CloseCode::BadVersion, reason);
    // Even if nothing else of the hello can be read.
    check_refusal(&[10, 0, 0, 0, 0, 0, 0, 0, 2, 0, 9, 9, 9, 9], CloseCode::BadVersion, reason);
}

#[test]
fn a_missing_or_wrong_pairing_code_sees_nothing() {
    check_refusal(
        &hello(|hello| hello.pairing_code.clear()),
        CloseCode::NotPaired,
        "no pairing code, expected the one that the server shows",
    );
    check_refusal(
        &hello(|hello| hello.pairing_code = "482914".to_owned()),
        CloseCode::NotPaired,
        "wrong pairing code, expected the one that the server shows",
    );
}

#[test]
fn a_device_that_cannot_be_served_is_told_why() {
    check_refusal(
        &hello(|hello| hello.device.eye_width_px = 5000),
        CloseCode::BadDevice,
        "eye picture is 5000×180 pixels, expected even sides of 16 to 4096",
    );
    check_refusal(
        &hello(|hello| hello.device.eyes[1].fov.up_rad = f32::NAN),
        CloseCode::BadDevice,
        &format!(
            "right eye: field of view {:?} has an angle that is not finite",
            [f64::from(-0.26f32), f64::from(0.26f32), f64::NAN, f64::from(-0.15f32)]
        ),
    );
}

#[test]
fn garbage_and_messages_out_of_order_close_the_session() {
    check_refusal(
        &[4, 0, 0, 0, 77, 0, 0, 0],
        CloseCode::BadMessage,
        "control message: 77 is no variant of ClientMessage",
    );
    check_refusal(
        &[0xff, 0xff, 0xff, 0x7f],
        CloseCode::BadMessage,
        "control message has 2147483647 bytes, expected at most 262144",
    );
    let scene = ClientMessage::ChangeScene { request_id: 0, scene_json: "{}".to_owned() };
    check_refusal(
        &scene.encode().expect("a small scene"),
        CloseCode::BadMessage,
        "first message is not a hello, expected one",
    );
    let twice = [hello(|_| {}), hello(|_| {})].concat();
    let mut server = answer_to(&twice);
    assert!(matches!(server.poll_event(), Some(ServerEvent::Connected { .. })));
    let Some(ServerEvent::Disconnected(end)) = server.poll_event() else { panic!("the session is over") };
    check_end(Some(&end), ClosedBy::Us, CloseCode::BadMessage, "second hello");
    let mut server = connected();
    server.handle_datagram(server_time(3_000), &[1, 2, 3]);
    let Some(ServerEvent::Disconnected(end)) = server.poll_event() else { panic!("the session is over") };
    check_end(Some(&end), ClosedBy::Us, CloseCode::BadMessage, "datagram ends after 3 bytes");
}

#[test]
fn a_peer_that_never_says_hello_is_closed() {
    let mut server = ServerSession::new(server_time(0), ServerSettings::default());
    let at = server.poll_timeout().expect("a limit");
    assert_eq!(at, server_time(5_000_000));
    // Datagrams prove nothing.
    server.handle_datagram(server_time(4_999_999), &ClientDatagram::Pose(pose(0, 0)).encode());
    server.handle_timeout(at);
    let Some(ServerEvent::Disconnected(end)) = server.poll_event() else { panic!("the session is over") };
    check_end(Some(&end), ClosedBy::Us, CloseCode::Idle, "no hello within 5000 ms");
    assert_eq!(server.counters().datagrams_early, 1);
}

#[test]
fn nothing_is_rendered_before_the_welcome() {
    let mut server = answer_to(&hello(|_| {}));
    server.handle_datagram(server_time(2_000), &ClientDatagram::Pose(pose(0, 0)).encode());
    assert!(server.begin_frame(server_time(2_000)).is_none());
    assert!(server.frame_request(server_time(2_000)).is_none());
}

#[test]
fn a_hundred_thousand_poses_a_second_are_cheap_and_make_no_more_frames() {
    let mut server = connected();
    let began = Instant::now();
    let mut frames = 0;
    for i in 0..100_000u64 {
        let now = 10_000 + i * 10;
        server.handle_datagram(server_time(now), &ClientDatagram::Pose(pose(i, now)).encode());
        if server
            .begin_frame(server_time(now))
            .map(|ticket| server.frame_abandoned(server_time(now), ticket))
            .is_some()
        {
            frames += 1;
        }
    }
    assert!((60..=63).contains(&frames), "{frames} frames in a second");
    assert_eq!(server.counters().poses_taken, 100_000);
    // A second of them takes some 20 ms; the bound leaves room for a busy machine.
    assert!(began.elapsed() < Duration::from_secs(1), "{:?}", began.elapsed());
}

#[test]
fn invalid_poses_are_ignored_and_too_many_in_a_row_close_the_session() {
    let mut server = connected();
    let spoilt = |sequence, orientation_xyzw| {
        let mut sample = pose(sequence, 1000);
        sample.world_from_head.orientation_xyzw = orientation_xyzw;
        ClientDatagram::Pose(sample).encode()
    };
    let bad = [[0.0; 4], [f32::NAN; 4], [0.0, 0.0, 0.0, 2.0], [f32::INFINITY, 0.0, 0.0, 1.0]];
    for i in 0..99 {
        server.handle_datagram(server_time(3_000), &spoilt(i, bad[i as usize % 4]));
    }
    assert!(!server.is_closed() && server.frame_request(server_time(3_000)).is_none());
    server.handle_datagram(server_time(3_000), &ClientDatagram::Pose(pose(100, 1000)).encode());
    assert!(server.frame_request(server_time(3_000)).is_some());
    for i in 0..100 {
        server.handle_datagram(server_time(3_000), &spoilt(101 + i, bad[0]));
    }
    let Some(ServerEvent::Disconnected(end)) = server.poll_event() else { panic!("the session is over") };
    check_end(
        Some(&end),
        ClosedBy::Us,
        CloseCode::BadMessage,
        "100 invalid poses in a row, the last: pose orientation",
    );
    assert_eq!(server.counters().poses_invalid, 199);
}

#[test]
fn at_most_two_frames_are_made_at_a_time() {
    let mut server = connected();
    let mut tickets = Vec::new();
    for i in 0..10u64 {
        let now = 100_000 * i + 10_000;
        server.handle_datagram(server_time(now), &ClientDatagram::Pose(pose(i, now)).encode());
        tickets.extend(server.begin_frame(server_time(now)));
    }
    assert_eq!(tickets.len(), 2);
    let ticket = tickets.remove(0);
    server.frame_abandoned(server_time(1_000_000), ticket);
    assert!(server.begin_frame(server_time(1_000_000)).is_some());
    let counters = server.counters();
    assert!(counters.frames_skipped_for_renderer > 40, "{counters:?}");
}

#[test]
fn a_request_waits_once_and_is_for_the_newest_pose() {
    let mut server = connected();
    for i in 0..5u64 {
        server.handle_datagram(server_time(3_000 + i), &ClientDatagram::Pose(pose(i, 3_000 + i)).encode());
    }
    let now = server_time(4_000);
    let request = server.frame_request(now).expect("a frame is wanted");
    assert_eq!(server.frame_request(now), Some(request));
    assert_eq!(request.pose_sequence, 4);
    let ticket = server.begin_frame(now).expect("a frame is due");
    assert_eq!((ticket.pose.sequence, ticket.deadline), (4, request.deadline));
    assert_eq!(server.frame_request(now), None);
}

#[test]
fn a_peer_that_does_not_read_its_frames_is_closed() {
    let mut world = World::new(Setup { reads_frames: false, ..Setup::default() });
    world.run_until(10.0);
    check_end(world.server_end(), ClosedBy::Us, CloseCode::Stalled, "none was completed for 5000 ms");
    assert!(world.most_in_flight <= 4, "{}", world.most_in_flight);
    assert!(world.server.counters().frames_sent < 100, "{:?}", world.server.counters());
}

#[test]
fn a_headset_that_pauses_is_not_taken_for_stalled() {
    let mut world = World::new(Setup::default());
    world.run_until(2.0);
    world.sends_poses = false;
    world.run_until(14.0);
    world.sends_poses = true;
    world.run_until(16.0);
    assert!(world.server_end().is_none(), "{:?}", world.server_end());
    assert!(world.shown_between(14.5, 16.0) >= 89);
}

#[test]
fn a_headset_that_vanishes_is_closed() {
    let mut world = World::new(Setup::default());
    world.run_until(2.0);
    world.has_vanished = true;
    let dark = LinkSettings { loss: 1.0, ..LinkSettings::default() };
    world.down.set_link(dark.clone());
    world.up.set_link(dark);
    world.run_until(6.9);
    assert!(world.server_end().is_none());
    world.run_until(7.1);
    check_end(world.server_end(), ClosedBy::Us, CloseCode::Idle, "nothing heard for 5000 ms");
}

#[test]
fn a_server_that_vanishes_is_given_up() {
    let mut world = World::new(Setup::default());
    world.run_until(2.0);
    world.down.set_link(LinkSettings { loss: 1.0, ..LinkSettings::default() });
    world.run_until(8.0);
    check_end(world.client_end(), ClosedBy::Us, CloseCode::Idle, "nothing heard for 5000 ms");
}

#[test]
fn a_connection_that_breaks_ends_both() {
    let mut world = World::new(Setup::default());
    world.run_until(1.0);
    let (server_now, headset_now) = (world.server_now(), world.headset_now());
    world.server.handle_disconnect(server_now, None, "connection timed out");
    world.client.handle_disconnect(headset_now, Some(CloseCode::ShuttingDown), "closed by peer");
    world.run_until(1.1);
    check_end(world.server_end(), ClosedBy::Network, CloseCode::Idle, "connection timed out");
    check_end(world.client_end(), ClosedBy::Peer, CloseCode::ShuttingDown, "closed by peer");
}

#[test]
fn feedback_about_frames_that_were_never_sent_is_ignored() {
    let mut server = connected();
    let feedback = Feedback { sequence: 1, newest_completed: Some(50), ..Feedback::default() };
    server.handle_datagram(server_time(3_000), &ClientDatagram::Feedback(feedback).encode());
    assert_eq!(server.counters().feedback_ignored, 1);
    assert_eq!(server.counters().frames_completed, 0);
}

#[test]
fn a_key_frame_on_its_way_answers_all_who_ask_for_one() {
    let mut server = connected();
    assert!(server.next_must_be_key_frame());
    assert_eq!(make_frame(&mut server, 10_000, 0, Reference::None), (0, FrameFate::Sent));
    assert!(!server.next_must_be_key_frame());
    let say = |server: &mut ServerSession, at: u64, sequence, newest_completed, key_frame_needed| {
        let feedback = Feedback { sequence, newest_completed, key_frame_needed, ..Feedback::default() };
        server.handle_datagram(server_time(at), &ClientDatagram::Feedback(feedback).encode());
    };
    // The headset asks before the first one has come.
    say(&mut server, 12_000, 1, None, true);
    say(&mut server, 13_000, 2, None, true);
    assert!(!server.next_must_be_key_frame());
    // It has come, and did not help.
    say(&mut server, 14_000, 3, Some(0), true);
    assert!(server.next_must_be_key_frame());
    assert_eq!(server.poll_event(), Some(ServerEvent::KeyFrameNeeded));
    assert_eq!(make_frame(&mut server, 40_000, 1, Reference::Previous), (1, FrameFate::Undecodable));
    assert_eq!(make_frame(&mut server, 60_000, 2, Reference::None), (2, FrameFate::Sent));
    // What was said before that key frame arrived is late news.
    say(&mut server, 61_000, 2, Some(0), true);
    say(&mut server, 62_000, 4, Some(0), true);
    assert!(!server.next_must_be_key_frame());
    assert_eq!(server.poll_event(), None);
}

#[test]
fn a_late_frame_takes_with_it_what_hangs_on_it_and_only_that() {
    let mut server = connected();
    make_frame(&mut server, 10_000, 0, Reference::None);
    let feedback = Feedback { sequence: 1, newest_completed: Some(0), ..Feedback::default() };
    server.handle_datagram(server_time(12_000), &ClientDatagram::Feedback(feedback).encode());
    make_frame(&mut server, 30_000, 1, Reference::Previous);
    make_frame(&mut server, 50_000, 2, Reference::Previous);
    while server.poll_transmit(server_time(3_000)).is_some() {}
    // Frame 1 is expected to be shown at 80 ms; 100 ms later it is late, and a round trip of 2 ms longer.
    assert_eq!(server.poll_timeout(), Some(server_time(182_000)));
    server.handle_timeout(server_time(182_000));
    let resets: Vec<_> = std::iter::from_fn(|| server.poll_transmit(server_time(3_000))).collect();
    assert_eq!(resets, [ServerTransmit::ResetFrame { number: 1 }, ServerTransmit::ResetFrame { number: 2 }]);
    assert!(server.next_must_be_key_frame());
    assert_eq!(server.counters().window, 1);
    // A frame built on the one that the headset has is as good as a key frame.
    assert_eq!(make_frame(&mut server, 190_000, 3, Reference::Frame(0)), (3, FrameFate::Sent));
    assert!(!server.next_must_be_key_frame());
    let feedback = Feedback { sequence: 2, newest_decoded: Some(0), key_frame_needed: true, ..feedback };
    server.handle_datagram(server_time(200_000), &ClientDatagram::Feedback(feedback).encode());
    assert!(!server.next_must_be_key_frame(), "help is on its way");
    assert_eq!(make_frame_refused(&mut server, 210_000, 4), None, "until it has come through");
}

fn make_frame_refused(server: &mut ServerSession, now_us: u64, sequence: u64) -> Option<u64> {
    server.handle_datagram(server_time(now_us), &ClientDatagram::Pose(pose(sequence, now_us)).encode());
    server.begin_frame(server_time(now_us)).map(|ticket| ticket.number)
}

#[test]
fn a_frame_that_was_not_yet_taken_is_reset_without_a_word() {
    let mut server = connected();
    make_frame(&mut server, 10_000, 0, Reference::None);
    server.handle_timeout(server_time(2_000_000));
    assert_eq!(server.counters().frames_reset, 1);
    assert!(
        std::iter::from_fn(|| server.poll_transmit(server_time(3_000)))
            .all(|transmit| matches!(transmit, ServerTransmit::Control(_)))
    );
}

#[test]
fn a_frame_says_when_it_went_out_and_not_when_it_was_encoded() {
    let mut server = connected();
    for (at_us, sequence, reference) in [(10_000, 0, Reference::None), (30_000, 1, Reference::Previous)] {
        make_frame(&mut server, at_us, sequence, reference);
        let transmit = server.poll_transmit(server_time(at_us + 700));
        let Some(ServerTransmit::Frame { bytes, .. }) = transmit else {
            panic!("a frame, found {transmit:?}")
        };
        let stages = wire::decode_frame(&bytes).expect("a frame").header.stages;
        let sent_us = server_time(at_us + 700).as_micros();
        assert_eq!((stages.encoded_us, stages.sent_us), (sent_us - 700, sent_us));
    }
}

#[test]
fn a_frame_too_large_to_send_is_an_error_and_asks_for_a_key_frame() {
    let mut server = connected();
    server.handle_datagram(server_time(10_000), &ClientDatagram::Pose(pose(0, 10_000)).encode());
    let ticket = server.begin_frame(server_time(10_000)).expect("a frame is due");
    let access_unit = vec![0; wire::MAX_ACCESS_UNIT_BYTES + 1];
    let frame = EncodedFrame { access_unit: &access_unit, ..encode(&ticket, Reference::None) };
    assert!(matches!(
        server.frame_encoded(server_time(10_000), ticket, frame),
        Err(wire::EncodeError::TooLarge { .. })
    ));
    assert!(server.next_must_be_key_frame());
    assert_eq!(make_frame(&mut server, 40_000, 1, Reference::None), (1, FrameFate::Sent));
}

#[test]
fn a_goodbye_of_any_length_is_kept_short() {
    let mut server = connected();
    let reason = "x".repeat(100_000);
    let goodbye = wire::Goodbye { code: CloseCode::Goodbye, reason };
    let bytes = ClientMessage::Goodbye(goodbye).encode().expect("a lawful goodbye");
    server.handle_control(server_time(3_000), &bytes);
    let Some(ServerEvent::Disconnected(end)) = server.poll_event() else { panic!("the session is over") };
    assert_eq!((end.by, end.reason.len()), (ClosedBy::Peer, 512));
}

#[test]
fn a_scene_that_grows_over_the_limit_is_announced_without_its_text() {
    let mut server = connected();
    let scene = "x".repeat(wire::MAX_CONTROL_BYTES);
    server.scene_changed(None, 7, Some(&scene));
    let Some(ServerTransmit::Control(bytes)) = server.poll_transmit(server_time(3_000)) else {
        panic!("an announcement")
    };
    let changed = wire::ServerMessage::SceneChanged { request_id: None, revision: 7, scene_json: None };
    assert_eq!(wire::ServerMessage::decode(&bytes[4..]), Ok(changed));
}

#[test]
fn scene_requests_that_nobody_takes_are_refused() {
    let mut server = connected();
    for request_id in 0..20 {
        let scene = ClientMessage::ChangeScene { request_id, scene_json: "{}".to_owned() };
        server.handle_control(server_time(3_000), &scene.encode().expect("a small scene"));
    }
    let events = std::iter::from_fn(|| server.poll_event()).count();
    let refusals = std::iter::from_fn(|| server.poll_transmit(server_time(3_000))).count();
    assert_eq!((events, refusals), (8, 12));
}

#[test]
fn a_server_that_sends_nonsense_is_left() {
    let check = |feed: &dyn Fn(&mut ClientSession), needle: &str| {
        let mut client =
            ClientSession::new(headset_time(0), &device(), &"".into(), ClientSettings::default())
                .expect("no pairing code");
        let welcome = wire::ServerMessage::Welcome(wire::Welcome {
            version: 1,
            session_id: 1,
            stream: wire::Stream {
                width_px: 640,
                height_px: 180,
                refresh_hz: 60.0,
                bitrate_bps: 1,
                codec: String::new(),
            },
            server_name: String::new(),
            scene_revision: 0,
        });
        client.handle_control(headset_time(1), &welcome.encode().expect("a small welcome"));
        assert!(matches!(client.poll_event(), Some(ClientEvent::Welcomed(_))));
        feed(&mut client);
        let Some(ClientEvent::Disconnected(end)) = client.poll_event() else { panic!("the session is over") };
        check_end(Some(&end), ClosedBy::Us, CloseCode::BadMessage, needle);
    };
    check(&|client| client.handle_frame(headset_time(2), vec![1, 2, 3]), "frame stream ends after 3 bytes");
    check(&|client| client.handle_datagram(headset_time(2), &[9; 4]), "is no variant of ServerDatagram");
    check(
        &|client| client.handle_control(headset_time(2), &[4, 0, 0, 0, 9, 0, 0, 0]),
        "is no variant of ServerMessage",
    );
}
