//! Frames over good and bad networks.

use crate::world::*;
use netsim::LinkSettings;
use session::*;
use wire::CloseCode;

fn link(delay_ms: u64) -> LinkSettings {
    LinkSettings { delay_us: delay_ms * 1000, ..LinkSettings::default() }
}

/// The longest time between two pictures in seconds `from` to `to`, in milliseconds.
fn longest_gap_ms(world: &World, from: f64, to: f64) -> f64 {
    let (from, to) = ((from * 1e6) as u64, (to * 1e6) as u64);
    let times: Vec<u64> =
        world.shown.iter().map(|shown| shown.decoded_at).filter(|at| (from..to).contains(at)).collect();
    times.windows(2).map(|pair| pair[1] - pair[0]).max().map_or(f64::INFINITY, |gap| gap as f64 * 1e-3)
}

#[test]
fn both_ends_meet() {
    let mut world = World::new(Setup::default());
    world.run_until(0.1);
    let Some(ServerEvent::Connected { device: found }) = world.server_events.first() else {
        panic!("no headset: {:?}", world.server_events);
    };
    assert_eq!(found.eye_width_px, 320);
    let Some(ClientEvent::Welcomed(welcome)) = world.client_events.first() else {
        panic!("no welcome: {:?}", world.client_events);
    };
    assert_eq!((welcome.version, welcome.stream.width_px), (wire::PROTOCOL_VERSION, 640));
}

#[test]
fn a_perfect_link_carries_every_frame() {
    let mut world = World::new(Setup::default());
    world.run_until(11.0);
    let shown = world.shown_between(1.0, 11.0);
    assert!((599..=601).contains(&shown), "{shown} frames in 10 s");
    let counters = world.server.counters();
    assert_eq!(
        (counters.frames_reset, counters.frames_dropped, counters.frames_skipped_for_network),
        (0, 0, 0),
        "{counters:?}"
    );
    assert_eq!(counters.key_frames_sent, 1, "{counters:?}");
    let client = world.client.counters();
    assert_eq!((client.frames_lost, client.frames_stale, client.frames_late), (0, 0, 0), "{client:?}");
}

#[test]
fn stages_sum_to_the_time_from_pose_to_picture() {
    let mut world = World::new(Setup::default());
    world.run_until(3.0);
    for shown in world.shown.iter().filter(|shown| shown.decoded_at > 1_000_000) {
        let timeline = shown.timeline.expect("the clock is known by now");
        let sum: i64 = timeline.stages().iter().map(|(_, micros)| micros).sum();
        assert_eq!(sum, timeline.pose_to_decoded_us());
        assert_eq!(timeline.micros(Stage::Render), 6_000);
        assert_eq!(timeline.micros(Stage::Encode), 5_000);
        assert_eq!(timeline.micros(Stage::Decode), 2_000);
        assert!((timeline.micros(Stage::Uplink) - 2_000).abs() <= 200, "{timeline:?}");
        assert!(timeline.stages().iter().all(|(_, micros)| *micros >= -100), "{timeline:?}");
        assert!(timeline.lateness_us() < 0);
    }
}

#[test]
fn jitter_costs_few_frames() {
    let jittery = LinkSettings { jitter_us: 8_000, ..link(5) };
    let mut world = World::new(Setup { up: jittery.clone(), down: jittery, ..Setup::default() });
    world.run_until(11.0);
    let shown = world.shown_between(1.0, 11.0);
    assert!(shown >= 560, "{shown} frames in 10 s");
    assert_eq!(world.server.counters().frames_reset, 0);
}

#[test]
fn lost_datagrams_cost_only_their_own_frames() {
    let lossy = LinkSettings { loss: 0.05, ..link(5) };
    let mut world = World::new(Setup { up: lossy.clone(), down: lossy, ..Setup::default() });
    world.run_until(11.0);
    let shown = world.shown_between(1.0, 11.0);
    assert!((555..=600).contains(&shown), "{shown} frames in 10 s");
    assert!(world.client.counters().poses_sent >= 600);
    assert!(world.server.counters().poses_taken >= 550);
}

#[test]
fn feedback_that_is_mostly_lost_stops_nothing() {
    // Half of what the headset says is lost, and with it half of the poses; feedback goes with each and says all.
    let lossy = LinkSettings { loss: 0.5, ..link(5) };
    let mut world = World::new(Setup { up: lossy, down: link(5), ..Setup::default() });
    world.run_until(11.0);
    let shown = world.shown_between(1.0, 11.0);
    assert!((260..=340).contains(&shown), "{shown} frames in 10 s");
    assert!(longest_gap_ms(&world, 1.0, 11.0) < 250.0, "{}", longest_gap_ms(&world, 1.0, 11.0));
    assert!(world.server_end().is_none());
}

#[test]
fn poses_out_of_order_and_twice_do_no_harm() {
    let up = LinkSettings { reordering: 0.3, reordering_us: 40_000, duplication: 0.3, ..link(5) };
    let mut world = World::new(Setup { up, ..Setup::default() });
    world.run_until(11.0);
    let counters = world.server.counters();
    assert!(counters.poses_stale > 200, "{counters:?}");
    assert!(world.shown_between(1.0, 11.0) > 420, "{}", world.shown_between(1.0, 11.0));
    assert_eq!(counters.frames_reset, 0, "{counters:?}");
}

#[test]
fn a_long_way_fills_the_window_and_keeps_the_rate() {
    let far = LinkSettings { ..link(75) };
    // The model of QUIC has 96 kB on the way at a time, so frames have to be small to be sixty a second over 150 ms.
    let setup = Setup {
        up: far.clone(),
        down: far,
        display_ahead_us: 200_000,
        frame_bytes: 6_000,
        ..Setup::default()
    };
    let mut world = World::new(setup);
    world.run_until(12.0);
    let shown = world.shown_between(2.0, 12.0);
    assert!(shown >= 590, "{shown} frames in 10 s");
    // 150 ms are 9 frames.
    assert_eq!(world.server.counters().window, 11);
    assert!(world.most_in_flight <= 13, "{}", world.most_in_flight);
}

#[test]
fn a_link_slower_than_the_frames_is_used_well_and_stays_fresh() {
    // 60 frames of 15 kB a second are 7.2 Mbit/s. The link carries 3, which are 25 frames, and the queue before it
    // holds half a second. Either all frames wait in that queue, or they wait in the transport and the newest goes
    // first.
    for window_bytes in [96_000, 6_000] {
        let slow = LinkSettings { bandwidth_bps: Some(3_000_000), queue_bytes: 200_000, ..link(5) };
        let mut world =
            World::new(Setup { down: slow, window_bytes, key_frame_bytes: 40_000, ..Setup::default() });
        world.run_until(21.0);
        // The decoder model fails the test if a stale frame follows a fresh one, or one that hangs on nothing.
        let shown = world.shown_between(1.0, 21.0);
        let counters = world.server.counters();
        assert!((380..=500).contains(&shown), "{shown} frames in 20 s with {window_bytes}: {counters:?}");
        let lateness = world.shown.iter().map(|shown| shown.decoded_at.saturating_sub(shown.display_at));
        let worst = lateness.max().unwrap_or(0);
        assert!(worst < 250_000, "a frame is {worst} µs late with {window_bytes}");
        assert!(longest_gap_ms(&world, 1.0, 21.0) < 250.0, "with {window_bytes}");
        assert!(counters.frames_reset < 30, "{counters:?}");
        assert!(counters.frames_skipped_for_network > 600, "{counters:?}");
        assert!(world.server_end().is_none());
    }
}

#[test]
fn a_queue_that_the_frames_fill_does_not_open_the_window() {
    let slow = LinkSettings { bandwidth_bps: Some(6_000_000), queue_bytes: 400_000, ..link(5) };
    let mut world = World::new(Setup { down: slow, ..Setup::default() });
    world.run_until(30.0);
    let counters = world.server.counters();
    assert!(counters.window <= 5, "{counters:?}");
    let median =
        world.shown[world.shown.len() / 2..].iter().map(|shown| shown.decoded_at - shown.display_at).max();
    assert!(median.is_some_and(|late| late < 60_000), "{median:?} µs");
}

#[test]
fn a_link_that_chokes_for_a_while_recovers_with_a_key_frame() {
    let mut world = World::new(Setup::default());
    world.run_until(3.0);
    let before = world.server.counters();
    // From one moment to the next the link carries a fifth of what the frames need.
    world.down.set_link(LinkSettings { bandwidth_bps: Some(1_500_000), queue_bytes: 400_000, ..link(2) });
    world.run_until(6.0);
    let choked = world.server.counters();
    assert!(choked.frames_reset > before.frames_reset, "{choked:?}");
    assert!(choked.key_frames_sent > before.key_frames_sent, "{choked:?}");
    world.down.set_link(link(2));
    world.run_until(12.0);
    let shown = world.shown_between(7.0, 12.0);
    assert!(shown >= 298, "{shown} frames in 5 s after it");
    assert!(world.shown.iter().any(|shown| shown.is_key_frame && shown.decoded_at > 3_000_000));
}

#[test]
fn a_blackout_of_two_seconds_is_survived() {
    let dark = |settings: LinkSettings| LinkSettings {
        blackouts_us: std::iter::once(3_000_000..5_000_000).collect(),
        ..settings
    };
    let mut world = World::new(Setup { up: dark(link(5)), down: dark(link(5)), ..Setup::default() });
    world.run_until(10.0);
    assert!(world.server_end().is_none() && world.client_end().is_none());
    assert_eq!(world.shown_between(3.1, 5.0), 0);
    let first = world.shown.iter().find(|shown| shown.decoded_at > 3_100_000).expect("frames come again");
    assert!(first.decoded_at < 5_300_000, "first frame at {} µs", first.decoded_at);
    assert!(first.is_key_frame);
    assert!(world.shown_between(6.0, 10.0) >= 238, "{}", world.shown_between(6.0, 10.0));
}

#[test]
fn frames_lost_on_the_way_are_sent_again_by_the_transport() {
    let lossy = LinkSettings { loss: 0.02, ..link(10) };
    let mut world = World::new(Setup { down: lossy, display_ahead_us: 80_000, ..Setup::default() });
    world.run_until(11.0);
    let shown = world.shown_between(1.0, 11.0);
    assert!(shown > 550, "{shown} frames in 10 s");
    assert!(world.client.counters().frames_stale <= 5, "{:?}", world.client.counters());
}

#[test]
fn a_renderer_that_is_too_slow_is_not_asked_for_more() {
    let mut world = World::new(Setup { render_us: 40_000, ..Setup::default() });
    world.run_until(6.0);
    let shown = world.shown_between(1.0, 6.0);
    assert!((115..=126).contains(&shown), "{shown} frames in 5 s at 25 a second");
    let counters = world.server.counters();
    assert!(counters.frames_reset == 0 && counters.in_flight <= 4, "{counters:?}");
}

#[test]
fn the_newest_pose_wins_when_the_renderer_is_slow() {
    let mut world = World::new(Setup { render_us: 40_000, ..Setup::default() });
    world.run_until(3.0);
    for shown in world.shown.iter().filter(|shown| shown.decoded_at > 1_000_000) {
        let age = shown.timeline.expect("the clock is known by now").pose_age_at_render_us();
        // No older than the newest of poses that come every 16.7 ms over 2 ms.
        assert!(age <= 18_900, "{age} µs");
    }
}

#[test]
fn statistics_go_both_ways() {
    let mut world = World::new(Setup::default());
    world.run_until(5.0);
    let sent = world.server_events.iter().filter(|e| matches!(e, ServerEvent::ClientStatistics(_))).count();
    assert_eq!(sent, 4);
    let last = world.client_events.iter().rev().find_map(|event| match event {
        ClientEvent::ServerStatistics(statistics) => Some(*statistics),
        _ => None,
    });
    let last = last.expect("the server tells");
    assert!((230..=245).contains(&last.frames_sent), "{last:?}");
    let told = world.server_events.iter().rev().find_map(|event| match event {
        ServerEvent::ClientStatistics(statistics) => Some(*statistics),
        _ => None,
    });
    let told = told.expect("the headset tells");
    assert!((told.round_trip_ms - 4.0).abs() < 0.1 && (told.decode_ms_mean - 2.0).abs() < 0.01, "{told:?}");
    assert!(told.pose_to_decoded_ms_mean > 15.0 && told.pose_to_decoded_ms_max < 50.0, "{told:?}");
}

#[test]
fn scenes_are_asked_for_and_answered() {
    let mut world = World::new(Setup::default());
    world.run_until(1.0);
    let asked = world.client.change_scene("{}").expect("a small scene");
    let refused = world.client.change_scene("nonsense").expect("a small scene");
    world.run_until(1.5);
    for event in world.server_events.clone() {
        if let ServerEvent::SceneRequested { request_id, scene_json } = event {
            if scene_json == "{}" {
                world.server.scene_changed(Some(request_id), 1, Some("{}"));
            } else {
                world.server.scene_refused(request_id, "expected a JSON object");
            }
        }
    }
    world.server.scene_changed(None, 2, None);
    world.run_until(2.0);
    let told: Vec<_> = world
        .client_events
        .iter()
        .filter(|event| matches!(event, ClientEvent::SceneChanged { .. } | ClientEvent::SceneRefused { .. }))
        .cloned()
        .collect();
    assert_eq!(
        told,
        [
            ClientEvent::SceneChanged {
                request_id: Some(asked),
                revision: 1,
                scene_json: Some("{}".to_owned())
            },
            ClientEvent::SceneRefused { request_id: refused, reason: "expected a JSON object".to_owned() },
            ClientEvent::SceneChanged { request_id: None, revision: 2, scene_json: None },
        ]
    );
}

#[test]
fn a_headset_says_goodbye() {
    let mut world = World::new(Setup::default());
    world.run_until(1.0);
    let now = world.headset_now();
    world.client.goodbye(now);
    world.run_until(1.5);
    check_end(world.client_end(), ClosedBy::Us, CloseCode::Goodbye, "goodbye");
    check_end(world.server_end(), ClosedBy::Peer, CloseCode::Goodbye, "goodbye");
    assert_eq!(world.server.poll_timeout(), None);
    assert_eq!(world.client.poll_timeout(), None);
}

#[test]
fn a_server_that_shuts_down_says_so() {
    let mut world = World::new(Setup::default());
    world.run_until(1.0);
    let now = world.server_now();
    world.server.close(now, CloseCode::ShuttingDown, "maintenance");
    world.run_until(1.5);
    check_end(world.client_end(), ClosedBy::Peer, CloseCode::ShuttingDown, "maintenance");
    assert!(world.server.begin_frame(world.server_now()).is_none());
}
