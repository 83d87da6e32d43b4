//! Series in time: one step of them, and all of them played.

use crate::files::{DIMS, Folder, nifti_of};
use crate::network::{headset, serve_scene, stop};
use crate::program::run;

const STEPS: u16 = 3;
/// As for one volume that is looked at by a moving head: see `network`.
const LEAST_DB: f64 = 29.6;

/// A ball that grows brighter from step to step.
fn series() -> Vec<u8> {
    let steps = (1..=STEPS).map(|step| i32::from(step) * 100 / i32::from(STEPS));
    nifti_of(&steps.collect::<Vec<_>>())
}

#[test]
fn time_chooses_a_step_and_says_which_there_are() {
    let folder = Folder::new();
    let volume = folder.write("beating.nii", &series());
    let info = |time: &str| run(["info", &volume, "--time", time, "--json"]).json();
    let highest = |time: &str| info(time)["channels"][0]["maximum"].as_f64().unwrap();
    assert_eq!(info("0")["dims"], serde_json::json!(DIMS));
    assert!(highest("0") < highest("1") && highest("1") < highest("2"));
    let scene = folder.write("window.json", br#"{"mode": "x-ray", "window": [0, 2500]}"#);
    let still = |time: &str| {
        let out = folder.arg(&format!("{time}.png"));
        let shown = ["render", "--volume", &volume, "--scene", &scene, "--time", time];
        run([&shown[..], &["--size", "48x32", "--out", &out]].concat()).well();
        image::open(out).unwrap().to_rgb8().pixels().map(|p| u64::from(p.0[0])).sum::<u64>()
    };
    let brightness = ["0", "1", "2"].map(still);
    assert!(brightness[0] > 0 && brightness.is_sorted_by(|a, b| a < b), "{brightness:?}");
    run(["render", "--volume", &volume, "--time", "3", "--out", &folder.arg("none.png")]).failed(&[
        "beating.nii",
        "time",
        "0 to 2",
        "3",
    ]);
    run(["render", "--volume", &folder.volume(), "--time", "1", "--out", &folder.arg("none.png")])
        .failed(&["ball.nii", "time"]);
}

#[test]
fn a_play_is_shown_step_by_step_and_each_picture_is_held_against_its_own() {
    let folder = Folder::new();
    let volume = folder.write("beating.nii", &series());
    let scene = folder.write("play.json", br#"{"play": {"steps_per_sec": 3}}"#);
    let exactly = ["--fixed-quality", "--bits-per-pixel", "3"];
    let (server, told) = serve_scene(&folder, &volume, &scene, &[&exactly[..], &["--time", "1"]].concat());
    assert_eq!(told["volume"]["steps"], STEPS, "{told}");
    let verified = ["--verify", "9", "--volume", &volume, "--scene", &scene, "--time", "1"];
    let small = ["--device", "96x64", "--hz", "30", "--seconds", "4", "--distance-m", "0.9", "--json"];
    let report = headset(&told, &[&small[..], &verified].concat()).json();
    let frames = report["headsets"][0]["verification"]["frames"].as_array().unwrap().clone();
    let mut steps: Vec<u64> = frames.iter().map(|frame| frame["time_step"].as_u64().unwrap()).collect();
    println!("steps {steps:?}");
    steps.sort_unstable();
    steps.dedup();
    assert!(steps.len() >= 2 && steps.iter().all(|step| *step < u64::from(STEPS)), "{steps:?}");
    for frame in &frames {
        let psnr_db = frame["at_rendered_pose"]["psnr_db"].as_f64().unwrap();
        assert!(psnr_db > LEAST_DB, "{psnr_db} dB: {frame}");
    }
    stop(server);
}

#[test]
fn pictures_of_a_step_that_the_file_lacks_are_left_out_and_the_report_is_written() {
    let folder = Folder::new();
    let volume = folder.write("beating.nii", &series());
    let shorter = folder.write("shorter.nii", &nifti_of(&[33, 66]));
    let scene = folder.write("scene.json", b"{}");
    let (server, told) = serve_scene(&folder, &volume, &scene, &["--time", "2"]);
    let report = folder.arg("report.json");
    let small = ["--device", "96x64", "--hz", "30", "--seconds", "2", "--distance-m", "0.9"];
    let verified = ["--verify", "3", "--volume", &shorter, "--report", &report];
    headset(&told, &[&small[..], &verified].concat()).failed_after_report(&[
        "step 2",
        "shorter.nii",
        "0 to 1",
    ]);
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let verification = &report["headsets"][0]["verification"];
    assert!(verification["skipped"].as_u64().unwrap() >= 1, "{verification}");
    assert_eq!(verification["frames"], serde_json::json!([]));
    assert!(verification["notes"][0].as_str().unwrap().contains("step 2"), "{verification}");
    stop(server);
}

#[test]
fn what_cannot_be_played_is_refused_before_anybody_comes() {
    let folder = Folder::new();
    let series = folder.write("beating.nii", &series());
    let serve = |volume: &str, play: &str| {
        let scene = folder.write("play.json", format!(r#"{{"play": {play}}}"#).as_bytes());
        let identity = folder.arg("identity");
        run([
            "serve",
            "--volume",
            volume,
            "--scene",
            &scene,
            "--identity",
            &identity,
            "--listen",
            "127.0.0.1:0",
        ])
    };
    serve(&folder.volume(), r#"{"steps_per_sec": 2}"#).failed(&["play", "series in time"]);
    serve(&series, r#"{"steps_per_sec": 2, "from": 3}"#).failed(&["play.from", "0 to 2", "3"]);
    serve(&series, r#"{"steps_per_sec": 61}"#).failed(&["play.steps_per_sec", "0 to 60"]);
    serve(&series, r#"{"rate": 2}"#).failed(&["rate"]);
}
