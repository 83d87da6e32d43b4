//! Where a frame's time goes, and where the head will be by then.

use end_to_end::{CENTRE_IN_ROOM, TestServer, Viewer, in_front, settings, subject, within};
use headset::{SimulatedHeadset, SimulatedSettings};
use server::Settings;
use session::{Prediction, Stage};
use spatial::{DQuat, DVec3, Pose};
use std::sync::Arc;
use std::time::Duration;
use trace::{Ending, Orbit, Trace};

/// The wire carries float32: a tenth of a micrometre in a room, 0.00001°.
const POSITION_OFF_M: f64 = 1.0e-6;
const ANGLE_OFF_RAD: f64 = 1.0e-6;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_stages_of_every_frame_sum_to_the_time_from_pose_to_picture() {
    let room = TestServer::start(subject(), "{}", settings());
    let orbit = Orbit { centre_in_world: CENTRE_IN_ROOM, radius_m: 1.0, height_m: 0.1, period_secs: 8.0 };
    let settings = SimulatedSettings {
        ending: Ending::Loop,
        seconds: 3.0,
        first_latency: Duration::from_millis(200),
        ..SimulatedSettings::new("measured", room.headset("measured"), Arc::new(Trace::orbit(&orbit)))
    };
    let run = within("the run", async {
        SimulatedHeadset::connect(settings, room.pool()).await.unwrap().run().await
    })
    .await;
    assert_eq!(run.violation_count(), 0, "{:?}", run.violations);
    assert!(run.ended_in_order(), "{:?}", run.end);
    assert_eq!(run.counters.decoded, run.frames.len() as u64);
    assert_eq!(run.stage_names, Stage::ALL.map(Stage::name));

    let timed: Vec<_> = run.frames.iter().filter_map(|frame| Some((frame, frame.times?))).collect();
    // The clock is known after the first pong: a handful of frames at most come before it.
    assert!(
        timed.len() >= 10 && timed.len() + 10 >= run.frames.len(),
        "{} of {}",
        timed.len(),
        run.frames.len()
    );
    for (frame, times) in &timed {
        let number = frame.frame;
        assert_eq!(
            times.stages_us.iter().sum::<i64>(),
            frame.pose_to_decoded_us,
            "frame {number}: {times:?}"
        );
        let of = |stage: Stage| times.stages_us[stage as usize];
        assert_eq!(of(Stage::Uplink) + of(Stage::Wait), times.pose_age_at_render_us, "frame {number}");
        assert_eq!(of(Stage::Decode), frame.decode_us, "frame {number}");
        for stage in Stage::ALL {
            // Two stages lead from one clock to the other and carry its error, one with plus, the other with minus.
            let least = match stage {
                Stage::Uplink | Stage::Network => -times.clock_error_us.cast_signed(),
                _ => 0,
            };
            assert!(of(stage) >= least, "frame {number}: {} took {} µs: {times:?}", stage.name(), of(stage));
        }
        for stage in [Stage::Render, Stage::Encode, Stage::Decode] {
            assert!(of(stage) > 0, "frame {number}: {} took no time", stage.name());
        }
        let whole_us = ((frame.decoded_at_secs - frame.pose_sampled_at_secs) * 1e6).round() as i64;
        assert!(
            (whole_us - frame.pose_to_decoded_us).abs() <= 1,
            "frame {number}: {whole_us} µs by its times"
        );
    }
    // From one thread to another takes a microsecond at least, now and then.
    let sends = || timed.iter().map(|(_, times)| times.stages_us[Stage::Send as usize]);
    println!("sending took {} µs at most", sends().max().unwrap());
    assert!(sends().any(|us| us > 0), "no frame waited to be sent");
    // Both clocks are this machine's, so that their offset is known to a part of the round trip.
    let clock = run.clock.unwrap();
    println!("{} frames, clock within {} µs", timed.len(), clock.error_us);
    assert!(timed.iter().all(|(_, times)| times.clock_error_us < 1_000_000), "{clock:?}");
    let server = run.server_statistics.last().unwrap();
    assert!(server.frames_sent >= server.frames_rendered.saturating_sub(2), "{server:?}");
    room.shutdown().await;
}

/// A head that walks sideways at 0.4 m/s, as no frame's time is too long for.
fn walk(secs: f64) -> Pose {
    let start = in_front();
    Pose { position_m: start.position_m + DVec3::X * (0.4 * secs - 0.3), ..start }
}

/// A head that turns to the left by 0.2 rad/s.
fn turn(secs: f64) -> Pose {
    let start = in_front();
    Pose { orientation: DQuat::from_rotation_y(0.2 * secs - 0.2) * start.orientation, ..start }
}

/// Frames with the pose that each was made for, and the head that each shows.
async fn shown_heads(prediction: Prediction, head_at: fn(f64) -> Pose) -> Vec<(Pose, Pose)> {
    let room = TestServer::start(subject(), "{}", Settings { prediction, ..settings() });
    let mut viewer = Viewer::join_as(&room, &room.headset("walker"), head_at).await;
    viewer.lead = Duration::from_millis(80);
    let mut heads = Vec::new();
    viewer.frame_after(8).await;
    for _ in 0..20 {
        let frame = viewer.frame_after(0).await;
        let header = &frame.received.header;
        let (sampled_at, sent) = viewer.sent[header.pose_sequence as usize];
        assert_eq!(header.pose_sampled_at_us, sampled_at.as_micros());
        assert_eq!(header.display_at_us, (sampled_at + viewer.lead).as_micros());
        let eyes = frame.received.view.eyes.map(|eye| eye.world_from_eye);
        // The eyes sit at either side of the head and look where it looks.
        let apart = eyes[0].orientation.conjugate() * (eyes[1].position_m - eyes[0].position_m);
        assert!((apart - DVec3::X * 0.064).length() < POSITION_OFF_M, "eyes are {apart} apart");
        let head = Pose { position_m: (eyes[0].position_m + eyes[1].position_m) / 2.0, ..eyes[0] };
        heads.push((sent, head));
    }
    viewer.leave().await;
    room.shutdown().await;
    heads
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_prediction_a_frame_shows_the_pose_that_was_sent() {
    let off = Prediction { enabled: false, ..Prediction::default() };
    for head_at in [walk, turn] {
        for (sent, shown) in shown_heads(off, head_at).await {
            let off_m = (shown.position_m - sent.position_m).length();
            let off_rad = shown.angle_to(&sent);
            assert!(off_m < POSITION_OFF_M && off_rad < ANGLE_OFF_RAD, "off by {off_m} m and {off_rad} rad");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn with_prediction_a_frame_shows_where_the_head_will_be() {
    // 80 ms ahead at 0.4 m/s are 32 mm, at 0.2 rad/s 16 mrad. The head moves evenly, so that only the microseconds of
    // poses' times and float32 are left: 1 µs of the 33 ms over which the velocity is taken, and of the 80 ms ahead.
    for (sent, shown) in shown_heads(Prediction::default(), walk).await {
        let ahead = shown.position_m - sent.position_m;
        assert!((ahead - DVec3::X * 0.032).length() < 1.0e-3, "{ahead} ahead, expected 0.032 m to the right");
        assert!(shown.angle_to(&sent) < ANGLE_OFF_RAD);
    }
    for (sent, shown) in shown_heads(Prediction::default(), turn).await {
        let ahead = shown.angle_to(&sent);
        assert!((ahead - 0.016).abs() < 0.5e-3, "{ahead} rad ahead, expected 0.016");
        assert!((shown.position_m - sent.position_m).length() < POSITION_OFF_M);
    }
}
