//! Empty space is skipped without a trace: on or off, the picture is the same to the bit.

use crate::setting::{Noise, Shown, each, eye, f32s, fov, i16s, straight, u8s, volume_on};
use render::{Quality, Sampling};
use spatial::{DVec3, EyeView};
use std::sync::Arc;
use volume::{Volume, Voxels};

const SIZE: [u32; 2] = [48, 27];

/// Draws every scene with and without skipping, from outside and from inside, at every level; `sees` says whether
/// something is to be seen.
#[track_caller]
fn check(name: &str, volume: Volume, scenes: &[(&str, bool)]) {
    let size_mm = volume.grid().size_mm();
    let eyes = [
        eye(size_mm * DVec3::new(-0.7, 1.6, 0.6), size_mm * 0.5, fov(45.0, SIZE)),
        eye(size_mm * DVec3::new(0.45, 0.4, 0.3), size_mm * DVec3::new(0.9, 0.8, 0.5), fov(80.0, SIZE)),
    ];
    check_from(&eyes, name, volume, scenes);
}

/// As [`check`], seen by these eyes.
#[track_caller]
fn check_from(eyes: &[EyeView], name: &str, volume: Volume, scenes: &[(&str, bool)]) {
    let volume = Arc::new(volume);
    let levels = [
        Quality::DRAFT,
        Quality::BALANCED,
        Quality::PLAIN,
        // Steps, refined, for surfaces too.
        Quality {
            sampling: Sampling::Float32,
            step_voxels: 0.3,
            solves_surfaces: false,
            ..Quality::BALANCED
        },
        Quality::FINE,
        Quality::EXACT,
    ];
    for (json, sees) in scenes {
        let file = scene::SceneFile::from_json(json).unwrap();
        let scene = file.resolve(&scene::VolumeFacts::of(&volume)).unwrap();
        let shown = Shown::of_scene(volume.clone(), scene);
        for quality in levels {
            let of = |skip_empty| shown.still(eyes, SIZE, Quality { skip_empty, ..quality }, None);
            let (with, without) = (of(true), of(false));
            if *sees && quality.sampling == Sampling::Cells {
                let hits = without.rgba.iter().filter(|p| p[3] > 1e-4).count();
                assert!(hits > 10, "{name}: {json}: something is seen: {hits}");
            }
            for (i, (a, b)) in with.rgba.iter().zip(&without.rgba).enumerate() {
                let (d, e) = (with.depth_mm[i], without.depth_mm[i]);
                let same = a.map(f32::to_bits) == b.map(f32::to_bits) && d.to_bits() == e.to_bits();
                assert!(
                    same,
                    "{name}: {json}: {:?}: pixel {i} is {a:?} at {d} with skipping, {b:?} at {e} without",
                    quality.sampling
                );
            }
        }
    }
}

/// Dimensions that are no multiple of a block's 8.
const DIMS: [u32; 3] = [61, 45, 51];

fn u8_volume(f: impl FnMut(DVec3) -> f64) -> Volume {
    volume_on(straight(DIMS, [1.0, 1.3, 0.8]), u8s(&each(DIMS, f)))
}

const BAND: &str =
    r#"{"transfer": [[0,0,0,0,0],[120,1,0.2,0.1,0],[121,1,0.5,0.1,0.7],[122,0.1,1,0.1,0],[255,0,0,0,0]]}"#;
const LIT_BAND: &str = r#"{"transfer": [[0,0,0,0,0],[120,1,0.2,0.1,0],[121,1,0.5,0.1,0.7],[122,0.1,1,0.1,0],[255,0,0,0,0]], "shade": true}"#;
const HIGH: &str = r#"{"mode": "threshold", "threshold": 180}"#;
const OVER: &str = r#"{"mode": "cumulated", "threshold": 250, "window": [0, 60]}"#;
const MAXIMUM: &str = r#"{"mode": "maximum", "window": [0, 255]}"#;
const X_RAY: &str = r#"{"mode": "x-ray", "window": [0, 255]}"#;

#[test]
fn neighbours_of_0_and_255_with_a_band_only_between_them() {
    let blocks = |p: DVec3| {
        let b = (p / DVec3::new(11.0, 7.0, 13.0)).floor();
        if ((b.x + b.y + b.z) as u32).is_multiple_of(5) { 255.0 } else { 0.0 }
    };
    check(
        "blocks",
        u8_volume(blocks),
        &[(BAND, true), (LIT_BAND, true), (HIGH, true), (OVER, true), (MAXIMUM, true), (X_RAY, true)],
    );
}

#[test]
fn features_of_one_voxel() {
    let mut noise = Noise(77);
    let lone = |_: DVec3| if noise.next() < 1.0 / 400.0 { 255.0 } else { 0.0 };
    check(
        "lone voxels",
        u8_volume(lone),
        &[(BAND, true), (LIT_BAND, true), (HIGH, true), (OVER, true), (MAXIMUM, true), (X_RAY, true)],
    );
}

#[test]
fn a_lone_voxel_at_every_place_in_a_block() {
    // At the ends, beside them and in the middle: whichever block knows of it, both sides of it are seen.
    for at in [0.0, 7.0, 8.0, 15.0, 16.0, 20.0] {
        let lone = |p: DVec3| f64::from(u8::from(p == DVec3::splat(at))) * 255.0;
        let v = volume_on(straight([23; 3], [1.0; 3]), u8s(&each([23; 3], lone)));
        check(&format!("a voxel at {at}"), v, &[(BAND, false), (HIGH, false), (MAXIMUM, false)]);
    }
}

/// A voxel at each corner of a cell, so that of what its neighbours see of it each cell around has another corner, edge or
/// face; from eyes on opposite sides, so that rays come into those cells through each of their faces.
#[test]
fn a_lone_voxel_at_each_corner_of_a_cell_from_both_sides() {
    let n = 18;
    let edge = r#"{"transfer": [[0,0,0,0,0],[254.5,0,0,0,0],[254.5,1,1,1,0.9],[255,1,1,1,0.9]]}"#;
    let without_width =
        r#"{"transfer": [[0,0,0,0,0],[9,0,0,0,0],[9,1,1,1,0.9],[9,0,0,0,0],[250,0,0,0,0],[250,1,1,1,0.9]]}"#;
    for corner in 0..8u32 {
        // Last and first voxels of cells of 4, every other one of 8 too.
        let at = DVec3::from_array([0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { 8.0 } else { 7.0 }));
        let lone = |p: DVec3| f64::from(u8::from(p == at)) * 255.0;
        for side in [DVec3::new(1.0, 1.3, 0.8), DVec3::new(-0.9, 1.1, -1.2)] {
            let eyes = [side, -side].map(|side| eye(at + side * 22.0, at, fov(6.0, SIZE)));
            let v = volume_on(straight([n; 3], [1.0; 3]), u8s(&each([n; 3], lone)));
            let scenes = [(BAND, true), (edge, false), (without_width, false), (HIGH, true), (MAXIMUM, true)];
            check_from(&eyes, &format!("a voxel at {at}"), v, &scenes);
        }
    }
}

#[test]
fn bands_without_width_or_narrower_than_an_entry_of_the_table() {
    let ramp = |p: DVec3| 6.0 * p.x;
    let floats = volume_on(straight(DIMS, [1.0; 3]), f32s(&each(DIMS, |p| 1000.0 * ramp(p).max(90.0))));
    check(
        "a ramp",
        floats,
        &[
            (
                r#"{"transfer": [[0,0,0,0,0],[100000,0,0,0,0],[100000,1,1,1,0.9],[100000,0,0,0,0],[200000,0,0,0,0]]}"#,
                false,
            ),
            (
                r#"{"transfer": [[0,0,0,0,0],[150000,0,0,0,0],[150000,1,1,1,1],[150001,1,1,1,1],[150001,0,0,0,0],[400000,0,0,0,0]]}"#,
                true,
            ),
            // All that is flat lies on the edge itself.
            (
                r#"{"transfer": [[0,0,0,0,0],[90000,0,0,0,0],[90000,1,0.5,0.2,0.1],[90000.5,1,1,1,0],[400000,0,0,0,0]]}"#,
                true,
            ),
        ],
    );
    let integers = volume_on(straight(DIMS, [1.0; 3]), i16s(&each(DIMS, |p| ramp(p) - 100.0)));
    check(
        "a ramp of integers",
        integers,
        &[
            (
                r#"{"transfer": [[-100,0,0,0,0],[80,0,0,0,0],[80,1,1,1,0.9],[80,0,0,0,0],[300,0,0,0,0]]}"#,
                false,
            ),
            (r#"{"mode": "threshold", "threshold": 80}"#, true),
        ],
    );
}

#[test]
fn labels() {
    let label = |p: DVec3| {
        let b = (p / 9.0).floor();
        f64::from([0u8, 0, 3, 0, 7, 0, 1, 0, 0][((b.x + 2.0 * b.y + 4.0 * b.z) as usize) % 9])
    };
    let volume = u8_volume(label);
    assert!(matches!(volume.channels()[0].voxels, Voxels::U8(_)));
    check(
        "labels",
        volume,
        &[
            (
                r#"{"transfer": [[0,0,0,0,0],[2.5,0,0,0,0],[2.5,1,0,0,0.6],[3.5,1,0,0,0.6],[3.5,0,0,0,0],[9,0,0,0,0]]}"#,
                true,
            ),
            (r#"{"transfer": [[0,0,0,0,0],[7,0,0,0,0],[7,0,1,0,0.6],[9,0,1,0,0.6]], "shade": true}"#, true),
            (r#"{"mode": "threshold", "threshold": 6.5}"#, true),
            (r#"{"mode": "maximum", "window": [0, 7]}"#, true),
        ],
    );
}
