//! The scenes of the suite.

use crate::setting::{
    Noise, Shown, each, eye, f32s, fov, i16s, oblique, scaled, straight, u8s, u16s, volume_on,
};
use spatial::{DAffine3, DMat3, DVec3, EyeView};
use std::path::Path;
use volume::{Grid, Volume};

/// Pixels of a scene's picture.
pub(crate) const SIZE: [u32; 2] = [64, 36];
/// Pixels of a real scan's picture.
pub(crate) const SCAN_SIZE: [u32; 2] = [96, 54];

/// What is drawn.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) shown: Shown,
    pub(crate) eye: EyeView,
    pub(crate) size: [u32; 2],
}

impl Case {
    /// Whether every sample is a number of its own.
    pub(crate) fn is_noise(&self) -> bool {
        self.name.starts_with("noise")
    }

    /// The smallest spacing.
    pub(crate) fn voxel_mm(&self) -> f64 {
        self.shown.volume.grid().spacing_mm().min_element()
    }
}

/// A volume, the range of its values, and what scenes of it are made of.
struct Subject {
    name: &'static str,
    volume: Volume,
    /// A value below which nothing is seen, and one above which all is.
    low: f64,
    high: f64,
    /// Opacity of a millimetre at `high`.
    opacity: f64,
}

/// Hills and hollows, none steeper than the samples can follow: 0 to 1.
pub(crate) fn hills(p: DVec3, n: f64) -> f64 {
    let q = p / n - 0.5;
    let ball = (-12.0 * q.length_squared()).exp();
    let wave = (9.0 * q.x + 2.0).sin() * (7.0 * q.y).cos() * (8.0 * q.z + 1.0).sin();
    (0.75 * ball + 0.25 * ball * (1.0 + wave)).clamp(0.0, 1.0)
}

fn subjects() -> Vec<Subject> {
    let n = 40u32;
    let smooth = each([n; 3], |p| hills(p, f64::from(n - 1)));
    let of = |scale: f64, offset: f64| smooth.iter().map(|v| v * scale + offset).collect::<Vec<_>>();
    let mut random = Noise(20_261_101);
    let noise = each([24, 20, 22], |_| random.next());
    // A scan's own: a smooth body, and in every sample a little noise.
    let grained: Vec<f64> = smooth.iter().map(|v| v * 1500.0 - 1000.0 + 60.0 * random.next()).collect();
    let slices = each([40, 36, 12], |p| hills(p * DVec3::new(1.0, 1.1, 3.4), 39.0));
    // x runs the other way (left-handed), y and z are swapped.
    let flipped = DAffine3::from_mat3_translation(
        DMat3::from_cols(DVec3::NEG_X, DVec3::Z * 1.2, DVec3::Y * 0.8),
        DVec3::new(39.0, 0.0, 0.0),
    );
    let rounded: Vec<f64> = smooth.iter().map(|v| (v * 5.0).round()).collect();
    let subject = |name, volume, low, high, opacity| Subject { name, volume, low, high, opacity };
    vec![
        subject("smooth u8", volume_on(straight([n; 3], [1.0; 3]), u8s(&of(255.0, 0.0))), 40.0, 220.0, 0.25),
        subject("smooth f32", volume_on(straight([n; 3], [1.0; 3]), f32s(&of(1.0, 0.0))), 0.15, 0.85, 0.25),
        subject(
            "smooth u16 with slope, oblique",
            scaled(oblique([n; 3], [0.7, 0.9, 1.3]), u16s(&of(4000.0, 100.0)), 0.5, -1000.0),
            -650.0,
            750.0,
            0.25,
        ),
        subject("grained i16", volume_on(straight([n; 3], [1.0; 3]), i16s(&grained)), -700.0, 400.0, 0.25),
        subject(
            "slices of 0.5 x 0.6 x 3 mm, oblique, i16",
            scaled(
                oblique([40, 36, 12], [0.5, 0.6, 3.0]),
                i16s(&slices.iter().map(|v| v * 1000.0).collect::<Vec<_>>()),
                1.0,
                -500.0,
            ),
            -350.0,
            350.0,
            0.25,
        ),
        subject(
            "smooth u8, left-handed",
            volume_on(Grid::new([n; 3], flipped).unwrap(), u8s(&of(255.0, 0.0))),
            40.0,
            220.0,
            0.25,
        ),
        subject(
            "noise u8",
            volume_on(
                straight([24, 20, 22], [1.5; 3]),
                u8s(&noise.iter().map(|v| v * 255.0).collect::<Vec<_>>()),
            ),
            60.0,
            240.0,
            0.2,
        ),
        subject(
            "noise f32, oblique",
            volume_on(oblique([24, 20, 22], [1.0, 1.5, 2.0]), f32s(&noise)),
            0.2,
            0.9,
            0.2,
        ),
        subject("labels u8", volume_on(straight([n; 3], [1.0; 3]), u8s(&rounded)), 1.0, 4.0, 0.25),
    ]
}

/// Scenes of one volume: every mode, and lit. Nothing is seen below `low`; at `high` a millimetre has the opacity.
pub(crate) fn looks(low: f64, high: f64, opacity: f64) -> Vec<(String, String)> {
    let at = |part: f64| low + (high - low) * part;
    let ramp = format!(
        "[[{}, 0.1, 0.2, 0.9, 0], [{}, 0.9, 0.3, 0.1, {}], [{}, 1, 0.9, 0.7, {opacity}]]",
        at(0.0),
        at(0.5),
        opacity * 0.3,
        at(1.0)
    );
    let window = format!("[{}, {}]", at(-0.2), at(1.2));
    vec![
        ("emission-absorption".into(), format!(r#"{{"transfer": {ramp}}}"#)),
        (
            "emission-absorption, lit".into(),
            format!(
                r#"{{"transfer": {ramp}, "light": {{"ambient": 0.2, "diffuse": 0.7, "specular": 0.2, "power": 20}}}}"#
            ),
        ),
        (
            "threshold".into(),
            format!(
                r#"{{"mode": "threshold", "threshold": {}, "surface_color": [0.9, 0.8, 0.6]}}"#,
                at(0.45)
            ),
        ),
        ("x-ray".into(), format!(r#"{{"mode": "x-ray", "window": {window}}}"#)),
        (
            "maximum".into(),
            format!(r#"{{"mode": "maximum", "transfer": {}}}"#, ramp.replace(&format!("{opacity}]"), "1]")),
        ),
        (
            "cumulated".into(),
            format!(
                r#"{{"mode": "cumulated", "threshold": {}, "window": {window}, "surface_opacity": 0.6}}"#,
                at(0.45)
            ),
        ),
    ]
}

/// Every mode of every made volume.
pub(crate) fn made() -> Vec<Case> {
    let mut cases = Vec::new();
    for subject in subjects() {
        let grid = subject.volume.grid();
        let size_mm = grid.size_mm();
        let middle = (size_mm - grid.spacing_mm()) / 2.0;
        let at = middle + DVec3::new(0.9, 1.1, 0.8) * size_mm.max_element() * 1.2;
        for (look, json) in looks(subject.low, subject.high, subject.opacity) {
            cases.push(Case {
                name: format!("{}: {look}", subject.name),
                shown: Shown::new(subject.volume.clone(), &json),
                eye: eye(at, middle, fov(30.0, SIZE)),
                size: SIZE,
            });
        }
    }
    cases
}

/// The bundled scans as the bundled scenes show them.
pub(crate) fn scans() -> Vec<Case> {
    let assets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let mut cases = Vec::new();
    for name in ["bones", "bones-over-xray", "brain", "demo", "xray"] {
        let path = assets.join("scenes").join(format!("{name}.json"));
        let json = std::fs::read_to_string(&path).unwrap();
        let file = scene::SceneFile::from_json(&json).unwrap();
        let volume = path.parent().unwrap().join(file.volume.as_ref().unwrap());
        let loaded = volume_io::load(&volume, &volume_io::LoadOptions::default()).unwrap();
        let camera = file.camera.unwrap();
        cases.push(Case {
            name: format!("scan: {name}"),
            shown: Shown::new(loaded.volume, &json),
            eye: EyeView {
                world_from_eye: camera.pose_mm().unwrap(),
                fov: camera.fov(SCAN_SIZE[0], SCAN_SIZE[1]).unwrap(),
            },
            size: SCAN_SIZE,
        });
    }
    cases
}
