//! What is counted, against what can be counted by hand.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{
    Counts, DepthGridSize, Gpu, Placed, Quality, Sampling, SceneOnDevice, StereoPlan, StereoRequest,
    StillRenderer, VolumeOnDevice,
};
use scene::{SceneFile, VolumeFacts};
use spatial::{DVec3, EyeView, Fov, Pose};
use std::sync::{Arc, OnceLock};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

const SIDE: u32 = 40;
const PIXELS: [u32; 2] = [24, 16];
const RAYS: u64 = 24 * 16;
const FOG: &str = r#"{"transfer": [[0, 0, 0, 0, 0], [50, 0, 0, 0, 0], [100, 1, 1, 1, 0.001]]}"#;

fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

/// A cube of 1 mm voxels, seen from far away through a hole so narrow that every ray passes straight through it.
struct Seen {
    scene: SceneOnDevice,
}

impl Seen {
    fn of(value: impl Fn(u32) -> u8, json: &str) -> Self {
        let z_of = |i: u32| i / (SIDE * SIDE);
        let voxels = Voxels::U8((0..SIDE.pow(3)).map(|i| value(z_of(i))).collect());
        let channel =
            Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
        let grid = Grid::axis_aligned([SIDE; 3], DVec3::ONE).unwrap();
        let volume = Volume::new(grid, vec![channel]).unwrap();
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
        let on_device = Arc::new(VolumeOnDevice::upload(gpu(), &volume, |_| {}).unwrap());
        Self { scene: SceneOnDevice::new(gpu(), &on_device, &scene).unwrap() }
    }

    fn plan(&self, quality: Quality) -> StereoPlan {
        let middle = DVec3::splat(f64::from(SIDE - 1) / 2.0);
        // Off the axis: straight along it, a ray of exactly 40 mm has nothing left behind its 40 steps.
        let at = middle - DVec3::new(7.0, 9.0, 1000.0);
        let eye = EyeView {
            world_from_eye: Pose::looking_at(at, middle, DVec3::Y).unwrap(),
            fov: Fov::symmetric(0.01, 0.01).unwrap(),
        };
        let request = StereoRequest {
            eyes: &[eye],
            placed: Placed::own_axes(self.scene.grid()),
            eye_size_px: PIXELS,
            quality,
            step_mm: None,
            depth_grid: DepthGridSize::default(),
        };
        StereoPlan::new(&request, self.scene.grid(), self.scene.numbers()).unwrap()
    }

    fn counts(&self, quality: Quality) -> Counts {
        StillRenderer::new(gpu()).count(&self.scene, &self.plan(quality)).unwrap()
    }
}

/// To the end of each ray, a voxel a step and no less.
const WHOLE: Quality = Quality { least_transmittance: 0.0, ..Quality::PLAIN };

#[test]
fn a_fog_that_fills_the_volume_takes_a_sample_a_step_and_each_contributes() {
    let fog = Seen::of(|_| 100, FOG);
    let counts = fog.counts(WHOLE);
    assert_eq!(counts.rays, RAYS);
    // A ray is hardly longer than the cube's side: a sample a millimetre, and one for what is left. Steps need one more, at
    // the beginning.
    assert_eq!(counts.contributed, RAYS * u64::from(SIDE + 1), "{counts:?}");
    assert_eq!(counts.samples, counts.contributed + RAYS);
    assert_eq!(counts.gradients, 0);
    let halved = fog.counts(Quality { step_voxels: 0.5, ..WHOLE });
    assert_eq!(halved.contributed, RAYS * u64::from(2 * SIDE + 1));
}

#[test]
fn the_bare_loop_reads_every_sample_of_every_ray_whatever_is_seen() {
    let empty = Seen::of(|_| 0, FOG);
    assert_eq!(empty.counts(WHOLE), Counts::default());
    let bare = StillRenderer::new(gpu()).count(&empty.scene, &empty.plan(WHOLE).bare()).unwrap();
    assert_eq!(bare, Counts { rays: RAYS, samples: RAYS * u64::from(SIDE + 1), ..Counts::default() });
}

#[test]
fn skipping_takes_fewer_samples_and_loses_none_that_contribute() {
    // A slab of eight voxels in the middle, and half a voxel of slope on each side of it.
    let slab = Seen::of(|z| if (16..24).contains(&z) { 100 } else { 0 }, FOG);
    for sampling in [Sampling::Hardware, Sampling::Float32, Sampling::Cells] {
        let quality = Quality { sampling, ..WHOLE };
        let skipped = slab.counts(quality);
        let looked_at = slab.counts(Quality { skip_empty: false, ..quality });
        assert_eq!(skipped.contributed, looked_at.contributed, "{sampling:?}");
        assert!(skipped.contributed >= 8 * RAYS && skipped.contributed <= 10 * RAYS, "{skipped:?}");
        assert!(skipped.samples >= skipped.contributed && skipped.samples < looked_at.samples, "{skipped:?}");
        assert!(looked_at.samples >= RAYS * u64::from(SIDE), "{looked_at:?}");
    }
}

#[test]
fn a_ray_that_ends_early_takes_no_more() {
    let wall = Seen::of(|_| 100, r#"{"transfer": [[0, 1, 1, 1, 0.9], [100, 1, 1, 1, 0.9]]}"#);
    // A tenth of the light passes each millimetre: after three, a thousandth is left.
    let counts = wall.counts(Quality { least_transmittance: 0.002, ..WHOLE });
    assert_eq!(counts.contributed, 3 * RAYS, "{counts:?}");
}

#[test]
fn light_counts_gradients_and_a_surface_is_one_sample() {
    let lit = r#"{"transfer": [[0, 1, 1, 1, 0.001]], "shade": true}"#;
    let counts = Seen::of(|_| 100, lit).counts(WHOLE);
    assert_eq!(counts.gradients, counts.contributed, "{counts:?}");
    let surface = Seen::of(|z| (z * 6) as u8, r#"{"mode": "threshold", "threshold": 100}"#).counts(WHOLE);
    assert_eq!((surface.contributed, surface.gradients), (RAYS, RAYS), "{surface:?}");
}

#[test]
fn a_ray_caster_without_what_is_not_used_draws_the_same_bits() {
    let lit = r#"{"transfer": [[0, 0, 0, 0, 0], [50, 0, 0, 0, 0], [100, 1, 0.5, 1, 0.1]], "shade": true}"#;
    let surface = r#"{"mode": "threshold", "threshold": 60}"#;
    for json in [FOG, lit, surface, r#"{"mode": "x-ray"}"#, r#"{"mode": "maximum"}"#] {
        let seen = Seen::of(|z| (z * 37 % 120) as u8, json);
        for quality in [Quality::BALANCED, Quality::FINE] {
            let plan = seen.plan(quality);
            let still = |plan| StillRenderer::new(gpu()).render(&seen.scene, plan).unwrap();
            assert_eq!(still(&plan), still(&plan.cut()), "{json}");
        }
    }
}
