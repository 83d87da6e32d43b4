//! Exact pictures, float data, and `compare`.

use crate::files::{Folder, png};
use crate::program::{Said, run};
use std::fs;

/// A ball, seen from the front; 64×36 pixels.
const SCENE: &str = r#"{"volume": "ball.nii", "shade": true,
  "transfer": [[0, 0, 0, 0, 0], [100, 0.8, 0.3, 0.25, 0.002], [250, 1, 1, 1, 0.02]],
  "camera": {"eye": [110, -600, 90], "target": [110, 90, 87.5], "up": [0, 0, 1], "fov_y_deg": 30},
  "size": [64, 36], "background": [0, 0, 0.2]}"#;

fn scene(folder: &Folder) -> String {
    folder.write("ball.json", SCENE.as_bytes())
}

fn compare(more: &[&str]) -> Said {
    run([&["compare"], more].concat())
}

#[test]
fn the_renderer_at_its_best_shows_the_exact_picture() {
    let folder = Folder::new();
    let scene = scene(&folder);
    let [exact, measured, draft] = ["exact.npy", "measured.npy", "draft.npy"].map(|name| folder.arg(name));
    let picture = folder.arg("exact.png");
    let json =
        run(["render", "--reference", "--scene", &scene, "--out", &picture, "--data", &exact, "--json"])
            .json();
    assert_eq!((&json["reference"], &json["eyes"]), (&true.into(), &1.into()), "{json}");
    assert_eq!(json["eye_size_px"], serde_json::json!([64, 36]), "{json}");
    assert!(json["seconds"].as_f64().unwrap() > 0.0, "{json}");
    assert_eq!(png(&folder.path("exact.png")), ([64, 36], false));

    let render = |out: &str, quality: &str, step: &str| {
        run(["render", "--scene", &scene, "--out", out, "--quality", quality, "--step-mm", step]).well();
    };
    render(&measured, "exact", "0.5");
    let json = compare(&[&exact, &measured, "--max-error", "0.5/255", "--json"]).json();
    assert_eq!(json["size_px"], serde_json::json!([64, 36]), "{json}");
    assert!(json["psnr_db"].as_f64().unwrap() > 55.0, "{json}");
    assert!(json["ssim"].as_f64().unwrap() > 0.999, "{json}");
    assert!(json["opacity"]["max_abs_error"].as_f64().unwrap() < 0.5 / 255.0, "{json}");
    assert!(json["depth"]["pixels_in_both"].as_u64().unwrap() > 100, "{json}");
    assert!(json["depth"]["rmse_mm"].as_f64().unwrap() < 0.5, "{json}");
    let depth = |name: &str| json["depth"][name].as_f64().unwrap();
    let expected = 20.0 * (depth("range_mm") / depth("rmse_mm")).log10();
    assert!((depth("psnr_db") - expected).abs() < 1e-9 && expected > 40.0, "{json}");
    assert!(depth("ssim") > 0.99, "{json}");

    render(&draft, "draft", "40");
    let worse = compare(&[&exact, &draft, "--json"]).json();
    assert!(worse["rmse"].as_f64() > json["rmse"].as_f64(), "{worse}");
    compare(&[&exact, &draft, "--max-error", "0.5/255"]).failed_after_report(&["differ by", "0.500/255"]);
}

#[test]
fn the_exact_picture_of_two_eyes_is_that_of_each() {
    let folder = Folder::new();
    let scene = scene(&folder);
    let [one, pair, apart] = ["one.npy", "pair.npy", "apart.npy"].map(|name| folder.arg(name));
    let render = |more: &[&str]| {
        run([&["render", "--reference", "--scene", &scene, "--size", "32x18"], more].concat()).well()
    };
    render(&["--out", &one]);
    render(&["--out", &pair, "--stereo", "--eye-distance-mm", "0"]);
    render(&["--out", &apart, "--stereo"]);
    let numbers = |path: &str| fs::read(path).unwrap().split_off(128);
    let row = 32 * 5 * 4;
    let rows_of = |numbers: &[u8], width: usize, eye: usize| -> Vec<u8> {
        numbers
            .chunks_exact(width * row)
            .flat_map(|both| &both[eye * row..(eye + 1) * row])
            .copied()
            .collect()
    };
    let (one, pair, apart) = (numbers(&one), numbers(&pair), numbers(&apart));
    assert_eq!((one.len(), pair.len()), (18 * row, 2 * 18 * row));
    assert!(rows_of(&pair, 2, 0) == one && rows_of(&pair, 2, 1) == one, "eyes in one place see the same");
    assert!(rows_of(&apart, 2, 0) != rows_of(&apart, 2, 1));
}

#[test]
fn a_picture_equals_itself_and_its_own_png_within_half_a_step() {
    let folder = Folder::new();
    let scene = scene(&folder);
    let (data, picture, difference) =
        (folder.arg("a.npy"), folder.arg("a.png"), folder.arg("difference.png"));
    run(["render", "--scene", &scene, "--out", &picture, "--data", &data]).well();
    let same = compare(&[&data, &data, "--max-error", "0", "--json"]).json();
    assert_eq!((&same["max_abs_error"], &same["worst"]), (&0.0.into(), &serde_json::Value::Null), "{same}");
    assert!(same["psnr_db"].is_null() && same["depth"]["rmse_mm"] == 0.0, "{same}");
    assert!(same["depth"]["psnr_db"].is_null() && same["depth"]["range_mm"].as_f64() > Some(1.0), "{same}");

    // The scene's background shows in the PNG; before another one it is another picture.
    let json = compare(&[&data, &picture, "--background", "0,0,0.2", "--json"]).json();
    let error = json["max_abs_error"].as_f64().unwrap();
    assert!(error > 0.0 && error <= 0.500_01 / 255.0, "{json}");
    assert_eq!(json["before_background"], serde_json::json!([0.0, 0.0, 0.2]), "{json}");
    assert!(json["opacity"].is_null() && json["depth"].is_null(), "{json}");
    let json = compare(&[&data, &picture, "--difference", &difference, "--json"]).json();
    assert!(json["max_abs_error"].as_f64().unwrap() > 0.1, "{json}");
    let worst = &json["worst"];
    let at = |of: &str| u32::try_from(worst[of].as_u64().unwrap()).unwrap();
    let shown = image::open(folder.path("difference.png")).unwrap().to_rgb8();
    assert_eq!(shown.get_pixel(at("x"), at("y"))[2], 255, "the worst sample is white: {json}");

    let words = compare(&[&data, &picture]).well();
    for part in ["64x36", "RMSE", "PSNR", "SSIM", "blue of pixel", "background 0,0,0"] {
        assert!(words.contains(part), "expected '{part}' in:\n{words}");
    }
}

#[test]
fn what_cannot_be_compared_is_told_with_what_is_wrong() {
    let folder = Folder::new();
    let scene = scene(&folder);
    let (good, small, nan) = (folder.arg("good.npy"), folder.arg("small.npy"), folder.arg("nan.npy"));
    run(["render", "--reference", "--scene", &scene, "--size", "16x8", "--out", &good]).well();
    run(["render", "--reference", "--scene", &scene, "--size", "8x8", "--out", &small]).well();
    compare(&[&good, &small]).failed(&["good.npy", "small.npy", "16x8", "8x8"]);

    let mut bytes = fs::read(&good).unwrap();
    // Green of pixel (1, 0), after the header of 128 bytes.
    bytes[128 + 6 * 4..128 + 7 * 4].copy_from_slice(&f32::NAN.to_le_bytes());
    fs::write(&nan, &bytes).unwrap();
    compare(&[&good, &nan]).failed(&["nan.npy", "pixel (1, 0): green is NaN"]);
    compare(&[&good, &folder.write("cut.npy", &bytes[..300])]).failed(&["cut.npy", "172 bytes of numbers"]);
    compare(&[&good, &folder.write("text.png", b"no picture")]).failed(&["text.png", "neither a PNG"]);
    compare(&[&good, &folder.arg("nowhere.png")]).failed(&["nowhere.png", "No such file"]);
    compare(&[&good, &folder.volume()]).failed(&["ball.nii", "neither a PNG"]);
    compare(&[&good]).failed(&["<B>"]);
    compare(&[&good, &good, "--max-error", "2"]).failed(&["'2' is no part of full brightness"]);
    compare(&[&good, &good, "--background", "red"]).failed(&["'red' is no colour"]);
    compare(&[&good, &good, "--gain", "2"]).failed(&["--difference"]);
    compare(&[&good, &good, "--difference", &folder.arg("x.png"), "--gain", "0"]).failed(&["above 0"]);
    compare(&[&good, &good, "--difference", &folder.arg("nowhere/x.png")])
        .failed(&["nowhere/x.png", "cannot be written"]);
}

#[test]
fn an_exact_picture_has_no_quality_and_needs_somewhere_to_go() {
    let folder = Folder::new();
    let (scene, out) = (scene(&folder), folder.arg("x.png"));
    let exact = |more: &[&str]| run([&["render", "--reference", "--scene", &scene], more].concat());
    for wrong in [&["--quality", "draft"][..], &["--step-mm", "1"], &["--no-skip"], &["--frames", "3"]] {
        exact(&[&["--out", &out], wrong].concat()).failed(&["--reference", "cannot be used with"]);
    }
    exact(&["--out", &folder.arg("x.exr")]).failed(&["x.exr", "cannot be written", ".npy"]);
    exact(&["--out", &out, "--data", &folder.arg("nowhere/x.npy")]).failed(&[
        "nowhere/x.npy",
        "cannot be written",
        "no such folder",
    ]);
    exact(&["--out", &out, "--size", "0x5"]).failed(&["0x5"]);
    assert!(!folder.path("x.png").exists());
}
