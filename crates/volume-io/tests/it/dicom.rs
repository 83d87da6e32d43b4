//! DICOM: series of folders and frames of files, against pydicom and by hand.

use crate::golden::{NEAR_MM, compare, golden_of, number, three, value_at};
use crate::{assert_field, assert_noted, fixtures, shared};
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use serde_json::Value;
use spatial::DVec3;
use std::io::{Read as _, Write as _};
use std::path::Path;
use tempfile::TempDir;
use volume::{Volume, Voxels};
use volume_io::{Format, LoadError, LoadOptions, Loaded, load, load_parts};

#[test]
fn small_series_of_each_syntax_and_geometry_agree_with_pydicom() {
    let all = golden_of("volumes.json", "dicom");
    assert_eq!(all.len(), 24);
    for expected in all {
        let path = fixtures().join(expected["file"].as_str().unwrap());
        let loaded = load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.report.format, Format::Dicom);
        if expected.get("factor").is_some() {
            uptake_agrees(&loaded, &expected);
        } else {
            compare(&loaded.volume, &path, &expected);
        }
    }
}

/// The golden values are Bq/ml.
fn uptake_agrees(loaded: &Loaded, expected: &Value) {
    let factor = number(&expected["factor"]);
    assert_eq!(loaded.volume.channels()[0].name, "suv");
    assert_noted(loaded, "standardised uptake");
    for voxel in expected["voxels"].as_array().unwrap() {
        let index = three(&voxel["index"], |i| i.as_u64().unwrap() as usize);
        let wanted = number(&voxel["value"]) * factor;
        assert!((value_at(&loaded.volume, index) - wanted).abs() <= 1e-12 * wanted.abs());
    }
}

#[test]
fn real_series_agree_with_pydicom() {
    let mut syntaxes = 0;
    for expected in golden_of("volumes.json", "archives") {
        let name = expected["file"].as_str().unwrap();
        let (archive, entry) = match name.split_once(".zip/") {
            Some((archive, entry)) => (format!("{archive}.zip"), Some(entry)),
            None => (name.to_owned(), None),
        };
        let Some(archive) = shared(&archive) else { continue };
        let folder = unzipped(&archive);
        let path = entry.map_or(folder.path().to_path_buf(), |entry| folder.path().join(entry));
        let loaded = match load(&path, &LoadOptions::default()) {
            Ok(loaded) => loaded,
            Err(error) => {
                // 12 bits in lossy JPEG are the one thing that no library in Rust reads.
                assert!(error.to_string().contains("lossy JPEG of 12 bits"), "{name}: {error}");
                continue;
            }
        };
        println!("{name}: {:?}", loaded.report.notes);
        if expected.get("anywhere").is_some() {
            lies_where_it_should(&loaded.volume, &expected);
        } else {
            compare(&loaded.volume, &path, &expected);
            syntaxes += usize::from(entry.is_some());
        }
    }
    if shared("dicom").is_some() {
        assert!(syntaxes >= 10, "{syntaxes}");
    }
}

/// Of a stack that was resampled: slices that were kept have their values, at their places.
fn lies_where_it_should(volume: &Volume, expected: &Value) {
    let index_from_volume = volume.grid().volume_from_index().inverse();
    let mut kept = 0;
    for voxel in expected["voxels"].as_array().unwrap() {
        let at = DVec3::from_array(three(&voxel["lps_mm"], number));
        let index = index_from_volume.transform_point3(at);
        assert!(
            (index.x - index.x.round()).abs() < 1e-3 && (index.y - index.y.round()).abs() < 1e-3,
            "{index}"
        );
        let nearest = index.round();
        let nearest_mm = volume.grid().volume_from_index().transform_point3(nearest);
        if nearest_mm.distance(at) < NEAR_MM {
            let value = value_at(volume, nearest.to_array().map(|c| c as usize));
            assert_eq!(value.to_bits(), number(&voxel["value"]).to_bits());
            kept += 1;
        }
    }
    // The first and the last slice are always kept.
    assert!(kept >= 8, "{kept}");
}

/// The files of a ZIP archive, in a folder of their own.
fn unzipped(archive: &Path) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let bytes = std::fs::read(archive).unwrap();
    let word = |at: usize| u16::from_le_bytes(bytes[at..at + 2].try_into().unwrap()) as usize;
    let long = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let end = bytes.windows(4).rposition(|w| w == b"PK\x05\x06").unwrap();
    let mut at = long(end + 16);
    for _ in 0..word(end + 10) {
        assert_eq!(&bytes[at..at + 4], b"PK\x01\x02");
        let (method, packed, name_length) = (word(at + 10), long(at + 20), word(at + 28));
        let name = std::str::from_utf8(&bytes[at + 46..at + 46 + name_length]).unwrap();
        let local = long(at + 42);
        let start = local + 30 + word(local + 26) + word(local + 28);
        let data = &bytes[start..start + packed];
        if !name.ends_with('/') {
            let mut content = Vec::new();
            match method {
                0 => content.extend_from_slice(data),
                _ => drop(DeflateDecoder::new(data).read_to_end(&mut content).unwrap()),
            }
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, content).unwrap();
        }
        at += 46 + name_length + word(at + 30) + word(at + 32);
    }
    folder
}

/// A file of 2 × 2 pixels of 16 bits, explicit and little-endian, that tests change.
#[derive(Clone)]
struct Slice {
    elements: Vec<(u16, u16, &'static str, Vec<u8>)>,
    syntax: &'static str,
}

impl Slice {
    /// A slice at `z_mm` whose four pixels are `value`.
    fn at(z_mm: f64, value: u16) -> Self {
        let position = format!("0\\0\\{z_mm}");
        Self { elements: Vec::new(), syntax: "1.2.840.10008.1.2.1" }
            .with(0x0008, 0x0060, "CS", "CT")
            .with(0x0010, 0x0010, "PN", "Secret^Person")
            .with(0x0010, 0x0020, "LO", "SECRET-ID")
            .with(0x0020, 0x000d, "UI", "1.2.3")
            .with(0x0020, 0x000e, "UI", "1.2.3.4")
            .with(0x0020, 0x0011, "IS", "5")
            .with(0x0020, 0x0013, "IS", "1")
            .with(0x0020, 0x0032, "DS", &position)
            .with(0x0020, 0x0037, "DS", "1\\0\\0\\0\\1\\0")
            .short(0x0028, 0x0002, 1)
            .with(0x0028, 0x0004, "CS", "MONOCHROME2")
            .short(0x0028, 0x0010, 2)
            .short(0x0028, 0x0011, 2)
            .with(0x0028, 0x0030, "DS", "1\\1")
            .short(0x0028, 0x0100, 16)
            .short(0x0028, 0x0101, 16)
            .short(0x0028, 0x0102, 15)
            .short(0x0028, 0x0103, 0)
            .raw(0x7fe0, 0x0010, "OW", &[value; 4].map(u16::to_le_bytes).concat())
    }

    fn with(self, group: u16, element: u16, vr: &'static str, text: &str) -> Self {
        let pad = if vr == "UI" { "\0" } else { " " };
        let text = if text.len() % 2 == 1 { format!("{text}{pad}") } else { text.to_owned() };
        self.raw(group, element, vr, text.as_bytes())
    }

    fn short(self, group: u16, element: u16, number: u16) -> Self {
        self.raw(group, element, "US", &number.to_le_bytes())
    }

    fn raw(mut self, group: u16, element: u16, vr: &'static str, value: &[u8]) -> Self {
        self.elements.retain(|e| (e.0, e.1) != (group, element));
        self.elements.push((group, element, vr, value.to_vec()));
        self.elements.sort_by_key(|e| (e.0, e.1));
        self
    }

    fn without(mut self, group: u16, element: u16) -> Self {
        self.elements.retain(|e| (e.0, e.1) != (group, element));
        self
    }

    /// All but the preamble and the group about the file.
    fn data_set(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for (group, element, vr, value) in &self.elements {
            Self::put(&mut out, *group, *element, vr, value);
        }
        out
    }

    fn put(out: &mut Vec<u8>, group: u16, element: u16, vr: &str, value: &[u8]) {
        out.extend([group.to_le_bytes(), element.to_le_bytes()].concat());
        out.extend(vr.as_bytes());
        if matches!(vr, "OW" | "OB" | "SQ" | "UN") {
            out.extend([0, 0]);
            out.extend((value.len() as u32).to_le_bytes());
        } else {
            out.extend((value.len() as u16).to_le_bytes());
        }
        out.extend(value);
    }

    fn bytes(&self) -> Vec<u8> {
        let mut out = vec![0; 128];
        out.extend(b"DICM");
        Self::put(&mut out, 2, 1, "OB", &[0, 1]);
        Self::put(
            &mut out,
            2,
            0x10,
            "UI",
            format!("{:\0<1$}", self.syntax, self.syntax.len().next_multiple_of(2)).as_bytes(),
        );
        Self::put(&mut out, 2, 0x13, "SH", b"TEST");
        out.extend(self.data_set());
        out
    }
}

fn parts_with(slices: &[Slice], options: &LoadOptions) -> Result<Loaded, LoadError> {
    let files: Vec<Vec<u8>> = slices.iter().map(Slice::bytes).collect();
    let names: Vec<String> = (0..files.len()).map(|i| format!("s{i}.dcm")).collect();
    let beside: Vec<(&str, &[u8])> =
        names.iter().map(String::as_str).zip(files.iter().map(Vec::as_slice)).collect();
    load_parts(beside[0].0, beside[0].1, &beside[1..], options)
}

fn parts(slices: &[Slice]) -> Result<Loaded, LoadError> {
    parts_with(slices, &LoadOptions::default())
}

/// The first pixel of each slice.
fn column(loaded: &Loaded) -> Vec<f64> {
    (0..loaded.volume.grid().dims()[2] as usize).map(|z| value_at(&loaded.volume, [0, 0, z])).collect()
}

fn stack(z_mm: &[f64]) -> Vec<Slice> {
    z_mm.iter().enumerate().map(|(i, &z)| Slice::at(z, 100 * i as u16)).collect()
}

#[test]
fn slices_are_sorted_by_their_place_and_not_by_name_or_number() {
    let loaded = parts(&[Slice::at(4.0, 3), Slice::at(-2.0, 1), Slice::at(1.0, 2)]).unwrap();
    assert_eq!(column(&loaded), [1.0, 2.0, 3.0]);
    assert_eq!(loaded.volume.grid().spacing_mm().to_array(), [1.0, 1.0, 3.0]);
    assert!(loaded.report.notes.is_empty(), "{:?}", loaded.report.notes);
}

#[test]
fn a_missing_slice_is_named_and_interpolated() {
    let loaded = parts(&stack(&[0.0, 1.0, 2.0, 4.0, 5.0])).unwrap();
    assert_noted(&loaded, "between s2.dcm and s3.dcm are 2.000 mm: 1 missing");
    assert_noted(&loaded, "resampled along the slice axis to 6 slices every 1.0000 mm");
    assert_noted(&loaded, "5 of 5 slices are kept");
    assert_eq!(column(&loaded), [0.0, 100.0, 200.0, 250.0, 300.0, 400.0]);
}

#[test]
fn equal_gaps_in_a_row_are_named_together() {
    let loaded = parts(&stack(&[0.0, 1.0, 2.0, 3.0, 4.0, 7.5, 11.0])).unwrap();
    assert_noted(&loaded, "between s4.dcm and s6.dcm are 2 times 3.500 mm: 1.000 mm is usual");
}

#[test]
fn uneven_slices_are_resampled_at_their_smallest_distance() {
    let loaded = parts(&stack(&[0.0, 2.0, 4.0, 9.0])).unwrap();
    assert_noted(&loaded, "between s2.dcm and s3.dcm are 5.000 mm: 2.000 mm is usual");
    let grid = loaded.volume.grid();
    // 4.5 steps of 2 mm do not go into 9 mm: 5 steps of 1.8 mm do.
    assert_eq!(grid.dims()[2], 6);
    assert!((grid.spacing_mm().z - 1.8).abs() < 1e-12);
    let expected = [0.0, 90.0, 180.0, 228.0, 264.0, 300.0];
    assert_eq!(column(&loaded), expected);
}

#[test]
fn a_tiny_gap_does_not_divide_the_whole_stack() {
    let loaded = parts(&stack(&[0.0, 0.01, 5.0, 10.0])).unwrap();
    assert_eq!(loaded.volume.grid().dims()[2], 13);
}

#[test]
fn a_tilted_gantry_shears_the_grid() {
    let tilted: Vec<Slice> =
        (0..4).map(|i| Slice::at(0.0, i).with(0x0020, 0x0032, "DS", &format!("0\\{i}\\{}", 2 * i))).collect();
    let loaded = parts(&tilted).unwrap();
    assert_noted(&loaded, "gantry tilt of 26.6°");
    let at = loaded.volume.grid().volume_from_index().transform_point3(DVec3::new(1.0, 0.0, 3.0));
    assert!(at.distance(DVec3::new(1.0, 3.0, 6.0)) < 1e-9, "{at}");
}

#[test]
fn of_two_images_at_one_place_the_first_is_taken_and_the_other_named() {
    let mut slices = stack(&[0.0, 1.0, 2.0]);
    slices.push(Slice::at(1.0, 999).with(0x0020, 0x0013, "IS", "2"));
    let loaded = parts(&slices).unwrap();
    assert_eq!(column(&loaded), [0.0, 100.0, 200.0]);
    assert_noted(&loaded, "1 images are at the place of another and were left out: s3.dcm");
}

#[test]
fn of_a_series_in_time_the_step_that_was_asked_for_is_loaded() {
    let mut slices = stack(&[0.0, 1.0, 2.0]);
    slices.extend(stack(&[0.0, 1.0, 2.0]).into_iter().map(|s| s.with(0x0020, 0x0013, "IS", "9")));
    let loaded = parts(&slices).unwrap();
    assert_eq!(column(&loaded), [0.0, 100.0, 200.0]);
    assert_noted(&loaded, "each of 3 places has 2 images, 6 in all");

    // Steps told apart by the scanner's count, by milliseconds after the heart's trigger, and by the clock.
    let at = |ms: u32| format!("1015{:02}.{:03}", ms / 1000, ms % 1000);
    let step = |of: u32, by: usize| {
        let slices = (0..3u32).map(move |i| {
            let slice = Slice::at(i.into(), (100 * i + of) as u16).with(
                0x0020,
                0x0013,
                "IS",
                &format!("{}", 99 - of),
            );
            match by {
                0 => slice.with(0x0020, 0x0100, "IS", &of.to_string()),
                1 => slice.raw(0x0020, 0x9128, "UL", &of.to_le_bytes()),
                2 => slice.with(0x0018, 0x1060, "DS", &(of * 40).to_string()),
                _ => slice.with(0x0008, 0x0032, "TM", &at(of * 1250 + i)),
            }
        });
        slices.collect::<Vec<_>>()
    };
    for (by, step_secs) in [None, None, Some(0.04), Some(1.25)].into_iter().enumerate() {
        let slices = [step(2, by), step(0, by), step(3, by), step(1, by)].concat();
        for time in 0..4 {
            let loaded = parts_with(&slices, &LoadOptions { time, ..LoadOptions::default() }).unwrap();
            let of = time as f64;
            assert_eq!(column(&loaded), [of, 100.0 + of, 200.0 + of], "by {by}");
            let found = loaded.report.sequence.unwrap();
            assert_eq!((found.steps, found.loaded), (4, time));
            let near = |secs: f64| (found.step_secs.unwrap() - secs).abs() < 1.0e-9;
            assert!(step_secs.map_or(found.step_secs.is_none(), near), "{found:?}");
        }
        let error = parts_with(&slices, &LoadOptions { time: 4, ..LoadOptions::default() }).unwrap_err();
        assert_field(&error, "time", &["0 to 3", "found 4"]);
    }
}

#[test]
fn images_of_another_size_or_orientation_are_left_out_and_named() {
    let mut slices = stack(&[0.0, 1.0, 2.0]);
    slices.push(Slice::at(3.0, 7).with(0x0020, 0x0037, "DS", "1\\0\\0\\0\\0\\-1"));
    slices.push(Slice::at(3.0, 7).short(0x0028, 0x0010, 1));
    let loaded = parts(&slices).unwrap();
    assert_eq!(loaded.volume.grid().dims(), [2, 2, 3]);
    assert_noted(
        &loaded,
        "1 images of 2 × 2 px have another size, orientation or pixel spacing than the other 3",
    );
    assert_noted(&loaded, "1 images of 2 × 1 px");
}

#[test]
fn objects_without_pixels_are_left_out() {
    let mut slices = stack(&[0.0, 1.0]);
    slices.push(Slice::at(3.0, 7).with(0x0008, 0x0060, "CS", "SR").without(0x7fe0, 0x0010));
    assert_noted(&parts(&slices).unwrap(), "1 DICOM objects without pixels were left out");
    assert_field(&parts(&slices[2..]).unwrap_err(), "pixel data", &["1 DICOM objects without"]);
}

#[test]
fn a_picture_in_colours_among_slices_is_left_out() {
    let mut slices = stack(&[0.0, 1.0]);
    slices.push(Slice::at(2.0, 7).with(0x0028, 0x0004, "CS", "RGB"));
    slices.push(Slice { syntax: "1.2.840.10008.1.2.4.102", ..Slice::at(3.0, 7) });
    let loaded = parts(&slices).unwrap();
    assert_eq!(column(&loaded), [0.0, 100.0]);
    assert_noted(
        &loaded,
        "2 images are no slices and were left out, such as s2.dcm: Photometric Interpretation",
    );
}

#[test]
fn several_patients_are_refused_unless_forced_and_never_named() {
    let mut slices = stack(&[0.0, 1.0]);
    slices.push(Slice::at(2.0, 7).with(0x0010, 0x0020, "LO", "OTHER-ID"));
    let error = parts(&slices).unwrap_err();
    assert!(matches!(error, LoadError::SeveralPatients { found: 2, .. }), "{error}");
    assert!(!error.to_string().contains("OTHER") && !error.to_string().contains("SECRET"), "{error}");
    let forced = parts_with(&slices, &LoadOptions { force: true, ..LoadOptions::default() }).unwrap();
    assert_noted(&forced, "2 patients");
}

#[test]
fn the_patient_is_told_only_to_those_who_ask() {
    let quiet = parts(&stack(&[0.0, 1.0])).unwrap();
    let everything = format!("{quiet:?}");
    assert!(!everything.contains("Secret") && !everything.contains("SECRET"), "{everything}");
    let asked =
        parts_with(&stack(&[0.0]), &LoadOptions { identity: true, ..LoadOptions::default() }).unwrap();
    assert_eq!(
        asked.report.identity,
        [("name", "Secret^Person".to_owned()), ("identifier", "SECRET-ID".to_owned())]
    );
}

/// What is missing from a positron emission tomography, or stands in it instead.
type Change = fn(Slice, Slice) -> [Slice; 2];

/// A slice of a positron emission tomography, and the item of its radiopharmaceutical: 70 kg, 350 MBq, a half-life of 6000 s,
/// an hour and 40 minutes from the injection to the scan. What is left of the dose is half.
fn positrons() -> [Slice; 2] {
    let injected = Slice { elements: Vec::new(), syntax: "" }
        .with(0x0018, 0x1072, "TM", "101500")
        .with(0x0018, 0x1074, "DS", "350000000")
        .with(0x0018, 0x1075, "DS", "6000");
    let slice = Slice::at(0.0, 100)
        .with(0x0008, 0x0021, "DA", "20240301")
        .with(0x0008, 0x0022, "DA", "20240301")
        .with(0x0008, 0x0031, "TM", "115500")
        .with(0x0008, 0x0032, "TM", "115510.5")
        .with(0x0008, 0x0060, "CS", "PT")
        .with(0x0010, 0x1030, "DS", "70")
        .with(0x0028, 0x0051, "CS", "DECY\\ATTN\\SCAT")
        .with(0x0054, 0x1001, "CS", "BQML")
        .with(0x0054, 0x1102, "CS", "START");
    [slice, injected]
}

fn uptake([slice, injected]: [Slice; 2]) -> Loaded {
    let mut item = vec![0xfe, 0xff, 0x00, 0xe0];
    // Behind the preamble and the group about the file: the elements alone.
    let elements = injected.data_set();
    item.extend((elements.len() as u32).to_le_bytes());
    item.extend(elements);
    parts(&[slice.raw(0x0054, 0x0016, "SQ", &item)]).unwrap()
}

#[test]
fn uptake_is_standardised_by_weight_dose_and_decay() {
    let exact = |change: Change, left: f64| {
        let [slice, injected] = positrons();
        let loaded = uptake(change(slice, injected));
        assert_eq!(loaded.volume.channels()[0].name, "suv", "{:?}", loaded.report.notes);
        let expected = 100.0 * 70_000.0 / (350.0e6 * left);
        let found = value_at(&loaded.volume, [0, 0, 0]);
        assert!((found - expected).abs() <= 1e-12 * expected, "{found} {expected}");
    };
    exact(|slice, injected| [slice, injected], 0.5);
    // Already corrected to the injection.
    exact(|slice, injected| [slice.with(0x0054, 0x1102, "CS", "ADMIN"), injected], 1.0);
    // Injected before midnight.
    exact(
        |slice, injected| {
            let early = slice.with(0x0008, 0x0031, "TM", "003000").with(0x0008, 0x0032, "TM", "003000");
            [early, injected.with(0x0018, 0x1072, "TM", "225000")]
        },
        0.5,
    );
    // The date and time of the injection go before its time alone.
    exact(|slice, injected| [slice, injected.with(0x0018, 0x1078, "DT", "20240301083500.00")], 0.25);
}

#[test]
fn uptake_without_what_it_takes_stays_in_becquerel_and_says_what_is_missing() {
    let times = "the time of injection or of the scan is not in the file";
    let changes: [(Change, &str); 11] = [
        (|slice, injected| [slice.without(0x0008, 0x0031), injected], times),
        (|slice, injected| [slice.without(0x0008, 0x0032), injected], times),
        (|slice, injected| [slice, injected.without(0x0018, 0x1072)], times),
        (|slice, injected| [slice, injected.with(0x0018, 0x1072, "TM", "noon")], times),
        // A series that was processed after the scan does not say when that was.
        (|slice, injected| [slice.with(0x0008, 0x0031, "TM", "120000"), injected], times),
        (|slice, injected| [slice, injected.without(0x0018, 0x1074)], "the dose"),
        (|slice, injected| [slice, injected.without(0x0018, 0x1075)], "the half-life"),
        (|slice, injected| [slice.without(0x0010, 0x1030), injected], "weight"),
        (|slice, injected| [slice.with(0x0010, 0x1030, "DS", "0"), injected], "weight"),
        (|slice, injected| [slice.with(0x0028, 0x0051, "CS", "ATTN"), injected], "attenuation and decay"),
        (|slice, injected| [slice.with(0x0054, 0x1102, "CS", "NONE"), injected], "decay is not corrected"),
    ];
    for (change, missing) in changes {
        let [slice, injected] = positrons();
        let loaded = uptake(change(slice, injected));
        assert_eq!(loaded.volume.channels()[0].name, "pet", "{missing}");
        assert_eq!(value_at(&loaded.volume, [0, 0, 0]), 100.0, "{missing}");
        assert_noted(&loaded, missing);
    }
}

#[test]
fn a_bomb_of_a_deflated_file_is_bounded() {
    let deflated = |data_set: &[u8]| {
        let slice = Slice { syntax: "1.2.840.10008.1.2.1.99", ..Slice::at(0.0, 5) };
        let whole = slice.bytes();
        let head = whole[..whole.len() - slice.data_set().len()].to_vec();
        let mut packed = DeflateEncoder::new(head, Compression::best());
        packed.write_all(data_set).unwrap();
        packed.finish().unwrap()
    };
    let load = |file: &[u8]| load_parts("bomb.dcm", file, &[], &LoadOptions::default());
    let data_set = Slice::at(0.0, 5).data_set();
    // After the pixels: not looked at.
    let mut after = data_set.clone();
    after.resize(after.len() + (64 << 20), 0);
    assert_eq!(column(&load(&deflated(&after)).unwrap()), [5.0]);
    // Before the pixels: unpacked as far as headers go, and then refused.
    let mut before =
        Slice { elements: Vec::new(), syntax: "" }.raw(0x0008, 0x0005, "OB", &vec![0; 64 << 20]).data_set();
    before.extend(data_set);
    let error = load(&deflated(&before)).unwrap_err();
    assert!(matches!(error, LoadError::Truncated { what: "data set", found: 33_554_432, .. }), "{error}");
    // A frame of one pixel each, all of which would be unpacked again for every one of them.
    let many = Slice::at(0.0, 5)
        .short(0x0028, 0x0010, 1)
        .short(0x0028, 0x0011, 1)
        .with(0x0028, 0x0008, "IS", "1000000")
        .raw(0x7fe0, 0x0010, "OW", &vec![0; 2_000_000]);
    let error = load(&deflated(&many.data_set())).unwrap_err();
    assert!(matches!(error, LoadError::TooLarge { what: "the frames of a deflated file", .. }), "{error}");
}

#[test]
fn of_several_series_the_largest_is_loaded_or_the_one_that_was_asked_for() {
    let mut slices = stack(&[0.0, 1.0, 2.0]);
    let other =
        |z, value| Slice::at(z, value).with(0x0020, 0x000e, "UI", "1.2.3.9").with(0x0020, 0x0011, "IS", "8");
    slices.extend([other(0.0, 7), other(3.0, 8)]);
    let loaded = parts(&slices).unwrap();
    assert_eq!(column(&loaded), [0.0, 100.0, 200.0]);
    assert_noted(&loaded, "2 series are here, and the largest is loaded, 5 (CT, 3 images, 1.2.3.4)");
    assert_eq!(loaded.report.series.len(), 2);
    for asked in ["8", "1.2.3.9"] {
        let options = LoadOptions { series: Some(asked.to_owned()), ..LoadOptions::default() };
        assert_eq!(column(&parts_with(&slices, &options).unwrap()), [7.0, 8.0]);
    }
    let options = LoadOptions { series: Some("77".to_owned()), ..LoadOptions::default() };
    let error = parts_with(&slices, &options).unwrap_err();
    assert_field(&error, "series", &["77", "8 (CT, 2 images, 1.2.3.9)"]);
}

#[test]
fn bits_that_are_not_stored_are_cut_off_and_signs_extended() {
    let read = |value: u16, signed: u16| {
        let slice = Slice::at(0.0, value)
            .short(0x0028, 0x0101, 12)
            .short(0x0028, 0x0102, 11)
            .short(0x0028, 0x0103, signed);
        parts(&[slice]).unwrap().volume.channels()[0].voxels.clone()
    };
    assert_eq!(read(0xf123, 0), Voxels::U16(vec![0x123; 4].into()));
    assert_eq!(read(0x0fff, 1), Voxels::I16(vec![-1; 4].into()));
    let high = Slice::at(0.0, 0x1230).short(0x0028, 0x0101, 12).short(0x0028, 0x0102, 15);
    assert_eq!(parts(&[high]).unwrap().volume.channels()[0].voxels, Voxels::U16(vec![0x123; 4].into()));
}

#[test]
fn slopes_of_each_slice_are_applied_to_the_bit() {
    let slope = |i: usize| [0.1, 0.3, 1.0 / 3.0][i];
    let slices: Vec<Slice> = (0..3)
        .map(|i| {
            let slice = Slice::at(i as f64, 1000 + i as u16).with(0x0028, 0x1052, "DS", "0.7");
            slice.with(0x0028, 0x1053, "DS", &slope(i).to_string())
        })
        .collect();
    let loaded = parts(&slices).unwrap();
    assert!(matches!(loaded.volume.channels()[0].voxels, Voxels::F64(_)));
    for (i, found) in column(&loaded).into_iter().enumerate() {
        let expected = slope(i) * (1000 + i) as f64 + 0.7;
        assert_eq!(found.to_bits(), expected.to_bits(), "{found} {expected}");
    }
    assert_noted(&loaded, "slices differ in slope, intercept or type");
    assert_noted(&loaded, "draws from float32 of them, off by at most");
}

#[test]
fn what_float32_loses_of_slices_between_slices_is_told() {
    // Whole numbers in both slices, thirds between them.
    let slice = |z: f64, slope: &str| Slice::at(z, 1).with(0x0028, 0x1053, "DS", slope);
    let slices = [slice(0.0, "1"), slice(1.0, "1"), slice(4.0, "2"), slice(5.0, "1")];
    let loaded = parts(&slices).unwrap();
    let found = column(&loaded);
    assert!((found[2] - 4.0 / 3.0).abs() < 1e-12, "{found:?}");
    let lost = found.iter().map(|v| (f64::from(*v as f32) - v).abs()).fold(0.0, f64::max);
    assert!(lost > 0.0);
    assert_noted(&loaded, &format!("draws from float32 of them, off by at most {lost:.3e}"));
}

#[test]
fn one_slice_has_the_thickness_that_the_file_says() {
    let slice = Slice::at(0.0, 1).with(0x0018, 0x0050, "DS", "2.5");
    assert_eq!(parts(&[slice]).unwrap().volume.grid().spacing_mm().z, 2.5);
    let bare = parts(&[Slice::at(0.0, 1).without(0x0020, 0x0032).without(0x0020, 0x0037)]).unwrap();
    assert_noted(&bare, "distance of slices is not in the file");
    assert_noted(&bare, "orientation is not in the file");
    assert_noted(&bare, "do not say where they are");
}

#[test]
fn the_window_of_the_file_and_low_that_is_bright_are_told() {
    let slice = Slice::at(0.0, 1)
        .with(0x0028, 0x0004, "CS", "MONOCHROME1")
        .with(0x0028, 0x1050, "DS", "40\\300")
        .with(0x0028, 0x1051, "DS", "400\\1500");
    let loaded = parts(&[slice]).unwrap();
    assert_eq!(loaded.report.window, Some([-160.0, 240.0]));
    assert_eq!(loaded.report.modality.as_deref(), Some("CT"));
    assert_noted(&loaded, "MONOCHROME1");
}

#[test]
fn what_is_no_volume_is_refused_by_name() {
    let slice = || Slice::at(0.0, 1);
    let refused = |slice: Slice, field: &str, parts_of: &[&str]| {
        assert_field(&parts(&[slice]).unwrap_err(), field, parts_of);
    };
    refused(slice().with(0x0028, 0x0004, "CS", "RGB"), "Photometric Interpretation", &["RGB"]);
    refused(slice().short(0x0028, 0x0002, 3), "Samples per Pixel", &["3"]);
    refused(slice().short(0x0028, 0x0100, 1), "Bits Allocated", &["1"]);
    refused(slice().short(0x0028, 0x0101, 17), "Bits Stored", &["17"]);
    refused(slice().short(0x0028, 0x0102, 16), "High Bit", &["16"]);
    refused(slice().short(0x0028, 0x0010, 0), "Rows", &["0"]);
    refused(slice().short(0x0028, 0x0011, 65_535), "Columns", &["65535"]);
    refused(slice().with(0x0028, 0x1053, "DS", "0"), "Rescale Slope", &["0"]);
    refused(slice().with(0x0020, 0x0037, "DS", "1\\0\\0"), "Image Orientation (Patient)", &["6 numbers"]);
    refused(slice().with(0x0020, 0x0037, "DS", "0\\0\\0\\0\\1\\0"), "Image Orientation (Patient)", &[]);
    refused(slice().with(0x0028, 0x0008, "IS", "-1"), "Number of Frames", &["-1"]);
    refused(slice().with(0x0028, 0x0008, "IS", "2147483648"), "Number of Frames", &[]);
    let jpeg_xl = Slice { syntax: "1.2.840.10008.1.2.4.110", ..slice() };
    refused(jpeg_xl, "transfer syntax", &["JPEG XL", "1.2.840.10008.1.2.4.110"]);
    let frames = parts(&[slice().with(0x0028, 0x0008, "IS", "100000")]).unwrap_err();
    assert!(matches!(frames, LoadError::Truncated { expected: 800_000, found: 8, .. }), "{frames}");
}

#[test]
fn a_file_that_ends_anywhere_does_no_harm_and_says_nothing_of_the_patient() {
    let whole = Slice::at(0.0, 1).bytes();
    for length in 0..whole.len() {
        let error =
            load_parts("cut.dcm", &whole[..length], &[], &LoadOptions::default()).unwrap_err().to_string();
        assert!(
            error.starts_with("cut.dcm") && !error.to_uppercase().contains("SECRET"),
            "{length}: {error}"
        );
    }
}

#[test]
fn a_length_that_lies_takes_no_memory() {
    // 4 GiB of text, and an element of unknown length that never ends.
    for length in [0xffff_fff0u32, 0xffff_ffff] {
        let mut bytes = Slice::at(0.0, 1).bytes();
        let at = bytes.windows(4).position(|w| w == [0x10, 0, 0x10, 0]).unwrap();
        let mut lie = bytes[..at + 4].to_vec();
        lie.extend(b"UN\0\0");
        lie.extend(length.to_le_bytes());
        lie.extend(bytes.drain(at + 8..));
        assert!(load_parts("lie.dcm", &lie, &[], &LoadOptions::default()).is_err());
    }
}

#[test]
fn compressed_pixels_of_another_size_are_refused_before_they_are_decoded() {
    for (name, field) in [
        ("jpeg_ls_u16", "JPEG-LS"),
        ("jpeg_2000_u16", "JPEG 2000"),
        ("jpeg70_i12", "JPEG"),
        ("htj2k_u16", "JPEG 2000"),
    ] {
        let folder = fixtures().join("dicom").join(name);
        let file = folder.read_dir().unwrap().next().unwrap().unwrap().path();
        let mut bytes = std::fs::read(file).unwrap();
        // Rows, explicit and little-endian.
        let at = bytes.windows(6).position(|w| w == [0x28, 0, 0x10, 0, b'U', b'S']).unwrap();
        bytes[at + 8] += 1;
        let error = load_parts("a.dcm", &bytes, &[], &LoadOptions::default()).unwrap_err();
        assert!(
            error.to_string().contains(field) && error.to_string().contains("px as the header says"),
            "{error}"
        );
    }
}

#[cfg(unix)]
#[test]
fn a_folder_is_searched_to_its_bottom_but_not_beyond() {
    let outside = tempfile::tempdir().unwrap();
    std::fs::write(outside.path().join("far"), Slice::at(9.0, 9).bytes()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let deep = folder.path().join("a/b");
    std::fs::create_dir_all(&deep).unwrap();
    std::fs::write(deep.join("one"), Slice::at(0.0, 1).bytes()).unwrap();
    std::fs::write(folder.path().join("two"), Slice::at(1.0, 2).bytes()).unwrap();
    std::fs::write(folder.path().join("readme.txt"), "hello").unwrap();
    let link = |to: &Path, from: &Path| std::os::unix::fs::symlink(to, from).unwrap();
    link(&outside.path().join("far"), &folder.path().join("three"));
    link(folder.path(), &deep.join("round"));
    link(&folder.path().join("nowhere"), &folder.path().join("broken"));
    let loaded = load(folder.path(), &LoadOptions::default()).unwrap();
    assert_eq!(column(&loaded), [1.0, 2.0]);
    assert_noted(&loaded, "1 files that are not DICOM");
}
