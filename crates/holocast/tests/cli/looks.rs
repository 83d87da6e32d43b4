//! Presets, looks of other programs, labels, and the sheet of all volumes.

use crate::files::Folder;
use crate::program::run;
use std::path::Path;

const ASSETS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/volumes");
const DICOM: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../volume-io/tests/fixtures/dicom");

/// How many pixels of a PNG are not black, and how many are redder than they are blue.
fn seen_and_red(path: &str) -> (usize, usize) {
    let rgb = image::open(path).unwrap().to_rgb8();
    let pixels: Vec<&[u8]> = rgb.as_raw().chunks_exact(3).collect();
    let seen = pixels.iter().filter(|p| p.iter().any(|&c| c > 20)).count();
    (seen, pixels.iter().filter(|p| p[0] > p[2].saturating_add(40)).count())
}

#[test]
fn presets_are_listed_with_modality_and_units() {
    let json = run(["presets", "--json"]).json();
    let bone = json.as_array().unwrap().iter().find(|p| p["name"] == "bone").unwrap();
    assert_eq!((&bone["modalities"], &bone["units"]), (&serde_json::json!(["CT"]), &"HU".into()));
    let words = run(["presets"]).well();
    for part in ["mip-angiography", "pet-hot", "percentile", "CT", "any"] {
        assert!(words.contains(part), "expected '{part}' in:\n{words}");
    }
}

#[test]
fn a_preset_shows_what_it_fits_and_is_refused_elsewhere() {
    let folder = Folder::new();
    let ct = format!("{ASSETS}/totalseg_example_ct.nii.gz");
    let picture = |name: &str, more: &[&str]| {
        let out = folder.arg(name);
        let base = ["render", "--volume", &ct, "--size", "64x48", "--quality", "draft", "--out", &out];
        run(base.iter().chain(more)).well();
        seen_and_red(&out)
    };
    let bone = picture("bone.png", &["--preset", "bone"]);
    let skin = picture("skin.png", &["--preset", "skin"]);
    assert!(bone.0 > 100 && skin.0 > bone.0 * 3 / 2, "{bone:?} {skin:?}");
    let ball = folder.volume();
    let render = |more: &[&str]| {
        let out = folder.arg("ball.png");
        run(["render", "--volume", &ball, "--size", "16x16", "--out", &out].iter().chain(more))
    };
    render(&["--preset", "bone"]).failed(&["Hounsfield", "surface", "--modality CT"]);
    render(&["--preset", "bone", "--modality", "ct"]).well();
    render(&["--preset", "bones"]).failed(&["no preset 'bones'", "mip-angiography"]);
    render(&["--preset", "labels"]).failed(&["measured values", "--kind label"]);
}

#[test]
fn transfer_functions_of_other_programs_are_taken_from_the_command_line_and_from_scenes() {
    let folder = Folder::new();
    let red = r#"<MRML><VolumeProperty name="red" scalarOpacity="4 0 0.5 250 0.5" colorTransfer="4 0 1 0 0"/>
        <VolumeProperty name="none" scalarOpacity="2 0 0" colorTransfer="4 0 1 0 0" gradientOpacity="2 0 0.5"/></MRML>"#;
    folder.write("presets.xml", red.as_bytes());
    let (presets, out, ball) = (folder.arg("presets.xml"), folder.arg("out.png"), folder.volume());
    let render = |more: &[&str]| run(["render", "--size", "16x16", "--out", &out].iter().chain(more));
    let named = format!("{presets}#red");
    render(&["--volume", &ball, "--transfer", &named]).well();
    assert!(seen_and_red(&out).1 > 20);
    let none = render(&["--volume", &ball, "--transfer", &format!("{presets}#none")]);
    assert!(none.err.contains("gradient"), "{}", none.err);
    none.well();
    assert_eq!(seen_and_red(&out).0, 0);
    render(&["--volume", &ball, "--transfer", &presets]).failed(&["red, none", "FILE#NAME"]);
    let scene = folder.write("scene.json", br#"{"volume": "ball.nii", "transfer_file": "presets.xml#red"}"#);
    render(&["--scene", &scene]).well();
    assert!(seen_and_red(&out).1 > 20);
}

#[test]
fn labels_have_names_millilitres_and_colours_of_their_own() {
    let labels = format!("{ASSETS}/totalseg_example_labels.nii.gz");
    let json = run(["info", &labels, "--json"]).json();
    let liver = json["channels"][0]["labels"].as_array().unwrap().iter().find(|l| l["name"] == "liver");
    let liver = liver.unwrap_or_else(|| panic!("no liver: {json}"));
    let (voxels, ml) = (liver["voxels"].as_f64().unwrap(), liver["ml"].as_f64().unwrap());
    assert!(voxels > 100.0 && (ml - voxels * 0.027).abs() < 1e-6 * ml, "voxels of 3 mm: {liver}");
    assert_eq!(json["suggested"][0]["preset"], "labels");
    let folder = Folder::new();
    let table = folder.write("table.ctbl", b"# red alone\n5 rouge 255 0 0 255\n");
    let scene = folder.write("scene.json", br#"{"preset": "labels", "labels": {"only": ["rouge"]}}"#);
    let out = folder.arg("liver.png");
    let render = |more: &[&str]| {
        let base = ["render", "--volume", &labels, "--scene", &scene, "--size", "64x48", "--out", &out];
        run(base.iter().chain(more))
    };
    render(&["--labels", &table]).well();
    let (seen, red) = seen_and_red(&out);
    assert!(red > 20 && seen - red < red / 4, "{seen} pixels, {red} of them red");
    render(&[]).failed(&["'rouge'", "spleen"]);
    render(&["--labels", &table, "--kind", "intensity"]).failed(&["--kind label"]);
}

#[test]
fn the_sheet_shows_what_there_is_and_names_what_it_could_not() {
    let folder = Folder::new();
    folder.write("notes.txt", b"no volume");
    let sheet = folder.arg("sheet.png");
    let arguments =
        ["contact-sheet", ASSETS, &format!("{DICOM}/explicit_axial"), "--size", "64x48", "--columns", "2"];
    let said = run(arguments.iter().copied().chain(["--out", &sheet, "--json"])).json();
    let of = |name: &str| {
        let all = said.as_array().unwrap();
        let found = all.iter().find(|v| v["volume"].as_str().unwrap().ends_with(name));
        found.unwrap_or_else(|| panic!("no {name} in {said}"))["shown"]["preset"].clone()
    };
    assert_eq!(said.as_array().unwrap().len(), 4, "three scans and a series: {said}");
    assert_eq!(of("totalseg_example_ct.nii.gz"), "bone");
    assert_eq!(of("totalseg_example_labels.nii.gz"), "labels");
    assert_eq!(of("mni152_t1_1mm.nii.gz"), "surface");
    assert_eq!(of("explicit_axial"), "bone");
    assert!(seen_and_red(&sheet).0 > 1000);
    folder.write("broken.nii", &std::fs::read(folder.volume()).unwrap()[..400]);
    let out = folder.arg("failed.png");
    let failed = run(["contact-sheet", &folder.arg(""), "--size", "32x32", "--out", &out]);
    assert!(
        failed.err.contains("broken.nii") && failed.err.contains("1 volumes could not be shown"),
        "{}",
        failed.err
    );
    assert!(!failed.status.success() && Path::new(&out).exists(), "the sheet is there all the same");
}
