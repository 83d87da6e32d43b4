//! What is measured of a scene whose samples can be counted by hand.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{Gpu, Placed, SceneOnDevice, VolumeOnDevice};
use scene::{Mode, Scene, SceneFile, VolumeFacts};
use spatial::{DVec3, Fov, HeadGeometry, Pose};
use std::sync::{Arc, OnceLock};
use sweep::{ScaleOptions, Watched, cost, cost_settings, first_use, phantom, scaling};

const FOG: &str = r#"{"transfer": [[0, 0, 0, 0, 0], [500, 0, 0, 0, 0], [1000, 1, 1, 1, 0.001]]}"#;

fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

/// A phantom with a share of it full, and its scene.
fn stage(side: u32, occupied: f64) -> (Arc<VolumeOnDevice>, Scene) {
    let volume = phantom(side, occupied).unwrap();
    let scene = SceneFile::from_json(FOG).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
    (Arc::new(VolumeOnDevice::upload(gpu(), &volume, |_| {}).unwrap()), scene)
}

fn watched(scene: &SceneOnDevice) -> Watched<'_> {
    let middle = DVec3::splat(124.0);
    let head = Pose::looking_at(middle + DVec3::new(500.0, 300.0, 200.0), middle, DVec3::Z).unwrap();
    let eyes = HeadGeometry::parallel(64.0, Fov::symmetric(0.4, 0.3).unwrap()).view(&head).eyes;
    Watched { name: "phantom", scene, placed: Placed::own_axes(scene.grid()), eyes, size_px: [48, 32] }
}

#[test]
fn a_full_volume_leaves_nothing_to_skip_and_a_sparse_one_much() {
    let setting = cost_settings().into_iter().find(|s| s.name == "a voxel a step").unwrap();
    let of = |occupied| {
        // Blocks larger than cells, and rays so near to each other that a tile's are not as wide as the gaps.
        let (volume, scene) = stage(128, occupied);
        let scene = SceneOnDevice::new(gpu(), &volume, &scene).unwrap();
        let watched = Watched { size_px: [160, 96], ..watched(&scene) };
        cost(gpu(), &watched, &setting, 3).unwrap()
    };
    let (full, sparse) = (of(1.0), of(0.01));
    assert!(full.skippable < 0.05 && sparse.skippable > 0.5, "{full:?}\n{sparse:?}");
    assert!(sparse.contributed > 0 && sparse.samples < full.samples / 2, "{sparse:?}");
    assert_eq!(sparse.bare_samples, full.bare_samples);
    assert!(full.bare_samples.abs_diff(full.contributed) < full.bare_samples / 50, "{full:?}");
    assert_eq!((full.frames, full.kind.as_str(), full.gradients), (3, "emission-absorption", 0));
    assert!(full.rate_over_bare.unwrap().median > 0.0 && full.stereo_over_monos.median > 0.0);
}

#[test]
fn cells_are_held_against_no_bare_loop() {
    let (volume, scene) = stage(32, 0.1);
    let scene = SceneOnDevice::new(gpu(), &volume, &scene).unwrap();
    let fine = cost_settings().into_iter().find(|s| s.name == "fine").unwrap();
    let row = cost(gpu(), &watched(&scene), &fine, 1).unwrap();
    assert!(row.solves_cells && row.rate_over_bare.is_none() && row.contributed > 0, "{row:?}");
}

#[test]
fn samples_grow_as_pixels_do_and_memory_to_skip_with_is_small() {
    let options = ScaleOptions {
        setting: cost_settings().into_iter().find(|s| s.name == "balanced").unwrap(),
        sizes_px: vec![[32, 24], [64, 48], [128, 96]],
        sides: vec![16, 32],
        occupied: vec![0.1, 1.0],
        sessions: vec![1, 2],
        rounds: 1,
        held: ([64, 48], 32, 0.1),
        session_size_px: [32, 24],
    };
    let found = scaling(gpu(), &options, &|_| {}).unwrap();
    let over: Vec<&str> = found.curves.iter().map(|curve| curve.over.as_str()).collect();
    let voxels = ["voxels, 10 % occupied", "voxels, 100 % occupied"];
    assert_eq!(
        over,
        [&["pixels of both eyes", "sessions", "occupied part of the volume"][..], &voxels].concat()
    );
    let exponent = found.curves[0].samples.unwrap().exponent;
    assert!((exponent - 1.0).abs() < 0.05, "{exponent}");
    assert_eq!(found.volumes.len(), 4);
    assert!(found.volumes.iter().all(|v| v.acceleration_over_voxels <= 0.05), "{:?}", found.volumes);
}

#[test]
fn frames_go_on_while_another_scene_is_made() {
    let (volume, scene) = stage(32, 0.1);
    let on_device = SceneOnDevice::new(gpu(), &volume, &scene).unwrap();
    let setting = cost_settings().into_iter().find(|s| s.name == "draft").unwrap();
    let other = |mode| Scene { mode, ..scene.clone() };
    let (maximum, x_ray) = (other(Mode::Maximum), other(Mode::XRay));
    let found = first_use(gpu(), &watched(&on_device), &setting, &volume, &maximum, &x_ray).unwrap();
    assert!(found.ready_ms > 0.0 && found.meanwhile_ms.max >= found.meanwhile_ms.median, "{found:?}");
    assert!(found.first_over_after > 0.0 && found.unprepared_first_over_after > 0.0, "{found:?}");
}
