//! Hard cases, each by name. None gives what is no number, hangs or crashes; each is held against the reference or a
//! closed form. What cannot be drawn is refused, with numbers, before anything is drawn.
//!
//! Of the light there is one case: a scene's light is a headlight, so it is always at the eye. It is inside of the volume,
//! and at a voxel's centre, where the eye is.

use crate::scenes::{hills, looks};
use crate::setting::{
    Noise, Seen, Shown, each, eye, f32s, finite, floats, fov, gpu, i16s, near, oblique, scaled, straight,
    to_the_end, true_picture, u8s, u16s, volume_on,
};
use crate::tolerances::{BALANCED_DB, CLOSED_FORM, DISTANCE, EXACT_COLOR};
use reference::compare;
use render::{
    DepthGridSize, Placed, PlanError, Quality, RenderError, Sampling, SceneOnDevice, StereoPlan,
    StereoRequest, StillRenderer, VolumeOnDevice,
};
use scene::{Mode, SceneFile, VolumeFacts};
use spatial::{DAffine3, DMat3, DQuat, DVec3, EyeView, Fov, Pose};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;
use volume::{Grid, GridError, Volume};

const SIZE: [u32; 2] = [24, 18];

/// Steps, interpolated in float32.
fn steps() -> Quality {
    Quality { sampling: Sampling::Float32, least_transmittance: 0.0, ..Quality::PLAIN }
}

/// Every look of a volume, with what is seen from `low` to `high`.
fn all_looks(volume: &Arc<Volume>, low: f64, high: f64, opacity: f64) -> Vec<Shown> {
    let facts = VolumeFacts::of(volume);
    looks(low, high, opacity)
        .into_iter()
        .map(|(_, json)| {
            Shown::of_scene(volume.clone(), SceneFile::from_json(&json).unwrap().resolve(&facts).unwrap())
        })
        .collect()
}

/// As [`any_and_true`]; and the unlit integrals of a smooth volume are at `balanced` as near as that level is to be. (Surfaces
/// and light turn within a step: what they have there stands with the scenes of `levels`.)
#[track_caller]
fn smooth_and_true(name: &str, volume: &Arc<Volume>, low: f64, high: f64, eye: EyeView) {
    any_and_true(name, volume, low, high, eye);
    for shown in all_looks(volume, low, high, 0.2) {
        let is_integral = matches!(shown.scene.mode, Mode::EmissionAbsorption | Mode::XRay);
        if shown.scene.light.is_none() && is_integral {
            let exact = shown.exact(eye, SIZE);
            let balanced = compare(&exact, &shown.drawn(eye, SIZE, Quality::BALANCED, None)).unwrap().psnr_db;
            assert!(balanced >= BALANCED_DB, "{name}, {}: {balanced} dB", shown.scene.mode.name());
        }
    }
}

/// Every look of any volume is true at `fine` and `exact`, and finite at every level.
#[track_caller]
fn any_and_true(name: &str, volume: &Arc<Volume>, low: f64, high: f64, eye: EyeView) {
    for shown in all_looks(volume, low, high, 0.2) {
        true_picture(name, &shown, eye, SIZE);
        for quality in [Quality::DRAFT, Quality::BALANCED] {
            finite(name, &shown.drawn(eye, SIZE, quality, None));
        }
    }
}

fn smooth(n: u32, spacing: f64) -> Arc<Volume> {
    let values = each([n; 3], |p| hills(p, f64::from(n - 1)));
    Arc::new(volume_on(straight([n; 3], [spacing; 3]), f32s(&values)))
}

fn noisy(grid: Grid, seed: u64) -> Arc<Volume> {
    let mut noise = Noise(seed);
    let values = each(grid.dims(), |_| noise.next());
    Arc::new(volume_on(grid, f32s(&values)))
}

/// An eye that looks along an axis of the volume, at a point given as voxel index.
fn along(volume: &Volume, at: [f64; 3], orientation: DQuat) -> EyeView {
    let position_m = volume.grid().own_axes_from_index().transform_point3(DVec3::from_array(at));
    let fov = Fov::symmetric(0.01, 0.01).unwrap();
    EyeView { world_from_eye: Pose { position_m, orientation }, fov }
}

#[track_caller]
fn as_the_reference(name: &str, shown: &Shown, eye: EyeView, quality: Quality, color: f64) -> Seen {
    let found = shown.seen(eye, quality, None);
    let expected = shown.reference().pixel(&shown.rays(eye).ray(0.5, 0.5));
    for (f, e) in found.rgba.iter().zip(expected.rgba) {
        assert!((f - e).abs() <= color, "{name}: {found:?}, expected {expected:?}");
    }
    found
}

#[test]
fn rays_in_faces_edges_and_corners_of_the_volume_are_inside() {
    // All in powers of two: the rays lie in the faces to the bit.
    let v = noisy(straight([5, 4, 6], [1.0, 2.0, 0.5]), 8);
    for shown in all_looks(&v, 0.2, 0.9, 0.2) {
        for x in [-0.5, 0.0, 2.0, 4.5] {
            for y in [-0.5, 1.0, 3.5] {
                // From before the volume, on its face, on a plane of centres inside, and on the far face.
                for z in [9.0, 5.5, 3.0, 0.5] {
                    let eye = along(&v, [x, y, z], DQuat::IDENTITY);
                    let name = format!("{}: down from {x} {y} {z}", shown.scene.mode.name());
                    as_the_reference(&name, &shown, eye, Quality::EXACT, EXACT_COLOR);
                    as_the_reference(&name, &shown, eye, Quality::FINE, EXACT_COLOR);
                    finite(&name, &shown.drawn(eye, [1, 1], Quality::BALANCED, None));
                }
            }
        }
        // Along the other axes, in planes of centres: in a face, a turn by 90° in float64 would lead out of it.
        for (turn, at) in [
            (DQuat::from_rotation_y(FRAC_PI_2), [9.0, 1.0, 3.0]),
            (DQuat::from_rotation_y(-FRAC_PI_2), [-9.0, 3.0, 5.0]),
            (DQuat::from_rotation_x(FRAC_PI_2), [3.0, -9.0, 2.0]),
            (DQuat::from_rotation_y(PI), [0.0, 2.0, -9.0]),
        ] {
            let eye = along(&v, at, turn);
            let name = format!("{}: from {at:?}", shown.scene.mode.name());
            as_the_reference(&name, &shown, eye, Quality::EXACT, EXACT_COLOR);
        }
    }
}

#[test]
fn rays_parallel_to_a_face_have_no_seam() {
    // Across a picture whose rays run along z, in a field that changes slowly: neighbours differ little.
    let v = smooth(24, 1.0);
    let shown = &all_looks(&v, 0.15, 0.85, 0.2)[0];
    let view = EyeView {
        fov: Fov::symmetric(0.12, 0.12).unwrap(),
        ..along(&v, [12.0, 11.5, 150.0], DQuat::IDENTITY)
    };
    for quality in [Quality::BALANCED, Quality::FINE, Quality::EXACT] {
        let picture = shown.drawn(view, [32, 32], quality, None);
        for y in 0..31 {
            for x in 0..31 {
                let here = picture.pixel(x, y).rgba[3];
                for other in [picture.pixel(x + 1, y), picture.pixel(x, y + 1)] {
                    assert!((here - other.rgba[3]).abs() < 0.2, "{x} {y}");
                }
            }
        }
    }
    true_picture("along z", shown, view, [32, 32]);
}

#[test]
fn the_eye_and_its_light_at_the_exact_centre_and_at_a_voxel_s_centre() {
    for n in [24u32, 25] {
        // The middle of 24 voxels lies between them, of 25 at the centre of one.
        let v = smooth(n, 1.0);
        let centre = DVec3::splat(f64::from(n - 1) / 2.0);
        let view = eye(centre, centre + DVec3::new(1.0, 2.0, 0.7), fov(80.0, SIZE));
        smooth_and_true(&format!("eye in the middle of {n}"), &v, 0.15, 0.85, view);
        let straight = EyeView { fov: fov(80.0, SIZE), ..along(&v, centre.to_array(), DQuat::IDENTITY) };
        smooth_and_true(&format!("eye in the middle of {n}, along an axis"), &v, 0.15, 0.85, straight);
    }
    let v = noisy(straight([9, 8, 7], [1.0; 3]), 5);
    let view = eye(DVec3::new(4.0, 3.0, 3.0), DVec3::new(5.0, 5.0, 4.0), fov(100.0, SIZE));
    any_and_true("eye in noise", &v, 0.2, 0.9, view);
}

#[test]
fn the_eye_in_front_of_and_inside_an_opaque_voxel() {
    let v = Arc::new(floats([9; 3], [1.0; 3], |p| f64::from(u8::from(p == DVec3::splat(4.0)))));
    let scene = SceneFile::from_json(r#"{"mode": "threshold", "threshold": 0.5}"#).unwrap();
    let shown = Shown::of_scene(v.clone(), scene.resolve(&VolumeFacts::of(&v)).unwrap());
    for quality in [Quality::EXACT, Quality::FINE, steps()] {
        let depth = |from, to| shown.ray(from, to, quality, None).depth_mm;
        near(depth([3.4, 4.0, 4.0], [4.0; 3]).unwrap(), 0.1, 1e-5);
        // At or above the threshold at the eye itself.
        near(depth([3.6, 4.0, 4.0], [4.0; 3]).unwrap(), 0.0, 1e-5);
        near(depth([4.0; 3], [5.0, 4.0, 4.0]).unwrap(), 0.0, 1e-5);
        assert_eq!(depth([4.6, 4.0, 4.0], [9.0, 4.0, 4.0]), None);
    }
    let view = eye(DVec3::new(3.2, 4.1, 4.0), DVec3::new(4.0, 4.0, 4.0), fov(60.0, SIZE));
    any_and_true("before an opaque voxel", &v, 0.2, 0.8, view);
}

#[test]
fn a_step_longer_than_the_ray() {
    let v = smooth(12, 1.0);
    let view = eye(DVec3::new(30.0, 25.0, 20.0), DVec3::splat(5.5), fov(30.0, SIZE));
    for shown in all_looks(&v, 0.15, 0.85, 0.2) {
        for step in [64.0, 1e6] {
            for quality in [Quality::DRAFT, steps(), Quality::EXACT] {
                finite("a long step", &shown.drawn(view, SIZE, quality, Some(step)));
            }
        }
        // A level without steps is not touched by one.
        let (plain, stepped) = (
            shown.drawn(view, SIZE, Quality::EXACT, None),
            shown.drawn(view, SIZE, Quality::EXACT, Some(1e6)),
        );
        assert_eq!(plain, stepped);
        true_picture("a long step", &shown, view, SIZE);
    }
    // What is homogeneous is right whatever the step.
    let slab = Shown::new(floats([4; 3], [1.0; 3], |_| 1.0), r#"{"transfer": [[0, 1, 1, 1, 0.3]]}"#);
    let found = slab.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], steps(), Some(1e6));
    near(found.rgba[3], 1.0 - 0.7f64.powi(4), CLOSED_FORM);
}

#[test]
fn one_voxel_and_one_slice_are_as_thick_as_a_voxel() {
    for (dims, spacing, from, towards, mm) in [
        ([1u32, 1, 1], [2.0, 3.0, 4.0], [-5.0, 0.2, 0.1], [5.0, 0.2, 0.1], 2.0),
        ([1, 1, 1], [2.0, 3.0, 4.0], [0.0, 0.0, 9.0], [0.0, 0.0, -9.0], 4.0),
        ([5, 1, 4], [1.0, 3.0, 1.0], [2.3, -4.0, 1.1], [2.3, 9.0, 1.1], 3.0),
        ([5, 1, 4], [1.0, 3.0, 1.0], [-2.0, 0.5, 1.0], [9.0, 0.5, 1.0], 5.0),
    ] {
        let shown = Shown::new(floats(dims, spacing, |_| 0.5), r#"{"transfer": [[0, 1, 1, 1, 0.2]]}"#);
        for quality in [to_the_end(Quality::EXACT), to_the_end(Quality::BALANCED), steps()] {
            let alpha = shown.ray(from, towards, quality, None).rgba[3];
            near(alpha, 1.0 - 0.8f64.powf(mm), CLOSED_FORM);
        }
    }
    for dims in [[1u32, 1, 1], [7, 1, 5], [1, 6, 1], [2, 2, 2]] {
        let v = noisy(straight(dims, [1.0, 1.5, 2.0]), 3);
        let middle = v.grid().size_mm() / 2.0 - v.grid().spacing_mm() / 2.0;
        let view = eye(middle + DVec3::new(9.0, 11.0, 7.0), middle, fov(40.0, SIZE));
        any_and_true(&format!("{dims:?} voxels"), &v, 0.1, 0.9, view);
    }
}

#[test]
fn spacings_from_a_nanometre_to_a_metre_give_the_same_picture_in_their_own_unit() {
    let values = each([12, 11, 13], |p| hills(p, 12.0));
    let mut pictures = Vec::new();
    for spacing in [1e-6f64, 1e-3, 0.1, 1.0, 1e3] {
        let v = Arc::new(volume_on(straight([12, 11, 13], [spacing; 3]), f32s(&values)));
        let view = eye(DVec3::new(30.0, 25.0, 20.0) * spacing, DVec3::splat(5.5) * spacing, fov(30.0, SIZE));
        // The same opacity a voxel, as far as a millimetre's is held below 1.
        let opacity = -((-0.2f64).ln_1p() / spacing).exp_m1();
        for shown in all_looks(&v, 0.15, 0.85, opacity.max(1e-4)) {
            true_picture(&format!("spacing {spacing}"), &shown, view, SIZE);
            finite("spacing", &shown.drawn(view, SIZE, Quality::BALANCED, None));
        }
        // What does not depend on lengths is the same to the bit's neighbourhood, at any spacing.
        let mean = Shown::new(
            volume_on(straight([12, 11, 13], [spacing; 3]), f32s(&values)),
            r#"{"mode": "x-ray", "window": [0, 1]}"#,
        );
        for quality in [Quality::EXACT, steps()] {
            pictures.push(mean.drawn(view, SIZE, quality, None));
        }
    }
    for (i, picture) in pictures.iter().enumerate() {
        let same = compare(&pictures[i % 2], picture).unwrap();
        assert!(same.max_abs_error < 1e-4, "{i}: {same:?}");
    }
}

#[test]
fn spacings_far_apart_are_drawn_or_refused_with_numbers() {
    let v = noisy(oblique([12, 12, 3], [0.1, 0.1, 5.0]), 21);
    let middle = v.grid().size_mm() / 2.0;
    let view = eye(middle + DVec3::new(3.0, 4.0, 22.0), middle, fov(20.0, SIZE));
    any_and_true("0.1 x 0.1 x 5 mm", &v, 0.1, 0.9, view);

    // A step of the smallest spacing could not be counted along the longest: the level says so. Without steps it is drawn.
    let v = noisy(straight([4, 4, 4], [1e-6, 1.0, 1e3]), 2);
    let shown = &all_looks(&v, 0.1, 0.9, 0.2)[0];
    let view = eye(DVec3::new(500.0, 900.0, 5000.0), DVec3::new(0.0, 1.5, 1500.0), fov(30.0, SIZE));
    true_picture("1e-6 x 1 x 1000 mm", shown, view, SIZE);
    let error = plan(shown, &[view], SIZE, Quality::PLAIN).unwrap_err();
    assert!(matches!(error, PlanError::Step { samples, .. } if samples > 4e9), "{error}");
    let text = error.to_string();
    assert!(text.contains("0.000001 mm") && text.contains("4000002000"), "{text}");
    // Beyond the limits of a grid there is no volume to draw.
    for spacing in [0.9e-6, 1.1e3, f64::NAN] {
        let found = Grid::axis_aligned([4; 3], DVec3::new(1.0, spacing, 1.0));
        assert!(matches!(found, Err(GridError::Spacing { .. } | GridError::NotFinite)), "{spacing}");
    }
}

fn plan(
    shown: &Shown,
    eyes: &[EyeView],
    eye_size_px: [u32; 2],
    quality: Quality,
) -> Result<StereoPlan, PlanError> {
    let grid = shown.volume.grid();
    let placed = Placed::own_axes(grid);
    let depth_grid = DepthGridSize::default();
    let request = StereoRequest { eyes, placed, eye_size_px, quality, step_mm: None, depth_grid };
    StereoPlan::new(&request, grid, shown.on_device.numbers())
}

#[test]
fn flipped_and_permuted_storage_of_one_field_gives_one_picture() {
    let dims = [14u32, 11, 17];
    let field = |p: DVec3| hills(p * DVec3::new(1.2, 1.4, 0.95), 16.0);
    let turn = DMat3::from_quat(DQuat::from_euler(Default::default(), 0.3, 0.2, -0.9));
    let axes = turn * DMat3::from_diagonal(DVec3::new(1.0, 0.7, 2.0));
    let grid = |dims, m, t| Grid::new(dims, DAffine3::from_mat3_translation(m, t)).unwrap();
    let stored = |grid: Grid, f: &dyn Fn(DVec3) -> f64| {
        let values = each(grid.dims(), f);
        Arc::new(volume_on(grid, f32s(&values)))
    };
    let plain = stored(grid(dims, axes, DVec3::ZERO), &field);
    let flipped_axes = DMat3::from_cols(-axes.x_axis, axes.y_axis, axes.z_axis);
    let flipped =
        stored(grid(dims, flipped_axes, axes.x_axis * 13.0), &|p| field(DVec3::new(13.0 - p.x, p.y, p.z)));
    let swapped_axes = DMat3::from_cols(axes.z_axis, axes.x_axis, axes.y_axis);
    let swapped =
        stored(grid([17, 14, 11], swapped_axes, DVec3::ZERO), &|p| field(DVec3::new(p.y, p.z, p.x)));
    assert!(flipped.grid().is_left_handed() && !plain.grid().is_left_handed());
    let centre = axes * DVec3::new(6.5, 5.0, 8.0);
    // In the patient's own millimetres.
    let view = eye(centre + DVec3::new(40.0, 30.0, 35.0), centre, fov(35.0, SIZE));
    let looks_of = |v: &Arc<Volume>| -> Vec<_> {
        let still = |shown: &Shown, quality| {
            let grid = shown.volume.grid();
            let placed =
                Placed { index_from_world: grid.volume_from_index().inverse(), room_mm_per_volume_mm: 1.0 };
            let depth_grid = DepthGridSize::default();
            let request = StereoRequest {
                eyes: &[view],
                placed,
                eye_size_px: SIZE,
                quality,
                step_mm: None,
                depth_grid,
            };
            let plan = StereoPlan::new(&request, grid, shown.on_device.numbers()).unwrap();
            let still = StillRenderer::new(gpu()).render(&shown.on_device, &plan).unwrap();
            crate::setting::picture_of(&still, 0)
        };
        let all = all_looks(v, 0.15, 0.85, 0.2);
        all.iter().flat_map(|s| [still(s, Quality::EXACT), still(s, steps())]).collect()
    };
    let expected = looks_of(&plain);
    assert!(expected[0].pixels().iter().any(|p| p.rgba[3] > 0.3));
    for other in [looks_of(&flipped), looks_of(&swapped)] {
        for (i, (a, b)) in expected.iter().zip(&other).enumerate() {
            let off = compare(a, b).unwrap().max_abs_error;
            // Each is within half a step of the true one; with steps they meet the same points, up to rounding.
            assert!(off < EXACT_COLOR, "{i}: {off}");
        }
    }
}

#[test]
fn full_opacity_shows_the_first_matter_and_nothing_behind_it() {
    let shown = Shown::new(
        floats([20, 3, 3], [10.0; 3], |p| p.x),
        r#"{"transfer": [[0, 1, 0, 0, 1], [9, 1, 0, 0, 1], [9, 0, 1, 0, 1]]}"#,
    );
    for quality in [Quality::EXACT, Quality::FINE] {
        let found = shown.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], quality, None);
        let left = quality.least_transmittance;
        near(found.rgba[0], 1.0, left + CLOSED_FORM);
        near(found.rgba[1], 0.0, CLOSED_FORM);
        near(found.rgba[3], 1.0, left + CLOSED_FORM);
        // Half the light is gone after 1/20 mm.
        near(found.depth_mm.unwrap(), 85.0 + 1.0 / 20.0, 0.01);
    }
    let view = eye(DVec3::new(-90.0, 60.0, 70.0), DVec3::new(95.0, 10.0, 10.0), fov(30.0, SIZE));
    true_picture("opacity 1", &shown, view, SIZE);
}

#[test]
fn an_opacity_of_a_millionth_is_seen_through_a_metre() {
    let shown = Shown::new(floats([10, 3, 3], [100.0; 3], |_| 1.0), r#"{"transfer": [[0, 1, 1, 1, 1e-6]]}"#);
    let expected = -(1000.0 * (-1e-6f64).ln_1p()).exp_m1();
    for (quality, step) in [
        (Quality::EXACT, None),
        (Quality::FINE, None),
        (Quality::BALANCED, None),
        (steps(), Some(0.1)),
        (steps(), Some(0.05)),
    ] {
        let found = shown.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], quality, step).rgba[3];
        near(found / expected, 1.0, 2e-3);
    }
    let view = eye(DVec3::new(-900.0, 200.0, 300.0), DVec3::new(450.0, 100.0, 100.0), fov(30.0, SIZE));
    true_picture("opacity 1e-6", &shown, view, SIZE);
}

#[test]
fn ten_thousand_and_a_hundred_thousand_steps_neither_drift_nor_lose_digits() {
    // A ramp of 10 mm along x.
    let ramp = |json: &str| Shown::new(floats([10, 3, 3], [1.0; 3], |p| p.x), json);
    let (from, to) = ([-1.5, 1.0, 1.0], [9.0, 1.0, 1.0]);
    for count in [1e4, 5e4, 1e5, 2e6] {
        let step = Some(10.0 / count);
        // The volume's diagonal, in steps, is what must be counted.
        let samples = 118f64.sqrt() / 10.0 * count;
        // Mesa's software driver leaves a loop after 65 535 rounds; float32 counts to 2²⁰ and a little.
        let most = if gpu().adapter().is_software { 60_000.0 } else { 1_048_576.0 };
        for quality in [steps(), to_the_end(Quality::BALANCED)] {
            let see = |json: &str| ramp(json).ray(from, to, quality, step);
            if samples > most {
                let shown = ramp("{}");
                let request = StereoRequest {
                    eyes: &[along(&shown.volume, from, DQuat::from_rotation_y(-FRAC_PI_2))],
                    placed: Placed::own_axes(shown.volume.grid()),
                    eye_size_px: [1, 1],
                    quality,
                    step_mm: step,
                    depth_grid: DepthGridSize::default(),
                };
                let refused = StereoPlan::new(&request, shown.volume.grid(), shown.on_device.numbers());
                let error = refused.unwrap_err();
                assert!(
                    matches!(error, PlanError::Step { samples: s, .. } if (s / samples - 1.0).abs() < 1e-6)
                );
                assert!(error.to_string().contains(&format!("{samples:.0}")), "{error}");
                continue;
            }
            // The surface at the far end is where it is: a sum of steps would be off by some hundred of them.
            let surface = see(r#"{"mode": "threshold", "threshold": 8.75}"#);
            near(surface.depth_mm.unwrap(), 10.25, 12.0 * DISTANCE * 4.0);
            // The mean: half a voxel of 0, the ramp, half a voxel of 9.
            near(see(r#"{"mode": "x-ray", "window": [0, 9]}"#).rgba[0], 0.5, CLOSED_FORM);
            near(see(r#"{"mode": "maximum", "window": [0, 9]}"#).rgba[3], 1.0, 2e-4);
            // n additions in float32 are off by n/2 roundings of 2⁻²⁴ at most.
            let fog = see(r#"{"transfer": [[0, 1, 1, 1, 0.1]]}"#);
            near(fog.rgba[3], 1.0 - 0.9f64.powi(10), count / 2.0 * 0.5f64.powi(24) + CLOSED_FORM);
        }
    }
}

#[test]
fn eight_bits_twelve_in_sixteen_and_hounsfield_units_show_one_body_alike() {
    let n = 24;
    let body = each([n; 3], |p| hills(p, f64::from(n - 1)));
    let grid = || straight([n; 3], [1.0; 3]);
    let scale = |by: f64, offset: f64| body.iter().map(|v| v * by + offset).collect::<Vec<_>>();
    let view = eye(DVec3::new(45.0, 40.0, 38.0), DVec3::splat(11.5), fov(30.0, SIZE));
    for (name, volume, low, high) in [
        ("8 bits", volume_on(grid(), u8s(&scale(255.0, 0.0))), 40.0, 220.0),
        ("12 bits in 16", scaled(grid(), u16s(&scale(4095.0, 0.0)), 1.0, -1024.0), -400.0, 2400.0),
        ("16 bits, all of them", scaled(grid(), u16s(&scale(65535.0, 0.0)), 0.25, 0.0), 2500.0, 14000.0),
        ("Hounsfield units", volume_on(grid(), i16s(&scale(4095.0, -1024.0))), -400.0, 2400.0),
        ("the lowest and highest of 16 bits", volume_on(grid(), i16s(&scale(65535.0, -32768.0))), -2e4, 2e4),
        ("a falling slope", scaled(grid(), u16s(&scale(-4095.0, 4095.0)), -2.0, 8190.0), 1200.0, 7000.0),
        ("float32", volume_on(grid(), f32s(&scale(1e-20, 0.0))), 1.5e-21, 8.5e-21),
        ("large float32", volume_on(grid(), f32s(&scale(1e11, 0.0))), 1.5e10, 8.5e10),
    ] {
        smooth_and_true(name, &Arc::new(volume), low, high, view);
    }
}

#[test]
fn nan_and_infinity_are_replaced_at_load_counted_and_else_refused() {
    let n = 12u32;
    let mut values: Vec<f32> = each([n; 3], |p| hills(p, 11.0)).iter().map(|&v| v as f32).collect();
    values[700] = f32::NAN;
    values[701] = f32::INFINITY;
    values[702] = f32::NEG_INFINITY;
    values[900] = f32::NAN;
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let header = format!(
        r#"{{"raw": "v.raw", "dims": [{n}, {n}, {n}], "type": "float32", "endian": "little", "spacing_mm": [1, 1, 1]}}"#
    );
    let options = volume_io::LoadOptions::default();
    let loaded = volume_io::load_parts("v.json", header.as_bytes(), &[("v.raw", &bytes)], &options).unwrap();
    let count = loaded.report.non_finite[0];
    assert_eq!((count.nan, count.positive_infinity, count.negative_infinity), (2, 1, 1));
    let view = eye(DVec3::new(25.0, 22.0, 20.0), DVec3::splat(5.5), fov(30.0, SIZE));
    any_and_true("NaN replaced", &Arc::new(loaded.volume), 0.15, 0.85, view);
    // Not replaced, they are no volume for a shader.
    let raw = volume_on(straight([n; 3], [1.0; 3]), volume::Voxels::F32(values.into()));
    let refused = VolumeOnDevice::upload(gpu(), &raw, |_| {});
    assert!(matches!(refused, Err(RenderError::NotFinite { count: 4, .. })), "{refused:?}");
}

#[test]
fn values_outside_the_window_are_black_or_white() {
    for (window, expected) in [("[6, 7]", 0.0), ("[1, 2]", 1.0), ("[4, 6]", 0.5)] {
        let v = floats([4; 3], [1.0; 3], |_| 5.0);
        let shown = Shown::new(v, &format!(r#"{{"mode": "x-ray", "window": {window}}}"#));
        for quality in [Quality::EXACT, Quality::BALANCED] {
            let found = shown.ray([-9.0, 1.0, 1.0], [9.0, 1.0, 1.0], quality, None);
            near(found.rgba[0], expected, 1e-6);
        }
    }
    // And in the maximum, whose ramp is the window.
    let v = Arc::new(floats([6; 3], [1.0; 3], |p| p.x * 10.0));
    for window in ["[-9, -5]", "[90, 95]", "[20, 30]"] {
        let json = format!(r#"{{"mode": "maximum", "window": {window}}}"#);
        let scene = SceneFile::from_json(&json).unwrap().resolve(&VolumeFacts::of(&v)).unwrap();
        let view = eye(DVec3::new(20.0, 15.0, 14.0), DVec3::splat(2.5), fov(30.0, SIZE));
        true_picture(&format!("window {window}"), &Shown::of_scene(v.clone(), scene), view, SIZE);
    }
}

#[test]
fn transfer_functions_with_vertical_edges_with_one_point_with_none_and_with_256() {
    let v = smooth(20, 1.0);
    let view = eye(DVec3::new(38.0, 33.0, 30.0), DVec3::splat(9.5), fov(30.0, SIZE));
    let saw: Vec<String> = (0..256)
        .map(|i| format!("[{}, 1, 0.{i}, 0.5, {}]", f64::from(i) / 255.0, if i % 2 == 1 { 0.4 } else { 0.0 }))
        .collect();
    for (name, transfer) in [
        ("a vertical edge", "[[0,0,0,0,0],[0.4,0,0,0,0],[0.4,1,0.5,0,0.4],[1,0,0.5,1,0.1]]".to_owned()),
        ("an edge of two colours", "[[0.3,1,0,0,0.2],[0.5,1,0,0,0.2],[0.5,0,0,1,0.9]]".into()),
        ("a falling edge", "[[0.1,1,0,0,0],[0.5,1,0,0,0.4],[0.5,0,0,1,0]]".into()),
        ("a band a thousandth wide", "[[0.5,1,1,1,0],[0.5,1,1,1,1],[0.501,1,1,1,1],[0.501,1,1,1,0]]".into()),
        ("one point", "[[0.5, 1, 0.5, 0.25, 0.1]]".into()),
        ("none", "[]".into()),
        ("256 points", format!("[{}]", saw.join(","))),
        ("all at one value", "[[0.5,1,0,0,0.1],[0.5,0,1,0,0.7],[0.5,0,0,1,0.3]]".into()),
    ] {
        for more in ["", r#", "shade": true"#, r#", "mode": "maximum""#] {
            let json = format!(r#"{{"transfer": {transfer}{more}}}"#);
            let scene = SceneFile::from_json(&json).unwrap().resolve(&VolumeFacts::of(&v)).unwrap();
            let shown = Shown::of_scene(v.clone(), scene);
            let picture = true_picture(&format!("{name}{more}"), &shown, view, SIZE);
            if name == "none" {
                assert!(picture.pixels().iter().all(|p| p.rgba == [0.0; 4]));
            }
            for quality in [Quality::DRAFT, Quality::BALANCED] {
                finite(name, &shown.drawn(view, SIZE, quality, None));
            }
        }
    }
}

#[test]
fn flat_matter_on_a_vertical_edge_belongs_to_its_upper_side() {
    // Integers, as labels are: the edge lies at the value itself.
    let v = volume_on(straight([6; 3], [1.0; 3]), u8s(&vec![7.0; 216]));
    let shown = Shown::new(v, r#"{"transfer": [[0, 1, 1, 1, 0], [7, 1, 1, 1, 0], [7, 1, 0.5, 0.2, 0.3]]}"#);
    for quality in [Quality::EXACT, Quality::FINE] {
        let found = shown.ray([-9.0, 2.0, 2.0], [9.0, 2.0, 2.0], to_the_end(quality), None);
        near(found.rgba[3], 1.0 - 0.7f64.powi(6), CLOSED_FORM);
    }
}

#[test]
fn fields_of_view_of_1_and_170_degrees_and_asymmetric_ones_see_slabs_of_the_right_length() {
    let shown = Shown::new(
        floats([101, 101, 1], [100.0, 100.0, 10.0], |_| 1.0),
        r#"{"transfer": [[0, 1, 1, 1, 0.01]]}"#,
    );
    for fov in [
        Fov::symmetric(1f64.to_radians(), 1f64.to_radians()).unwrap(),
        Fov::symmetric(170f64.to_radians(), 170f64.to_radians()).unwrap(),
        Fov::checked(-0.2, 1.3, 0.1, -1.2).unwrap(),
        Fov::checked(0.1, 0.4, -0.2, -0.3).unwrap(),
    ] {
        // 100 mm above the slab's upper face, looking down -Z.
        let position_m = DVec3::new(5000.0, 5000.0, 105.0);
        let view = EyeView { world_from_eye: Pose { position_m, orientation: DQuat::IDENTITY }, fov };
        for quality in [Quality::EXACT, Quality::FINE, Quality::BALANCED] {
            let picture = shown.drawn(view, [9, 7], to_the_end(quality), None);
            for y in 0..7 {
                for x in 0..9 {
                    let at = |i: u32, n: f64| (f64::from(i) + 0.5) / n;
                    let slant = fov.ray(at(x, 9.0), at(y, 7.0)).length();
                    near(picture.pixel(x, y).rgba[3], 1.0 - 0.99f64.powf(10.0 * slant), 1e-4);
                }
            }
        }
    }
    // And a body.
    let v = smooth(24, 1.0);
    for (degrees, away) in [(1.0, 700.0), (170.0, 3.0)] {
        let fov = Fov::symmetric(f64::to_radians(degrees), f64::to_radians(degrees)).unwrap();
        let view = eye(DVec3::new(11.5, 11.5, 23.5 + away), DVec3::new(11.5, 11.5, 0.0), fov);
        any_and_true(&format!("{degrees} degrees"), &v, 0.15, 0.85, view);
    }
    // Wider is refused with the angle.
    let shown = &all_looks(&v, 0.15, 0.85, 0.2)[0];
    let wide = Fov { left: -1.5, right: 1.5, up: 0.5, down: -0.5 };
    let view = EyeView { world_from_eye: Pose::IDENTITY, fov: wide };
    let error = plan(shown, &[view], SIZE, Quality::BALANCED).unwrap_err();
    assert!(matches!(error, PlanError::Fov { eye: 0, .. }) && error.to_string().contains("85.94"), "{error}");
}

#[test]
fn poses_that_are_none_are_refused_before_anything_is_drawn() {
    let v = smooth(8, 1.0);
    let shown = &all_looks(&v, 0.15, 0.85, 0.2)[0];
    let fov = Fov::symmetric(0.5, 0.5).unwrap();
    let good = EyeView { world_from_eye: Pose::IDENTITY, fov };
    let of = |position_m, orientation| EyeView { world_from_eye: Pose { position_m, orientation }, fov };
    for bad in [
        of(DVec3::new(0.0, f64::NAN, 0.0), DQuat::IDENTITY),
        of(DVec3::new(f64::INFINITY, 0.0, 0.0), DQuat::IDENTITY),
        of(DVec3::ZERO, DQuat::from_xyzw(0.0, f64::NAN, 0.0, 1.0)),
        of(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, f64::NEG_INFINITY, 1.0)),
        of(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0)),
        of(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0)),
    ] {
        for eyes in [vec![bad], vec![good, bad]] {
            let error = plan(shown, &eyes, SIZE, Quality::BALANCED).unwrap_err();
            assert!(matches!(error, PlanError::Pose { eye, .. } if eye == eyes.len() - 1), "{error}");
        }
        let received = Pose::checked(bad.world_from_eye.position_m, bad.world_from_eye.orientation);
        assert!(received.is_err(), "{bad:?}");
    }
    // A placement that is none, too.
    let grid = shown.volume.grid();
    for index_from_world in
        [DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), DAffine3::from_scale(DVec3::NAN)]
    {
        let request = StereoRequest {
            eyes: &[good],
            placed: Placed { index_from_world, room_mm_per_volume_mm: 1.0 },
            eye_size_px: SIZE,
            quality: Quality::BALANCED,
            step_mm: None,
            depth_grid: DepthGridSize::default(),
        };
        let found = StereoPlan::new(&request, grid, shown.on_device.numbers());
        assert!(matches!(found, Err(PlanError::Placed(_))), "{found:?}");
    }
}

#[test]
fn a_quaternion_off_by_rounding_is_drawn() {
    let v = smooth(12, 1.0);
    let shown = &all_looks(&v, 0.15, 0.85, 0.2)[0];
    let view = eye(DVec3::new(25.0, 22.0, 20.0), DVec3::splat(5.5), fov(30.0, SIZE));
    let q = view.world_from_eye.orientation;
    let orientation =
        DQuat::from_xyzw(q.x as f32 as f64, q.y as f32 as f64, q.z as f32 as f64, q.w as f32 as f64);
    let rounded = EyeView { world_from_eye: Pose { orientation, ..view.world_from_eye }, ..view };
    let [a, b] = [view, rounded].map(|view| shown.drawn(view, SIZE, Quality::EXACT, None));
    assert!(compare(&a, &b).unwrap().max_abs_error < 1e-5);
}

#[test]
fn textures_at_the_device_s_limit_are_drawn_and_one_over_it_is_refused() {
    let max = gpu().longest_volume_axis();
    let long = |n: u32| {
        let values = each([n, 1, 1], |p| if p.x as u32 % 500 < 40 { 200.0 } else { 0.0 });
        volume_on(straight([n, 1, 1], [0.01, 1.0, 1.0]), u8s(&values))
    };
    let v = Arc::new(long(max));
    let middle = DVec3::new(f64::from(max) * 0.005, 0.0, 0.0);
    let view = eye(middle + DVec3::new(3.0, 2.0, f64::from(max) * 0.02), middle, fov(40.0, SIZE));
    any_and_true("the longest axis", &v, 40.0, 180.0, view);
    let refused = VolumeOnDevice::upload(gpu(), &long(max + 1), |_| {}).unwrap_err();
    assert!(
        matches!(refused, RenderError::VolumeTooLarge { dims, max: m } if dims[0] == max + 1 && m == max)
    );
    let text = refused.to_string();
    assert!(text.contains(&max.to_string()) && text.contains(&(max + 1).to_string()), "{text}");
}

#[test]
fn pictures_at_the_longest_side_are_drawn_and_one_over_it_is_refused() {
    let v = smooth(8, 1.0);
    let shown = &all_looks(&v, 0.15, 0.85, 0.2)[3];
    let view = eye(DVec3::new(20.0, 18.0, 15.0), DVec3::splat(3.5), Fov::symmetric(0.4, 0.4).unwrap());
    let longest = 16_384;
    let picture = shown.drawn(view, [longest, 1], Quality::EXACT, None);
    finite("the longest row", &picture);
    let thin = shown.exact(view, [64, 1]);
    // Every 256th pixel of the long row lies beside one of 64, as near as half a pixel of the long one.
    for x in 0..64 {
        near(picture.pixel(x * 256 + 128, 0).rgba[3], thin.pixel(x, 0).rgba[3], 2e-3);
    }
    for size in [[longest + 1, 1], [1, longest + 1], [0, 4]] {
        let error = plan(shown, &[view], size, Quality::BALANCED).unwrap_err();
        assert!(matches!(error, PlanError::Size(_)) && error.to_string().contains("16384"), "{error}");
    }
}

#[test]
fn a_ray_that_only_touches_the_volume_sees_nothing_or_its_edge() {
    let v = noisy(straight([4; 3], [1.0; 3]), 9);
    for shown in all_looks(&v, 0.1, 0.9, 0.2) {
        // Past the edge at (3.5, 3.5), at 45°; and away from the volume.
        for (from, to) in [([9.5, -2.5, 1.0], [3.5, 3.5, 1.0]), ([9.0, 9.0, 9.0], [20.0, 9.0, 9.0])] {
            for quality in [Quality::BALANCED, Quality::FINE, Quality::EXACT, steps()] {
                let found = shown.ray(from, to, quality, None);
                assert!(found.rgba.iter().all(|x| x.is_finite()), "{found:?}");
                assert!(found.depth_mm.is_none_or(|d| (d - 72f64.sqrt()).abs() < 1e-3), "{found:?}");
            }
        }
    }
}

#[test]
fn where_there_is_no_gradient_light_is_ambient() {
    let v = Arc::new(volume_on(straight([8; 3], [1.0; 3]), i16s(&vec![-777.0; 512])));
    for (json, expected, alpha) in [
        (r#"{"transfer": [[0, 1, 1, 1, 0.2]], "shade": true}"#, 0.15, 1.0 - 0.8f64.powi(8)),
        (r#"{"mode": "threshold", "threshold": -800, "surface_color": [1, 1, 1]}"#, 0.15, 1.0),
    ] {
        let scene = SceneFile::from_json(json).unwrap().resolve(&VolumeFacts::of(&v)).unwrap();
        let shown = Shown::of_scene(v.clone(), scene);
        for quality in [Quality::EXACT, Quality::FINE] {
            // Off the axes: between voxels of one value there is no slope to the bit.
            let found = shown.ray([-9.0, 3.3, 4.1], [9.0, 4.2, 3.7], to_the_end(quality), None);
            near(found.rgba[0] / found.rgba[3], expected, 1e-6);
            assert!(found.rgba[3] >= alpha - 1e-3, "{found:?}");
        }
    }
}

#[test]
fn light_falls_and_rises_where_the_gradient_all_but_vanishes_within_matter() {
    // Sheets of bone, thin and without grain: in the middle of each the gradient turns round, within a fiftieth of a voxel
    // where the sheet's own height hardly changes along it. There light falls to ambient; a rule whose nodes lie farther
    // apart sees both sides alike, agrees with a coarser one, and is too bright by more than a step of 8 bits.
    let spacing = [1.5, 1.5, 2.0];
    let dims = [28, 26, 20];
    let sheets = |p: DVec3| {
        let mm = p * DVec3::from_array(spacing);
        let across = DVec3::new(0.8, 0.5, 0.33).normalize().dot(mm);
        let along = DVec3::new(-0.5, 0.8, 0.1).dot(mm);
        let off = across.rem_euclid(11.0) - 5.5 + 0.6 * (0.2 * along).sin();
        1000.0 * (-(off / 1.8).powi(2)).exp() * (1.0 + 0.04 * (0.31 * along).sin()) - 200.0
    };
    let v = Arc::new(volume_on(straight(dims, spacing), i16s(&each(dims, sheets))));
    let size = [96, 54];
    let view = eye(DVec3::new(90.0, 60.0, 55.0), DVec3::new(20.0, 19.0, 19.0), fov(30.0, size));
    let bone = r#""transfer": [[120, 0.8, 0.3, 0.25, 0], [220, 0.95, 0.6, 0.45, 0.06], [400, 1, 0.95, 0.85, 0.4], [1800, 1, 1, 1, 0.95]]"#;
    for light in ["", r#", "light": {"ambient": 0.1, "diffuse": 0.5, "specular": 0.8, "power": 200}"#] {
        let json = format!(r#"{{{bone}, "shade": true{light}}}"#);
        let scene = SceneFile::from_json(&json).unwrap().resolve(&VolumeFacts::of(&v)).unwrap();
        let shown = Shown::of_scene(v.clone(), scene);
        true_picture("sheets", &shown, view, size);
    }
}

#[test]
fn a_scene_of_a_channel_that_is_not_there_is_refused() {
    let v = smooth(8, 1.0);
    let uploaded = Arc::new(VolumeOnDevice::upload(gpu(), &v, |_| {}).unwrap());
    let scene = SceneFile::from_json("{}").unwrap().resolve(&VolumeFacts::of(&v)).unwrap();
    let missing = scene::Scene { channel: 3, ..scene };
    let refused = SceneOnDevice::new(gpu(), &uploaded, &missing);
    assert!(matches!(refused, Err(RenderError::NoSuchChannel { channel: 3, channels: 1 })));
}
