//! `info` and `convert` on what hospitals have.

use crate::files::{DIMS, Folder, nifti, raw};
use crate::program::{Said, holocast, run};
use std::path::{Path, PathBuf};

/// A folder of slices that `tools/golden_volumes.py` wrote.
const SERIES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../volume-io/tests/fixtures/dicom/explicit_axial");

#[test]
fn info_reads_a_folder_and_says_who_it_is_only_if_asked() {
    let json = run(["info", SERIES, "--json"]).json();
    assert_eq!((&json["format"], &json["modality"]), (&"DICOM".into(), &"CT".into()), "{json}");
    assert_eq!(json["channels"][0]["window"], serde_json::json!([-160.0, 240.0]), "{json}");
    let quiet = [run(["info", SERIES, "--json"]).well(), run(["info", SERIES]).well()].concat();
    assert!(!quiet.contains("Nobody") && !quiet.contains("NOBODY"), "{quiet}");
    let asked = run(["info", SERIES, "--identity"]).well();
    assert!(asked.contains("Nobody^Test") && asked.contains("NOBODY-1"), "{asked}");
    run(["info", SERIES, "--series", "99"]).failed(&["series", "7 (CT, 4 images"]);
}

#[test]
fn convert_writes_what_info_reads_and_replaces_nothing_silently() {
    let folder = Folder::new();
    for name in ["scan.nii.gz", "scan.nrrd", "scan.png"] {
        let out = folder.arg(name);
        let said = run(["convert", SERIES, &out, "--crop", "1:9,:,1:", "--json"]).json();
        assert_eq!(said["dims"], serde_json::json!([8, 12, 3]), "{said}");
        let [before, after] = [SERIES, &out].map(|path| run(["info", path, "--json"]).json());
        assert_eq!(after["dims"], said["dims"]);
        assert_eq!(after["orientation"], before["orientation"]);
        run(["convert", SERIES, &out]).failed(&["is there already", "--overwrite"]);
        run(["convert", SERIES, &out, "--bits", "8", "--window", "-160,240", "--overwrite"]).well();
        assert_eq!(run(["info", &out, "--json"]).json()["channels"][0]["maximum"], 240.0);
    }
    run(["convert", SERIES, &folder.arg("scan.mha")]).failed(&[".nrrd"]);
}

/// What names the patient of the series, and what is known of them.
const PATIENT: [&str; 3] = ["Nobody", "NOBODY", "19000101"];

fn slices() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = Path::new(SERIES).read_dir().unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    files
}

#[test]
fn nothing_of_the_patient_is_written_or_logged() {
    let folder = Folder::new();
    let telling: Vec<u8> = slices().iter().flat_map(|file| std::fs::read(file).unwrap()).collect();
    let holds = |bytes: &[u8], name: &str| bytes.windows(name.len()).any(|w| w == name.as_bytes());
    assert!(PATIENT.iter().all(|name| holds(&telling, name)), "the series would tell");
    let check = |what: &str, bytes: &[u8]| {
        let told: Vec<_> = PATIENT.iter().filter(|name| holds(bytes, name)).collect();
        assert!(told.is_empty(), "{what} tells {told:?}");
    };
    let loud = |arguments: &[&str]| {
        let output = holocast(arguments).env("RUST_LOG", "trace").output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
        check(&format!("what {arguments:?} says"), &[output.stdout, output.stderr].concat());
    };
    for (name, plain) in
        [("s.nii", "s.nii"), ("s.nii.gz", "unpacked.nii"), ("s.nrrd", "again.nii"), ("s.png", "s.json")]
    {
        let (out, plain) = (folder.arg(name), folder.arg(plain));
        loud(&["convert", SERIES, &out]);
        // What is compressed is looked at as it is read again.
        if !Path::new(&plain).exists() {
            loud(&["convert", &out, &plain]);
        }
        check(name, &std::fs::read(&out).unwrap());
        check(&plain, &std::fs::read(&plain).unwrap());
    }
    let picture = folder.arg("picture.png");
    loud(&["info", SERIES]);
    loud(&["render", "--volume", SERIES, "--size", "16x16", "--out", &picture]);
    check("a picture", &std::fs::read(&picture).unwrap());
    loud(&["contact-sheet", SERIES, "--size", "32x32", "--out", &folder.arg("sheet.png")]);
    check("a sheet", &std::fs::read(folder.path("sheet.png")).unwrap());
}

#[test]
fn images_of_two_patients_are_loaded_only_if_that_is_forced() {
    let folder = Folder::new();
    let both = folder.path("both");
    std::fs::create_dir(&both).unwrap();
    for (i, file) in slices().iter().enumerate() {
        let mut bytes = std::fs::read(file).unwrap();
        let id = bytes.windows(8).position(|w| w == b"NOBODY-1").unwrap();
        bytes[id + 7] = if i == 0 { b'2' } else { b'1' };
        std::fs::write(both.join(file.file_name().unwrap()), bytes).unwrap();
    }
    let both = folder.arg("both");
    for command in [
        &["info", &both][..],
        &["convert", &both, &folder.arg("both.nii")],
        &["render", "--volume", &both, "--size", "16x16", "--out", &folder.arg("both.png")],
    ] {
        let refused = run(command);
        assert!(!refused.err.contains("NOBODY"), "{}", refused.err);
        refused.failed(&["images of one patient are expected, found those of 2", "force"]);
        run(command.iter().chain(&["--force"])).well();
    }
}

#[test]
fn of_a_series_in_time_the_step_that_was_asked_for_is_taken_in_each_format() {
    let folder = Folder::new();
    let [x, y, z] = DIMS;
    // Two steps: the ball, and one everywhere.
    let (ball, json) = raw();
    let ones: Vec<u8> = [1i16.to_le_bytes()].concat().repeat(ball.len() / 2);
    let steps = [ball.clone(), ones].concat();
    let mut four_axes = nifti();
    four_axes[40..42].copy_from_slice(&4i16.to_le_bytes());
    four_axes[48..50].copy_from_slice(&2i16.to_le_bytes());
    four_axes.extend(&steps[ball.len()..]);
    let nrrd = format!(
        "NRRD0004\ntype: short\ndimension: 4\nsizes: {x} {y} {z} 2\nencoding: raw\nendian: little\nspace: LPS\n\
         space directions: (1,0,0) (0,1,0) (0,0,2) none\nspace origin: (0,0,0)\n\n"
    );
    let meta = format!(
        "ObjectType = Image\nNDims = 4\nDimSize = {x} {y} {z} 2\nElementType = MET_SHORT\nElementSpacing = 1 1 2 0.5\n\
         ElementByteOrderMSB = False\nElementDataFile = LOCAL\n"
    );
    // Each slice again, with another number of its image and with one everywhere.
    let dicom = folder.path("dicom");
    std::fs::create_dir(&dicom).unwrap();
    for (i, file) in slices().iter().enumerate() {
        let mut bytes = std::fs::read(file).unwrap();
        std::fs::write(dicom.join(format!("{i}-first")), &bytes).unwrap();
        let number = bytes.windows(8).position(|w| w == [0x20, 0, 0x13, 0, b'I', b'S', 2, 0]).unwrap();
        bytes[number + 8] = b'9';
        let pixels = bytes.windows(6).rposition(|w| w == [0xe0, 0x7f, 0x10, 0, b'O', b'W']).unwrap() + 12;
        let ones = [1, 0].repeat((bytes.len() - pixels) / 2);
        bytes[pixels..].copy_from_slice(&ones);
        std::fs::write(dicom.join(format!("{i}-second")), &bytes).unwrap();
    }
    // Hounsfield units begin at -1024.
    for (path, one) in [
        (folder.write("t.nii", &four_axes), 1.0),
        (folder.write("t.nrrd", &[nrrd.as_bytes(), &steps].concat()), 1.0),
        (folder.write("t.mha", &[meta.as_bytes(), &steps].concat()), 1.0),
        (folder.arg("dicom"), -1023.0),
    ] {
        let range = |said: Said| {
            let json = said.json();
            let channel = &json["channels"][0];
            [&channel["minimum"], &channel["maximum"]].map(|n| n.as_f64().unwrap())
        };
        let first = range(run(["info", &path, "--json"]));
        assert!(first[0] < first[1], "{path}: {first:?}");
        assert_eq!(range(run(["info", &path, "--time", "0", "--json"])), first, "{path}");
        assert_eq!(range(run(["info", &path, "--time", "1", "--json"])), [one; 2], "{path}");
        let out = folder.arg("step.nii");
        run(["convert", &path, &out, "--time", "1", "--overwrite"]).well();
        assert_eq!(range(run(["info", &out, "--json"])), [one; 2], "{path}");
        let render = |time: &str| {
            run([
                "render",
                "--volume",
                &path,
                "--size",
                "16x16",
                "--out",
                &folder.arg("step.png"),
                "--time",
                time,
            ])
        };
        render("1").well();
        render("2").failed(&["time", "0 to 1", "found 2"]);
        run(["info", &path, "--time", "2"]).failed(&["time", "0 to 1", "found 2"]);
    }
    // What cannot be a series has no second volume.
    folder.write("ball.raw", &ball);
    let atlas = folder.arg("ball.png");
    run(["convert", &folder.volume(), &atlas]).well();
    for path in [folder.write("ball.json", json.as_bytes()), atlas] {
        run(["info", &path, "--time", "1"]).failed(&["time", "0, the only volume there is"]);
    }
}
