//! The hard cases, each on every mode: finite, and what the picture means.

use crate::common::{Noise, near, noisy, oblique, pixel, ray, scene, volume};
use reference::{Pixel, Ray, RaySetup, Reference, ReferenceError};
use scene::{Mode, Scene, SceneError, SceneFile, TransferFunction};
use spatial::{DAffine3, DMat3, DQuat, DVec3, EyeView, Fov, Pose};
use volume::{Grid, Volume};

/// A scene of each mode, emission-absorption also lit.
fn scenes(volume: &Volume) -> Vec<Scene> {
    let json = r#"{"transfer": [[0.1, 0.2, 0.4, 1, 0], [0.5, 1, 0.5, 0, 0.2], [0.9, 0.1, 0.9, 0.3, 0.7]],
        "threshold": 0.6, "window": [0, 1], "surface_opacity": 0.7}"#;
    let plain = scene(volume, json);
    let mut all: Vec<_> = Mode::ALL.map(|mode| Scene { mode, ..plain.clone() }).to_vec();
    all.push(Scene { light: Some(Default::default()), ..plain });
    all
}

#[track_caller]
fn finite(p: &Pixel) {
    assert!(p.rgba.iter().all(|x| x.is_finite() && (0.0..=1.0 + 1e-12).contains(x)), "{p:?}");
    assert!(p.depth_mm.is_none_or(|d| d.is_finite() && d >= 0.0), "{p:?}");
}

#[track_caller]
fn same(a: &Pixel, b: &Pixel, tolerance: f64) {
    for (a, b) in a.rgba.iter().zip(b.rgba) {
        near(*a, b, tolerance);
    }
    match (a.depth_mm, b.depth_mm) {
        (Some(a), Some(b)) => near(a, b, tolerance * 100.0),
        (None, None) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn rays_in_faces_edges_and_corners_see_what_their_neighbours_see() {
    let v = noisy(Grid::axis_aligned([5, 4, 6], DVec3::new(1.0, 2.0, 0.5)).unwrap(), 8);
    let far = |axis: usize| f64::from(v.grid().dims()[axis]) - 0.5;
    // Origins on the border's faces, edges and corners, on planes of centres, and outside in their prolongation; rays
    // along axes and diagonals.
    let mut places = Vec::new();
    for x in [-3.0, -0.5, 0.0, 2.0, far(0)] {
        for y in [-0.5, 1.0, far(1)] {
            for z in [-0.5, 3.0, far(2)] {
                places.push(DVec3::new(x, y, z));
            }
        }
    }
    let centre = DVec3::new(2.0, 1.5, 2.5);
    for s in scenes(&v) {
        for &from in &places {
            for along in [
                DVec3::X,
                DVec3::NEG_X,
                DVec3::Y,
                DVec3::NEG_Z,
                DVec3::new(1.0, 1.0, 0.0),
                DVec3::new(-1.0, 1.0, 1.0),
            ] {
                let found = pixel(&v, &s, &ray(&v, from, from + along));
                finite(&found);
                // A ray parallel to an axis that lies in the border is inside: moved inwards by a hair it sees the same.
                if [DVec3::X, DVec3::NEG_X].contains(&along) && from.x == -3.0 {
                    let inwards = (centre - from) * DVec3::new(0.0, 1e-10, 1e-10);
                    let moved = from + inwards;
                    same(&found, &pixel(&v, &s, &ray(&v, moved, moved + along)), 1e-7);
                }
            }
        }
    }
}

#[test]
fn the_eye_at_the_exact_centre_sees_half_of_the_way() {
    let v = volume([4, 4, 4], [1.0; 3], |_| 0.5);
    let centre = DVec3::splat(1.5);
    for s in scenes(&v) {
        finite(&pixel(&v, &s, &ray(&v, centre, centre + DVec3::new(1.0, 2.0, 3.0))));
    }
    let s = &scenes(&v)[0];
    near(pixel(&v, s, &ray(&v, centre, centre + DVec3::X)).rgba[3], 1.0 - 0.8f64.powi(2), 1e-10);
    let from_voxel = pixel(&v, s, &ray(&v, DVec3::splat(2.0), DVec3::new(2.0, 3.0, 2.0)));
    near(from_voxel.rgba[3], 1.0 - 0.8f64.powf(1.5), 1e-10);
}

#[test]
fn the_eye_in_front_of_and_inside_an_opaque_voxel() {
    let v = volume([9, 9, 9], [1.0; 3], |p| f64::from(u8::from(p == DVec3::splat(4.0))));
    let s = scene(&v, r#"{"mode": "threshold", "threshold": 0.5}"#);
    near(pixel(&v, &s, &ray(&v, [3.4, 4.0, 4.0], [4.0; 3])).depth_mm.unwrap(), 0.1, 1e-12);
    // At or above the threshold at the eye itself.
    assert_eq!(pixel(&v, &s, &ray(&v, [3.5, 4.0, 4.0], [4.0; 3])).depth_mm, Some(0.0));
    assert_eq!(pixel(&v, &s, &ray(&v, [4.0; 3], [5.0, 4.0, 4.0])).depth_mm, Some(0.0));
    assert_eq!(pixel(&v, &s, &ray(&v, [4.6, 4.0, 4.0], [9.0, 4.0, 4.0])), Pixel::NOTHING);
}

#[test]
fn one_voxel_and_one_slice_are_as_thick_as_a_voxel() {
    let one = volume([1, 1, 1], [2.0, 3.0, 4.0], |_| 0.5);
    let slice = volume([5, 1, 4], [1.0, 3.0, 1.0], |_| 0.5);
    for (v, from, towards, mm) in [
        (&one, [-5.0, 0.2, 0.1], [5.0, 0.2, 0.1], 2.0),
        (&one, [0.0, 0.0, 9.0], [0.0, 0.0, -9.0], 4.0),
        (&slice, [2.3, -4.0, 1.1], [2.3, 9.0, 1.1], 3.0),
        (&slice, [-2.0, 0.5, 1.0], [9.0, 0.5, 1.0], 5.0),
    ] {
        let all = scenes(v);
        near(pixel(v, &all[0], &ray(v, from, towards)).rgba[3], 1.0 - 0.8f64.powf(mm), 1e-10);
        for s in &all {
            finite(&pixel(v, s, &ray(v, from, towards)));
        }
    }
}

#[test]
fn spacings_from_a_nanometre_to_a_metre_give_the_same_picture_in_their_own_unit() {
    // The same numbers with millimetres replaced by the spacing: opacities a spacing are equal, so is the picture. Where
    // voxels are small, so is their opacity: a millimetre's is held below 1.
    let values = noisy(Grid::axis_aligned([5, 4, 6], DVec3::ONE).unwrap(), 3);
    for spacing in [1e-6f64, 1e-3, 0.1, 1.0, 1e3] {
        let opacity = 0.3f64.min(-(-2.0 * spacing).exp_m1());
        let grid = Grid::axis_aligned([5, 4, 6], DVec3::splat(spacing)).unwrap();
        let v = Volume::new(grid, values.channels().to_vec()).unwrap();
        for lit in [false, true] {
            let constant = |v: &Volume, o: f64| {
                let mut s = scene(v, r#"{"mode": "emission-absorption"}"#);
                let a = [0.0, 1.0, 0.0, 0.5, o].into();
                let b = [1.0, 0.0, 1.0, 0.5, o].into();
                s.transfer = TransferFunction::new(vec![a, b]).unwrap();
                s.light = lit.then(Default::default);
                s
            };
            let per_mm = -((-opacity).ln_1p() / spacing).exp_m1();
            let r = |v: &Volume| ray(v, [-3.0, 1.0, 2.2], [5.0, 2.7, 3.1]);
            let found = pixel(&v, &constant(&v, per_mm), &r(&v));
            let expected = pixel(&values, &constant(&values, opacity), &r(&values));
            for (f, e) in found.rgba.iter().zip(expected.rgba) {
                near(*f, e, 1e-9 * e);
            }
            assert_eq!(found.depth_mm.is_some(), spacing >= 0.1);
            near(found.depth_mm.unwrap_or_default() / spacing, expected.depth_mm.unwrap_or_default(), 1e-9);
        }
        for s in scenes(&v) {
            finite(&pixel(&v, &s, &ray(&v, [-3.0, 1.0, 2.2], [5.0, 2.7, 3.1])));
        }
    }
}

#[test]
fn flat_voxels_of_a_tenth_by_a_tenth_by_five_millimetres() {
    let v = noisy(oblique([12, 12, 3], [0.1, 0.1, 5.0]), 21);
    let mut noise = Noise(2);
    for s in scenes(&v) {
        for _ in 0..20 {
            finite(&pixel(&v, &s, &ray(&v, noise.point(-20.0, 20.0), noise.point(0.0, 2.0))));
        }
    }
}

#[test]
fn flipped_and_permuted_storage_of_one_field_gives_one_picture() {
    let dims = [5u32, 4, 6];
    let mut noise = Noise(33);
    let samples: Vec<f64> = (0..120).map(|_| noise.next()).collect();
    let sample = |x: f64, y: f64, z: f64| samples[(z as usize * 4 + y as usize) * 5 + x as usize];
    let turn = DMat3::from_quat(DQuat::from_euler(Default::default(), 0.3, 0.2, -0.9));
    let axes = turn * DMat3::from_diagonal(DVec3::new(1.0, 0.7, 2.0));
    let grid = |dims, m, t| Grid::new(dims, DAffine3::from_mat3_translation(m, t)).unwrap();
    let plain = crate::common::volume_on(grid(dims, axes, DVec3::ZERO), |p| sample(p.x, p.y, p.z));
    let flipped_axes = DMat3::from_cols(-axes.x_axis, axes.y_axis, axes.z_axis);
    let flipped = crate::common::volume_on(grid(dims, flipped_axes, axes.x_axis * 4.0), |p| {
        sample(4.0 - p.x, p.y, p.z)
    });
    let swapped_axes = DMat3::from_cols(axes.z_axis, axes.x_axis, axes.y_axis);
    let swapped =
        crate::common::volume_on(grid([6, 5, 4], swapped_axes, DVec3::ZERO), |p| sample(p.y, p.z, p.x));
    assert!(flipped.grid().is_left_handed() && !plain.grid().is_left_handed());
    for _ in 0..30 {
        let (from, to) = (axes * noise.point(-9.0, 12.0), axes * noise.point(0.0, 4.0));
        let seen = |v: &Volume| {
            let index = v.grid().volume_from_index().inverse();
            let r = ray(v, index.transform_point3(from), index.transform_point3(to));
            scenes(v).iter().map(|s| pixel(v, s, &r)).collect::<Vec<_>>()
        };
        let expected = seen(&plain);
        for other in [seen(&flipped), seen(&swapped)] {
            for (a, b) in expected.iter().zip(&other) {
                same(a, b, 1e-9);
            }
        }
    }
}

#[test]
fn full_opacity_shows_the_first_matter_and_nothing_behind_it() {
    let v = volume([20, 3, 3], [10.0; 3], |p| p.x);
    let s = scene(&v, r#"{"transfer": [[0, 1, 0, 0, 1], [9, 1, 0, 0, 1], [9, 0, 1, 0, 1]]}"#);
    let found = pixel(&v, &s, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0]));
    near(found.rgba[0], 1.0, 1e-13);
    near(found.rgba[1], 0.0, 1e-13);
    near(found.rgba[3], 1.0, 1e-13);
    near(found.depth_mm.unwrap(), 85.0 + 1.0 / 20.0, 1e-10);
}

#[test]
fn no_point_shows_nothing_and_one_point_a_homogeneous_block() {
    let v = noisy(Grid::axis_aligned([4, 4, 4], DVec3::ONE).unwrap(), 5);
    let r = ray(&v, [-9.0, 1.2, 1.7], [9.0, 1.2, 1.7]);
    let none = scene(&v, r#"{"transfer": []}"#);
    assert_eq!(pixel(&v, &none, &r), Pixel::NOTHING);
    let none = Scene { mode: Mode::Maximum, ..none };
    assert_eq!(pixel(&v, &none, &r).rgba, [0.0; 4]);
    let one = scene(&v, r#"{"transfer": [[0.5, 1, 0.5, 0.25, 0.1]]}"#);
    near(pixel(&v, &one, &r).rgba[1], 0.5 * (1.0 - 0.9f64.powi(4)), 1e-10);
}

#[test]
fn a_band_between_two_voxels_is_seen_though_no_sample_lies_in_it() {
    let v = volume([6, 3, 3], [1.0; 3], |p| if p.x >= 3.0 { 255.0 } else { 0.0 });
    let s = scene(
        &v,
        r#"{"transfer": [[0, 0, 0, 0, 0], [100, 0, 0, 0, 0], [100, 1, 1, 1, 0.9], [101, 1, 1, 1, 0.9], [101, 0, 0, 0, 0]]}"#,
    );
    let found = pixel(&v, &s, &ray(&v, [-9.0, 1.0, 1.0], [9.0, 1.0, 1.0]));
    near(found.rgba[3], 1.0 - 0.1f64.powf(1.0 / 255.0), 1e-10);
}

#[test]
fn a_feature_of_one_voxel_is_seen() {
    let v = volume([9, 9, 9], [1.0; 3], |p| f64::from(u8::from(p == DVec3::splat(4.0))));
    let s = scene(&v, r#"{"transfer": [[0.9, 1, 1, 1, 0], [0.9, 1, 1, 1, 0.5], [1, 1, 1, 1, 0.5]]}"#);
    near(pixel(&v, &s, &ray(&v, [-9.0, 4.0, 4.0], [9.0, 4.0, 4.0])).rgba[3], 1.0 - 0.5f64.powf(0.2), 1e-10);
}

#[test]
fn where_there_is_no_gradient_light_is_ambient() {
    let v = volume([8, 8, 8], [1.0; 3], |_| 0.5);
    let lit = scenes(&v).pop().unwrap();
    let found = pixel(&v, &lit, &ray(&v, [-9.0, 4.0, 4.0], [9.0, 4.0, 4.0]));
    near(found.rgba[0], 0.15 * (1.0 - 0.8f64.powi(8)), 1e-10);
    let surface = scene(&v, r#"{"mode": "threshold", "threshold": 0.2, "surface_color": [1, 1, 1]}"#);
    let found = pixel(&v, &surface, &ray(&v, [-9.0, 4.0, 4.0], [9.0, 4.0, 4.0]));
    assert_eq!(found.rgba, [0.15, 0.15, 0.15, 1.0]);
    assert_eq!(found.depth_mm, Some(8.5));
}

#[test]
fn fields_of_view_of_1_and_170_degrees_and_asymmetric_ones_see_slabs_of_the_right_length() {
    let v = volume([101, 101, 1], [100.0, 100.0, 10.0], |_| 1.0);
    let s = scene(&v, r#"{"transfer": [[0, 1, 1, 1, 0.01]]}"#);
    let reference = Reference::new(&v, &s).unwrap();
    let fovs = [
        Fov::symmetric(1f64.to_radians(), 1f64.to_radians()).unwrap(),
        Fov::symmetric(170f64.to_radians(), 170f64.to_radians()).unwrap(),
        Fov::checked(-0.2, 1.3, 0.1, -1.2).unwrap(),
        Fov::checked(0.1, 0.4, -0.2, -0.3).unwrap(),
    ];
    for fov in fovs {
        // 100 mm above the slab's upper face, in the volume's own millimetres, looking down -Z.
        let world_from_eye =
            Pose { position_m: DVec3::new(5000.0, 5000.0, 105.0), orientation: DQuat::IDENTITY };
        let setup = RaySetup::new(
            v.grid(),
            v.grid().own_axes_from_index().inverse(),
            EyeView { world_from_eye, fov },
        );
        let picture = reference.picture(&setup, 9, 7, &|_| ()).unwrap();
        for y in 0..7 {
            for x in 0..9 {
                let at = |i: u32, n: f64| (f64::from(i) + 0.5) / n;
                let slant = fov.ray(at(x, 9.0), at(y, 7.0)).length();
                let expected = 1.0 - 0.99f64.powf(10.0 * slant);
                near(picture.pixel(x, y).rgba[3], expected, 1e-9);
            }
        }
    }
}

#[test]
fn what_cannot_be_drawn_is_an_error_with_numbers() {
    let v = noisy(Grid::axis_aligned([4, 4, 4], DVec3::ONE).unwrap(), 5);
    let mut s = scene(&v, "{}");
    let fov = Fov::symmetric(0.5, 0.5).unwrap();
    let setup = |position_m| {
        let eye = EyeView { world_from_eye: Pose { position_m, orientation: DQuat::IDENTITY }, fov };
        RaySetup::new(v.grid(), DAffine3::IDENTITY, eye)
    };
    let reference = Reference::new(&v, &s).unwrap();
    let draw = |position_m, width| reference.picture(&setup(position_m), width, 4, &|_| ());
    assert!(matches!(draw(DVec3::ZERO, 0), Err(ReferenceError::Empty { width: 0, height: 4 })));
    assert!(matches!(draw(DVec3::NAN, 4), Err(ReferenceError::Ray { .. })));
    s.channel = 1;
    assert!(matches!(Reference::new(&v, &s), Err(ReferenceError::NoSuchChannel { wanted: 1, found: 1 })));
    s.channel = 0;
    let bad = volume([2, 2, 2], [1.0; 3], |p| if p == DVec3::ONE { f64::NAN } else { 1.0 });
    assert!(matches!(Reference::new(&bad, &s), Err(ReferenceError::NotFinite { count: 1, .. })));
}

#[test]
fn progress_counts_each_row_once() {
    let v = volume([2, 2, 2], [1.0; 3], |_| 1.0);
    let s = scene(&v, "{}");
    let json = r#"{"camera": {"eye": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0], "fov_y_deg": 30}}"#;
    let camera = SceneFile::from_json(json).unwrap().camera.unwrap();
    let setup = RaySetup::of_camera(v.grid(), &camera, 4, 11).unwrap();
    let seen = std::sync::Mutex::new(Vec::new());
    let progress = |p: reference::Progress| seen.lock().unwrap().push((p.rows_done, p.rows));
    reference::render(&v, &s, &setup, 4, 11, &progress).unwrap();
    let mut seen = seen.into_inner().unwrap();
    seen.sort_unstable();
    assert_eq!(seen, (1..=11).map(|i| (i, 11)).collect::<Vec<_>>());
}

#[test]
fn a_transfer_function_of_256_points_is_cut_at_each() -> Result<(), SceneError> {
    // A saw of opacity over a ramp: the same optical depth as its mean, tooth by tooth.
    let v = volume([11, 3, 3], [1.0; 3], |p| p.x);
    let tooth =
        |i: u32| [f64::from(i) * 10.0 / 255.0, 1.0, 1.0, 1.0, if i % 2 == 1 { 0.5 } else { 0.0 }].into();
    let mut s = scene(&v, "{}");
    s.transfer = TransferFunction::new((0..256).map(tooth).collect())?;
    let found = pixel(&v, &s, &ray(&v, [0.0, 1.0, 1.0], [9.0, 1.0, 1.0]));
    // Each of 255 flanks: ∫₀^w -ln(1 - k·t) dt with k·w = ½; then half a voxel of the last value, ½.
    let w = 10.0 / 255.0;
    let flank = w * (0.5 * 0.5f64.ln() + 0.5) / 0.5;
    let tau = 255.0 * flank + 0.5 * 2f64.ln();
    near(found.rgba[3], -(-tau).exp_m1(), 1e-10);
    Ok(())
}

#[test]
fn a_ray_of_no_length_in_the_volume_sees_nothing() {
    let v = volume([2, 2, 2], [1.0; 3], |_| 1.0);
    // Touches the corner (1.5, 1.5, ·) only.
    let touch = Ray { origin: DVec3::new(0.5, 2.5, 0.5), direction: DVec3::new(1.0, -1.0, 0.0).normalize() };
    for s in scenes(&v) {
        let found = pixel(&v, &s, &touch);
        finite(&found);
        assert!(found == Pixel::NOTHING || found.depth_mm.is_some_and(|d| (d - 2f64.sqrt()).abs() < 1e-9));
    }
}
