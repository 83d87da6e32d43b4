//! What a headset decodes is what its frame's header says that it shows.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use end_to_end::{
    BEACON_IN_ROOM, CENTRE_IN_ROOM, Likeness, Planes, SIZE_PX, TestServer, Viewer, beacon, in_front, labels,
    scene_of_mode, scene_with, settings, subject,
};
use headset::{DecodedFrame, HeadsetEvent};
use reference::{RaySetup, Reference};
use render::Quality;
use scene::Mode;
use server::Settings;
use spatial::{DVec3, Pose, StereoView};

/// A picture that stands still, after some frames with more bits than the encoder can use, against the renderer's own.
/// The finest quantiser of openh264 is 12, a step of 2.5; what is left of a step is at most as good as evenly spread,
/// 2.5²/12 = 0.52 of mean square, 51 dB. This allows twice that, for the dead zone and for rounding to bytes. Found: 51.8
/// to 53.3 dB of luma, 52.0 to 54.6 dB of chroma. With its eyes changed over a picture has 15 to 26 dB.
const STILL: Likeness = Likeness { luma_db: 48.0, chroma_db: 48.0 };
/// The same against the exact picture: to the 1.03 of mean square above comes what the renderer is off, at its worst a
/// mean square of 0.88 (48.7 dB, along the silhouettes of the threshold surface). Found: 47.9 to 53.8 dB.
const EXACT: Likeness = Likeness { luma_db: 45.0, chroma_db: 45.0 };
/// A picture that moves against the renderer's own of the same view: each frame begins with what the last has left, and
/// the encoder has one go at it.
const MOVING: Likeness = Likeness { luma_db: 42.0, chroma_db: 42.0 };
/// How much less a moving picture is like the view of the frame before it.
const ANOTHER_VIEW_DB: f64 = 3.0;
/// Whatever the codec did, these are two different scenes.
const ANOTHER_SCENE_DB: f64 = 30.0;

/// Frames of one view until the encoder has nothing left to add.
const CONVERGED: usize = 15;

/// Quality that stays, with two samples a voxel: near the exact picture, and fast enough on a software driver that shares
/// its cores with all else here. And more bits than the encoder can use: 96x64x2 pixels at 30 Hz get 11 Mbit/s.
fn generous() -> Settings {
    let quality = Quality { step_voxels: 0.5, least_transmittance: 1.0 / 2048.0, ..Quality::BALANCED };
    Settings { quality, adapt_quality: false, bits_per_pixel: 30.0, ..settings() }
}

fn decoded(frame: &DecodedFrame) -> Planes {
    Planes::of_decoded(&frame.picture)
}

/// The exact picture of a view.
fn exact(room: &TestServer, scene_json: &str, view: &StereoView) -> Planes {
    let scene = room.scene(scene_json);
    let grid = room.volume.grid();
    let volumes: Vec<_> = std::iter::once(&room.volume).chain(&room.others).collect();
    let reference = Reference::of_several(&volumes, &scene).unwrap();
    let eyes = view.eyes.map(|eye| {
        let setup = RaySetup::in_room(grid, scene.placement.world_from_volume(grid).inverse(), eye);
        let picture = reference.picture(&setup, SIZE_PX[0], SIZE_PX[1], &|_| {}).unwrap();
        picture.over(scene.background).pixels().iter().map(|p| [p.rgba[0], p.rgba[1], p.rgba[2]]).collect()
    });
    let [left, right]: [Vec<[f64; 3]>; 2] = eyes;
    Planes::of_eyes(SIZE_PX, [&left, &right])
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_decoded_frame_is_the_picture_of_its_headers_view_in_every_mode() {
    let room = TestServer::start(subject(), &scene_of_mode(Mode::ALL[0]), generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    for (mode, revision) in Mode::ALL.into_iter().zip(0..) {
        let json = scene_of_mode(mode);
        if revision > 0 {
            assert_eq!(room.server.change_scene(&json).unwrap(), revision);
        }
        let frame = viewer.frame_of_scene(revision, CONVERGED).await;
        let view = frame.received.view;
        let (own, found) = (Planes::of_still(&room.still(&json, &view)), decoded(&frame));
        let name = mode.name();
        let of_own = own.assert_alike(&found, STILL, &format!("{name} against the renderer's own picture"));
        let of_exact = exact(&room, &json, &view).assert_alike(
            &found,
            EXACT,
            &format!("{name} against the exact picture"),
        );
        let swapped = own.with_eyes_swapped().likeness(&found);
        println!("{name}: {of_own}; against the exact picture {of_exact}; with eyes changed over {swapped}");
        assert!(swapped.luma_db < ANOTHER_SCENE_DB, "the eyes see the same: {swapped}");
    }
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_further_volume_is_shown_and_hidden_while_a_headset_watches() {
    let of = |fields: &str| {
        let looks = r#"{"tint": {"1": [1, 0.2, 0.2], "2": [0.2, 1, 0.3]}, "opacity": {"1": 0.01, "2": 0.2}}"#;
        scene_with(&format!(r#""further_volumes": [{{"volume": "1", "labels": {looks}{fields}}}]"#))
    };
    let (shown, hidden) = (of(""), of(r#", "shown": false"#));
    let room = TestServer::start_beside(subject(), vec![labels()], &hidden, generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    let mut before: Option<Planes> = None;
    for (json, revision) in [(&hidden, 0), (&shown, 1), (&hidden, 2)] {
        if revision > 0 {
            assert_eq!(room.server.change_scene(json).unwrap(), revision);
        }
        let frame = viewer.frame_of_scene(revision, CONVERGED).await;
        let (own, found) = (Planes::of_still(&room.still(json, &frame.received.view)), decoded(&frame));
        let of_own = own.assert_alike(&found, STILL, "several volumes against the renderer's own picture");
        let of_exact = exact(&room, json, &frame.received.view).assert_alike(
            &found,
            EXACT,
            "several volumes against the exact picture",
        );
        println!("scene {revision}: {of_own}; against the exact picture {of_exact}");
        if let Some(before) = before.replace(own) {
            let other = before.likeness(&found);
            assert!(other.luma_db < ANOTHER_SCENE_DB, "the labels come and go: {other}");
        }
    }
    // No file is opened for a scene that names another.
    let refused =
        room.server.change_scene(&shown.replace(r#""1", "labels""#, r#""2", "labels""#)).unwrap_err();
    assert!(refused.to_string().contains("'2'"), "{refused}");
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_frame_of_a_moving_head_shows_its_own_view_and_no_other() {
    let json = scene_of_mode(Mode::Threshold);
    let room = TestServer::start(subject(), &json, generous());
    // Round in front of it at 0.6 m/s, with the eyes on the middle.
    let walk = |secs: f64| {
        let swing = DVec3::new(0.3 * (2.0 * secs).cos(), 0.3 * (2.0 * secs).sin(), 0.95);
        Pose::looking_at(CENTRE_IN_ROOM + swing, CENTRE_IN_ROOM, DVec3::Y).unwrap()
    };
    let mut viewer = Viewer::join_as(&room, &room.headset("walker"), walk).await;
    let mut before = viewer.frame_after(10).await.received.view;
    for _ in 0..8 {
        let frame = viewer.frame_after(2).await;
        let view = frame.received.view;
        let found = decoded(&frame);
        let own =
            Planes::of_still(&room.still(&json, &view)).assert_alike(&found, MOVING, "a moving picture");
        let other = Planes::of_still(&room.still(&json, &before)).likeness(&found);
        println!("own view {own}, that of three frames before {other}");
        assert!(other.luma_db + ANOTHER_VIEW_DB < own.luma_db, "{own}, the view before has {other}");
        before = view;
    }
    viewer.leave().await;
    room.shutdown().await;
}

/// Where a point of the room is seen by an eye of the headset, in pixels from the picture's upper left corner, worked
/// out here from the head alone: eyes 64 mm apart, 30° wide, square pixels.
fn projected(head: &Pose, eye: usize, point_in_room: DVec3) -> [f64; 2] {
    let eye_in_head = DVec3::new([-0.032, 0.032][eye], 0.0, 0.0);
    let in_eye = head.orientation.conjugate() * (point_in_room - head.position_m) - eye_in_head;
    let [width, height] = SIZE_PX.map(f64::from);
    let focal_px = width / 2.0 / 15f64.to_radians().tan();
    [width / 2.0 + focal_px * in_eye.x / -in_eye.z, height / 2.0 - focal_px * in_eye.y / -in_eye.z]
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn left_is_left_up_is_up_and_the_left_eye_sees_near_things_farther_right() {
    let room = TestServer::start(beacon(), &scene_of_mode(Mode::Maximum), generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    let found = decoded(&viewer.frame_after(CONVERGED).await);
    let expected = [0, 1].map(|eye| projected(&in_front(), eye, BEACON_IN_ROOM));
    let seen = [0, 1].map(|eye| found.centroid(eye).unwrap());
    println!("beacon seen at {seen:.2?}, expected at {expected:.2?}");
    // The beacon is 7 pixels wide and its middle is found to a part of one; the eyes see it 12 pixels apart.
    for (seen, expected) in seen.iter().flatten().zip(expected.iter().flatten()) {
        assert!((seen - expected).abs() < 0.5, "seen at {seen:.2}, expected at {expected:.2}");
    }
    assert!(expected[0][0] - expected[1][0] > 8.0, "the test would not see swapped eyes: {expected:?}");
    assert!(expected.iter().all(|[x, y]| *x > 48.0 && *y < 32.0), "nor a mirrored picture: {expected:?}");
    viewer.leave().await;
    room.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_scene_asked_for_by_one_headset_is_seen_by_all() {
    let before = scene_of_mode(Mode::EmissionAbsorption);
    let after = scene_with(r#""placement": {"yaw_deg": 140, "scale": 0.8}, "background": [0.1, 0.2, 0.15]"#);
    let room = TestServer::start(subject(), &before, generous());
    let mut asking = Viewer::join(&room, "asking").await;
    let mut watching = Viewer::join(&room, "watching").await;
    for viewer in [&mut asking, &mut watching] {
        assert_eq!(viewer.frame_after(0).await.received.header.scene_revision, 0);
    }

    let request = asking.headset.change_scene(&after).unwrap();
    let check = |event, expected_request| match event {
        HeadsetEvent::SceneChanged { request_id, revision, scene_json } => {
            assert_eq!((request_id, revision), (expected_request, 1));
            assert_eq!(scene_json.as_deref(), Some(after.as_str()), "the scene is told to all");
        }
        other => panic!("expected a change of the scene, found {other:?}"),
    };
    check(asking.notice("the answer").await, Some(request));
    check(watching.notice("the other's change").await, None);
    for viewer in [&mut asking, &mut watching] {
        let frame = viewer.frame_of_scene(1, CONVERGED).await;
        let (view, found) = (frame.received.view, decoded(&frame));
        let old = Planes::of_still(&room.still(&before, &view)).likeness(&found);
        assert!(old.luma_db < ANOTHER_SCENE_DB, "still like the old scene: {old}");
        let scene = room.still(&after, &view);
        over(&scene, [0.1, 0.2, 0.15]).assert_alike(&found, STILL, "the new scene");
    }

    // A headset that comes later is told which scene there is, and sees it.
    let mut late = Viewer::join(&room, "late").await;
    assert_eq!(late.frame_after(0).await.received.header.scene_revision, 1);
    for viewer in [asking, watching, late] {
        viewer.leave().await;
    }
    room.shutdown().await;
}

/// A still before a background.
fn over(still: &render::Still, background: [f64; 3]) -> Planes {
    let eyes = [0, 1].map(|eye| -> Vec<[f64; 3]> {
        let shown = |p: &[f32; 4], i: usize| f64::from(p[i]) + (1.0 - f64::from(p[3])) * background[i];
        still.eye(eye).iter().map(|p| std::array::from_fn(|i| shown(p, i))).collect()
    });
    Planes::of_eyes(still.eye_size_px, [&eyes[0], &eyes[1]])
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_scene_that_cannot_be_shown_leaves_the_old_one_and_is_answered_with_the_reason() {
    let json = scene_of_mode(Mode::Threshold);
    let room = TestServer::start(subject(), &json, generous());
    let mut viewer = Viewer::join(&room, "viewer").await;
    let mut other = Viewer::join(&room, "other").await;
    let points = "[[0, 0, 0, 0, 0], [9, 1, 1, 1, 1], [5, 1, 1, 1, 1]]";
    for (scene, reasons) in [
        (r#"{"fog": 1}"#, &["unknown field", "fog"][..]),
        (r#"{"threshold": NaN}"#, &["line 1 column 15"]),
        (r#"{"threshold": 1e999}"#, &["out of range"]),
        (r#"{"window": [5, 5]}"#, &["window", "low below high"]),
        (&format!(r#"{{"transfer": {points}}}"#), &["transfer", "5", "9"]),
        (r#"{"channel": "mri"}"#, &["mri", "density"]),
        (r#"{"volume": "other.nii"}"#, &["other.nii", "keeps its first volume"]),
        ("", &["line 1 column 0"]),
    ] {
        let request = viewer.headset.change_scene(scene).unwrap();
        match viewer.notice("a refusal").await {
            HeadsetEvent::SceneRefused { request_id, reason } => {
                assert_eq!(request_id, request);
                println!("{scene}: {reason}");
                for part in reasons {
                    assert!(reason.contains(part), "{scene}: expected '{part}' in '{reason}'");
                }
            }
            event => panic!("{scene}: expected a refusal, found {event:?}"),
        }
        assert_eq!(viewer.frame_after(1).await.received.header.scene_revision, 0, "{scene}");
    }
    for viewer in [&mut viewer, &mut other] {
        let frame = viewer.frame_after(CONVERGED).await;
        assert_eq!(frame.received.header.scene_revision, 0);
        let own = Planes::of_still(&room.still(&json, &frame.received.view));
        own.assert_alike(&decoded(&frame), STILL, "the old scene");
    }
    // The next one that can be shown is the first change, and the other has heard of nothing before it.
    room.server.change_scene("{}").unwrap();
    match other.notice("the change").await {
        HeadsetEvent::SceneChanged { request_id: None, revision: 1, .. } => {}
        event => panic!("expected the first change, found {event:?}"),
    }
    for viewer in [viewer, other] {
        viewer.leave().await;
    }
    room.shutdown().await;
}
