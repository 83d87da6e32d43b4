//! `info` and `convert` on what hospitals have.

use crate::files::Folder;
use crate::program::run;

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
