//! What is said about a volume.

use crate::{fixture, fixture_path};
use std::path::Path;
use volume_io::describe::VolumeDescription;
use volume_io::{LoadOptions, load, load_bytes};

fn describe(name: &str) -> VolumeDescription {
    VolumeDescription::of(name, &load(fixture_path(name), &LoadOptions::default()).unwrap())
}

#[test]
fn geometry_is_said_in_numbers_and_words() {
    let oblique = describe("n1_be_f32_qform_oblique.nii.gz");
    assert!(oblique.oblique_deg > 10.0 && !oblique.sheared && !oblique.left_handed);
    let flipped = describe("n1_le_u16_qform_flipped.nii");
    assert_eq!(flipped.orientation, "LAS");
    assert!(flipped.left_handed && flipped.oblique_deg < 1e-3);
    assert!((flipped.size_mm[2] - 12.5).abs() < 1e-6);
    let sheared = describe("n2_le_f32_sheared.nii");
    assert!(sheared.sheared && (sheared.shear_deg - 26.565).abs() < 1e-3, "{}", sheared.shear_deg);
    assert!(sheared.to_string().contains("sheared by 26.6°"));
}

#[test]
fn json_carries_every_figure() {
    let json = serde_json::to_value(describe("n1_be_i16_sform_scaled.nii")).unwrap();
    assert_eq!(json["dims"], serde_json::json!([4, 3, 5]));
    let channel = &json["channels"][0];
    assert_eq!((channel["type"].as_str(), channel["slope"].as_f64()), (Some("int16"), Some(2.5)));
    let counts = channel["histogram"]["counts"].as_array().unwrap();
    assert_eq!(counts.iter().map(|c| c.as_u64().unwrap()).sum::<u64>(), 60);
    for figure in ["minimum", "maximum", "mean", "intercept"] {
        assert!(channel[figure].is_number(), "{figure}");
    }
    assert!(channel["percentiles"]["p99"].as_f64() <= channel["maximum"].as_f64());
}

#[test]
fn the_page_fits_a_terminal() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/volumes/totalseg_example_ct.nii.gz");
    let loaded = load(&path, &LoadOptions::default()).unwrap();
    let page = VolumeDescription::of("totalseg_example_ct.nii.gz", &loaded).to_string();
    println!("{page}");
    assert!(page.lines().all(|line| line.chars().count() <= 80), "{page}");
    for part in ["NIfTI-1", "122 × 101 × 112", "3 × 3 × 3 mm", "RAS", "-1207 to 3382", "█", "without loss"]
    {
        assert!(page.contains(part), "{part} in {page}");
    }
}

#[test]
fn what_the_header_says_about_a_person_is_not_shown() {
    let mut bytes = fixture("n1_le_u8_sform.nii");
    for text in [4..32, 148..252, 328..344] {
        // data_type and db_name; descrip and aux_file; intent_name.
        bytes[text.clone()].copy_from_slice(&b"DOE^JANE".repeat(13)[..text.len()]);
    }
    let loaded = load_bytes("scan.nii", &bytes, &LoadOptions::default()).unwrap();
    let description = VolumeDescription::of("scan.nii", &loaded);
    let said = format!("{description} {} {loaded:?}", serde_json::to_string(&description).unwrap());
    assert!(!said.contains("DOE") && !said.contains("JANE"), "{said}");
}
