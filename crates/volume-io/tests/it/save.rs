//! What is written is what is read again.

use crate::{assert_noted, fixtures};
use spatial::{DAffine3, DMat3, DQuat, DVec3};
use volume::{Channel, ChannelKind, Grid, Volume, Voxels};
use volume_io::{Depth, Format, LoadOptions, Loaded, SaveError, SaveOptions, Saved, load, save};

/// 4 × 3 × 5 voxels, oblique and left-handed.
fn volume(voxels: Voxels, slope: f64, intercept: f64, kind: ChannelKind) -> Volume {
    let turned = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.4));
    let matrix3 = turned * DMat3::from_diagonal(DVec3::new(0.7, 0.9, -2.5));
    let grid =
        Grid::new([4, 3, 5], DAffine3 { matrix3, translation: DVec3::new(-120.3, 44.1, 7.7) }).unwrap();
    Volume::new(grid, vec![Channel { name: "image".into(), kind, voxels, slope, intercept }]).unwrap()
}

fn numbers() -> Voxels {
    Voxels::I16((-30..30).map(|i| i * 1000).collect())
}

fn through(name: &str, volume: &Volume, options: &SaveOptions) -> (Saved, Loaded) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let saved = save(&path, volume.clone(), options).unwrap();
    assert_eq!(saved.files[0].1, std::fs::metadata(&path).unwrap().len());
    (saved, load(&path, &LoadOptions::default()).unwrap())
}

/// The same places to a tenth of a micrometre, and the same values bit for bit.
#[track_caller]
fn assert_same(a: &Volume, b: &Volume) {
    assert_eq!(a.grid().dims(), b.grid().dims());
    let last = DVec3::from_array(a.grid().dims().map(|n| f64::from(n) - 1.0));
    for corner in [DVec3::ZERO, last, last * DVec3::X, last * DVec3::Y, last * DVec3::Z] {
        let [p, q] = [a, b].map(|v| v.grid().volume_from_index().transform_point3(corner));
        assert!(p.distance(q) < 1e-4, "{p} {q}");
    }
    for at in 0..a.grid().voxel_count() {
        assert_eq!(a.channels()[0].value(at).to_bits(), b.channels()[0].value(at).to_bits(), "{at}");
    }
}

#[test]
fn each_format_keeps_geometry_and_values() {
    let plain = volume(numbers(), 1.0, -1024.0, ChannelKind::Intensity);
    let floats = Voxels::F32((0..60).map(|i| i as f32 / 7.0).collect());
    let floats = volume(floats, 1.0, 0.0, ChannelKind::Intensity);
    let doubles = Voxels::F64((0..60).map(|i| f64::from(i) / 7.0).collect());
    let doubles = volume(doubles, 3.0, 0.5, ChannelKind::Intensity);
    for (name, format) in [
        ("a.nii", Format::Nifti1),
        ("a.nii.gz", Format::Nifti1),
        ("a.nrrd", Format::Nrrd),
        ("a.png", Format::Atlas),
    ] {
        let (_, loaded) = through(name, &plain, &SaveOptions::default());
        assert_eq!(loaded.report.format, format);
        assert_same(&plain, &loaded.volume);
        if format != Format::Atlas {
            assert_same(&floats, &through(name, &floats, &SaveOptions::default()).1.volume);
            assert_same(&doubles, &through(name, &doubles, &SaveOptions::default()).1.volume);
        }
    }
}

#[test]
fn a_slope_that_float32_does_not_hold_makes_nifti_2() {
    let scaled = volume(numbers(), 0.1, 3.3, ChannelKind::Intensity);
    let (saved, loaded) = through("a.nii", &scaled, &SaveOptions::default());
    assert_eq!(loaded.report.format, Format::Nifti2);
    assert!(saved.notes[0].contains("NIfTI-2"), "{:?}", saved.notes);
    assert_same(&scaled, &loaded.volume);
    // Without a slope, values take what holds them: none is rounded.
    let (saved, loaded) = through("a.nrrd", &scaled, &SaveOptions::default());
    assert!(saved.notes[0].contains("written as float64, without loss"), "{:?}", saved.notes);
    assert_same(&scaled, &loaded.volume);
    let halves = volume(numbers(), 0.5, 3.25, ChannelKind::Intensity);
    let (saved, loaded) = through("a.nrrd", &halves, &SaveOptions::default());
    assert!(saved.notes[0].contains("written as float32, without loss"), "{:?}", saved.notes);
    assert_same(&halves, &loaded.volume);
}

#[test]
fn a_crop_stays_where_it_was() {
    let whole = volume(numbers(), 1.0, 0.0, ChannelKind::Intensity);
    let options = SaveOptions { crop: Some([1..3, 0..3, 2..5]), ..SaveOptions::default() };
    let (_, loaded) = through("a.nrrd", &whole, &options);
    assert_eq!(loaded.volume.grid().dims(), [2, 3, 3]);
    assert_eq!(loaded.volume.channels()[0].value(0), whole.channels()[0].value(1 + 2 * 12));
    let [here, there] = [(&loaded.volume, DVec3::ZERO), (&whole, DVec3::new(1.0, 0.0, 2.0))]
        .map(|(v, at)| v.grid().volume_from_index().transform_point3(at));
    assert!(here.distance(there) < 1e-9);
    for wrong in [[1..1, 0..3, 0..5], [0..5, 0..3, 0..5], [std::ops::Range { start: 3, end: 1 }, 0..3, 0..5]]
    {
        let options = SaveOptions { crop: Some(wrong), ..SaveOptions::default() };
        let error = save(&std::env::temp_dir().join("never.nii"), whole.clone(), &options).unwrap_err();
        assert!(matches!(error, SaveError::Crop { .. }), "{error}");
    }
}

#[test]
fn fewer_bits_say_what_they_lose() {
    let whole = volume(numbers(), 2.0, 0.0, ChannelKind::Intensity);
    let options =
        SaveOptions { depth: Depth::Eight, window: Some([-20_000.0, 31_000.0]), ..SaveOptions::default() };
    let (saved, loaded) = through("a.nii.gz", &whole, &options);
    let channel = &loaded.volume.channels()[0];
    assert!(matches!(channel.voxels, Voxels::U8(_)));
    assert!(
        saved.notes[0].contains("256 steps") && saved.notes[0].contains("34 outside were clipped"),
        "{:?}",
        saved.notes
    );
    // 200 a step: half of that at most.
    assert!((channel.value(30) - whole.channels()[0].value(30)).abs() <= 100.0);
    assert_eq!((channel.value(0), channel.value(59)), (-20_000.0, 31_000.0));
}

#[test]
fn labels_are_never_rounded() {
    let few = volume(Voxels::U16((0..60).collect()), 1.0, 0.0, ChannelKind::Label);
    let options = SaveOptions { depth: Depth::Eight, ..SaveOptions::default() };
    let (_, loaded) = through("a.nii", &few, &options);
    assert_eq!(loaded.volume.channels()[0].voxels, Voxels::U8((0..60).collect()));
    assert_eq!(loaded.volume.channels()[0].kind, ChannelKind::Label);
    let many = volume(Voxels::U16((0..60).map(|i| i * 100).collect()), 1.0, 0.0, ChannelKind::Label);
    let error = save(&std::env::temp_dir().join("never.nii"), many, &options).unwrap_err();
    assert!(error.to_string().contains("label 300 does not fit"), "{error}");
}

#[test]
fn a_file_that_is_there_is_not_replaced_silently() {
    let folder = tempfile::tempdir().unwrap();
    let whole = volume(numbers(), 1.0, 0.0, ChannelKind::Intensity);
    for name in ["a.nii", "a.nrrd", "a.png"] {
        let path = folder.path().join(name);
        std::fs::write(&path, "mine").unwrap();
        let error = save(&path, whole.clone(), &SaveOptions::default()).unwrap_err();
        assert!(matches!(error, SaveError::Exists(_)), "{error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        save(&path, whole.clone(), &SaveOptions { overwrite: true, ..SaveOptions::default() }).unwrap();
    }
    // Nor is the JSON beside a picture.
    std::fs::write(folder.path().join("b.json"), "mine").unwrap();
    let error = save(&folder.path().join("b.png"), whole.clone(), &SaveOptions::default()).unwrap_err();
    assert!(matches!(error, SaveError::Exists(_)), "{error}");
    let error = save(&folder.path().join("a.mha"), whole, &SaveOptions::default()).unwrap_err();
    assert!(matches!(error, SaveError::Format(_)), "{error}");
}

#[test]
fn a_series_of_slices_becomes_a_file() {
    let series = load(fixtures().join("dicom/jpeg_ls_i12"), &LoadOptions::default()).unwrap();
    let (_, loaded) = through("a.nii.gz", &series.volume, &SaveOptions::default());
    assert_same(&series.volume, &loaded.volume);
    let tilted = load(fixtures().join("dicom/tilted"), &LoadOptions::default()).unwrap();
    assert_noted(&tilted, "gantry tilt");
    assert_same(&tilted.volume, &through("a.nrrd", &tilted.volume, &SaveOptions::default()).1.volume);
}
