//! A sweep's folder: what is kept, what goes on, what is noticed.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{Gpu, Placed, Quality};
use scene::{Scene, SceneFile, VolumeFacts};
use spatial::{DVec3, EyeView, Fov, Pose};
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock};
use sweep::{Curve, Options, Row, Setting, Subject, Sweep};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

/// A ball, lit.
fn ball() -> (Volume, Scene) {
    let along = |i: usize| i as f64 - 7.5;
    let value = |i: usize| {
        let (x, y, z) = (along(i % 16), along(i / 16 % 16), along(i / 256));
        (250.0 * (1.2 - (x * x + y * y + z * z).sqrt() / 8.0).clamp(0.0, 1.0)) as u8
    };
    let voxels = Voxels::U8((0..16 * 16 * 16).map(value).collect());
    let channel =
        Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
    let volume = Volume::new(Grid::axis_aligned([16; 3], DVec3::ONE).unwrap(), vec![channel]).unwrap();
    let json = r#"{"transfer": [[60, 0, 0, 0, 0], [250, 1, 0.8, 0.6, 0.5]], "shade": true}"#;
    let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
    (volume, scene)
}

fn subject<'a>(volume: &'a Volume, scene: &'a Scene) -> Subject<'a> {
    let world_from_eye =
        Pose::looking_at(DVec3::new(30.0, -25.0, 20.0), DVec3::splat(7.5), DVec3::Z).unwrap();
    Subject {
        name: "ball",
        volume,
        scene,
        placed: Placed::own_axes(volume.grid()),
        eye: EyeView { world_from_eye, fov: Fov::symmetric(0.5, 0.4).unwrap() },
        size_px: [24, 18],
    }
}

fn levels() -> Vec<Setting> {
    let level =
        |(name, quality): (&str, Quality)| Setting { curve: Curve::Level, name: name.into(), quality };
    Quality::LEVELS.map(level).to_vec()
}

/// Measures in a folder; the rows, and how often each thing was done.
fn measured(
    folder: &Path,
    settings: Vec<Setting>,
    program: &str,
    subject: &Subject<'_>,
) -> (Vec<Row>, Vec<String>) {
    let options = Options { settings, frames: 1, program: program.into() };
    let mut sweep = Sweep::open(folder, options).unwrap();
    let done = Mutex::new(Vec::new());
    let rows = sweep.measure(gpu(), subject, &|p| done.lock().unwrap().push(p.doing.to_owned())).unwrap();
    let mut done = done.into_inner().unwrap();
    done.dedup();
    (rows, done)
}

#[test]
fn levels_come_nearer_to_the_exact_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (volume, scene) = ball();
    let (rows, done) = measured(folder.path(), levels(), "one", &subject(&volume, &scene));
    assert_eq!(done, ["exact picture", "draft", "balanced", "fine", "exact"]);
    assert_eq!(rows.len(), 4);
    let (draft, exact) = (&rows[0], &rows[3]);
    assert_eq!((draft.setting.as_str(), draft.kind.as_str()), ("draft", "emission-absorption, lit"));
    assert!(exact.errors.rmse < draft.errors.rmse, "{rows:?}");
    assert!(exact.errors.beside_doubt.max_abs_error <= 0.5 / 255.0, "{exact:?}");
    assert!(rows.iter().all(|row| row.frames == 1 && row.frame_ms.min > 0.0), "{rows:?}");
}

#[test]
fn what_was_measured_is_not_measured_again() {
    let folder = tempfile::tempdir().unwrap();
    let (volume, scene) = ball();
    let subject = subject(&volume, &scene);
    let (first, _) = measured(folder.path(), levels()[..2].to_vec(), "one", &subject);
    // The sweep was interrupted while it wrote.
    let journal = folder.path().join("measured.jsonl");
    let text = fs::read(&journal).unwrap();
    fs::write(&journal, &text[..text.len() - 20]).unwrap();
    let (rows, done) = measured(folder.path(), levels(), "one", &subject);
    assert_eq!(done, ["balanced", "fine", "exact"], "the first is there, so is the exact picture");
    assert_eq!(rows[0], first[0]);
    let (again, done) = measured(folder.path(), levels(), "one", &subject);
    assert!(done.is_empty(), "{done:?}");
    assert_eq!(again, rows, "figures are read as they were written");

    // Another program draws otherwise; the exact picture is what it was.
    let (_, done) = measured(folder.path(), levels()[..1].to_vec(), "two", &subject);
    assert_eq!(done, ["draft"]);
}

#[test]
fn a_changed_scene_is_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let (volume, scene) = ball();
    let draft = || levels()[..1].to_vec();
    let before = subject(&volume, &scene);
    measured(folder.path(), draft(), "one", &before);
    let sweep =
        || Sweep::open(folder.path(), Options { settings: draft(), frames: 1, program: "one".into() });
    assert!(!sweep().unwrap().has_changed(&before));
    assert!(!sweep().unwrap().has_changed(&Subject { name: "another", ..before }), "it was never measured");

    let other_scene = Scene { light: None, ..scene.clone() };
    let (grid, mut channels) = volume.clone().into_parts();
    if let Voxels::U8(voxels) = &mut channels[0].voxels {
        voxels[2000] ^= 1;
    }
    let other_volume = Volume::new(grid, channels).unwrap();
    let mut nearer = before;
    nearer.eye.world_from_eye.position_m.z += 1e-9;
    for changed in [
        Subject { scene: &other_scene, ..before },
        Subject { volume: &other_volume, ..before },
        Subject { size_px: [24, 20], ..before },
        nearer,
    ] {
        assert!(sweep().unwrap().has_changed(&changed), "{:?}", changed.size_px);
        assert_ne!(changed.key(), before.key());
    }
    let (_, done) = measured(folder.path(), draft(), "one", &Subject { scene: &other_scene, ..before });
    assert_eq!(done, ["exact picture", "draft"]);
}

#[test]
fn an_exact_picture_that_is_not_what_it_should_be_is_computed_again() {
    let folder = tempfile::tempdir().unwrap();
    let (volume, scene) = ball();
    let subject = subject(&volume, &scene);
    measured(folder.path(), levels()[..1].to_vec(), "one", &subject);
    let path = folder.path().join("exact").join(format!("{}.npy", subject.key()));
    let good = fs::read(&path).unwrap();
    for spoilt in [good[..good.len() - 8].to_vec(), {
        // Every pixel a little off, as an older reference might have been.
        let picture = picture_io::from_npy(&good).unwrap().over([1e-9; 3]);
        picture_io::to_npy(&picture, picture_io::Precision::Float64)
    }] {
        fs::write(&path, spoilt).unwrap();
        let (_, done) = measured(folder.path(), levels()[..2].to_vec(), "two", &subject);
        assert_eq!(done[0], "exact picture");
        assert!(fs::read(&path).unwrap() == good);
        fs::remove_file(folder.path().join("measured.jsonl")).unwrap();
    }
}
