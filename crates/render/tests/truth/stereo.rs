//! Two eyes.

use crate::scenes::{hills, looks};
use crate::setting::{
    Noise, Shown, each, floats, labels_on, oblique, picture_of, straight, true_picture, u8s, volume_on,
};
use crate::tolerances::EXACT_COLOR;
use render::{Quality, Sampling};
use spatial::{DQuat, DVec3, EyeView, Fov, HeadGeometry, Pose};
use std::sync::Arc;

/// Every way of sampling.
fn levels() -> [Quality; 5] {
    [
        Quality::BALANCED,
        Quality::PLAIN,
        Quality { sampling: Sampling::Float32, solves_surfaces: false, ..Quality::BALANCED },
        Quality::FINE,
        Quality::EXACT,
    ]
}

#[test]
fn eyes_without_distance_see_the_same_and_a_pair_is_two_single_eyes_to_the_bit() {
    let n = 24;
    let v =
        Arc::new(volume_on(oblique([n; 3], [1.0, 1.2, 0.9]), u8s(&each([n; 3], |p| 255.0 * hills(p, 23.0)))));
    let head = Pose::looking_at(DVec3::new(55.0, -30.0, 40.0), DVec3::splat(11.0), DVec3::Z).unwrap();
    let fov = Fov::checked(-0.35, 0.4, 0.35, -0.3).unwrap();
    let together = HeadGeometry::parallel(0.0, fov).view(&head).eyes;
    let apart = HeadGeometry::parallel(6.0, fov).view(&head).eyes;
    let size = [33, 25];
    for (look, json) in looks(40.0, 220.0, 0.25) {
        let file = scene::SceneFile::from_json(&json).unwrap();
        let scene = file.resolve(&scene::VolumeFacts::of(&v)).unwrap();
        let shown = Shown::of_scene(v.clone(), scene);
        for quality in levels().into_iter().chain([Quality::DRAFT]) {
            let what = format!("{look}, {quality:?}");
            let same = shown.still(&together, size, quality, None);
            assert!(same.eye(0) == same.eye(1) && same.eye_depth_mm(0) == same.eye_depth_mm(1), "{what}");
            assert!(same.rgba.iter().any(|p| p[3] > 0.1), "{what}: something is seen");
            let pair = shown.still(&apart, size, quality, None);
            assert!(pair.eye(0) != pair.eye(1), "{what}");
            for i in 0..2 {
                let single = shown.still(&apart[i..=i], size, quality, None);
                assert!(single.rgba == pair.eye(i), "{what}: eye {i}");
                assert!(single.depth_mm == pair.eye_depth_mm(i), "{what}: depths of eye {i}");
            }
        }
    }
}

/// Holds a pair of eyes of which each sees something else against the two by themselves, to the bit.
#[track_caller]
fn as_single_eyes(what: &str, shown: &Shown, head: &Pose, fov: Fov) {
    let size = [33, 25];
    let eyes = HeadGeometry::parallel(6.0, fov).view(head).eyes;
    for quality in levels().into_iter().chain([Quality::DRAFT]) {
        let what = format!("{what}, {quality:?}");
        let pair = shown.still(&eyes, size, quality, None);
        assert!(pair.eye(0) != pair.eye(1), "{what}");
        assert!(pair.rgba.iter().filter(|p| p[3] > 0.1).count() > 200, "{what}: something is seen");
        for i in 0..2 {
            let single = shown.still(&eyes[i..=i], size, quality, None);
            let bits = |rgba: &[[f32; 4]]| rgba.iter().map(|p| p.map(f32::to_bits)).collect::<Vec<_>>();
            assert!(bits(&single.rgba) == bits(pair.eye(i)), "{what}: eye {i}");
            assert!(single.depth_mm == pair.eye_depth_mm(i), "{what}: depths of eye {i}");
        }
    }
}

/// Shells of labels around the middle of 24 voxels.
fn shells() -> Vec<f64> {
    each([24; 3], |p| match (p - 11.5).length() {
        r if r > 11.0 => 0.0,
        r if r > 7.0 => 1.0,
        _ if p.x > 12.0 => 2.0,
        _ => 3.0,
    })
}

const FOV: Fov = Fov { left: -0.35, right: 0.4, up: 0.35, down: -0.3 };

#[test]
fn a_pair_of_eyes_sees_labels_as_two_single_eyes_to_the_bit() {
    let grid = oblique([24; 3], [1.0, 1.2, 0.9]);
    let head = Pose::looking_at(DVec3::new(55.0, -30.0, 40.0), DVec3::splat(11.0), DVec3::Z).unwrap();
    for shade in [false, true] {
        let json = format!(r#"{{"labels": {{"opacity": {{"1": 0.05, "2": 0.4}}}}, "shade": {shade}}}"#);
        let shown = Shown::new(labels_on(grid.clone(), u8s(&shells())), &json);
        as_single_eyes(&format!("labels, shade {shade}"), &shown, &head, FOV);
    }
}

#[test]
fn a_pair_of_eyes_sees_several_volumes_as_two_single_eyes_to_the_bit() {
    let n = 24;
    let smooth = |scale: f64| u8s(&each([n; 3], |p| scale * hills(p, 23.0)));
    let first = Arc::new(volume_on(straight([n; 3], [1.0; 3]), smooth(255.0)));
    let second = Arc::new(volume_on(straight([n; 3], [1.2, 0.8, 1.1]), smooth(200.0)));
    let labels = Arc::new(labels_on(straight([n; 3], [1.0; 3]), u8s(&shells())));
    let head = Pose::looking_at(DVec3::new(55.0, -30.0, 40.0), DVec3::splat(11.0), DVec3::Z).unwrap();
    let json = r#"{"transfer": [[40, 0.2, 0.4, 1, 0], [220, 1, 0.9, 0.7, 0.2]], "shade": true, "further_volumes": [
        {"volume": "1", "transfer": [[60, 1, 0, 0, 0], [180, 1, 0.8, 0, 0.1]]},
        {"volume": "2", "labels": {"opacity": {"1": 0.03, "2": 0.3}}, "shade": true}]}"#;
    as_single_eyes("several", &Shown::several(&[&first, &second, &labels], json), &head, FOV);
}

#[test]
fn disparity_is_focal_length_times_base_over_distance() {
    // A slice of noise, 60 mm before the eyes: with 40 pixels over 60 mm there, a base of 6 mm is 4 pixels of disparity,
    // whatever stands in the slice. The fields of view are asymmetric.
    let mut noise = Noise(8);
    let n = 64;
    let shown = Shown::new(
        floats([n, n, 1], [1.0, 1.0, 1e-3], |_| noise.next()),
        r#"{"mode": "x-ray", "window": [0, 1]}"#,
    );
    let z = 60.0;
    let size = [40, 24];
    let fov = Fov::checked(
        (-22.0f64 / z).atan(),
        (38.0f64 / z).atan(),
        (20.0f64 / z).atan(),
        (-16.0f64 / z).atan(),
    );
    let fov = fov.unwrap();
    let eyes = [-3.0, 3.0].map(|side| EyeView {
        world_from_eye: Pose { position_m: DVec3::new(24.3 + side, 30.2, z), orientation: DQuat::IDENTITY },
        fov,
    });
    let still = shown.still(&eyes, size, Quality::EXACT, None);
    let [left, right] = [0, 1].map(|eye| picture_of(&still, eye));
    let disparity = 4;
    let mut compared = 0;
    for y in 0..size[1] {
        for x in 0..size[0] - disparity {
            let (l, r) = (left.pixel(x + disparity, y), right.pixel(x, y));
            // Noise turns by up to 2 a voxel, and a float32 ray is off by some 2⁻²⁰ of 60 mm: 1.2e-4.
            assert!((l.rgba[0] - r.rgba[0]).abs() < 2.5e-4, "{x} {y}: {l:?} {r:?}");
            compared += usize::from(l.rgba[0] > 0.0);
        }
    }
    assert!(compared > 600, "{compared}");
    // And both are where the reference has them.
    for eye in eyes {
        true_picture("noise in a slice", &shown, eye, size);
    }
    // A base a pixel wider would not do.
    let off = (0..size[0] - 5).map(|x| (left.pixel(x + 5, 12).rgba[0] - right.pixel(x, 12).rgba[0]).abs());
    assert!(off.fold(0.0, f64::max) > 100.0 * EXACT_COLOR);
}

#[test]
fn a_point_s_disparity_does_not_depend_on_where_it_stands() {
    // A tent around one voxel, seen by each eye in a narrow picture that is turned to it by f·b/z.
    let grid = straight([21; 3], [4.0; 3]);
    let point = DVec3::new(12.0, 9.0, 14.0);
    let values = each([21; 3], |p| 255.0 * f64::from(u8::from(p == point)));
    let shown = Shown::new(volume_on(grid, u8s(&values)), r#"{"mode": "maximum", "window": [0, 255]}"#);
    let at = point * 4.0;
    for (base, z) in [(0.0f64, 100.0f64), (6.4, 100.0), (64.0, 300.0), (64.0, 60.0)] {
        for side in [-0.5, 0.5] {
            let turned: f64 = -side * base / z;
            let fov = Fov {
                left: (turned - 2e-3).atan(),
                right: (turned + 2e-3).atan(),
                up: 2e-3f64.atan(),
                down: -(2e-3f64.atan()),
            };
            let position_m = at + DVec3::new(side * base, 0.0, z);
            let world_from_eye = Pose { position_m, orientation: DQuat::IDENTITY };
            let picture = shown.drawn(EyeView { world_from_eye, fov }, [9, 9], Quality::EXACT, None);
            let row: Vec<f64> = (0..9).map(|x| picture.pixel(x, 4).rgba[3]).collect();
            let best = (0..9).max_by(|&a, &b| row[a].total_cmp(&row[b])).unwrap();
            assert_eq!(best, 4, "{base} {z}: {row:?}");
            assert!(row[4] > 0.999, "{base} {z}: {row:?}");
        }
    }
}
