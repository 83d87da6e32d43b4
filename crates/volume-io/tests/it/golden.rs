//! Positions and values against nibabel, SimpleITK and pynrrd; `tools/golden_geometry.py` and `tools/golden_volumes.py`
//! computed what is expected.

use crate::{fixture_path, fixtures, shared};
use serde_json::Value;
use spatial::DVec3;
use std::path::Path;
use volume::{Statistics, Volume};
use volume_io::{LoadOptions, load};

/// How far a position may lie from theirs, in millimetres.
pub(crate) const NEAR_MM: f64 = 1.0e-4;

fn golden(part: &str) -> Vec<Value> {
    golden_of("golden.json", part)
}

pub(crate) fn golden_of(file: &str, part: &str) -> Vec<Value> {
    let path = fixtures().join(file);
    let golden: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    golden[part].as_array().unwrap().clone()
}

pub(crate) fn number(text: &Value) -> f64 {
    text.as_str().unwrap().parse().unwrap()
}

pub(crate) fn three<T>(list: &Value, one: impl Fn(&Value) -> T) -> [T; 3] {
    [one(&list[0]), one(&list[1]), one(&list[2])]
}

pub(crate) fn value_at(volume: &Volume, index: [usize; 3]) -> f64 {
    let [nx, ny, _] = volume.grid().dims().map(|n| n as usize);
    volume.channels()[0].value(index[0] + nx * (index[1] + ny * index[2]))
}

#[track_caller]
fn check(path: &Path, expected: &Value) {
    let volume = load(path, &LoadOptions::default()).unwrap().volume;
    compare(&volume, path, expected);
}

/// A volume against what other programs say of it.
#[track_caller]
pub(crate) fn compare(volume: &Volume, path: &Path, expected: &Value) {
    let name = path.display();
    // Lossy JPEG and lossy JPEG 2000 alone: their standards let decoders differ, the first in rounding, the second in where
    // in a quantiser's interval a value is put back (ITU-T T.800, E.1).
    let within = expected.get("within").map_or(0.0, number);
    assert_eq!(volume.grid().dims(), three(&expected["dims"], |d| d.as_u64().unwrap() as u32), "{name}");
    let voxels = expected["voxels"].as_array().unwrap();
    assert!(voxels.len() >= 8);
    for voxel in voxels {
        let index = three(&voxel["index"], |i| i.as_u64().unwrap() as usize);
        let position_mm =
            volume.grid().volume_from_index().transform_point3(DVec3::from_array(index.map(|i| i as f64)));
        let expected_mm = DVec3::from_array(three(&voxel["lps_mm"], number));
        assert!(
            position_mm.distance(expected_mm) < NEAR_MM,
            "{name} {index:?}: {position_mm}, {expected_mm}"
        );
        let (value, wanted) = (value_at(volume, index), number(&voxel["value"]));
        if within == 0.0 {
            assert_eq!(value.to_bits(), wanted.to_bits(), "{name} {index:?}");
        }
        assert!((value - wanted).abs() <= within, "{name} {index:?}: {value} {wanted}");
    }
    let statistics = Statistics::of(&volume.channels()[0]);
    assert!((statistics.minimum - number(&expected["minimum"])).abs() <= within, "{name}");
    assert!((statistics.maximum - number(&expected["maximum"])).abs() <= within, "{name}");
    let mean = number(&expected["mean"]);
    let scale = statistics.maximum.abs().max(statistics.minimum.abs());
    assert!((statistics.mean - mean).abs() <= within + 1e-9 * scale, "{name}: {} {mean}", statistics.mean);
}

#[test]
fn small_files_of_each_kind_agree_with_nibabel() {
    let all = golden("small");
    assert_eq!(all.len(), 18);
    for expected in all {
        check(&fixture_path(expected["file"].as_str().unwrap()), &expected);
    }
}

#[test]
fn small_nrrd_and_metaimage_files_agree_with_simple_itk_and_pynrrd() {
    let all = golden_of("volumes.json", "small");
    assert_eq!(all.len(), 23);
    for expected in all {
        check(&fixtures().join(expected["file"].as_str().unwrap()), &expected);
    }
}

#[test]
fn real_nrrd_and_metaimage_files_agree_with_simple_itk_and_pynrrd() {
    for expected in golden_of("volumes.json", "shared") {
        if let Some(path) = shared(expected["file"].as_str().unwrap()) {
            check(&path, &expected);
        }
    }
}

#[test]
fn real_files_agree_with_nibabel() {
    for expected in golden("shared") {
        if let Some(path) = shared(expected["file"].as_str().unwrap()) {
            check(&path, &expected);
        }
    }
}

#[test]
fn bundled_files_agree_with_nibabel() {
    let bundled = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/volumes");
    let mut found = 0;
    for expected in golden("shared") {
        let name = Path::new(expected["file"].as_str().unwrap()).file_name().unwrap();
        if bundled.join(name).exists() {
            check(&bundled.join(name), &expected);
            found += 1;
        }
    }
    assert_eq!(found, 3);
}

#[test]
fn storage_order_does_not_change_what_lies_where() {
    let files = ["orientation_RL_nifti1.nii.gz", "orientation_LR_nifti2.nii.gz"];
    let Some([rl, lr]) = both(files) else { return };
    assert_ne!(rl.grid().orientation().0, lr.grid().orientation().0);
    let lr_from_rl = lr.grid().volume_from_index().inverse() * rl.grid().volume_from_index();
    let [nx, ny, nz] = rl.grid().dims();
    for index in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z]))) {
        let there = lr_from_rl.transform_point3(DVec3::from_array(index.map(f64::from)));
        assert!(there.distance(there.round()) < 1e-6, "the grids share their voxel centres");
        let there = there.round().to_array().map(|c| c as usize);
        assert_eq!(value_at(&rl, index.map(|i| i as usize)), value_at(&lr, there), "{index:?}");
    }
}

#[test]
fn byte_order_does_not_change_values() {
    let Some([big, little]) = both(["endian_big.nii.gz", "endian_little.nii.gz"]) else { return };
    assert_eq!(big.grid(), little.grid());
    assert_eq!(big.channels()[0].voxels, little.channels()[0].voxels);
}

fn both(names: [&str; 2]) -> Option<[Volume; 2]> {
    let load = |name| shared(&format!("nifti_variants/{name}")).map(|p| load(p, &LoadOptions::default()));
    let (a, b) = (load(names[0])?.unwrap(), load(names[1])?.unwrap());
    Some([a.volume, b.volume])
}
