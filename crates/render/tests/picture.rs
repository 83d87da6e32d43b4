//! The picture on the device against closed forms, and against itself.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use render::{
    DepthGridSize, FrameRenderer, Gpu, Placed, Quality, Sampling, SceneOnDevice, StereoPlan, StereoRequest,
    Still, StillRenderer, VolumeOnDevice,
};
use scene::{SceneFile, VolumeFacts};
use spatial::{DAffine3, DMat3, DQuat, DVec3, EyeView, Fov, HeadGeometry, Pose};
use std::sync::{Arc, OnceLock};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

/// What float32 and 8 fractional bits of the filter may do to a colour of these small scenes.
const COLOR_TOLERANCE: f64 = 1.0e-4;

fn gpu() -> &'static Arc<Gpu> {
    static GPU: OnceLock<Arc<Gpu>> = OnceLock::new();
    GPU.get_or_init(|| Arc::new(Gpu::open(None).unwrap_or_else(|e| panic!("{e}"))))
}

fn volume(dims: [u32; 3], spacing_mm: DVec3, voxels: Voxels) -> Volume {
    let channel =
        Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
    Volume::new(Grid::axis_aligned(dims, spacing_mm).unwrap(), vec![channel]).unwrap()
}

fn floats(dims: [u32; 3], f: impl Fn(f32, f32, f32) -> f32) -> Voxels {
    let [nx, ny, nz] = dims;
    let mut v = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                v.push(f(x as f32, y as f32, z as f32));
            }
        }
    }
    Voxels::F32(v.into())
}

fn noise(dims: [u32; 3], seed: u64) -> Voxels {
    let mut state = seed;
    let next = |state: &mut u64| {
        *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*state >> 33) as u32
    };
    // Mostly empty, with lone voxels and some blocks of noise.
    let [nx, ny, nz] = dims;
    let mut v = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let r = next(&mut state);
                let block = (x / 11 + y / 7 + z / 13) % 5 == 0;
                v.push(if block || r % 997 == 0 { (r >> 8) as u8 } else { 0 });
            }
        }
    }
    Voxels::U8(v.into())
}

/// A volume on the device with a scene of it.
struct Shown {
    scene: SceneOnDevice,
}

impl Shown {
    fn new(volume: &Volume, json: &str) -> Self {
        let on_device = Arc::new(VolumeOnDevice::upload(gpu(), volume, |_| {}).unwrap());
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(volume)).unwrap();
        Self { scene: SceneOnDevice::new(gpu(), &on_device, &scene).unwrap() }
    }

    fn plan(&self, eyes: &[EyeView], size: [u32; 2], quality: Quality, step_mm: Option<f64>) -> StereoPlan {
        let grid = self.scene.grid();
        StereoPlan::new(
            &StereoRequest {
                eyes,
                placed: Placed::own_axes(grid),
                eye_size_px: size,
                quality,
                step_mm,
                depth_grid: DepthGridSize { columns: 4, rows: 3 },
            },
            grid,
            self.scene.numbers(),
        )
        .unwrap()
    }

    fn still(&self, eyes: &[EyeView], size: [u32; 2], quality: Quality, step_mm: Option<f64>) -> Still {
        StillRenderer::new(gpu()).render(&self.scene, &self.plan(eyes, size, quality, step_mm)).unwrap()
    }
}

fn eye(at: DVec3, target: DVec3, fov_deg: f64) -> EyeView {
    EyeView {
        world_from_eye: Pose::looking_at(at, target, DVec3::new(0.1, 0.2, 1.0)).unwrap(),
        fov: Fov::symmetric(fov_deg.to_radians(), fov_deg.to_radians()).unwrap(),
    }
}

/// The one pixel in the middle of a narrow picture.
fn middle(shown: &Shown, eye: EyeView, quality: Quality, step_mm: f64) -> ([f32; 4], f32) {
    let still = shown.still(&[eye], [1, 1], quality, Some(step_mm));
    (still.rgba[0], still.depth_mm[0])
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "found {found}, expected {expected} within {tolerance}");
}

#[test]
fn a_homogeneous_slab_is_as_opaque_as_its_length_whatever_the_step() {
    let v = volume([20, 20, 10], DVec3::splat(1.0), Voxels::U8(vec![100; 4000].into()));
    let shown = Shown::new(&v, r#"{"transfer": [[0, 0.8, 0.4, 0.2, 0.1]]}"#);
    // Straight down z: 10 mm of it.
    let eye = eye(DVec3::new(9.5, 9.5, -50.0), DVec3::new(9.5, 9.5, 0.0), 0.2);
    let alpha = 1.0 - 0.9f64.powi(10);
    let quality = Quality { least_transmittance: 0.0, ..Quality::FINE };
    for step_mm in [0.013, 0.3, 1.0, 2.7, 10.0, 1000.0] {
        let (rgba, depth) = middle(&shown, eye, quality, step_mm);
        near(f64::from(rgba[3]), alpha, 2.0e-5);
        for (c, full) in rgba.iter().zip([0.8, 0.4, 0.2]) {
            near(f64::from(*c), full * alpha, 2.0e-5);
        }
        // Half the light is gone after ln 2 / σ.
        near(f64::from(depth), 49.5 + 0.5f64.ln() / 0.9f64.ln(), 1.0e-3);
    }
}

#[test]
fn early_termination_costs_no_more_than_the_transmittance_it_stops_at() {
    let v = volume([20, 20, 40], DVec3::splat(1.0), Voxels::U8(vec![100; 16000].into()));
    let shown = Shown::new(&v, r#"{"transfer": [[0, 1, 1, 1, 0.3]]}"#);
    let eye = eye(DVec3::new(9.5, 9.5, -50.0), DVec3::new(9.5, 9.5, 0.0), 0.2);
    let alpha =
        |t| f64::from(middle(&shown, eye, Quality { least_transmittance: t, ..Quality::FINE }, 1.0).0[3]);
    for least in [0.25, 1.0 / 64.0, 1.0 / 1024.0] {
        let error = alpha(0.0) - alpha(least);
        assert!(error > 0.0 && error <= least, "stopped at {least}: error {error}");
    }
}

#[test]
fn the_threshold_surface_of_a_plane_lies_where_the_plane_lies() {
    // f = 2x + y - 3z + 40, which trilinear interpolation reproduces.
    let dims = [30, 30, 30];
    let plane = |x: f32, y: f32, z: f32| 2.0 * x + y - 3.0 * z + 40.0;
    let v = volume(dims, DVec3::new(1.0, 0.5, 2.0), floats(dims, plane));
    let shown = Shown::new(&v, r#"{"mode": "threshold", "threshold": 31.0}"#);
    let at = DVec3::new(12.0, 8.0, 100.0);
    let eye = eye(at, DVec3::new(13.0, 7.0, 20.0), 0.2);
    let direction = eye.world_from_eye.orientation * DVec3::NEG_Z;
    // In millimetres the gradient is (2, 2, -1.5).
    let gradient = DVec3::new(2.0, 2.0, -1.5);
    let expected = (31.0 - 40.0 - gradient.dot(at)) / gradient.dot(direction);
    let (rgba, depth) = middle(&shown, eye, Quality::EXACT, 1.7);
    near(f64::from(depth), expected, 1.0e-3);
    let k = gradient.normalize().dot(direction).abs();
    let lit = scene::Headlight::default().lit([0.95, 0.9, 0.8], k);
    for (c, expected) in rgba.iter().zip(lit) {
        near(f64::from(*c), expected, COLOR_TOLERANCE);
    }
}

#[test]
fn the_x_ray_is_the_mean_along_the_way() {
    let dims = [8, 8, 16];
    let v = volume(dims, DVec3::splat(1.0), floats(dims, |_, _, z| if z < 4.0 { 0.0 } else { 1.0 }));
    let shown = Shown::new(&v, r#"{"mode": "x-ray", "window": [0, 1]}"#);
    let eye = eye(DVec3::new(3.5, 3.5, -20.0), DVec3::new(3.5, 3.5, 0.0), 0.1);
    // 4 voxels at 0 and 12 at 1, linear between: the mean is 12/16.
    let (rgba, depth) = middle(&shown, eye, Quality::EXACT, 0.01);
    near(f64::from(rgba[0]), 0.75, 1.0e-4);
    near(f64::from(rgba[3]), 0.75, 1.0e-4);
    near(f64::from(depth), 19.5 + 8.0, 1.0e-3);
}

#[test]
fn the_maximum_is_the_highest_value_on_the_way() {
    let dims = [9, 9, 21];
    let v = volume(
        dims,
        DVec3::splat(1.0),
        floats(dims, |x, y, z| if (x, y, z) == (4.0, 4.0, 12.0) { 10.0 } else { z * 0.1 }),
    );
    let shown = Shown::new(&v, r#"{"mode": "maximum", "transfer": [[0, 0, 0, 0, 0], [10, 1, 0.5, 0, 1]]}"#);
    let eye = eye(DVec3::new(4.0, 4.0, -20.0), DVec3::new(4.0, 4.0, 0.0), 0.1);
    let (rgba, depth) = middle(&shown, eye, Quality::EXACT, 0.5);
    near(f64::from(rgba[3]), 1.0, 1.0e-3);
    near(f64::from(rgba[1]), 0.5, 1.0e-3);
    near(f64::from(depth), 32.0, 1.0e-3);
}

#[test]
fn cumulated_shows_the_x_ray_through_the_surface() {
    let v = volume([8, 8, 10], DVec3::splat(1.0), Voxels::U8(vec![200; 640].into()));
    let json = |mode: &str| {
        format!(r#"{{"mode": "{mode}", "threshold": 100, "window": [0, 250], "surface_opacity": 0.6}}"#)
    };
    let eye = eye(DVec3::new(3.5, 3.5, -20.0), DVec3::new(3.5, 3.5, 0.0), 0.1);
    let of = |mode| middle(&Shown::new(&v, &json(mode)), eye, Quality::FINE, 0.5).0.map(f64::from);
    let (surface, x_ray, both) = (of("threshold"), of("x-ray"), of("cumulated"));
    for i in 0..4 {
        near(both[i], surface[i] + 0.4 * x_ray[i], 1.0e-6);
    }
}

#[test]
fn skipping_empty_space_changes_no_bit() {
    let dims = [70, 45, 61];
    let v = volume(dims, DVec3::new(1.0, 1.3, 0.8), noise(dims, 7));
    let eyes = [
        eye(DVec3::new(-60.0, 90.0, 30.0), DVec3::new(35.0, 30.0, 25.0), 50.0),
        // Inside the volume.
        eye(DVec3::new(30.0, 20.0, 20.0), DVec3::new(60.0, 50.0, 20.0), 90.0),
    ];
    // A band between 0 and 255 that no voxel has, only what lies between them.
    let band =
        r#""transfer": [[0,0,0,0,0],[120,1,0.2,0.1,0],[121,1,0.5,0.1,0.7],[122,0.1,1,0.1,0],[255,0,0,0,0]]"#;
    let edge = r#""transfer": [[0,0,0,0,0],[90,0,0,0,0],[90,1,0.5,0.1,0.2],[255,0.1,1,1,0.9]]"#;
    for json in [
        format!("{{{band}}}"),
        format!("{{{edge}, \"shade\": true}}"),
        r#"{"mode": "threshold", "threshold": 180}"#.into(),
        r#"{"mode": "cumulated", "threshold": 250, "window": [0, 60]}"#.into(),
        r#"{"mode": "maximum", "window": [0, 255]}"#.into(),
    ] {
        let shown = Shown::new(&v, &json);
        // Rays as far apart as these stand in tiles of 4 by 4, of 2 by 2 and of 8 by 8.
        for (quality, size) in [
            (Quality::PLAIN, [97, 61]),
            (Quality::BALANCED, [97, 61]),
            (Quality::FINE, [97, 61]),
            (Quality::EXACT, [97, 61]),
            (Quality::DRAFT, [97, 61]),
            (Quality::BALANCED, [23, 15]),
            (Quality::DRAFT, [23, 15]),
            (Quality::DRAFT, [160, 100]),
        ] {
            let of = |skip_empty| shown.still(&eyes, size, Quality { skip_empty, ..quality }, None);
            let (with, without) = (of(true), of(false));
            assert!(without.rgba.iter().any(|p| p[3] > 0.1), "{json}: something is seen");
            for (i, (a, b)) in with.rgba.iter().zip(&without.rgba).enumerate() {
                let (d, e) = (with.depth_mm[i], without.depth_mm[i]);
                assert!(
                    a == b && d == e,
                    "{json}: pixel {i} is {a:?} at {d} with skipping, {b:?} at {e} without"
                );
            }
        }
    }
}

#[test]
fn eyes_in_one_place_see_the_same_and_a_pair_equals_two_single_eyes() {
    let dims = [40, 40, 40];
    let v = volume(dims, DVec3::ONE, noise(dims, 3));
    let shown = Shown::new(&v, r#"{"transfer": [[0,0,0,0,0],[255,1,0.5,0.2,0.9]], "shade": true}"#);
    let head = Pose::looking_at(DVec3::new(90.0, -30.0, 50.0), DVec3::splat(20.0), DVec3::Z).unwrap();
    let fov = Fov::checked(-0.3, 0.4, 0.35, -0.3).unwrap();
    let same = HeadGeometry::parallel(0.0, fov).view(&head);
    let still = shown.still(&same.eyes, [64, 48], Quality::BALANCED, None);
    assert!(still.eye(0) == still.eye(1));
    let apart = HeadGeometry::parallel(6.0, fov).view(&head);
    let pair = shown.still(&apart.eyes, [64, 48], Quality::BALANCED, None);
    assert!(pair.eye(0) != pair.eye(1));
    for i in 0..2 {
        let single = shown.still(&apart.eyes[i..=i], [64, 48], Quality::BALANCED, None);
        assert!(single.eye(0) == pair.eye(i));
    }
}

#[test]
fn turned_and_mirrored_grids_are_lit_alike() {
    // One ball, stored along three different sets of axes: the picture is the same.
    let dims = [24, 24, 24];
    let ball =
        |x: f32, y: f32, z: f32| 20.0 - ((x - 13.0).powi(2) + (y - 11.0).powi(2) + (z - 9.5).powi(2)).sqrt();
    let head = eye(DVec3::new(0.05, 0.1, 0.15), DVec3::ZERO, 12.0);
    let picture = |grid: Grid, voxels: Voxels| {
        let channel =
            Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
        let v = Volume::new(grid, vec![channel]).unwrap();
        let json = r#"{"mode": "threshold", "threshold": 12, "placement": {"position_m": [0, 0, 0]}}"#;
        let shown = Shown::new(&v, json);
        let grid = shown.scene.grid();
        let plan = StereoPlan::new(
            &StereoRequest {
                eyes: &[head],
                placed: Placed::in_room(&shown.scene.scene().placement, grid),
                eye_size_px: [40, 40],
                quality: Quality::EXACT,
                step_mm: None,
                depth_grid: DepthGridSize::default(),
            },
            grid,
            shown.scene.numbers(),
        )
        .unwrap();
        StillRenderer::new(gpu()).render(&shown.scene, &plan).unwrap()
    };
    let straight = picture(Grid::axis_aligned(dims, DVec3::ONE).unwrap(), floats(dims, ball));
    // x runs the other way in memory (left-handed), y and z are swapped.
    let swapped = DAffine3::from_mat3_translation(
        DMat3::from_cols(DVec3::NEG_X, DVec3::Z, DVec3::Y),
        DVec3::new(23.0, 0.0, 0.0),
    );
    let mirrored = picture(Grid::new(dims, swapped).unwrap(), floats(dims, |i, j, k| ball(23.0 - i, k, j)));
    assert!(straight.rgba.iter().any(|p| p[3] > 0.5));
    for (a, b) in straight.rgba.iter().zip(&mirrored.rgba) {
        for i in 0..4 {
            near(f64::from(a[i]), f64::from(b[i]), COLOR_TOLERANCE);
        }
    }
    let turned = Grid::new(dims, DAffine3::from_quat(DQuat::from_rotation_z(0.3))).unwrap();
    assert!(picture(turned, floats(dims, ball)).rgba != straight.rgba, "orientation is honoured");
}

#[test]
fn one_voxel_and_one_slice_are_seen() {
    for dims in [[1, 1, 1], [16, 16, 1], [1, 16, 16]] {
        let n = dims.iter().product::<u32>() as usize;
        let v = volume(dims, DVec3::splat(2.0), Voxels::U8(vec![255; n].into()));
        let shown = Shown::new(&v, r#"{"transfer": [[0, 1, 1, 1, 0.5]]}"#);
        let centre = (DVec3::from_array(dims.map(f64::from)) - 1.0) * 2.0 / 2.0;
        // Along z: as many slices of 2 mm as there are.
        let eye = eye(centre - DVec3::Z * 30.0, centre, 0.1);
        let (rgba, _) = middle(&shown, eye, Quality { least_transmittance: 0.0, ..Quality::FINE }, 0.7);
        near(f64::from(rgba[3]), 1.0 - 0.25f64.powi(dims[2] as i32), 1.0e-5);
    }
}

#[test]
fn float32_and_hardware_interpolation_agree_to_the_filters_digits() {
    let dims = [32, 32, 32];
    let v = volume(dims, DVec3::ONE, noise(dims, 11));
    let shown = Shown::new(&v, r#"{"mode": "x-ray", "window": [0, 255]}"#);
    let eyes = [eye(DVec3::new(80.0, 70.0, 60.0), DVec3::splat(16.0), 30.0)];
    let of = |sampling| shown.still(&eyes, [48, 48], Quality { sampling, ..Quality::FINE }, None);
    let (hardware, float) = (of(Sampling::Hardware), of(Sampling::Float32));
    // Eight fractional bits: each value is off by at most 2^-8 of the neighbours' difference along each axis.
    for (a, b) in hardware.rgba.iter().zip(&float.rgba) {
        near(f64::from(a[0]), f64::from(b[0]), 3.0 / 256.0);
    }
}

#[test]
fn float64_is_drawn_as_the_float32_nearest_to_it() {
    let dims = [9, 8, 7];
    let doubles: Vec<f64> = (0..9 * 8 * 7).map(|i| f64::from(i % 101) / 7.0).collect();
    let singles: Vec<f32> = doubles.iter().map(|&v| v as f32).collect();
    assert!(doubles.iter().zip(&singles).any(|(d, s)| *d != f64::from(*s)));
    let at = eye(DVec3::new(30.0, 25.0, 20.0), DVec3::new(4.0, 3.5, 3.0), 25.0);
    let draw = |voxels: Voxels| {
        let shown = Shown::new(
            &volume(dims, DVec3::splat(1.0), voxels),
            r#"{"transfer": [[2, 1, 0, 0, 0], [9, 0, 1, 0, 0.4], [14, 0, 0, 1, 0.9]]}"#,
        );
        shown.still(&[at], [24, 24], Quality::BALANCED, None).rgba
    };
    let single = draw(Voxels::F32(singles.into()));
    assert!(single.iter().any(|p| p[3] > 0.5));
    assert_eq!(draw(Voxels::F64(doubles.clone().into())), single);
    // Beyond float32, the largest there is.
    let beyond: Vec<f64> = doubles.iter().map(|&v| if v > 13.0 { 1.0e100 } else { v }).collect();
    let clamped = beyond.iter().map(|&v| v.min(f64::from(f32::MAX)) as f32).collect();
    assert_eq!(draw(Voxels::F64(beyond.into())), draw(Voxels::F32(clamped)));
}

#[test]
fn the_planes_are_the_picture_in_bt709() {
    let dims = [32, 32, 32];
    let v = volume(dims, DVec3::ONE, noise(dims, 5));
    let shown = Shown::new(&v, r#"{"transfer": [[0,0,0,0,0],[128,1,0.1,0.2,0.3],[255,0.1,0.9,1,0.9]]}"#);
    let view = HeadGeometry::parallel(6.0, Fov::symmetric(0.4, 0.4).unwrap())
        .view(&Pose::looking_at(DVec3::new(80.0, 70.0, 60.0), DVec3::splat(16.0), DVec3::Z).unwrap());
    let size = [36, 26];
    let plan = shown.plan(&view.eyes, size, Quality::BALANCED, None);
    let still = StillRenderer::new(gpu()).render(&shown.scene, &plan).unwrap();
    let frame = FrameRenderer::new(gpu(), 1).unwrap().submit(&shown.scene, &plan).unwrap().finish().unwrap();
    assert_eq!((frame.size_px(), frame.luma_stride()), ([72, 26], 72));
    let rgb = |x: usize, y: usize| {
        let eye = x / 36;
        still.eye(eye)[y * 36 + x % 36].map(f64::from)
    };
    let luma = |c: [f64; 4]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    let planes = frame.planes();
    assert_eq!(planes.len(), 72 * 26 * 3 / 2);
    for y in 0..26 {
        for x in 0..72 {
            near(f64::from(planes[y * 72 + x]), 16.0 + 219.0 * luma(rgb(x, y)), 0.501);
        }
    }
    for y in 0..13 {
        for x in 0..36 {
            let mut mean = [0.0; 4];
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let c = rgb(2 * x + dx, 2 * y + dy);
                mean.iter_mut().zip(c).for_each(|(m, c)| *m += c / 4.0);
            }
            let (u, v) = (72 * 26 + y * 36 + x, 72 * 26 + 36 * 13 + y * 36 + x);
            near(f64::from(planes[u]), 128.0 + 224.0 * (mean[2] - luma(mean)) / 1.8556, 0.501);
            near(f64::from(planes[v]), 128.0 + 224.0 * (mean[0] - luma(mean)) / 1.5748, 0.501);
        }
    }
    assert!(frame.gpu_times().is_none_or(|t| !t.raycast.is_zero()));
}

#[test]
fn fewer_rays_are_stretched_over_the_whole_picture() {
    let v = volume([20, 20, 20], DVec3::ONE, Voxels::U8(vec![255; 8000].into()));
    let shown = Shown::new(&v, r#"{"transfer": [[0, 1, 1, 1, 1]]}"#);
    let eyes = [eye(DVec3::new(9.5, 9.5, -10.0), DVec3::splat(9.5), 10.0)];
    let quality = Quality { resolution_scale: 0.37, ..Quality::BALANCED };
    let plan = shown.plan(&eyes, [64, 48], quality, None);
    assert_eq!((plan.render_size_px(), plan.output_size_px()), ([24, 18], [64, 48]));
    let frame = FrameRenderer::new(gpu(), 1).unwrap().submit(&shown.scene, &plan).unwrap().finish().unwrap();
    assert!(frame.planes()[..64 * 48].iter().all(|&y| y == 235), "white from edge to edge");
    // The volume's face is 9.5 mm away, straight ahead.
    let depths = frame.depth_grid_mm();
    assert_eq!(depths.len(), 12);
    assert!(depths.iter().all(|&d| (9..=10).contains(&d)), "{depths:?}");
}

#[test]
fn the_planes_of_fewer_rays_lie_between_them() {
    let dims = [32, 32, 32];
    let v = volume(dims, DVec3::ONE, noise(dims, 5));
    let shown = Shown::new(&v, r#"{"transfer": [[0,0,0,0,0],[128,1,0.1,0.2,0.3],[255,0.1,0.9,1,0.9]]}"#);
    let view = HeadGeometry::parallel(6.0, Fov::symmetric(0.4, 0.4).unwrap())
        .view(&Pose::looking_at(DVec3::new(80.0, 70.0, 60.0), DVec3::splat(16.0), DVec3::Z).unwrap());
    let quality = Quality { resolution_scale: 0.4, ..Quality::BALANCED };
    let plan = shown.plan(&view.eyes, [36, 26], quality, None);
    let [columns, rows] = plan.render_size_px().map(|n| n as usize);
    assert_eq!([columns, rows], [14, 10]);
    let still = StillRenderer::new(gpu()).render(&shown.scene, &plan).unwrap();
    // Larger frames first: what lies beyond this one's rays is another's.
    let mut ring = FrameRenderer::new(gpu(), 1).unwrap();
    for scale in [0.9, 1.0] {
        let quality = Quality { resolution_scale: scale, ..Quality::BALANCED };
        let plan = shown.plan(&view.eyes, [36, 26], quality, None);
        ring.submit(&shown.scene, &plan).unwrap().finish().unwrap();
    }
    let frame = ring.submit(&shown.scene, &plan).unwrap().finish().unwrap();
    // Bilinear, at a point of the picture in pixels from its corner.
    let between = |eye: usize, at: [f64; 2]| {
        let [x, y] = [(at[0] * columns as f64 / 36.0, columns), (at[1] * rows as f64 / 26.0, rows)]
            .map(|(q, n)| (q - 0.5).clamp(0.0, (n - 1) as f64));
        let of = |x: usize, y: usize| still.eye(eye)[y.min(rows - 1) * columns + x.min(columns - 1)];
        let (x0, y0) = (x as usize, y as usize);
        let (fx, fy) = (x.fract(), y.fract());
        let corners = [
            (of(x0, y0), (1.0 - fx) * (1.0 - fy)),
            (of(x0 + 1, y0), fx * (1.0 - fy)),
            (of(x0, y0 + 1), (1.0 - fx) * fy),
            (of(x0 + 1, y0 + 1), fx * fy),
        ];
        std::array::from_fn(|i| corners.iter().map(|(c, weight)| f64::from(c[i]) * weight).sum::<f64>())
    };
    let luma = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
    let planes = frame.planes();
    // A device's filter may weigh in 256ths; the steepest neighbours here are half of all brightness apart.
    let tolerance = 0.5 + 2.0 * 219.0 / 256.0 / 2.0;
    for y in 0..26 {
        for x in 0..72 {
            let c = between(x / 36, [(x % 36) as f64 + 0.5, y as f64 + 0.5]);
            near(f64::from(planes[y * 72 + x]), 16.0 + 219.0 * luma(c), tolerance);
        }
    }
    for y in 0..13 {
        for x in 0..36 {
            let c = between(x / 18, [(2 * (x % 18) + 1) as f64, (2 * y + 1) as f64]);
            let (u, v) = (72 * 26 + y * 36 + x, 72 * 26 + 36 * 13 + y * 36 + x);
            near(f64::from(planes[u]), 128.0 + 224.0 * (c[2] - luma(c)) / 1.8556, tolerance);
            near(f64::from(planes[v]), 128.0 + 224.0 * (c[0] - luma(c)) / 1.5748, tolerance);
        }
    }
}

#[test]
fn a_ring_that_is_full_says_so_and_goes_on_when_a_frame_is_done() {
    let v = volume([8, 8, 8], DVec3::ONE, Voxels::U8(vec![9; 512].into()));
    let shown = Shown::new(&v, "{}");
    let plan =
        shown.plan(&[eye(DVec3::new(50.0, 9.0, 3.0), DVec3::ZERO, 10.0)], [16, 16], Quality::DRAFT, None);
    let mut ring = FrameRenderer::new(gpu(), 2).unwrap();
    let first = ring.submit(&shown.scene, &plan).unwrap();
    let second = ring.submit(&shown.scene, &plan).unwrap();
    assert!(matches!(ring.submit(&shown.scene, &plan), Err(render::RenderError::RingFull { slots: 2 })));
    let done = first.finish().unwrap();
    assert!(ring.submit(&shown.scene, &plan).is_err(), "a finished frame still holds its slot");
    drop(done);
    ring.submit(&shown.scene, &plan).unwrap();
    drop(second);
}

#[test]
fn a_volume_too_large_for_the_device_is_refused_with_both_numbers() {
    let max = gpu().longest_volume_axis();
    let v = volume([max + 1, 1, 1], DVec3::ONE, Voxels::U8(vec![0; max as usize + 1].into()));
    let error = VolumeOnDevice::upload(gpu(), &v, |_| {}).unwrap_err().to_string();
    assert!(error.contains(&max.to_string()) && error.contains(&(max + 1).to_string()), "{error}");
}

#[test]
fn an_adapter_that_is_not_there_is_named_with_those_that_are() {
    let error = Gpu::open(Some("no such adapter")).unwrap_err().to_string();
    assert!(error.contains("no such adapter") && error.contains(&gpu().adapter().name), "{error}");
}
