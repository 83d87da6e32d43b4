//! Several volumes in one picture, each on its own grid, against the reference.

use crate::setting::{
    Noise, Shown, each, eye, f32s, finite, fov, gpu, i16s, keep_failure, labels_on, near, oblique,
    picture_of, scaled, straight, tell, true_picture, u8s, u16s, volume_on,
};
use crate::tolerances;
use reference::compare;
use render::{Quality, RenderError, Sampling, SceneOnDevice, VolumeOnDevice};
use spatial::{DAffine3, DMat3, DVec3, EyeView};
use std::sync::Arc;
use volume::{Grid, Volume};

const SIZE: [u32; 2] = [64, 36];
const GREY: &str = "[[20, 0, 0, 0.2, 0], [120, 0.5, 0.5, 0.5, 0.05], [255, 0.9, 0.8, 0.7, 0.6]]";
const HOT: &str = "[[60, 1, 0.4, 0, 0], [200, 1, 0.9, 0.2, 0.3], [255, 1, 1, 1, 0.1]]";
const EDGES: &str = "[[100, 0, 1, 0, 0], [100, 0, 1, 0.5, 0.4], [140, 0, 0.5, 1, 0.4], [140, 0, 0, 0, 0]]";

/// Where the volumes of one patient meet, millimetres.
const MIDDLE: DVec3 = DVec3::new(12.0, -15.0, 34.0);

/// A grid about the middle of the patient, shifted from it.
fn about(dims: [u32; 3], axes: DMat3, shift: DVec3) -> Grid {
    let half = (DVec3::from_array(dims.map(f64::from)) - 1.0) / 2.0;
    Grid::new(dims, DAffine3::from_mat3_translation(axes, MIDDLE + shift - axes * half)).unwrap()
}

/// A ball with ripples around the middle of the patient: what it is worth at a point, 0 to 255.
fn ripples(at_mm: DVec3) -> f64 {
    let r = (at_mm - MIDDLE).length();
    (200.0 - 12.0 * r + 40.0 * (1.1 * r).sin()).clamp(0.0, 255.0)
}

fn sampled(grid: &Grid, mut f: impl FnMut(DVec3) -> f64) -> Vec<f64> {
    let mm = grid.volume_from_index();
    each(grid.dims(), |at| f(mm.transform_point3(at)))
}

/// CT, PET, MR and labels of one patient: other spacings, other axes (the second left-handed, the third and the fourth
/// oblique), other formats.
fn patient() -> [Arc<Volume>; 4] {
    let oblique_axes = oblique([2; 3], [2.5, 1.2, 1.9]).volume_from_index().matrix3;
    let mirrored = DMat3::from_cols(DVec3::NEG_Z * 3.1, DVec3::Y * 2.7, DVec3::NEG_X * 2.2);
    let ct = about([30, 28, 22], DMat3::from_diagonal(DVec3::new(1.0, 1.1, 1.4)), DVec3::ZERO);
    let pet = about([9, 10, 12], mirrored, DVec3::new(4.0, -2.0, 3.0));
    let mr = about([11, 19, 14], oblique_axes, DVec3::new(-5.0, 1.0, 0.0));
    assert!(pet.is_left_handed() && !mr.is_left_handed());
    let mut noise = Noise(9);
    let of_ct = i16s(&sampled(&ct, |p| 10.0 * ripples(p) - 1024.0));
    let of_pet = f32s(&sampled(&pet, |p| 0.7 * ripples(p) + noise.within(0.0, 70.0)));
    let of_mr = u8s(&sampled(&mr, ripples));
    let seg = about([17, 15, 16], oblique_axes.transpose(), DVec3::new(1.0, 0.0, -2.0));
    // Shells of labels, 7 next to 2, and a wedge of air through all of them.
    let label = |p: DVec3| match ((p - MIDDLE).length(), (p - MIDDLE).x) {
        (r, x) if r > 13.0 || x > 0.6 * r => 0.0,
        (r, _) if r > 9.0 => 7.0,
        (r, _) if r > 5.0 => 2.0,
        _ => 4.0,
    };
    let of_seg = u8s(&sampled(&seg, label));
    let measured = [scaled(ct, of_ct, 0.1, 102.4), volume_on(pet, of_pet), volume_on(mr, of_mr)];
    let [ct, pet, mr] = measured.map(Arc::new);
    [ct, pet, mr, Arc::new(labels_on(seg, of_seg))]
}

/// An eye outside of all, and one among them; in the first volume's own millimetres.
fn eyes(first: &Volume) -> [EyeView; 2] {
    let size_mm = first.grid().size_mm();
    [
        eye(size_mm * DVec3::new(-0.9, 1.9, 0.8), size_mm * 0.5, fov(55.0, SIZE)),
        eye(size_mm * DVec3::new(0.4, 0.45, 0.55), size_mm * DVec3::new(0.9, 0.8, 0.5), fov(80.0, SIZE)),
    ]
}

/// Labels beside the first volume: glassy ones, one of them hidden, one dense.
fn labels(more: &str) -> String {
    let looks = r#"{"tint": {"7": [0.3, 0.6, 1], "4": [1, 0.8, 0.3]}, "opacity": {"7": 0.03, "4": 0.4}, "hide": [2]}"#;
    format!(r#"{{"volume": "3", "labels": {looks}{more}}}"#)
}

fn entry(file: &str, transfer: &str, more: &str) -> String {
    format!(r#"{{"volume": "{file}", "transfer": {transfer}{more}}}"#)
}

fn scene(first: &str, more: &str, further: &[String]) -> String {
    format!(r#"{{"transfer": {first}{more}, "further_volumes": [{}]}}"#, further.join(", "))
}

/// Two and three volumes, lit and not, with a band and with edges, and one moved.
fn scenes() -> Vec<(&'static str, String)> {
    let turned = r#", "registration": [[0.8, -0.6, 0, 0.4], [0.6, 0.8, 0, -10.2], [0, 0, 1.1, -3.4]]"#;
    vec![
        ("CT and PET", scene(GREY, "", &[entry("1", HOT, "")])),
        ("lit CT, PET", scene(GREY, r#", "shade": true"#, &[entry("1", HOT, "")])),
        ("CT, PET, lit MR", scene(GREY, "", &[entry("1", HOT, ""), entry("2", EDGES, r#", "shade": true"#)])),
        (
            "PET and MR over hidden CT",
            scene(GREY, r#", "shown": false"#, &[entry("1", HOT, ""), entry("2", GREY, "")]),
        ),
        ("PET alone beside hidden CT", scene(GREY, r#", "shown": false"#, &[entry("1", HOT, "")])),
        ("CT and turned MR", scene(HOT, "", &[entry("2", GREY, turned)])),
        ("lit CT and lit labels", scene(GREY, r#", "shade": true"#, &[labels(r#", "shade": true"#)])),
        ("labels, PET and MR", scene(GREY, "", &[labels(""), entry("1", HOT, ""), entry("2", EDGES, "")])),
        ("CT twice, CT edges", scene(GREY, "", &[format!(r#"{{"transfer": {EDGES}, "opacity": 0.3}}"#)])),
    ]
}

#[test]
fn several_volumes_are_drawn_as_the_reference_has_them() {
    let [ct, pet, mr, seg] = &patient();
    for (name, json) in scenes() {
        let shown = Shown::several(&[ct, pet, mr, seg], &json);
        for (at, eye) in eyes(ct).into_iter().enumerate() {
            let drawn = true_picture(&format!("several: {name}, eye {at}"), &shown, eye, SIZE);
            assert!(
                drawn.pixels().iter().filter(|p| p.rgba[3] > 0.05).count() > 200,
                "{name}: something is seen"
            );
        }
    }
}

#[test]
fn every_level_is_as_near_as_it_promises() {
    let [ct, pet, mr, seg] = &patient();
    for (name, json) in scenes() {
        let shown = Shown::several(&[ct, pet, mr, seg], &json);
        let eye = eyes(ct)[0];
        let exact = shown.exact(eye, SIZE);
        for (level, quality) in Quality::LEVELS {
            let drawn = shown.drawn(eye, SIZE, quality, None);
            finite(name, &drawn);
            let apart = compare(&exact, &drawn).unwrap();
            tell(&format!(
                "several: {name}, {level}: {:.1} dB, at most {:.3}/255",
                apart.psnr_db,
                apart.max_abs_error * 255.0
            ));
            let most = match level {
                "exact" => tolerances::EXACT_COLOR,
                "fine" => tolerances::FINE_COLOR,
                _ => f64::INFINITY,
            };
            let least_db = if level == "balanced" { tolerances::BALANCED_DB } else { 0.0 };
            if apart.max_abs_error > most || apart.psnr_db < least_db {
                keep_failure(&format!("several {name} {level}"), &exact, &drawn);
                panic!("{name}, {level}: {apart:?}");
            }
        }
    }
}

#[test]
fn short_steps_come_to_the_exact_picture() {
    let [ct, pet, mr, _] = &patient();
    let smooth = scene(GREY, "", &[entry("1", HOT, ""), entry("2", GREY, "")]);
    let shown = Shown::several(&[ct, pet, mr], &smooth);
    let eye = eyes(ct)[0];
    let exact = shown.exact(eye, SIZE);
    let of = |step_mm: f64| {
        let quality = Quality {
            sampling: Sampling::Float32,
            least_transmittance: 0.0,
            refined_parts: 1,
            ..Quality::BALANCED
        };
        compare(&exact, &shown.drawn(eye, SIZE, quality, Some(step_mm))).unwrap().rmse
    };
    let errors = [0.8, 0.4, 0.2].map(of);
    tell(&format!("several: steps of 0.8, 0.4, 0.2 mm: {errors:?}"));
    // Midpoints, and borders by their share of a step. Light that jumps where a gradient ends would be of the first order.
    assert!(errors[1] < errors[0] / 2.5 && errors[2] < errors[1] / 2.5, "{errors:?}");
}

#[test]
fn skipping_changes_no_bit() {
    let [ct, pet, mr, seg] = &patient();
    let float32 = Quality { sampling: Sampling::Float32, step_voxels: 0.3, ..Quality::BALANCED };
    // Besides those with wide functions, one in which nearly all cells are empty.
    let narrow = "[[176, 1, 0, 0, 0], [180, 1, 1, 0, 0.7], [184, 1, 0, 0, 0]]";
    let sparse = ("sparse", scene(narrow, "", &[entry("1", narrow, ""), entry("2", narrow, "")]));
    for (name, json) in scenes().into_iter().filter(|(name, _)| name.contains("lit ")).chain([sparse]) {
        let shown = Shown::several(&[ct, pet, mr, seg], &json);
        let stepped = if name == "sparse" { float32 } else { Quality::BALANCED };
        for quality in [stepped, Quality::FINE] {
            let of = |skip_empty| shown.still(&eyes(ct), SIZE, Quality { skip_empty, ..quality }, None);
            let (with, without) = (of(true), of(false));
            let hits = without.rgba.iter().filter(|p| p[3] > 1e-4).count();
            assert!(hits > 10, "{name}: something is seen: {hits}");
            for (i, (a, b)) in with.rgba.iter().zip(&without.rgba).enumerate() {
                let (d, e) = (with.depth_mm[i], without.depth_mm[i]);
                let same = a.map(f32::to_bits) == b.map(f32::to_bits) && d.to_bits() == e.to_bits();
                assert!(
                    same,
                    "{name}: {:?}: pixel {i} is {a:?} at {d}, without skipping {b:?} at {e}",
                    quality.sampling
                );
            }
        }
    }
}

#[test]
fn the_order_of_volumes_does_not_matter() {
    let [ct, pet, mr, _] = &patient();
    let abc = Shown::several(&[ct, pet, mr], &scene(GREY, "", &[entry("1", HOT, ""), entry("2", EDGES, "")]));
    let cab = Shown::several(&[mr, ct, pet], &scene(EDGES, "", &[entry("1", GREY, ""), entry("2", HOT, "")]));
    let eye = eyes(ct)[0];
    // The same eye in the other first volume's own millimetres.
    let own_from_own = mr.grid().own_axes_from_index()
        * mr.grid().volume_from_index().inverse()
        * ct.grid().volume_from_index()
        * ct.grid().own_axes_from_index().inverse();
    let turn = spatial::DQuat::from_mat3(&own_from_own.matrix3);
    let pose = eye.world_from_eye;
    let moved = EyeView {
        world_from_eye: spatial::Pose {
            position_m: own_from_own.transform_point3(pose.position_m),
            orientation: (turn * pose.orientation).normalize(),
        },
        ..eye
    };
    for (level, quality) in [("exact", Quality::EXACT), ("balanced", Quality::BALANCED)] {
        // The same steps: they begin where the union of all begins.
        let [a, b] =
            [(&abc, eye), (&cab, moved)].map(|(shown, eye)| shown.drawn(eye, SIZE, quality, Some(1.0)));
        let apart = compare(&a, &b).unwrap();
        tell(&format!("several: another order, {level}: at most {:.4}/255", apart.max_abs_error * 255.0));
        // Rays are float32 in either's index space.
        assert!(apart.max_abs_error < tolerances::EXACT_COLOR, "{level}: {apart:?}");
    }
}

#[test]
fn more_labels_than_a_table_has_entries_are_drawn_too() {
    let [ct, ..] = &patient();
    // Each voxel has a label of its own.
    let grid = about([18, 17, 16], DMat3::from_diagonal(DVec3::splat(1.5)), DVec3::ZERO);
    let mut number = 0.0;
    let numbers = each(grid.dims(), |_| {
        number += 1.0;
        number
    });
    let many = Arc::new(labels_on(grid, u16s(&numbers)));
    let json = scene(GREY, "", &[r#"{"volume": "1", "opacity": 0.2}"#.to_owned()]);
    let shown = Shown::several(&[ct, &many], &json);
    let eye = eyes(ct)[0];
    let exact = shown.exact(eye, SIZE);
    for (quality, least_db) in [(Quality::BALANCED, tolerances::BALANCED_DB), (Quality::EXACT, 90.0)] {
        let apart = compare(&exact, &shown.drawn(eye, SIZE, quality, None)).unwrap();
        tell(&format!("several: 4896 labels: {:.1} dB", apart.psnr_db));
        assert!(apart.psnr_db > least_db, "{apart:?}");
    }
}

#[test]
fn a_hidden_volume_changes_no_bit() {
    let [ct, pet, ..] = &patient();
    let alone = Shown::several(&[ct], &scene(GREY, "", &[]));
    let hidden = Shown::several(&[ct, pet], &scene(GREY, "", &[entry("1", HOT, r#", "shown": false"#)]));
    let clear = Shown::several(&[ct, pet], &scene(GREY, "", &[entry("1", HOT, r#", "opacity": 0"#)]));
    assert_eq!(hidden.on_device.numbers(), alone.on_device.numbers(), "it is drawn as if it were not there");
    for quality in [Quality::BALANCED, Quality::EXACT] {
        let expected = alone.still(&eyes(ct), SIZE, quality, None);
        assert_eq!(hidden.still(&eyes(ct), SIZE, quality, None), expected);
        let clear = picture_of(&clear.still(&eyes(ct), SIZE, quality, None), 0);
        let apart = compare(&picture_of(&expected, 0), &clear).unwrap();
        assert!(apart.rmse < 0.01, "{apart:?}");
    }
}

#[test]
fn a_volume_twice_has_twice_the_extinction() {
    let [ct, ..] = &patient();
    let of = |opacity: f64| format!("[[20, 1, 0, 0, {opacity}], [200, 0, 1, 0.5, {opacity}]]");
    let once = Shown::several(&[ct], &scene(&of(1.0 - 0.9 * 0.9), "", &[]));
    let twice = Shown::several(&[ct], &scene(&of(0.1), "", &[format!(r#"{{"transfer": {}}}"#, of(0.1))]));
    let [a, b] = [&once, &twice].map(|shown| shown.drawn(eyes(ct)[0], SIZE, Quality::EXACT, None));
    let apart = compare(&a, &b).unwrap();
    assert!(apart.max_abs_error < tolerances::EXACT_COLOR, "{apart:?}");
}

#[test]
fn slabs_beside_each_other_follow_the_closed_form() {
    let slab = |from_mm: f64| {
        let grid =
            Grid::new([8, 8, 10], DAffine3::from_translation(DVec3::new(0.0, 0.0, from_mm + 0.5))).unwrap();
        Arc::new(volume_on(grid, u16s(&[1000.0; 640])))
    };
    // A gap, and an overlap of two millimetres and a half.
    for (from_mm, gap) in [(25.0, true), (7.5, false)] {
        let (first, second) = (slab(0.0), slab(from_mm));
        let json = r#"{"transfer": [[0, 1, 0, 0, 0.05]],
            "further_volumes": [{"volume": "1", "transfer": [[0, 0, 1, 0, 0.2]]}]}"#;
        let shown = Shown::several(&[&first, &second], json);
        let (red, green) = (-(0.95f64.ln()), -(0.8f64.ln()));
        let through = |mm: f64, extinction: f64| (-mm * extinction).exp();
        let alpha = 1.0 - through(10.0, red) * through(10.0, green);
        let expected_red = if gap {
            1.0 - through(10.0, red)
        } else {
            let both = red + green;
            1.0 - through(7.5, red) + through(7.5, red) * (red / both) * (1.0 - through(2.5, both))
        };
        for (quality, tolerance) in [(Quality::EXACT, tolerances::CLOSED_FORM), (Quality::BALANCED, 0.01)] {
            let seen = shown.ray([3.0, 3.0, -5.5], [3.0, 3.0, 50.0], quality, None);
            near(seen.rgba[0], expected_red, tolerance);
            near(seen.rgba[3], alpha, tolerance);
            near(seen.rgba[0] + seen.rgba[1], alpha, tolerance);
        }
        // Beside the first volume there is only the second.
        let beside = shown.ray([3.0, 30.0, from_mm + 11.5], [3.0, 3.0, from_mm + 4.0], Quality::EXACT, None);
        assert!(beside.rgba[1] > 0.5, "{beside:?}");
    }
}

#[test]
fn an_edge_is_in_register_to_a_part_of_a_voxel() {
    // The same plane on three grids: where the picture of one grid has its edge, that of another has it too.
    let plane = |grid: Grid| {
        let values = sampled(&grid, |p| 1000.0 + (p - MIDDLE).dot(DVec3::new(30.0, -50.0, 20.0)));
        Arc::new(volume_on(grid, f32s(&values)))
    };
    let oblique_axes = oblique([2; 3], [2.0, 1.3, 0.6]).volume_from_index().matrix3;
    let mirrored = DMat3::from_cols(DVec3::NEG_Z * 3.0, DVec3::Y * 0.9, DVec3::NEG_X * 1.7);
    let first = plane(about([41; 3], DMat3::IDENTITY, DVec3::ZERO));
    let wall = "[[1000, 1, 0.5, 0, 0], [1000, 1, 0.5, 0, 0.9]]";
    let alone = Shown::several(&[&first], &scene(wall, "", &[]));
    let size_mm = first.grid().size_mm();
    let across = DVec3::new(30.0, -50.0, 20.0).normalize();
    let eye = eye(size_mm * 0.5 - across * 15.0, size_mm * 0.5, fov(20.0, SIZE));
    let expected = alone.drawn(eye, SIZE, Quality::EXACT, None);
    for grid in [about([41, 61, 121], oblique_axes, DVec3::ZERO), about([31, 81, 51], mirrored, DVec3::ZERO)]
    {
        let other = plane(grid);
        let hidden =
            Shown::several(&[&first, &other], &scene(wall, r#", "shown": false"#, &[entry("1", wall, "")]));
        let drawn = hidden.drawn(eye, SIZE, Quality::EXACT, None);
        let mut farthest = 0.0f64;
        for (a, b) in drawn.pixels().iter().zip(expected.pixels()) {
            farthest = farthest.max((a.depth_mm.unwrap() - b.depth_mm.unwrap()).abs());
        }
        tell(&format!("several: one plane on two grids, {farthest:.1e} mm apart at most"));
        // Float32 has the voxels to 1e-4 of 1000, at a slope of 61 a millimetre; the plane is 15 mm away.
        assert!(farthest < 1e-3, "{farthest} mm");
    }
}

#[test]
fn what_is_not_on_the_device_is_refused_with_numbers() {
    let [ct, pet, ..] = &patient();
    let shown = Shown::several(&[ct, pet], &scene(GREY, "", &[entry("1", HOT, "")]));
    let uploaded = Arc::new(VolumeOnDevice::upload(gpu(), ct, |_| {}).unwrap());
    let missing = SceneOnDevice::new(gpu(), &uploaded, &shown.scene);
    assert!(matches!(missing, Err(RenderError::NoSuchVolume { volume: 1, volumes: 1 })), "{missing:?}");
    let mut five = shown.scene.clone();
    five.further = vec![five.further[0].clone(); 4];
    five.further.iter_mut().for_each(|further| further.volume = 0);
    let found = SceneOnDevice::new(gpu(), &uploaded, &five);
    assert!(matches!(found, Err(RenderError::TooManyVolumes { found: 5, max: 4 })), "{found:?}");
    let straight = straight([2; 3], [1.0; 3]);
    assert!(shown.scene.further[0].grid(&straight).is_ok());
}
