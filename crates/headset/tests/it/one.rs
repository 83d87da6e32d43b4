//! One headset and an honest server.

use crate::fake_server::{honest, pool, run, start};
use headset::{
    Headset, HeadsetEvent, KeepSettings, PictureChoice, PictureSettings, SceneChange, SceneOutcome,
    SimulatedSettings,
};
use session::HeadsetTime;
use spatial::Pose;
use std::fs;
use std::sync::Arc;
use std::time::{Duration, Instant};
use trace::{Ending, Trace};

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_frame_is_decoded_checked_and_written_down() {
    let server = start(honest());
    let settings = server.simulated();
    let progress = settings.progress.clone();
    let run = run(settings).await;

    assert!(run.frames.len() >= 5, "{} frames in a second", run.frames.len());
    assert!(run.violations.is_empty(), "{:?}", run.violations);
    assert!(run.ended_in_order(), "{:?}", run.end);
    assert_eq!(run.end.by, "us");
    let counters = run.counters;
    assert_eq!(counters.decoded, run.frames.len() as u64);
    assert_eq!(counters.decoded, progress.decoded());
    assert_eq!(counters.late, run.frames.iter().filter(|frame| frame.lateness_us > 0).count() as u64);
    assert_eq!((counters.undecodable, counters.at_jumps, counters.without_depth), (0, 0, 0));
    assert!(counters.poses_sent > counters.decoded / 2 && counters.received >= counters.decoded);

    assert!(run.frames[0].depends_on.is_none());
    assert_eq!(run.frames.iter().filter(|frame| frame.depends_on.is_none()).count(), 1);
    for frame in &run.frames {
        if let Some(times) = frame.times {
            assert_eq!(times.stages_us.iter().sum::<i64>(), frame.pose_to_decoded_us);
        }
        assert!(frame.bytes > 0 && frame.stream_bytes > frame.bytes);
        assert!(frame.pose_to_decoded_us > 0 && frame.decode_us >= 0);
        assert!(frame.prediction_error_mm.is_some() && frame.prediction_error_deg.is_some());
        assert_eq!((frame.resolution_scale, frame.step_scale, frame.shading), (0.5, 2.0, 1));
    }
    assert!(run.frames.iter().any(|frame| frame.times.is_some()));
    assert!(run.frames.windows(2).all(|pair| pair[0].frame < pair[1].frame));

    let clock = run.clock.unwrap();
    assert!(clock.server_minus_headset_us > 4_900_000_000, "{clock:?}");
    assert!(!run.server_statistics.is_empty());
    let session = run.session.as_ref().unwrap();
    assert_eq!((session.server_name.as_str(), session.stream_size_px), ("fake", [128, 32]));
    assert!(run.bitrate_bps() > 0.0 && run.frames_per_second() > 0.0);
    assert!(
        (run.seconds - 1.0).abs() < 1e-6,
        "its time is what was asked, not when it came to notice the end"
    );
    assert!(run.path.bytes_received > counters.bytes_received / 2 && run.path.rtt_us > 0);
    serde_json::to_string(&run).unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn scenes_are_changed_at_their_time_and_refusals_told() {
    let server = start(honest());
    let change = |at_secs, scene_json: &str| SceneChange { at_secs, scene_json: scene_json.to_owned() };
    let scene_changes =
        vec![change(0.5, "bad"), change(0.1, "{}"), change(0.6, &"x".repeat(1 << 20)), change(100.0, "{}")];
    // Time for an answer, and for a frame after it.
    let run = run(SimulatedSettings { scene_changes, seconds: 3.0, ..server.simulated() }).await;
    let [shown, refused, too_large] = &run.scene_requests[..] else {
        panic!("three were asked for in time: {:?}", run.scene_requests);
    };
    let SceneOutcome::Shown { revision: 1, answered_at_secs, first_frame_at_secs: Some(first) } =
        shown.outcome
    else {
        panic!("{shown:?}");
    };
    assert!(shown.at_secs <= answered_at_secs && shown.at_secs < first);
    assert!(
        matches!(&refused.outcome, SceneOutcome::Refused { reason, .. } if reason == "a bad scene"),
        "{refused:?}"
    );
    assert!(matches!(too_large.outcome, SceneOutcome::NotSent { .. }), "{too_large:?}");
    assert!(run.frames.iter().any(|frame| frame.scene_revision == 1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pictures_and_the_stream_are_kept() {
    let directory = tempfile::tempdir().unwrap();
    let pictures = directory.path().join("pictures");
    let movie = directory.path().join("stream.mp4");
    let server = start(honest());
    let keep = KeepSettings {
        pictures: Some(PictureSettings {
            directory: pictures.clone(),
            choice: PictureChoice::Spread { count: 3, seconds: 1.0 },
        }),
        recording: Some(movie.clone()),
    };
    let run = run(SimulatedSettings { keep, ..server.simulated() }).await;
    assert_eq!(run.kept.errors, Vec::<String>::new());
    assert!((1..=3).contains(&run.kept.pictures.len()), "{:?}", run.kept);
    for number in &run.kept.pictures {
        let name = |end: &str| pictures.join(format!("frame-{number:06}{end}"));
        for eye in ["-left.png", "-right.png"] {
            let picture = image::open(name(eye)).unwrap().to_rgb8();
            assert_eq!(picture.dimensions(), (64, 32));
            assert!(picture.pixels().any(|pixel| pixel.0[0] > 180), "the bar is there");
            assert!(picture.pixels().any(|pixel| pixel.0[0] < 30), "and the ground");
        }
        let json: serde_json::Value = serde_json::from_slice(&fs::read(name(".json")).unwrap()).unwrap();
        assert_eq!(json["frame"], *number);
        assert_eq!(json["eyes"][1]["file"], format!("frame-{number:06}-right.png"));
        assert_eq!(json["eyes"][0]["world_from_eye"]["position_m"].as_array().unwrap().len(), 3);
    }
    let recording = run.kept.recording.unwrap();
    assert_eq!(recording.pictures, run.frames.len(), "all that was decoded");
    assert_eq!(fs::metadata(&movie).unwrap().len(), recording.bytes);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_nth_picture_is_kept_if_so_asked() {
    let directory = tempfile::tempdir().unwrap();
    let server = start(honest());
    let choice = PictureChoice::Every(5);
    let pictures = Some(PictureSettings { directory: directory.path().to_owned(), choice });
    let keep = KeepSettings { pictures, recording: None };
    let run = run(SimulatedSettings { keep, ..server.simulated() }).await;
    let chosen: Vec<u64> = run.frames.iter().step_by(5).map(|frame| frame.frame).collect();
    assert_eq!(run.kept.pictures.len() as u64 + run.kept.pictures_skipped, chosen.len() as u64);
    assert!(run.kept.pictures.iter().all(|number| chosen.contains(number)));
    assert!(run.kept.recording.is_none());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_trace_that_jumps_breaks_no_rule() {
    let server = start(honest());
    // A fifth of a second, then back to the beginning, two metres away and turned round.
    let walk = "0 0 1.6 0 0 0 0 1\n0.2 2 1.6 0 0 1 0 0\n";
    let trace = Arc::new(Trace::parse("walk", walk.as_bytes()).unwrap());
    let run = run(SimulatedSettings { trace, ending: Ending::Loop, ..server.simulated() }).await;
    assert!(run.counters.at_jumps > 0);
    assert!(run.violations.is_empty(), "{:?}", run.violations);
    assert_eq!(
        run.frames.iter().filter(|frame| frame.prediction_error_mm.is_none()).count() as u64,
        run.counters.at_jumps
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_client_of_one_s_own_drives_the_same_headset() {
    let server = start(honest());
    let mut headset = Headset::connect(&server.simulated().headset, &pool(), Instant::now()).await.unwrap();
    let mut sent: Option<(u64, HeadsetTime)> = None;
    let mut decoded = 0;
    loop {
        // Every wait for an event may be given up.
        let event = tokio::time::timeout(Duration::from_millis(2), headset.next_event()).await;
        match event {
            Ok(HeadsetEvent::Frame(frame)) => {
                assert!(sent.is_some_and(|(sequence, _)| frame.received.header.pose_sequence <= sequence));
                decoded += 1;
                if decoded == 5 {
                    headset.goodbye();
                }
            }
            Ok(HeadsetEvent::Disconnected(end)) => {
                assert_eq!(end.by, session::ClosedBy::Us);
                break;
            }
            Ok(_) | Err(_) => {
                let now = headset.clock().now();
                let sequence = headset.send_pose(now, now + Duration::from_millis(50), &Pose::IDENTITY);
                sent = sequence.map(|sequence| (sequence, now)).or(sent);
            }
        }
    }
    assert!(headset.counters().frames_decoded >= 5);
}
