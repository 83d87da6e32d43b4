//! Real recordings: bundled excerpts always, whole ones where they are at hand.

use spatial::{DQuat, DVec3, Motion};
use std::path::{Path, PathBuf};
use trace::{Ending, Format, Stand, Trace, TraceError};

fn excerpt(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("testdata").join(name)
}

fn bundled(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/traces").join(name)
}

/// A recording beside the repository, where it is there.
fn whole(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/headpose").join(name);
    path.exists().then_some(path)
}

/// A head upright on the average, and no faster than necks and legs are.
fn check_is_a_head(trace: &Trace) {
    let poses = trace.poses();
    let tops: DVec3 = poses.iter().map(|pose| pose.pose.orientation * DVec3::Y).sum();
    assert!(tops.y / poses.len() as f64 > 0.9, "{}: mean top {}", trace.name(), tops / poses.len() as f64);
    for pair in poses.windows(2) {
        let motion = Motion::between(&pair[0], &pair[1]);
        let (metres, radians) = (motion.linear_m_per_sec.length(), motion.angular_rad_per_sec.length());
        assert!(metres < 3.0 && radians < 15.0, "{}: {metres} m/s, {radians} rad/s", trace.name());
    }
}

#[test]
fn the_excerpts_of_each_format_read_as_they_are() {
    let check = |name: &str, format: Format, poses: usize, duration_secs: f64| {
        let trace = Trace::load(excerpt(name)).unwrap();
        assert_eq!((trace.format(), trace.poses().len(), trace.duplicates()), (format, poses, 0), "{name}");
        assert!((trace.duration_secs() - duration_secs).abs() < 1e-6, "{name}: {}", trace.duration_secs());
        check_is_a_head(&trace);
        trace
    };
    check("eye_pairs.csv", Format::EyePairs, 12, 0.307);
    let captured = check("motion_capture.json", Format::MotionCapture, 12, 0.11914);
    let numbers = check("tum.txt", Format::Tum, 12, 0.11914);
    // The same poses, once as Euler angles, once as quaternions that were computed elsewhere.
    for (a, b) in captured.poses().iter().zip(numbers.poses()) {
        assert!(a.pose.position_m.distance(b.pose.position_m) < 1e-6);
        assert!(a.pose.angle_to(&b.pose) < 1e-6);
    }
}

#[test]
fn the_bundled_traces_are_sixteen_seconds_of_walking() {
    for name in ["walk-bicycle.jsonl", "walk-drjohnson.jsonl"] {
        let trace = Trace::load(bundled(name)).unwrap();
        assert_eq!(trace.format(), Format::JsonLines);
        assert!((15.9..=16.0).contains(&trace.duration_secs()), "{name}: {} s", trace.duration_secs());
        check_is_a_head(&trace);
        let steps = trace.poses().windows(2);
        let way_m: f64 = steps.map(|pair| pair[0].pose.position_m.distance(pair[1].pose.position_m)).sum();
        assert!(way_m > 1.0, "{name}: {way_m} m");
    }
}

#[test]
fn a_placed_trace_looks_at_the_hologram() {
    let target_in_world = DVec3::new(0.0, 1.5, -2.0);
    for name in ["walk-bicycle.jsonl", "walk-drjohnson.jsonl"] {
        let stand = Stand { target_in_world, distance_m: 2.0, azimuth_rad: 0.5 };
        let placed = Trace::load(bundled(name)).unwrap().facing(&stand);
        check_is_a_head(&placed);
        let first = placed.poses()[0].pose;
        assert!(
            (first.position_m + 2.0 * (first.orientation * DVec3::NEG_Z) - target_in_world).length() < 1e-9
        );

        let attentive = placed.attentive(target_in_world, 0.15);
        check_is_a_head(&attentive);
        for i in 0..1600 {
            let pose = attentive.sample(f64::from(i) * 0.01, Ending::PingPong);
            let to_target = target_in_world - pose.position_m;
            let off_deg = (pose.orientation * DVec3::NEG_Z).angle_between(to_target).to_degrees();
            assert!(off_deg < 12.3, "{name}: {off_deg}° off after {i} steps");
        }
    }
}

#[test]
fn whole_recordings_read() {
    let check = |name: &str, poses: usize, duration_secs: f64| {
        let Some(path) = whole(name) else { return };
        let trace = Trace::load(path).unwrap();
        assert_eq!(trace.poses().len(), poses, "{name}");
        assert!((trace.duration_secs() - duration_secs).abs() < 0.01, "{name}: {}", trace.duration_secs());
        check_is_a_head(&trace);
        let back = Trace::parse(name, trace.to_json_lines().as_bytes()).unwrap();
        assert_eq!(back.poses().len(), poses);
    };
    check("questpro_user105_bicycle.csv", 1456, 40.634);
    check("questpro_user118_drjohnson.csv", 2285, 64.004);
    check("vive_dev_recording.json", 816, 9.33448);
}

#[test]
fn levelling_by_the_mean_comes_near_the_true_tilt() {
    // The scenes' quaternions from the data set's list, and how far off the mean is known to be.
    for (name, scene, most_deg) in [
        ("questpro_user105_bicycle.csv", [-0.1142, 0.0, 0.0, 0.9935], 5.7),
        ("questpro_user118_drjohnson.csv", [-0.3699, 0.0, 0.5976, 0.7114], 1.9),
    ] {
        let Some(path) = whole(name) else { continue };
        let trace = Trace::load(&path).unwrap();
        // The first data row, left eye: columns 8 to 11.
        let text = std::fs::read_to_string(&path).unwrap();
        let row: Vec<f64> = text.lines().nth(1).unwrap().split(',').map(|f| f.parse().unwrap()).collect();
        let recorded = DQuat::from_xyzw(row[8], row[9], row[10], row[11]).normalize();
        let level = DQuat::from_array(scene).normalize() * recorded;
        let up_of = |head: DQuat| head.conjugate() * DVec3::Y;
        let off_deg = up_of(trace.poses()[0].pose.orientation).angle_between(up_of(level)).to_degrees();
        assert!(off_deg < most_deg, "{name}: {off_deg}°");
    }
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let error = Trace::load("no/such/trace.csv").unwrap_err();
    assert_eq!(error.to_string(), "cannot read the trace no/such/trace.csv");
}

#[test]
fn a_file_that_is_too_long_is_not_read_to_its_end() {
    let file = tempfile::NamedTempFile::new().unwrap();
    // A hole: a hundred gigabytes that take no room.
    file.as_file().set_len(100 << 30).unwrap();
    let error = Trace::load(file.path()).unwrap_err();
    assert!(matches!(error, TraceError::TooLong { .. }), "{error}");
    assert!(
        error.to_string().ends_with("longer than 67108864 bytes, which is the limit for a trace"),
        "{error}"
    );
}

#[test]
fn no_truncation_of_a_recording_panics() {
    for name in ["eye_pairs.csv", "motion_capture.json", "tum.txt"] {
        let bytes = std::fs::read(excerpt(name)).unwrap();
        for length in 0..bytes.len() {
            // Cut at a line's end it is a shorter trace; anything else is an error.
            let _ = Trace::parse(name, &bytes[..length]);
        }
    }
}
