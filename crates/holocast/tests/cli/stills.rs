//! Help, `info`, `adapters` and `render`.

use crate::files::{DIMS, Folder, png, raw};
use crate::program::{run, text};
use std::fs;
use std::path::Path;

#[test]
fn every_command_helps() {
    let commands = [
        "serve",
        "headset",
        "load",
        "render",
        "compare",
        "bench",
        "info",
        "convert",
        "presets",
        "contact-sheet",
        "adapters",
    ];
    let help = run(["--help"]).well();
    for command in commands {
        assert!(help.contains(command), "{command} is not in:\n{help}");
        let of_command = run([command, "--help"]).well();
        assert!(of_command.contains(&format!("Usage: holocast {command}")), "{of_command}");
        // Every option says what it is for.
        let mut lines =
            of_command.lines().skip_while(|line| !line.starts_with("Options:")).skip(1).peekable();
        while let Some(line) = lines.next() {
            let Some((_, rest)) = line.split_once("--") else { continue };
            let next = lines.peek().is_some_and(|next| next.starts_with("          "));
            assert!(rest.trim().contains("  ") || next, "{command}: no help in '{line}'");
        }
    }
    assert!(run(["--version"]).well().starts_with("holocast "));
    let none = run::<&str>([]);
    assert_eq!(none.status.code(), Some(2));
    assert!(none.err.contains("Usage: holocast"), "{}", none.err);
}

#[test]
fn info_tells_what_a_volume_is() {
    let folder = Folder::new();
    let (voxels, header) = raw();
    folder.write("ball.raw", &voxels);
    let header = folder.write("ball.json", header.as_bytes());
    let [nx, ny, nz] = DIMS;
    for (path, values) in [(folder.volume(), [0.0, 250.0]), (header, [-100.0, 400.0])] {
        let json = run(["info", &path, "--json"]).json();
        assert_eq!(json["dims"], serde_json::json!([nx, ny, nz]), "{json}");
        assert_eq!(json["spacing_mm"], serde_json::json!([20.0, 20.0, 25.0]), "{json}");
        let channel = &json["channels"][0];
        assert_eq!(channel["type"], "int16", "{json}");
        assert_eq!(channel["minimum"], values[0], "{json}");
        assert!((channel["maximum"].as_f64().unwrap() - values[1]).abs() <= 2.0, "{json}");
        let counts = channel["histogram"]["counts"].as_array().unwrap();
        let counted: u64 = counts.iter().map(|c| c.as_u64().unwrap()).sum();
        assert_eq!(counted, u64::from(nx) * u64::from(ny) * u64::from(nz), "{json}");

        let words = run(["info", &path]).well();
        let name = Path::new(&path).file_name().unwrap().to_str().unwrap();
        for part in [name, "12", "10", "8", "int16", "mm"] {
            assert!(words.contains(part), "expected '{part}' in:\n{words}");
        }
    }
}

#[test]
fn adapters_are_named() {
    let adapters = run(["adapters", "--json"]).json();
    let first = adapters[0]["name"].as_str().unwrap();
    assert!(run(["adapters"]).well().contains(first));
}

/// The form of scenes that other tools write: the camera in the volume's own millimetres, the volume beside the scene.
const PEER_SCENE: &str = r#"{
  "description": "a ball",
  "volume": "../ball.nii",
  "mode": "dvr",
  "transfer": [[0, 0, 0, 0, 0],
   [100, 0.8, 0.3, 0.25, 0.01],
   [250, 1, 1, 1, 0.2]],
  "shade": false,
  "camera": {"eye": [110, -600, 90],
  "target": [110, 90, 87.5],
  "up": [0, 0, 1],
  "fov_y_deg": 30},
  "size": [64, 36],
  "step_mm": 5,
  "background": [0, 0, 0]}"#;

#[test]
fn a_still_is_drawn_of_a_scene_as_other_tools_write_it() {
    let folder = Folder::new();
    fs::create_dir(folder.path("scenes")).unwrap();
    let scene = folder.write("scenes/ball.json", PEER_SCENE.as_bytes());
    let out = folder.arg("ball.png");
    let render = |more: &[&str]| run([&["render", "--scene", &scene, "--out", &out][..], more].concat());

    let json = render(&["--json", "--frames", "3"]).json();
    assert_eq!(json["eye_size_px"], serde_json::json!([64, 36]), "{json}");
    assert_eq!((&json["eyes"], &json["frames"]), (&1.into(), &3.into()), "{json}");
    assert_eq!(json["step_mm"], 5.0, "{json}");
    let (least, median) = (&json["frame_ms_min"], &json["frame_ms_median"]);
    assert!(least.as_f64().unwrap() > 0.0 && median.as_f64() >= least.as_f64(), "{json}");
    assert_eq!(png(&folder.path("ball.png")), ([64, 36], false));

    // The command line goes before the scene.
    render(&["--size", "32x20", "--stereo", "--quality", "draft", "--step-mm", "10"]).well();
    assert_eq!(png(&folder.path("ball.png")), ([64, 20], false));
    let stereo = image::open(folder.path("ball.png")).unwrap().to_rgb8();
    assert!((0..20).any(|y| (0..32).any(|x| stereo.get_pixel(x, y) != stereo.get_pixel(x + 32, y))));
}

#[test]
fn a_volume_without_a_scene_is_drawn_in_default_colours() {
    let folder = Folder::new();
    let out = folder.arg("picture.png");
    let said = run(["render", "--volume", &folder.volume(), "--out", &out, "--size", "48x32"]).well();
    assert_eq!(said.trim(), out, "the picture's path is what a script wants");
    assert_eq!(png(&folder.path("picture.png")), ([48, 32], false));
    // Skipping what is empty changes no pixel.
    let all = folder.arg("all.png");
    run(["render", "--volume", &folder.volume(), "--out", &all, "--size", "48x32", "--no-skip"]).well();
    assert!(fs::read(&out).unwrap() == fs::read(&all).unwrap());
}

#[test]
fn several_volumes_are_told_and_drawn_as_they_are() {
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes/several/organs-in-ct.json");
    let json = run(["info", scene, "--json"]).json();
    assert_eq!(json["volume"]["dims"], serde_json::json!([122, 101, 112]), "{json}");
    let organs = &json["further_volumes"][0];
    assert_eq!((&organs["name"], &organs["is_moved"]), (&"organs".into(), &false.into()), "{json}");
    assert_eq!(organs["share_within_first"], 1.0, "{json}");
    let words = run(["info", scene]).well();
    assert!(words.contains("with organs: 122x101x112 voxels") && words.contains("not resampled"), "{words}");

    let folder = Folder::new();
    let [drawn, exact, bones] = ["drawn.png", "exact.png", "bones.png"].map(|name| folder.arg(name));
    let render = |scene: &str, more: &[&str]| {
        run([&["render", "--scene", scene, "--size", "64x36", "--out"][..], more].concat()).well()
    };
    render(scene, &[&drawn, "--quality", "fine"]);
    render(scene, &[&exact, "--reference"]);
    // A step of rounding to 8 bits on either side.
    run(["compare", &drawn, &exact, "--max-error", "1.01/255"]).well();
    // The organs are in the picture.
    let text = fs::read_to_string(scene).unwrap();
    let hidden = text.replace(r#""name": "organs","#, r#""name": "organs", "shown": false,"#);
    assert_ne!(hidden, text);
    let volumes = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/volumes");
    let hidden = folder.write("hidden.json", hidden.replace("../../volumes", volumes).as_bytes());
    render(&hidden, &[&bones, "--quality", "fine"]);
    let apart = run(["compare", &drawn, &bones, "--max-error", "0.2"]);
    assert!(!apart.status.success(), "{}", apart.out);

    // What measures scenes of one volume says so.
    let out = folder.arg("bench");
    run(["bench", "render", "--scene", scene, "--out", &out])
        .failed(&["organs-in-ct.json", "measures scenes of one"]);
}

/// Scenes that the renderer's peers draw, where their volumes are on this machine.
#[test]
fn all_peer_scenes_are_drawn() {
    let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/scenes");
    let Ok(entries) = fs::read_dir(&scenes) else {
        println!("SKIPPED: no {} on this machine", scenes.display());
        return;
    };
    let folder = Folder::new();
    let out = folder.arg("picture.png");
    let mut drawn = 0;
    for entry in entries.flatten().filter(|e| e.path().extension().is_some_and(|x| x == "json")) {
        let scene = entry.path();
        let name = entry.file_name();
        run(["render", "--scene", text(&scene), "--size", "64x36", "--quality", "draft", "--out", &out])
            .well();
        assert_eq!(png(&folder.path("picture.png")), ([64, 36], false), "{}", name.display());
        drawn += 1;
    }
    println!("{drawn} scenes drawn");
    assert!(drawn > 0, "no scene in {}", scenes.display());
}

#[test]
fn the_registration_error_is_swept_alike_each_time_and_prediction_gains() {
    let folder = Folder::new();
    let trace = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/traces/walk-bicycle.jsonl");
    let scene = folder.write("x-ray.json", br#"{"volume": "ball.nii", "mode": "x-ray"}"#);
    let sweep = |out: &str| {
        let (json, csv, plot) = (folder.arg(out), folder.arg("sweep.csv"), folder.arg("sweep.png"));
        let files = ["--out", &json, "--csv", &csv, "--plot", &plot, "--scene", &scene];
        let few =
            ["--step-ms", "50", "--picture-ages-ms", "50", "--pictures", "2", "--picture-size", "32x18"];
        run([&["bench", "registration", "--trace", trace, "--json"][..], &files, &few].concat()).json()
    };
    let found = sweep("one.json");
    assert_eq!(found, sweep("two.json"));
    assert_eq!(fs::read(folder.path("one.json")).unwrap(), fs::read(folder.path("two.json")).unwrap());
    assert_eq!(found["ages_ms"], serde_json::json!([0.0, 50.0, 100.0]));
    let at_50 = &found["all"]["by_age"][1];
    let p95 = |which: &str| at_50[which]["deg"]["p95"].as_f64().unwrap();
    assert!(p95("predicted") < p95("as_it_came") / 2.0, "{at_50}");
    let pictures = &found["all"]["pictures"][0];
    let db = |which: &str| pictures[which]["p50"].as_f64().unwrap();
    assert!(db("predicted_psnr_db") > db("as_it_came_psnr_db") + 3.0, "{pictures}");
    let poses = found["all"]["poses"].as_u64().unwrap() as usize;
    assert_eq!(fs::read_to_string(folder.path("sweep.csv")).unwrap().lines().count(), 1 + 3 * poses);
    // By head in degrees, in pixels, by speed, and what it does to pictures.
    for name in ["sweep.png", "sweep-px.png", "sweep-speed.png", "sweep-db.png"] {
        assert!(!png(&folder.path(name)).1, "{name}");
    }
    run(["bench", "registration", "--trace", trace, "--longest-ms", "500"]).failed(&["--longest-ms", "100"]);
}
