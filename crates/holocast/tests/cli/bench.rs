//! `bench accuracy`.

use crate::files::Folder;
use crate::program::{Said, run};
use std::fs;

const SCENE: &str = r#"{"volume": "../ball.nii",
  "transfer": [[0, 0, 0, 0, 0], [100, 0.8, 0.3, 0.25, 0.002], [250, 1, 1, 1, 0.02]], "step_mm": 5,
  "camera": {"eye": [110, -600, 90], "target": [110, 90, 87.5], "up": [0, 0, 1], "fov_y_deg": 30}}"#;

fn accuracy(folder: &Folder, more: &[&str]) -> Said {
    let out = folder.arg("out");
    let common = ["bench", "accuracy", "--out", &out, "--size", "24x16", "--frames", "1"];
    run([&common[..], more].concat())
}

#[test]
fn levels_are_measured_once_and_anew_when_a_scene_changes() {
    let folder = Folder::new();
    fs::create_dir(folder.path("scenes")).unwrap();
    folder.write("scenes/ball.json", SCENE.as_bytes());
    folder
        .write("scenes/surface.json", br#"{"volume": "../ball.nii", "mode": "threshold", "threshold": 100}"#);
    let scenes = folder.arg("scenes");
    let sweep =
        || accuracy(&folder, &["--scene", &scenes, "--setting", "draft", "--setting", "exact", "--json"]);
    let json = sweep().json();
    let levels = json["levels"].as_array().unwrap();
    assert_eq!(levels.len(), 2, "{json}");
    let error = |at: usize| levels[at]["max_abs_error_beside_doubt"].as_f64().unwrap();
    assert!(error(1) < error(0) && error(1) <= 0.5 / 255.0, "{json}");
    assert_eq!((&levels[0]["level"], &levels[1]["scenes"]), (&"draft".into(), &2.into()), "{json}");
    for name in ["accuracy.json", "accuracy.csv", "max-error.png", "max-error.svg", "rmse.png", "rmse.svg"] {
        assert!(folder.path("out").join(name).is_file(), "{name}");
    }
    let csv = fs::read_to_string(folder.path("out/accuracy.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 4, "{csv}");
    assert!(
        csv.lines().all(|line| line.split(',').count() == csv.lines().next().unwrap().split(',').count())
    );

    let journal = || fs::read(folder.path("out/measured.jsonl")).unwrap();
    let before = journal();
    assert_eq!(sweep().json()["levels"], json["levels"], "nothing is measured twice");
    assert!(journal() == before);
    folder.write("scenes/ball.json", SCENE.replace("0.02]", "0.03]").as_bytes());
    let again = sweep();
    assert!(again.err.contains("ball is not what it was"), "{}", again.err);
    assert!(journal().len() > before.len() && journal().starts_with(&before));

    let words = accuracy(&folder, &["--scene", &scenes, "--setting", "draft"]).well();
    for part in ["draft", "RMSE", "PSNR", "accuracy.json"] {
        assert!(words.contains(part), "expected '{part}' in:\n{words}");
    }
}

#[test]
fn what_cannot_be_swept_is_told_with_what_there_is() {
    let folder = Folder::new();
    fs::create_dir(folder.path("empty")).unwrap();
    let empty = folder.arg("empty");
    let scene = folder.write("broken.json", br#"{"volume": "ball.nii", "fog": 1}"#);
    accuracy(&folder, &["--scene", &empty]).failed(&["empty", "no scene (.json)"]);
    accuracy(&folder, &["--scene", &folder.arg("nowhere.json")]).failed_after_report(&["nowhere.json"]);
    accuracy(&folder, &["--scene", &scene]).failed_after_report(&["broken.json", "fog"]);
    accuracy(&folder, &["--scene", &scene, &scene]).failed(&["broken.json", "named twice"]);
    accuracy(&folder, &["--scene", &scene, "--setting", "superb"]).failed(&["superb", "draft", "exact"]);
    run(["bench", "accuracy", "--scene", &scene, "--frames", "0"]).failed(&["--frames", "1 or more"]);
    run(["bench", "accuracy", "--scene", &scene, "--size", "0x5"]).failed(&["0x5"]);
    accuracy(&folder, &["--scene", &scene, "--adapter", "nonesuch"]).failed(&["nonesuch"]);
    run(["bench"]).failed(&["accuracy"]);
}
