//! Looks by modality and purpose, in `assets/presets.json`.

use crate::error::SceneError;
use crate::file::default_window;
use crate::{ChannelFacts, Headlight, Mode, SceneFile, TransferFunction, TransferPoint, VolumeFacts, Window};
use std::sync::OnceLock;

/// Lowest value from which a volume that names no modality is taken for a CT in Hounsfield units: there is air or lung in
/// it, ...
const AIR_HU: f64 = -500.0;
/// ... and bone or contrast agent, ...
const BONE_HU: f64 = 150.0;
/// ... and nothing below what scanners write outside their circle.
const PADDING_HU: f64 = -10_000.0;
/// The window in which most of a body's tissue is told apart, HU.
const TISSUE_HU: Window = Window { low: -160.0, high: 240.0 };

/// What the values of a preset are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PresetUnits {
    /// Hounsfield units.
    Hounsfield,
    /// Parts of the way from the channel's 2nd (0) to its 99.8th percentile (1): for what has no absolute units.
    Window,
    /// None: labels are shown.
    Labels,
}

impl PresetUnits {
    /// In words.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Hounsfield => "HU",
            Self::Window => "parts from the 2nd to the 99.8th percentile",
            Self::Labels => "labels",
        }
    }
}

/// A look with a name.
#[derive(Clone, Debug, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// As `--preset` and scene files call it.
    pub name: String,
    /// What is seen.
    pub description: String,
    /// The modalities it is made for, as DICOM codes them; none: all.
    pub modalities: Vec<String>,
    /// What its values are.
    pub units: PresetUnits,
    look: Look,
}

/// What a preset says; the names are those of [`SceneFile`].
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Look {
    mode: Option<Mode>,
    transfer: Option<TransferFunction>,
    window: Option<Window>,
    threshold: Option<f64>,
    surface_color: Option<[f64; 3]>,
    surface_opacity: Option<f64>,
    light: Option<Headlight>,
}

impl Preset {
    /// All presets.
    #[must_use]
    pub fn all() -> &'static [Self] {
        static ALL: OnceLock<Vec<Preset>> = OnceLock::new();
        // A test reads the same text: it is whole.
        ALL.get_or_init(|| {
            serde_json::from_str(include_str!("../../../assets/presets.json")).unwrap_or_default()
        })
    }

    /// The preset of a name.
    ///
    /// # Errors
    /// If there is none; the message names those there are.
    pub fn named(name: &str) -> Result<&'static Self, SceneError> {
        Self::all()
            .iter()
            .find(|p| p.name == name)
            .ok_or_else(|| SceneError::NoSuchPreset { wanted: name.to_owned(), available: names(|_| true) })
    }

    /// The preset to begin with: by what the file says of its modality, else by the values.
    #[must_use]
    pub fn suggested(facts: &VolumeFacts, channel: &ChannelFacts) -> &'static str {
        if channel.labels.is_some() {
            return "labels";
        }
        match facts.modality.as_deref() {
            Some("MR") => "mr-tissue",
            Some("PT" | "NM") => "pet-hot",
            Some("CT") => "bone",
            _ if is_hounsfield(channel) => "bone",
            _ => "surface",
        }
    }

    /// The window to begin with: soft tissue for a CT, else from the 2nd to the 99.8th percentile.
    #[must_use]
    pub fn suggested_window(facts: &VolumeFacts, channel: &ChannelFacts) -> Window {
        match facts.modality.as_deref() {
            Some("CT") => TISSUE_HU,
            None if is_hounsfield(channel) => TISSUE_HU,
            _ => default_window(channel),
        }
    }

    /// Fills what a scene leaves out.
    ///
    /// # Errors
    /// If the volume is of another modality, or its values are not in the preset's units.
    pub(crate) fn applied(
        &self,
        file: &SceneFile,
        facts: &VolumeFacts,
        of: &ChannelFacts,
    ) -> Result<SceneFile, SceneError> {
        self.check_fit(facts, of)?;
        let Window { low, high } = match self.units {
            PresetUnits::Window => default_window(of),
            _ => Window { low: 0.0, high: 1.0 },
        };
        let value = |v: f64| low + (high - low) * v;
        let look = &self.look;
        let transfer = match &look.transfer {
            None => None,
            Some(transfer) => {
                let moved = |p: &TransferPoint| TransferPoint { value: value(p.value), ..*p };
                Some(TransferFunction::new(transfer.points().iter().map(moved).collect())?)
            }
        };
        let window = look.window.map(|w| Window { low: value(w.low), high: value(w.high) });
        // In another mode the preset's opacities mean something else.
        let is_same_mode = file.mode.is_none_or(|mode| mode == look.mode.unwrap_or(Mode::EmissionAbsorption));
        Ok(SceneFile {
            mode: file.mode.or(look.mode),
            transfer: file.transfer.clone().or(transfer.filter(|_| is_same_mode)),
            window: file.window.or(window),
            threshold: file.threshold.or(look.threshold.map(value)),
            surface_color: file.surface_color.or(look.surface_color),
            surface_opacity: file.surface_opacity.or(look.surface_opacity),
            light: file.light.or(look.light),
            ..file.clone()
        })
    }

    fn check_fit(&self, facts: &VolumeFacts, of: &ChannelFacts) -> Result<(), SceneError> {
        let wrong = |found: String| {
            let fits = names(|p| p.misfit(facts, of).is_none());
            Err(SceneError::PresetFit { preset: self.name.clone(), wants: self.wants(), found, fits })
        };
        self.misfit(facts, of).map_or(Ok(()), wrong)
    }

    fn wants(&self) -> String {
        match (self.units, self.modalities.as_slice()) {
            (PresetUnits::Hounsfield, _) => "a CT in Hounsfield units".to_owned(),
            (PresetUnits::Labels, _) => "labels".to_owned(),
            (PresetUnits::Window, []) => "measured values".to_owned(),
            (PresetUnits::Window, modalities) => modalities.join(" or "),
        }
    }

    /// Why this preset does not fit, if it does not.
    fn misfit(&self, facts: &VolumeFacts, of: &ChannelFacts) -> Option<String> {
        if of.labels.is_some() != (self.units == PresetUnits::Labels) {
            let is = if of.labels.is_some() { "labels" } else { "measured values" };
            return Some(format!("channel '{}' holds {is}", of.name));
        }
        match &facts.modality {
            Some(modality) if self.modalities.is_empty() || self.modalities.contains(modality) => None,
            Some(modality) => Some(format!("this volume is {modality}")),
            None if self.units == PresetUnits::Hounsfield && !is_hounsfield(of) => Some(format!(
                "this volume names no modality, and its values, {} to {}, do not look like them",
                of.minimum, of.maximum
            )),
            None => None,
        }
    }
}

/// Whether values are Hounsfield units, by their range.
fn is_hounsfield(of: &ChannelFacts) -> bool {
    (PADDING_HU..=AIR_HU).contains(&of.minimum) && of.maximum >= BONE_HU
}

fn names(wanted: impl Fn(&Preset) -> bool) -> String {
    let names: Vec<&str> = Preset::all().iter().filter(|p| wanted(p)).map(|p| p.name.as_str()).collect();
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LabelFacts;

    fn facts(modality: Option<&str>, minimum: f64, maximum: f64) -> VolumeFacts {
        let channel = ChannelFacts {
            name: "image".into(),
            minimum,
            maximum,
            percentile_2: minimum,
            percentile_99_8: maximum,
            labels: None,
        };
        VolumeFacts { channels: vec![channel], modality: modality.map(str::to_owned) }
    }

    fn with(preset: &str, facts: &VolumeFacts) -> Result<crate::Scene, SceneError> {
        SceneFile { preset: Some(preset.to_owned()), ..SceneFile::default() }.resolve(facts)
    }

    #[test]
    fn every_preset_is_whole_and_fits_what_it_is_made_for() {
        let text = include_str!("../../../assets/presets.json");
        let all: Vec<Preset> = serde_json::from_str(text).unwrap();
        assert_eq!(all, Preset::all());
        for preset in &all {
            let facts = match preset.units {
                PresetUnits::Labels => {
                    let mut facts = facts(None, 0.0, 3.0);
                    facts.channels[0].labels =
                        Some(LabelFacts { present: vec![0, 1], ..LabelFacts::default() });
                    facts
                }
                _ => facts(preset.modalities.first().map(String::as_str), -1000.0, 3000.0),
            };
            let scene = with(&preset.name, &facts).unwrap_or_else(|e| panic!("{}: {e}", preset.name));
            assert!(scene.transfer.points().len() > 1, "{}", preset.name);
            assert_eq!(all.iter().filter(|p| p.name == preset.name).count(), 1);
        }
    }

    #[test]
    fn hounsfield_presets_fit_any_ct_and_nothing_else() {
        with("bone", &facts(Some("CT"), 0.0, 60.0)).unwrap();
        with("bone", &facts(None, -1024.0, 1851.0)).unwrap();
        for (facts, why) in
            [(facts(Some("MR"), -1000.0, 3000.0), "this volume is MR"), (facts(None, 0.0, 255.0), "0 to 255")]
        {
            let message = with("bone", &facts).unwrap_err().to_string();
            assert!(message.contains(why) && message.contains("surface"), "{message}");
            assert!(message.contains("--modality"), "{message}");
        }
        assert!(with("bones", &facts(None, 0.0, 1.0)).unwrap_err().to_string().contains("mip-angiography"));
    }

    #[test]
    fn relative_presets_follow_the_percentiles() {
        let scene = with("mr-brain", &facts(Some("MR"), 100.0, 300.0)).unwrap();
        let values: Vec<f64> = scene.transfer.points().iter().map(|p| p.value).collect();
        assert!((values[1] - 170.0).abs() < 1e-9 && (values[4] - 320.0).abs() < 1e-9, "{values:?}");
        let maximum = with("mr-angiography", &facts(None, 0.0, 10.0)).unwrap();
        assert_eq!((maximum.mode, maximum.window), (Mode::Maximum, Window { low: 3.0, high: 10.0 }));
    }

    #[test]
    fn what_the_scene_says_goes_before_the_preset() {
        let file = SceneFile::from_json(r#"{"preset": "bone", "transfer": [[0, 1, 0, 0, 0.5]]}"#).unwrap();
        let scene = file.resolve(&facts(Some("CT"), -1000.0, 1000.0)).unwrap();
        assert_eq!(scene.transfer.points().len(), 1);
        assert!(scene.light.is_some_and(|l| l.power == 20.0), "the rest is the preset's");
        let file = SceneFile::from_json(r#"{"preset": "bone", "mode": "maximum"}"#).unwrap();
        let scene = file.resolve(&facts(Some("CT"), -1000.0, 1000.0)).unwrap();
        assert_eq!(scene.transfer.points().len(), 2, "opacities of a millimetre are none of a maximum");
        assert!(SceneFile::from_json(r#"{"preset": "bones"}"#).is_err());
    }

    #[test]
    fn suggestions_follow_modality_and_values() {
        let of = |facts: &VolumeFacts| Preset::suggested(facts, &facts.channels[0]);
        assert_eq!(of(&facts(Some("PT"), 0.0, 30.0)), "pet-hot");
        assert_eq!(of(&facts(Some("MR"), 0.0, 30.0)), "mr-tissue");
        assert_eq!(of(&facts(None, -1000.0, 1400.0)), "bone");
        assert_eq!(of(&facts(None, -8.0, 18.0)), "surface");
        let ct = facts(None, -1000.0, 1400.0);
        assert_eq!(Preset::suggested_window(&ct, &ct.channels[0]), TISSUE_HU);
    }
}
