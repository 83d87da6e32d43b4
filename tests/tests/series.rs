//! A series in time: headsets see the step that its frame's header says, and the play goes on whatever a step does.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use end_to_end::{Likeness, Planes, TestServer, Viewer, growing, scene_with, settings, subject, until};
use headset::HeadsetEvent;
use render::Quality;
use server::{Series, Settings};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use volume::Volume;

/// A prime: where making a step takes as long as several are on view, each is seen all the same, some rounds later.
const STEPS: u32 = 5;
/// As for a still picture of one volume: the encoder has nothing left to add.
const STILL: Likeness = Likeness { luma_db: 48.0, chroma_db: 48.0 };
/// Two steps after each other are less alike than this, whatever the codec did.
const ANOTHER_STEP_DB: f64 = 35.0;
/// Frames of one view until the encoder has nothing left to add.
const CONVERGED: usize = 15;

fn generous() -> Settings {
    let quality = Quality { step_voxels: 0.5, ..Quality::BALANCED };
    Settings { quality, adapt_quality: false, bits_per_pixel: 30.0, ..settings() }
}

/// A scene that plays.
fn playing(steps_per_sec: f64, from: Option<u32>) -> String {
    let from = from.map(|from| format!(r#", "from": {from}"#)).unwrap_or_default();
    scene_with(&format!(r#""play": {{"steps_per_sec": {steps_per_sec}{from}}}"#))
}

/// A scene that says nothing of playing.
fn standing() -> String {
    scene_with(r#""description": "the step on view""#)
}

fn room(steps: &[Volume], scene_json: &str) -> TestServer {
    counting_room(steps, scene_json).0
}

/// A room, and how many steps were loaded for it.
fn counting_room(steps: &[Volume], scene_json: &str) -> (TestServer, Arc<AtomicUsize>) {
    let all: Vec<Arc<Volume>> = steps.iter().cloned().map(Arc::new).collect();
    let loads = Arc::new(AtomicUsize::new(0));
    let counted = loads.clone();
    let load = move |step: u32| {
        counted.fetch_add(1, Ordering::Relaxed);
        Ok(all[step as usize].clone())
    };
    let series = Series::new(steps.len() as u32, 0, Arc::new(load));
    (TestServer::start_series(steps[0].clone(), series, scene_json, generous()), loads)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_step_that_is_asked_for_is_the_picture_that_comes() {
    let steps = growing(STEPS);
    let room = room(&steps, &standing());
    let mut viewer = Viewer::join(&room, "viewer").await;
    assert_eq!(viewer.frame_after(0).await.received.header.time_step, 0);
    for wanted in [2, 1, 4, 3, 0] {
        let scene = playing(0.0, Some(wanted));
        viewer.headset.change_scene(&scene).unwrap();
        let frame = viewer.frame_of_step(wanted, CONVERGED).await;
        let (found, view) = (Planes::of_decoded(&frame.picture), frame.received.view);
        for step in 0..STEPS {
            let still = Planes::of_still(&room.still_of_step(&steps[step as usize], &scene, &view));
            if step == wanted {
                still.assert_alike(&found, STILL, &format!("step {step}"));
            } else {
                let other = still.likeness(&found);
                assert!(other.luma_db < ANOTHER_STEP_DB, "{wanted} looks like {step}: {other}");
            }
        }
    }
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_play_goes_round_and_stays_where_it_is_when_the_scene_plays_no_more() {
    let room = room(&growing(STEPS), &playing(2.0, None));
    let mut viewer = Viewer::join(&room, "viewer").await;
    let (mut seen, mut changes) = (Vec::new(), 0);
    while changes < 2 * STEPS {
        let header = viewer.frame_after(0).await.received.header;
        assert_eq!(header.scene_revision, 0, "another step is no other scene");
        if seen.last() != Some(&header.time_step) {
            seen.push(header.time_step);
            changes += 1;
        }
    }
    println!("steps {seen:?}");
    assert!((0..STEPS).all(|step| seen.contains(&step)), "some step is never seen: {seen:?}");
    // A busy machine leaves steps out; were they shown in the wrong order, most would be three or four on.
    let advances = seen.windows(2).map(|w| (w[1] + STEPS - w[0]) % STEPS);
    let ahead = advances.filter(|&advance| advance <= STEPS / 2).count();
    assert!(2 * ahead > seen.len() - 1, "{ahead} steps lead ahead: {seen:?}");

    viewer.headset.change_scene(&standing()).unwrap();
    let stays = viewer.frame_of_scene(1, 0).await.received.header.time_step;
    for _ in 0..CONVERGED {
        assert_eq!(viewer.frame_after(0).await.received.header.time_step, stays);
    }
    // And goes on from there, through another scene that plays at the same rate too.
    viewer.headset.change_scene(&playing(2.0, None)).unwrap();
    assert_eq!(viewer.frame_of_scene(2, 0).await.received.header.time_step, stays);
    viewer.frame_of_step((stays + 1) % STEPS, 0).await;
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_play_begins_with_the_step_that_it_is_to_begin_with() {
    let room = room(&growing(STEPS), &standing());
    let mut viewer = Viewer::join(&room, "viewer").await;
    viewer.frame_after(0).await;
    // Slow, so that also a busy machine sees each of them.
    viewer.headset.change_scene(&playing(1.0, Some(2))).unwrap();
    let mut seen = vec![0];
    while seen.len() < 5 {
        let step = viewer.frame_after(0).await.received.header.time_step;
        if seen.last() != Some(&step) {
            seen.push(step);
        }
    }
    assert_eq!(seen, [0, 2, 3, 4, 0]);
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_play_stands_while_nobody_looks() {
    // What would be loaded meanwhile, if it did not.
    const MEANWHILE: Duration = Duration::from_secs(1);
    let (room, loads) = counting_room(&growing(STEPS), &playing(4.0, Some(2)));
    let loads = || loads.load(Ordering::Relaxed);
    // The first step is made for whoever comes.
    until("the first step is there", || loads() == 1).await;
    tokio::time::sleep(MEANWHILE).await;
    assert_eq!(loads(), 1);
    let mut viewer = Viewer::join(&room, "viewer").await;
    viewer.frame_of_step(0, 0).await;
    viewer.frame_of_step(1, 0).await;
    viewer.leave().await;
    room.is_empty().await;
    let when_it_left = loads();
    assert!(when_it_left >= 3, "{when_it_left}");
    tokio::time::sleep(MEANWHILE).await;
    // One may have been in the making.
    assert!(loads() <= when_it_left + 1, "{} after {when_it_left}", loads());
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_label_that_a_step_lacks_is_not_seen_and_the_step_is_shown() {
    let both = end_to_end::labels();
    let mut alone = both.channels()[0].clone();
    let only_one = |label: &u8| if *label == 1 { 1 } else { 0 };
    alone.voxels = volume::Voxels::U8(alone.voxels.as_bytes().iter().map(only_one).collect());
    let lacks_two = Volume::new(both.grid().clone(), vec![alone]).unwrap();
    let scene = r#"{"labels": {"only": [2], "opacity": {"2": 0.2}}, "play": {"steps_per_sec": 4}}"#;
    let room = room(&[both, lacks_two], scene);
    let mut viewer = Viewer::join(&room, "viewer").await;
    for (step, is_seen) in [(0, true), (1, false), (0, true)] {
        let frame = viewer.frame_of_step(step, 0).await;
        let luma = Planes::of_decoded(&frame.picture).brightest_luma();
        assert_eq!(luma > 60.0, is_seen, "step {step} has a luma of {luma}");
    }
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_step_that_cannot_be_loaded_is_left_out_and_a_series_of_none_stands_still() {
    let steps = growing(STEPS);
    let calls = Arc::new(AtomicUsize::new(0));
    let bad = [2, 3];
    let load = {
        let (calls, steps): (_, Vec<_>) = (calls.clone(), steps.iter().cloned().map(Arc::new).collect());
        move |step: u32| {
            calls.fetch_add(1, Ordering::Relaxed);
            match step {
                // Of another size: it would lie elsewhere.
                2 => Ok(Arc::new(end_to_end::labels())),
                3 => Err("the disk is gone".into()),
                step => Ok(steps[step as usize].clone()),
            }
        }
    };
    let series = Series::new(STEPS, 0, Arc::new(load));
    let room = TestServer::start_series(steps[0].clone(), series, &playing(20.0, None), generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    for step in [1, 0, 1, 0] {
        viewer
            .frame_with("a good step", |frame| {
                let found = frame.received.header.time_step;
                assert!(!bad.contains(&found), "step {found} cannot be had");
                found == step
            })
            .await;
    }
    viewer.leave().await;
    room.shutdown().await;

    let calls = Arc::new(AtomicUsize::new(0));
    let counted = calls.clone();
    let none = move |_: u32| {
        counted.fetch_add(1, Ordering::Relaxed);
        Err("the disk is gone".into())
    };
    let series = Series::new(STEPS, 0, Arc::new(none));
    let room = TestServer::start_series(steps[0].clone(), series, &playing(60.0, None), generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    viewer.frame_after(3 * CONVERGED).await;
    // Each once; it is not asked for again and again.
    assert_eq!(calls.load(Ordering::Relaxed), STEPS as usize);
    assert_eq!(viewer.frame_after(0).await.received.header.time_step, 0);
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_step_that_does_not_come_holds_up_no_shutdown() {
    let steps = growing(2);
    let (comes, wait) = std::sync::mpsc::channel::<()>();
    let (wait, asked) = (Mutex::new(wait), Arc::new(AtomicUsize::new(0)));
    let counted = asked.clone();
    let load = move |_: u32| {
        counted.fetch_add(1, Ordering::Relaxed);
        let _ = wait.lock().unwrap().recv();
        Err("the disk was slow".into())
    };
    let series = Series::new(2, 0, Arc::new(load));
    let room = TestServer::start_series(steps[0].clone(), series, &playing(4.0, Some(1)), generous());
    until("the step is asked for", || asked.load(Ordering::Relaxed) == 1).await;
    end_to_end::within("the server's end", room.shutdown()).await;
    drop(comes);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_cannot_be_played_is_refused_with_the_reason() {
    let series = room(&growing(STEPS), &standing());
    refused(&series, &playing(5.0, Some(STEPS)), &["play.from", "0 to 4", "5"]).await;
    series.shutdown().await;
    let alone = TestServer::start(subject(), &standing(), generous());
    refused(&alone, &playing(5.0, None), &["play", "series in time"]).await;
    refused(&alone, &playing(61.0, None), &["play.steps_per_sec", "61", "0 to 60"]).await;
    alone.shutdown().await;
}

async fn refused(room: &TestServer, scene: &str, parts: &[&str]) {
    let mut viewer = Viewer::join(room, "viewer").await;
    viewer.headset.change_scene(scene).unwrap();
    match viewer.notice("a refusal").await {
        HeadsetEvent::SceneRefused { reason, .. } => {
            assert!(parts.iter().all(|part| reason.contains(part)), "expected {parts:?} in '{reason}'");
        }
        event => panic!("expected a refusal, found {event:?}"),
    }
    viewer.leave().await;
}
