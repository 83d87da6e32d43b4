//! NIfTI files that are odd, and headers that lie. Small files are patched at the offsets of the standard.

use crate::{assert_field, assert_noted, fixture, load_err, load_ok};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::sync::{Arc, Mutex};
use volume::{ChannelKind, VoxelType, Voxels};
use volume_io::{Format, LoadError, LoadOptions, Sequence, load_bytes};

/// NIfTI-1, little endian, 4 × 3 × 5 of uint8, sform alone.
const PLAIN: &str = "n1_le_u8_sform.nii";
/// NIfTI-2, little endian, 4 × 3 × 5 of float32, sform alone.
const TWO: &str = "n2_le_f32_sheared.nii";

/// The file with some bytes written over it.
fn patched(name: &str, patches: &[(usize, &[u8])]) -> Vec<u8> {
    let mut bytes = fixture(name);
    for (at, patch) in patches {
        bytes[*at..at + patch.len()].copy_from_slice(patch);
    }
    bytes
}

fn i16s(values: &[i16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn f32s(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn i64s(values: &[i64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn types_that_a_volume_holds_are_kept() {
    let held = |name: &str| load_ok(&fixture(name)).volume.channels()[0].voxels.voxel_type();
    assert_eq!(held(PLAIN), VoxelType::U8);
    assert_eq!(held("n1_be_i16_sform_scaled.nii"), VoxelType::I16);
    assert_eq!(held("n1_le_u16_qform_flipped.nii"), VoxelType::U16);
    assert_eq!(held("n1_be_f32_qform_oblique.nii.gz"), VoxelType::F32);
}

#[test]
fn other_types_are_converted_and_that_is_noted() {
    let check = |name: &str, held: VoxelType, note: &str| {
        let loaded = load_ok(&fixture(name));
        assert_eq!(loaded.volume.channels()[0].voxels.voxel_type(), held, "{name}");
        assert_noted(&loaded, note);
    };
    check("n1_le_i32_sagittal.nii", VoxelType::I16, "int32 in the file, held as int16 without loss");
    check("n1_le_i8_series.nii", VoxelType::I16, "int8 in the file, held as int16 without loss");
    check("n1_be_u32_coronal.nii.gz", VoxelType::I16, "uint32 in the file, held as int16 without loss");
    check("n2_be_i64_flipped.nii", VoxelType::I16, "int64 in the file, held as int16 without loss");
    check("n2_le_u64_sform.nii", VoxelType::I16, "uint64 in the file, held as int16 without loss");
    check("n1_le_f64_sheared.nii", VoxelType::F32, "float64 in the file, held as float32 without loss");
}

#[test]
fn what_float32_would_lose_is_held_and_what_a_device_loses_is_noted_in_values() {
    // 2^24 + 1 as int32 with a slope of 3: in float32 off by 1 stored, 3 in values.
    let bytes = patched(
        "n1_le_i32_sagittal.nii",
        &[(352, &((1i32 << 24) + 1).to_le_bytes()), (112, &f32s(&[3.0, 0.0]))],
    );
    let loaded = load_ok(&bytes);
    assert_noted(&loaded, "int32 in the file, held as float64 without loss");
    assert_noted(&loaded, "draws from float32 of them, off by at most 3.000e0");
    assert_eq!(loaded.volume.channels()[0].value(0), 3.0 * 16_777_217.0);
    // 2^53 + 1 as int64: no float64.
    let bytes = patched("n2_be_i64_flipped.nii", &[(544, &((1i64 << 53) + 1).to_be_bytes())]);
    assert_noted(&load_ok(&bytes), "int64 in the file, held as float64: values are rounded by at most");
}

#[test]
fn format_and_version_are_reported() {
    assert_eq!(load_ok(&fixture(PLAIN)).report.format, Format::Nifti1);
    assert_eq!(load_ok(&fixture(TWO)).report.format, Format::Nifti2);
}

#[test]
fn of_a_series_the_volume_that_was_asked_for_is_loaded() {
    let loaded = load_ok(&fixture("n1_le_i8_series.nii"));
    assert_eq!(loaded.volume.grid().dims(), [4, 3, 5]);
    assert_noted(&loaded, "a series of 3 volumes in time");

    // 2.5 in pixdim[4], in milliseconds.
    let mut file = patched("n1_le_i8_series.nii", &[(92, &2.5f32.to_le_bytes()), (123, &[2 | 16])]);
    let voxels = file.len() - 3 * 60;
    for (i, sample) in file[voxels..].iter_mut().enumerate() {
        *sample = (i % 125) as u8;
    }
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(&file).unwrap();
    for bytes in [file, packed.finish().unwrap()] {
        for time in 0..3 {
            let loaded = load_bytes("test", &bytes, &LoadOptions { time, ..LoadOptions::default() }).unwrap();
            let expected: Vec<i16> = (0..60).map(|i| (i + 60 * time as i16) % 125).collect();
            assert_eq!(loaded.volume.channels()[0].voxels, Voxels::I16(expected.into()), "step {time}");
            let sequence = Sequence { steps: 3, loaded: time, step_secs: Some(0.0025) };
            assert_eq!(loaded.report.sequence, Some(sequence));
        }
        let error = load_bytes("test", &bytes, &LoadOptions { time: 3, ..LoadOptions::default() });
        assert_field(&error.unwrap_err(), "time", &["0 to 2", "found 3"]);
        let short = load_bytes(
            "test",
            &bytes[..bytes.len() - 30],
            &LoadOptions { time: 2, ..LoadOptions::default() },
        );
        assert!(matches!(short, Err(LoadError::Truncated { .. } | LoadError::Damaged { .. })), "{short:?}");
    }
}

#[test]
fn a_volume_that_is_no_series_has_no_other_step() {
    let error = load_bytes("test", &fixture(PLAIN), &LoadOptions { time: 1, ..LoadOptions::default() });
    assert_field(&error.unwrap_err(), "time", &["the only volume there is"]);
}

#[test]
fn a_picture_is_a_volume_of_one_slice() {
    let bytes = patched(PLAIN, &[(40, &i16s(&[2, 4, 3, 99, -7]))]);
    assert_eq!(load_ok(&bytes).volume.grid().dims(), [4, 3, 1]);
}

#[test]
fn vectors_and_colours_are_refused_by_name() {
    let vectors = patched(PLAIN, &[(40, &i16s(&[5, 4, 1, 1, 1, 15]))]);
    assert_field(&load_err(&vectors), "dim[5]", &["15 numbers a voxel"]);
    for (code, what) in [(128i16, "RGB"), (32, "complex"), (1, "bits"), (0, "no type"), (-4, "no type")] {
        let error = load_err(&patched(PLAIN, &[(70, &code.to_le_bytes())]));
        assert_field(&error, "datatype", &[what, &code.to_string()]);
    }
}

#[test]
fn dimensions_that_cannot_be_are_refused_before_anything_is_allocated() {
    for dim in [[0i16, 1, 1, 1], [9, 1, 1, 1], [-1, 1, 1, 1]] {
        assert_field(&load_err(&patched(PLAIN, &[(40, &i16s(&dim))])), "dim[0]", &["1 to 7"]);
    }
    for (axis, dim) in [(1, [3i16, 0, 3, 5]), (2, [3, 4, -3, 5]), (3, [3, 4, 3, i16::MIN])] {
        let error = load_err(&patched(PLAIN, &[(40, &i16s(&dim))]));
        assert_field(&error, &format!("dim[{axis}]"), &["1 to 32767", &dim[axis].to_string()]);
    }
    for found in [1i64 << 31, 1 << 62, i64::MIN, -1, 32_768] {
        let error = load_err(&patched(TWO, &[(24, &i64s(&[found]))]));
        assert_field(&error, "dim[1]", &["1 to 32767", &found.to_string()]);
    }
    let largest = patched(PLAIN, &[(42, &i16s(&[32_767, 32_767, 32_767]))]);
    let LoadError::TooLarge { found, allowed, .. } = load_err(&largest) else { panic!() };
    assert_eq!((found, allowed), (32_767u128.pow(3), 16 << 30));
}

#[test]
fn the_caller_sets_how_large_a_volume_may_be() {
    let options = |max_bytes| LoadOptions { max_bytes, ..LoadOptions::default() };
    load_bytes("test", &fixture(PLAIN), &options(60)).unwrap();
    let error = load_bytes("test", &fixture(PLAIN), &options(59)).unwrap_err();
    assert!(matches!(error, LoadError::TooLarge { found: 60, allowed: 59, .. }), "{error}");
}

#[test]
fn a_header_that_promises_more_than_the_file_holds_names_both_sizes() {
    // 2 GiB promised, 60 bytes there.
    let lying = patched(PLAIN, &[(42, &i16s(&[2048, 1024, 1024]))]);
    let LoadError::Truncated { expected, found, .. } = load_err(&lying) else { panic!() };
    assert_eq!((expected, found), ((2 << 30) + 352, 412));
    let LoadError::Truncated { expected, found, .. } = load_err(&gzip(&lying)) else { panic!() };
    assert_eq!((expected, found), (2 << 30, 60));
}

#[test]
fn a_file_that_ends_anywhere_is_an_error_that_says_so() {
    for name in [PLAIN, TWO] {
        let whole = fixture(name);
        for length in 4..whole.len() {
            let error = load_err(&whole[..length]);
            assert!(matches!(error, LoadError::Truncated { .. }), "{length}: {error}");
        }
        for length in 0..4 {
            assert!(matches!(load_err(&whole[..length]), LoadError::UnknownFormat { .. }));
        }
        let packed = gzip(&whole);
        for length in 2..packed.len() {
            let error = load_err(&packed[..length]);
            let known = matches!(
                error,
                LoadError::Truncated { .. } | LoadError::Damaged { .. } | LoadError::UnknownFormat { .. }
            );
            assert!(known, "{length}: {error}");
        }
    }
}

#[test]
fn damaged_gzip_is_an_error() {
    let mut packed = gzip(&fixture(PLAIN));
    let checksum = packed.len() - 8;
    packed[checksum] ^= 1;
    assert!(matches!(load_err(&packed), LoadError::Damaged { what: "gzip data", .. }));
}

#[test]
fn several_gzip_members_are_one_file() {
    let whole = fixture(PLAIN);
    let two = [gzip(&whole[..377]), gzip(&whole[377..])].concat();
    assert_eq!(load_ok(&two).volume.channels()[0].voxels, load_ok(&whole).volume.channels()[0].voxels);
}

#[test]
fn a_gzip_bomb_is_not_unpacked() {
    let mut bomb = fixture(PLAIN);
    bomb.resize(bomb.len() + (64 << 20), 0);
    let loaded = load_ok(&gzip(&bomb));
    assert_eq!(loaded.volume.sample_bytes(), 60);
    assert_noted(&loaded, "65536 bytes or more after the voxels were not read");
}

#[test]
fn samples_that_are_no_numbers_are_replaced_and_counted() {
    let name = "n1_le_f32_three_negative_axes.nii";
    let some = patched(name, &[(352, &f32s(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY]))]);
    let loaded = load_ok(&some);
    let count = loaded.report.non_finite[0];
    assert_eq!((count.nan, count.positive_infinity, count.negative_infinity), (1, 1, 1));
    assert_noted(&loaded, "1 NaN and 1 -Inf replaced by the lowest, 1 +Inf by the highest");
    let Voxels::F32(samples) = &loaded.volume.channels()[0].voxels else { panic!() };
    assert!(samples.iter().all(|s| s.is_finite()));

    let all = load_ok(&patched(name, &[(352, &f32s(&[f32::NAN; 60]))]));
    assert_eq!(all.report.non_finite[0].nan, 60);
    assert_eq!(all.volume.channels()[0].voxels, Voxels::F32(vec![0.0; 60].into()));
}

#[test]
fn float64_is_held_to_the_bit_unless_it_is_beyond_all_measure() {
    let third = load_ok(&patched("n1_le_f64_sheared.nii", &[(352, &(1.0f64 / 3.0).to_le_bytes())]));
    let channel = &third.volume.channels()[0];
    let expected = channel.slope * (1.0 / 3.0) + channel.intercept;
    assert_eq!(channel.value(0).to_bits(), expected.to_bits());
    let loaded = load_ok(&patched("n1_le_f64_sheared.nii", &[(352, &(-1e300f64).to_le_bytes())]));
    assert_noted(&loaded, "1 values are beyond 1e150");
    assert_eq!(loaded.report.non_finite[0].negative_infinity, 1);
}

#[test]
fn a_slope_of_zero_or_nan_is_none() {
    let scaling = |slope: f32, inter: f32| {
        let loaded = load_ok(&patched(PLAIN, &[(112, &f32s(&[slope, inter]))]));
        let channel = &loaded.volume.channels()[0];
        (channel.slope, channel.intercept)
    };
    assert_eq!(scaling(0.0, 5.0), (1.0, 0.0));
    assert_eq!(scaling(f32::NAN, f32::NAN), (1.0, 0.0));
    assert_eq!(scaling(f32::INFINITY, 5.0), (1.0, 0.0));
    assert_eq!(scaling(-2.0, 5.0), (-2.0, 5.0));
    let error = load_err(&patched(PLAIN, &[(112, &f32s(&[1.0, f32::NAN]))]));
    assert_field(&error, "scl_inter", &["NaN"]);
    let error = load_err(&patched(TWO, &[(176, &1e300f64.to_le_bytes())]));
    assert_field(&error, "scl_slope", &[]);
}

#[test]
fn without_a_transform_the_spacing_is_used_and_that_is_noted() {
    let loaded = load_ok(&fixture("n1_le_u8_neither.nii"));
    assert_noted(&loaded, "orientation is not in the file");
    assert_eq!(loaded.volume.grid().orientation().0, "RAS");
}

#[test]
fn the_sform_goes_before_the_qform() {
    let both = load_ok(&fixture("n1_le_u8_qform_and_other_sform.nii"));
    assert_eq!(both.volume.grid().spacing_mm().to_array(), [9.0, 8.0, 7.0]);
    let no_sform = patched("n1_le_u8_qform_and_other_sform.nii", &[(254, &0i16.to_le_bytes())]);
    let spacing_mm = load_ok(&no_sform).volume.grid().spacing_mm();
    assert!((spacing_mm.x - 0.7).abs() < 1e-6, "{spacing_mm}");
}

#[test]
fn a_sheared_transform_is_kept() {
    let grid = load_ok(&fixture(TWO)).volume.grid().clone();
    let d = grid.directions();
    assert!((d.col(1).dot(d.col(2)).abs() - 1.2 / 7.2f64.sqrt()).abs() < 1e-6);
}

#[test]
fn lengths_in_other_units_become_millimetres() {
    let micrometres = load_ok(&patched(PLAIN, &[(123, &[3])]));
    assert_noted(&micrometres, "lengths are in micrometres");
    assert!((micrometres.volume.grid().spacing_mm().x - 0.7e-3).abs() < 1e-9);
    let rows = [0.001, 0.0, 0.0, 0.1, 0.0, 0.002, 0.0, 0.2, 0.0, 0.0, 0.003, 0.3];
    let metres = load_ok(&patched(PLAIN, &[(123, &[1]), (280, &f32s(&rows))]));
    let grid = metres.volume.grid();
    assert!((grid.spacing_mm() - spatial::DVec3::new(1.0, 2.0, 3.0)).length() < 1e-6);
    assert!((grid.volume_from_index().translation.z - 300.0).abs() < 1e-4);
}

#[test]
fn transforms_that_are_none_are_refused() {
    let zero = load_err(&patched(PLAIN, &[(280, &[0; 48])]));
    assert!(matches!(zero, LoadError::Grid { field: "sform", .. }), "{zero}");
    let nan = load_err(&patched("n1_le_u16_qform_flipped.nii", &[(256, &f32s(&[f32::NAN]))]));
    assert!(matches!(nan, LoadError::Grid { field: "qform", .. }), "{nan}");
    let far = load_err(&patched("n1_le_u8_neither.nii", &[(80, &f32s(&[1e9]))]));
    assert!(matches!(far, LoadError::Grid { field: "pixdim", .. }), "{far}");
}

#[test]
fn a_quaternion_that_is_too_long_is_noted() {
    let loaded = load_ok(&patched("n1_le_u16_qform_flipped.nii", &[(256, &f32s(&[0.0, 2.0, 0.0]))]));
    assert_noted(&loaded, "have length 2");
}

#[test]
fn spacing_that_is_not_positive_is_mended_and_noted() {
    let loaded = load_ok(&patched("n1_le_u8_neither.nii", &[(80, &f32s(&[-2.0, 0.0]))]));
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [2.0, 1.0, 2.5]);
    assert_noted(&loaded, "pixdim[1] is -2");
}

#[test]
fn voxels_begin_where_the_header_says() {
    let mut later = patched(PLAIN, &[(108, &f32s(&[384.0]))]);
    later.splice(352..352, [7; 32]);
    assert_eq!(
        load_ok(&later).volume.channels()[0].voxels,
        load_ok(&fixture(PLAIN)).volume.channels()[0].voxels
    );
    assert_noted(&load_ok(&patched(PLAIN, &[(108, &f32s(&[0.0]))])), "vox_offset is 0");
    for bad in [-352.0, 348.0, 352.5, f32::NAN, f32::INFINITY, 1e30] {
        assert_field(&load_err(&patched(PLAIN, &[(108, &f32s(&[bad]))])), "vox_offset", &["352"]);
    }
    let far = load_err(&gzip(&patched(PLAIN, &[(108, &f32s(&[1e15]))])));
    assert!(matches!(far, LoadError::Truncated { what: "header extensions", .. }), "{far}");
}

#[test]
fn label_maps_are_known_by_intent_by_their_table_or_by_the_caller() {
    let kind = |bytes: &[u8]| load_ok(bytes).volume.channels()[0].kind;
    assert_eq!(kind(&fixture(PLAIN)), ChannelKind::Intensity);
    assert_eq!(kind(&patched(PLAIN, &[(68, &1002i16.to_le_bytes())])), ChannelKind::Label);
    let mut table = patched(PLAIN, &[(108, &f32s(&[384.0]))]);
    table.splice(352..352, *b"<LabelTable>                    ");
    assert_eq!(kind(&table), ChannelKind::Label);
    let text = b"<LabelTable><Label Key=\"5\" Red=\"1\" Green=\"0\" Blue=\"0\">liver</Label></LabelTable>";
    let mut named = patched(PLAIN, &[(108, &f32s(&[352.0 + 80.0]))]);
    assert_eq!(text.len(), 80);
    named.splice(352..352, *text);
    assert_eq!(load_ok(&named).report.labels.get(5).unwrap().name, "liver");
    let options = LoadOptions { kind: Some(ChannelKind::Label), ..LoadOptions::default() };
    let told = load_bytes("test", &fixture(PLAIN), &options).unwrap();
    assert_eq!(told.volume.channels()[0].kind, ChannelKind::Label);
}

#[test]
fn wrong_magic_is_refused() {
    assert_field(&load_err(&patched(PLAIN, &[(344, b"nix\0")])), "magic", &["n+1", "nix"]);
    assert_field(&load_err(&patched(PLAIN, &[(344, b"ni1\0")])), "magic", &["another file"]);
    assert_field(&load_err(&patched(TWO, &[(8, b"\n\n\n\n")])), "magic", &["n+2"]);
}

#[test]
fn progress_rises_to_one() {
    let seen = Arc::new(Mutex::new(Vec::new()));
    let sink = Arc::clone(&seen);
    let options = LoadOptions {
        progress: Some(Arc::new(move |fraction| sink.lock().unwrap().push(fraction))),
        ..LoadOptions::default()
    };
    let mut large = patched(PLAIN, &[(42, &i16s(&[512, 512, 256]))]);
    large.resize(352 + (64 << 20), 0);
    load_bytes("test", &large, &options).unwrap();
    let seen = seen.lock().unwrap();
    assert_eq!(*seen, [0.25, 0.5, 0.75, 1.0]);
}
