//! Volumes, scenes and eyes on the device and in the reference.

use crate::tolerances;
use reference::{Picture, RaySetup, Reference, Tolerance, Uncertainty, judge};
use render::{
    DepthGridSize, Gpu, Placed, Quality, SceneOnDevice, StereoPlan, StereoRequest, Still, StillRenderer,
    VolumeOnDevice,
};
use scene::{FurtherFacts, Scene, SceneFile, VolumeFacts, VolumeSource};
use spatial::{DAffine3, DMat3, DQuat, DVec3, EyeView, Fov, Pose};
use std::collections::HashSet;
use std::path::Path;
use std::sync::{Arc, OnceLock};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// The device of all tests: the best there is.
pub(crate) fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

/// Prints a figure for people.
#[expect(clippy::print_stdout, reason = "figures for people, shown with --nocapture")]
pub(crate) fn tell(line: &str) {
    println!("{line}");
}

/// A volume of one channel whose values are the stored numbers.
pub(crate) fn volume_on(grid: Grid, voxels: Voxels) -> Volume {
    scaled(grid, voxels, 1.0, 0.0)
}

/// A volume of one channel.
pub(crate) fn scaled(grid: Grid, voxels: Voxels, slope: f64, intercept: f64) -> Volume {
    let channel = Channel { name: "test".into(), kind: ChannelKind::Intensity, voxels, slope, intercept };
    Volume::new(grid, vec![channel]).unwrap()
}

/// A volume of labels.
pub(crate) fn labels_on(grid: Grid, voxels: Voxels) -> Volume {
    let name = "labels".into();
    let channel = Channel { name, kind: ChannelKind::Label, voxels, slope: 1.0, intercept: 0.0 };
    Volume::new(grid, vec![channel]).unwrap()
}

/// Along the patient's axes, the first voxel's centre at the origin.
pub(crate) fn straight(dims: [u32; 3], spacing_mm: [f64; 3]) -> Grid {
    Grid::axis_aligned(dims, DVec3::from_array(spacing_mm)).unwrap()
}

/// A grid that stands oblique to the patient.
pub(crate) fn oblique(dims: [u32; 3], spacing_mm: [f64; 3]) -> Grid {
    let turn = DMat3::from_quat(DQuat::from_euler(Default::default(), 0.4, -0.7, 1.1));
    let axes = turn * DMat3::from_diagonal(DVec3::from_array(spacing_mm));
    Grid::new(dims, DAffine3::from_mat3_translation(axes, DVec3::new(10.0, -20.0, 30.0))).unwrap()
}

/// A function of the voxel's index, at every voxel.
pub(crate) fn each(dims: [u32; 3], mut f: impl FnMut(DVec3) -> f64) -> Vec<f64> {
    let mut all = Vec::with_capacity(dims.iter().product::<u32>() as usize);
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                all.push(f(DVec3::new(f64::from(x), f64::from(y), f64::from(z))));
            }
        }
    }
    all
}

pub(crate) fn u8s(values: &[f64]) -> Voxels {
    Voxels::U8(values.iter().map(|&v| v.round().clamp(0.0, 255.0) as u8).collect())
}

pub(crate) fn u16s(values: &[f64]) -> Voxels {
    Voxels::U16(values.iter().map(|&v| v.round().clamp(0.0, 65535.0) as u16).collect())
}

pub(crate) fn i16s(values: &[f64]) -> Voxels {
    Voxels::I16(values.iter().map(|&v| v.round().clamp(-32768.0, 32767.0) as i16).collect())
}

pub(crate) fn f32s(values: &[f64]) -> Voxels {
    Voxels::F32(values.iter().map(|&v| v as f32).collect())
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

/// An eye in the volume's own millimetres.
pub(crate) fn eye(at: impl Into<DVec3>, target: impl Into<DVec3>, fov: Fov) -> EyeView {
    let (at, target) = (at.into(), target.into());
    let pose = Pose::looking_at(at, target, DVec3::new(0.1, 0.2, 1.0));
    let pose = pose.or_else(|| Pose::looking_at(at, target, DVec3::X)).unwrap();
    EyeView { world_from_eye: pose, fov }
}

/// A field of view of square pixels, from its vertical angle.
pub(crate) fn fov(vertical_deg: f64, [width, height]: [u32; 2]) -> Fov {
    Fov::from_vertical(vertical_deg.to_radians(), f64::from(width) / f64::from(height)).unwrap()
}

/// A volume with a scene of it, on both sides.
pub(crate) struct Shown {
    pub(crate) volume: Arc<Volume>,
    /// Those beside it.
    pub(crate) others: Vec<Arc<Volume>>,
    pub(crate) scene: Scene,
    pub(crate) on_device: SceneOnDevice,
}

impl Shown {
    pub(crate) fn new(volume: Volume, json: &str) -> Self {
        let volume = Arc::new(volume);
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
        Self::of_scene(volume, scene)
    }

    pub(crate) fn of_scene(volume: Arc<Volume>, scene: Scene) -> Self {
        Self::of_several(vec![volume], scene)
    }

    /// Several volumes; the scene names those beside the first `1`, `2`, ….
    pub(crate) fn several(volumes: &[&Arc<Volume>], json: &str) -> Self {
        let others: Vec<_> = (1..volumes.len())
            .map(|i| FurtherFacts {
                source: VolumeSource { path: i.to_string().into(), series: None, kind: None },
                facts: VolumeFacts::of(volumes[i]),
            })
            .collect();
        let file = SceneFile::from_json(json).unwrap();
        let scene = file.resolve_among(&VolumeFacts::of(volumes[0]), &others).unwrap();
        Self::of_several(volumes.iter().map(|&volume| volume.clone()).collect(), scene)
    }

    fn of_several(mut volumes: Vec<Arc<Volume>>, scene: Scene) -> Self {
        let upload = |volume: &Arc<Volume>| Arc::new(VolumeOnDevice::upload(gpu(), volume, |_| {}).unwrap());
        let uploaded: Vec<_> = volumes.iter().map(upload).collect();
        let on_device = SceneOnDevice::of_several(gpu(), &uploaded, &scene).unwrap();
        Self { volume: volumes.remove(0), others: volumes, scene, on_device }
    }

    /// The picture of eyes in the volume's own millimetres.
    pub(crate) fn still(
        &self,
        eyes: &[EyeView],
        size: [u32; 2],
        quality: Quality,
        step_mm: Option<f64>,
    ) -> Still {
        let grid = self.volume.grid();
        let request = StereoRequest {
            eyes,
            placed: Placed::own_axes(grid),
            eye_size_px: size,
            quality,
            step_mm,
            depth_grid: DepthGridSize::default(),
        };
        let plan = StereoPlan::new(&request, grid, self.on_device.numbers()).unwrap();
        StillRenderer::new(gpu()).render(&self.on_device, &plan).unwrap()
    }

    /// One eye's picture as the reference has its own.
    pub(crate) fn drawn(
        &self,
        eye: EyeView,
        size: [u32; 2],
        quality: Quality,
        step_mm: Option<f64>,
    ) -> Picture {
        picture_of(&self.still(&[eye], size, quality, step_mm), 0)
    }

    pub(crate) fn reference(&self) -> Reference<'_> {
        let volumes: Vec<&Volume> = std::iter::once(&self.volume).chain(&self.others).map(|v| &**v).collect();
        Reference::of_several(&volumes, &self.scene).unwrap()
    }

    /// The reference's rays of the same eye.
    pub(crate) fn rays(&self, eye: EyeView) -> RaySetup {
        RaySetup::new(self.volume.grid(), self.volume.grid().own_axes_from_index().inverse(), eye)
    }

    pub(crate) fn exact(&self, eye: EyeView, size: [u32; 2]) -> Picture {
        self.reference().picture(&self.rays(eye), size[0], size[1], &|_| ()).unwrap()
    }
}

/// One eye's part of a picture read back from the device.
pub(crate) fn picture_of(still: &Still, eye: usize) -> Picture {
    let [width, height] = still.eye_size_px;
    Picture::from_f32(width, height, still.eye(eye), still.eye_depth_mm(eye)).unwrap()
}

/// Leaves a picture that failed, the exact one, and eight times their difference as PNG, before grey.
pub(crate) fn keep_failure(name: &str, exact: &Picture, drawn: &Picture) {
    let plain: String = name.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("truth");
    std::fs::create_dir_all(&folder).unwrap();
    let difference = reference::difference(exact, drawn, 8.0).unwrap();
    for (what, picture) in [("exact", exact), ("drawn", drawn), ("difference", &difference)] {
        let path = folder.join(format!("{plain}-{what}.png"));
        let file = std::fs::File::create(&path).unwrap();
        let mut encoder = png::Encoder::new(file, picture.width(), picture.height());
        encoder.set_color(png::ColorType::Rgba);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&picture.over([0.25; 3]).to_rgba8()).unwrap();
        tell(&format!("left {}", path.display()));
    }
}

/// A volume of float32 voxels along the patient's axes.
pub(crate) fn floats(dims: [u32; 3], spacing_mm: [f64; 3], f: impl FnMut(DVec3) -> f64) -> Volume {
    volume_on(straight(dims, spacing_mm), f32s(&each(dims, f)))
}

/// What one ray sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    pub(crate) rgba: [f64; 4],
    pub(crate) depth_mm: Option<f64>,
}

/// A quality that never ends a ray early.
pub(crate) fn to_the_end(quality: Quality) -> Quality {
    Quality { least_transmittance: 0.0, ..quality }
}

impl Shown {
    /// What the ray from one point through another sees, both as voxel index.
    pub(crate) fn ray(
        &self,
        from: [f64; 3],
        towards: [f64; 3],
        quality: Quality,
        step_mm: Option<f64>,
    ) -> Seen {
        let mm = self.volume.grid().own_axes_from_index();
        let at = |p: [f64; 3]| mm.transform_point3(DVec3::from_array(p));
        let narrow = Fov::symmetric(0.01, 0.01).unwrap();
        self.seen(eye(at(from), at(towards), narrow), quality, step_mm)
    }

    /// What the ray in the middle of an eye's view sees.
    pub(crate) fn seen(&self, eye: EyeView, quality: Quality, step_mm: Option<f64>) -> Seen {
        let pixel = self.drawn(eye, [1, 1], quality, step_mm).pixel(0, 0);
        Seen { rgba: pixel.rgba, depth_mm: pixel.depth_mm }
    }
}

#[track_caller]
pub(crate) fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found}, expected {expected} within {tolerance:e}");
}

/// Draws a picture at the levels `fine` and `exact`, and asks of each what is asked there of every picture; that of
/// `exact`.
#[track_caller]
pub(crate) fn true_picture(name: &str, shown: &Shown, eye: EyeView, size: [u32; 2]) -> Picture {
    let exact = shown.exact(eye, size);
    let voxel_mm = shown.volume.grid().spacing_mm().min_element();
    let held = |level, quality, tolerance, most_rmse: Option<f64>| {
        let drawn = shown.drawn(eye, size, quality, None);
        let name = format!("{name}, {}, {level}", shown.scene.mode.name());
        hold(&name, shown, eye, [&exact, &drawn], &tolerance, most_rmse);
        drawn
    };
    held("fine", Quality::FINE, tolerances::fine(voxel_mm), Some(tolerances::FINE_RMSE));
    // The root of the mean square is below the largest error, of which nothing smaller is asked.
    held("exact", Quality::EXACT, tolerances::exact(voxel_mm), None)
}

/// Holds a drawn picture against the exact one: each pixel, where the picture jumps against the nearest right answer; and
/// the root of the mean square over all others, where something is asked of it.
#[track_caller]
fn hold(
    name: &str,
    shown: &Shown,
    eye: EyeView,
    [exact, drawn]: [&Picture; 2],
    tolerance: &Tolerance,
    most_rmse: Option<f64>,
) {
    let reference = shown.reference();
    let uncertainty = Uncertainty::of_float32(&reference);
    let verdict = judge(&reference, &shown.rays(eye), exact, drawn, tolerance, &uncertainty).unwrap();
    let most = (tolerances::MOST_JUMPS * verdict.pixels as f64).ceil() as usize;
    let jumps: HashSet<(u32, u32)> = verdict.jumps.iter().copied().collect();
    let (mut squares, mut count) = (0.0, 0.0);
    for (i, (a, b)) in exact.pixels().iter().zip(drawn.pixels()).enumerate() {
        let (i, width) = (i as u32, exact.width());
        if !jumps.contains(&(i % width, i / width)) {
            squares += (0..3).map(|c| (a.rgba[c] - b.rgba[c]).powi(2)).sum::<f64>();
            count += 3.0;
        }
    }
    let rmse = if count > 0.0 { (squares / count).sqrt() } else { 0.0 };
    tell(&format!(
        "{name}: at most {:.4}/255, rmse {:.4}/255, {} jumps",
        verdict.color_error * 255.0,
        rmse * 255.0,
        jumps.len()
    ));
    if !verdict.wrong.is_empty() || jumps.len() > most || most_rmse.is_some_and(|most| rmse > most) {
        keep_failure(name, exact, drawn);
        panic!("{name}: rmse {:.4}/255, {verdict:?}", rmse * 255.0);
    }
    finite(name, drawn);
}

/// No pixel is anything but a colour.
#[track_caller]
pub(crate) fn finite(name: &str, picture: &Picture) {
    for (i, p) in picture.pixels().iter().enumerate() {
        // A lit colour may be brighter than white; opacity is a part.
        let is_color = p.rgba.iter().all(|x| x.is_finite() && (0.0..=2.0).contains(x)) && p.rgba[3] <= 1.0;
        assert!(is_color && p.depth_mm.is_none_or(|d| d.is_finite() && d >= 0.0), "{name}: pixel {i}: {p:?}");
    }
}
