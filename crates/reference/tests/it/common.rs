//! Volumes, scenes and rays for tests.

use reference::{Pixel, Ray, Reference};
use scene::{Scene, SceneFile, VolumeFacts};
use spatial::{DAffine3, DMat3, DQuat, DVec3};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// A volume whose samples are a function of the voxel's index.
pub(crate) fn volume_on(grid: Grid, value: impl Fn(DVec3) -> f64) -> Volume {
    let [nx, ny, nz] = grid.dims();
    let mut samples = Vec::with_capacity(grid.voxel_count());
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                samples.push(value(DVec3::new(f64::from(x), f64::from(y), f64::from(z))) as f32);
            }
        }
    }
    let channel = Channel {
        name: "test".into(),
        kind: ChannelKind::Intensity,
        voxels: Voxels::F32(samples.into()),
        slope: 1.0,
        intercept: 0.0,
    };
    Volume::new(grid, vec![channel]).expect("as many samples as voxels")
}

/// Along the patient's axes, the first voxel's centre at the origin.
pub(crate) fn volume(dims: [u32; 3], spacing_mm: [f64; 3], value: impl Fn(DVec3) -> f64) -> Volume {
    volume_on(Grid::axis_aligned(dims, DVec3::from_array(spacing_mm)).expect("a grid"), value)
}

/// A grid that stands oblique to the patient.
pub(crate) fn oblique(dims: [u32; 3], spacing_mm: [f64; 3]) -> Grid {
    let turn = DMat3::from_quat(DQuat::from_euler(Default::default(), 0.4, -0.7, 1.1));
    let axes = turn * DMat3::from_diagonal(DVec3::from_array(spacing_mm));
    Grid::new(dims, DAffine3::from_mat3_translation(axes, DVec3::new(10.0, -20.0, 30.0))).expect("a grid")
}

/// A scene of a volume from its file's text.
pub(crate) fn scene(volume: &Volume, json: &str) -> Scene {
    SceneFile::from_json(json).expect("a scene").resolve(&VolumeFacts::of(volume)).expect("a scene")
}

/// The ray from one point towards another, both as voxel index.
pub(crate) fn ray(volume: &Volume, from: impl Into<[f64; 3]>, towards: impl Into<[f64; 3]>) -> Ray {
    let (from, towards) = (DVec3::from_array(from.into()), DVec3::from_array(towards.into()));
    let along = towards - from;
    let mm = (volume.grid().volume_from_index().matrix3 * along).length();
    Ray { origin: from, direction: along / mm }
}

/// What a ray sees.
pub(crate) fn pixel(volume: &Volume, scene: &Scene, ray: &Ray) -> Pixel {
    Reference::new(volume, scene).expect("a picture").pixel(ray)
}

/// Numbers from 0 to 1 that are the same in every run.
pub(crate) struct Noise(pub(crate) u64);

impl Noise {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    pub(crate) fn point(&mut self, low: f64, high: f64) -> DVec3 {
        DVec3::new(self.within(low, high), self.within(low, high), self.within(low, high))
    }
}

/// Values of no order, the same in every run for one seed.
pub(crate) fn noisy(grid: Grid, seed: u64) -> Volume {
    let numbers = std::cell::RefCell::new(Noise(seed));
    volume_on(grid, |_| numbers.borrow_mut().next())
}

#[track_caller]
pub(crate) fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected} within {tolerance:e}");
}
