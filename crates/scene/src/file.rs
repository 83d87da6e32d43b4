//! The scene file.

use crate::error::{SceneError, within};
use crate::further::{self, FurtherFacts, FurtherVolume, VolumeSource};
use crate::{
    Camera, Headlight, LabelFacts, LabelLooks, LabelsFile, Mode, Placement, Play, Preset, Scene,
    TransferFunction, Window,
};
use std::path::PathBuf;

/// Largest scene file in bytes: a scene is some numbers, not data.
const LARGEST_FILE: usize = 256 * 1024;

/// A scene as a person writes it. What is left out is filled from the volume.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SceneFile {
    /// For people; not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub description: Option<String>,
    /// The volume's file, relative to the scene file. The command line may name another.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<PathBuf>,
    /// Channel of the volume, by name or by number from 0. Default: the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<ChannelChoice>,
    /// The look that fills what the scene leaves out: `holocast presets` names them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Whether the first volume is seen, in mode emission-absorption.
    #[serde(skip_serializing_if = "is_true")]
    pub shown: bool,
    /// Volumes that are shown together with the first, in mode emission-absorption: at most 4 at a time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub further_volumes: Vec<FurtherVolume>,
    /// How samples become a pixel. Default: emission-absorption.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<Mode>,
    /// `[[value, red, green, blue, opacity per mm], …]`, in the order of values, linear between. Default: a grey ramp
    /// over the window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer: Option<TransferFunction>,
    /// A file with a transfer function instead, relative to the scene file: a volume property or `presets.xml` of 3D
    /// Slicer (`presets.xml#CT-AAA`), or a colour map of ParaView.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer_file: Option<String>,
    /// How labels look, where the channel holds labels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsFile>,
    /// Value of the surface in the modes threshold and cumulated. Default: the middle of the window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Colour of that surface, RGB 0 to 1. Default: that of the transfer function, if one is given, else ivory.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_color: Option<[f64; 3]>,
    /// Opacity of that surface, 0 to 1. Default: 1 in mode threshold, 0.6 in mode cumulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface_opacity: Option<f64>,
    /// `[low, high]`: values from black to white. Default: the 2nd and 99.8th percentile.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// Light emission-absorption pictures by a headlight.
    pub shade: bool,
    /// The headlight's numbers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<Headlight>,
    /// Where the volume lies in the room.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub placement: Option<Placement>,
    /// How the first volume is played, where its file is a series in time. Default: the step on view stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<Play>,
    /// What stands behind, RGB 0 to 1. Default: black, which is transparent on an additive display.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<[f64; 3]>,
    /// Where a still is taken from. Headsets bring their own eyes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Width and height of a still in pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Distance of samples along a ray of a still, millimetres. Default: by quality.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_mm: Option<f64>,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde asks for a reference")]
fn is_true(shown: &bool) -> bool {
    *shown
}

impl Default for SceneFile {
    fn default() -> Self {
        Self {
            description: None,
            volume: None,
            channel: None,
            preset: None,
            shown: true,
            further_volumes: Vec::new(),
            mode: None,
            transfer: None,
            transfer_file: None,
            labels: None,
            threshold: None,
            surface_color: None,
            surface_opacity: None,
            window: None,
            shade: false,
            light: None,
            placement: None,
            play: None,
            background: None,
            camera: None,
            size: None,
            step_mm: None,
        }
    }
}

/// A channel by name or by number.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum ChannelChoice {
    /// Counted from 0.
    Number(usize),
    /// As the file or its header calls it.
    Name(String),
}

/// What a scene needs to know of a channel to fill its gaps.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelFacts {
    /// The channel's name.
    pub name: String,
    /// Lowest value.
    pub minimum: f64,
    /// Highest value.
    pub maximum: f64,
    /// Value that 2 % of the samples lie below.
    pub percentile_2: f64,
    /// Value that 99.8 % of the samples lie below.
    pub percentile_99_8: f64,
    /// Its labels, where it holds labels.
    pub labels: Option<LabelFacts>,
}

/// What a scene needs to know of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeFacts {
    /// One for each channel.
    pub channels: Vec<ChannelFacts>,
    /// `CT`, `MR`, `PT`, … where it is known.
    pub modality: Option<String>,
}

impl VolumeFacts {
    /// Counts a volume's values; reads all samples.
    #[must_use]
    pub fn of(volume: &volume::Volume) -> Self {
        let channel = |c: &volume::Channel| {
            let statistics = volume::Statistics::of(c);
            ChannelFacts {
                name: c.name.clone(),
                minimum: statistics.minimum,
                maximum: statistics.maximum,
                percentile_2: statistics.percentile(0.02),
                percentile_99_8: statistics.percentile(0.998),
                labels: (c.kind == volume::ChannelKind::Label).then(|| LabelFacts {
                    present: c.label_counts().iter().map(|l| l.number).collect(),
                    ..LabelFacts::default()
                }),
            }
        };
        Self { channels: volume.channels().iter().map(channel).collect(), modality: None }
    }

    /// The same with the modality that the file or a person names.
    #[must_use]
    pub fn with_modality(self, modality: Option<&str>) -> Self {
        Self { modality: modality.map(str::to_owned), ..self }
    }

    /// The same with what the volume's file says of its labels.
    #[must_use]
    pub fn with_labels(mut self, table: &volume::LabelTable) -> Self {
        for labels in self.channels.iter_mut().filter_map(|c| c.labels.as_mut()) {
            labels.table = table.clone();
        }
        self
    }

    /// The same for another step of a series in time: numbers that fill a scene's gaps stay, so that a picture does not
    /// flicker where values go up and down. So do the labels that a scene can name: one is right or wrong for all steps.
    #[must_use]
    pub fn with_step(&self, step: &volume::Volume) -> Self {
        let mut facts = self.clone();
        for (of, channel) in facts.channels.iter_mut().zip(step.channels()) {
            if let Some(labels) = &mut of.labels {
                labels.in_step = channel.label_counts().iter().map(|l| l.number).collect();
            }
        }
        facts
    }

    /// The number of the channel that was asked for; the first, if none was.
    pub(crate) fn channel_index(&self, choice: Option<&ChannelChoice>) -> Result<usize, SceneError> {
        let found = match choice {
            None => (!self.channels.is_empty()).then_some(0),
            Some(ChannelChoice::Number(n)) => (*n < self.channels.len()).then_some(*n),
            Some(ChannelChoice::Name(name)) => self.channels.iter().position(|c| c.name == *name),
        };
        found.ok_or_else(|| SceneError::NoSuchChannel {
            wanted: match choice {
                None => "0".into(),
                Some(ChannelChoice::Number(n)) => n.to_string(),
                Some(ChannelChoice::Name(name)) => name.clone(),
            },
            available: self
                .channels
                .iter()
                .enumerate()
                .map(|(i, c)| format!("{i} '{}'", c.name))
                .collect::<Vec<_>>()
                .join(", "),
        })
    }
}

impl SceneFile {
    /// Reads a scene from JSON text and checks every number in it.
    ///
    /// # Errors
    /// If it is not JSON, has an unknown field, or a number is out of its range.
    pub fn from_json(text: &str) -> Result<Self, SceneError> {
        if text.len() > LARGEST_FILE {
            return Err(SceneError::Range {
                field: "the whole file".into(),
                found: format!("{} bytes", text.len()),
                expected: "at most 256 KiB",
            });
        }
        // A list would be taken for the fields in their order, which nobody has promised.
        if text.trim_start().starts_with('[') {
            return Err(SceneError::Json("found a list, expected an object with fields".into()));
        }
        let file: Self = serde_json::from_str(text).map_err(|e| SceneError::Json(e.to_string()))?;
        file.check()?;
        Ok(file)
    }

    /// The scene as JSON text.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Serialising plain numbers and strings into memory has nothing that could fail.
        serde_json::to_string_pretty(self).unwrap_or_default()
    }

    fn check(&self) -> Result<(), SceneError> {
        if let Some(preset) = &self.preset {
            Preset::named(preset)?;
        }
        if let Some(transfer) = &self.transfer {
            transfer.check()?;
        }
        if let Some(labels) = &self.labels {
            labels.check()?;
        }
        if let Some(threshold) = self.threshold {
            within("threshold", threshold, -1.0e12..=1.0e12, "a finite number within 1e12")?;
        }
        if let Some(window) = self.window {
            window.check("window")?;
        }
        further::check(&self.further_volumes)?;
        for (field, color) in [("surface_color", self.surface_color), ("background", self.background)] {
            for c in color.into_iter().flatten() {
                within(field, c, 0.0..=1.0, "0 to 1")?;
            }
        }
        if let Some(opacity) = self.surface_opacity {
            within("surface_opacity", opacity, 0.0..=1.0, "0 to 1")?;
        }
        if let Some(light) = &self.light {
            light.check()?;
        }
        if let Some(placement) = &self.placement {
            placement.check()?;
        }
        if let Some(play) = &self.play {
            play.check()?;
        }
        if let Some(camera) = &self.camera {
            camera.check()?;
        }
        for side in self.size.into_iter().flatten() {
            within("size", f64::from(side), 1.0..=16384.0, "1 to 16384 pixels")?;
        }
        if let Some(step) = self.step_mm {
            within("step_mm", step, 1.0e-9..=1.0e6, "1e-9 to 1e6 mm")?;
        }
        Ok(())
    }

    /// The files that further volumes are read from, each once, in the order in which they are named first; those of
    /// hidden volumes too, or only those of shown ones.
    #[must_use]
    pub fn further_sources(&self, shown_only: bool) -> Vec<VolumeSource> {
        let mut sources = Vec::new();
        for source in
            self.further_volumes.iter().filter(|f| f.shown || !shown_only).filter_map(FurtherVolume::source)
        {
            if !sources.contains(&source) {
                sources.push(source);
            }
        }
        sources
    }

    /// Fills what was left out from the volume's facts.
    ///
    /// # Errors
    /// If the volume has no such channel, a number is out of its range, or the scene shows a further volume from a file.
    pub fn resolve(&self, facts: &VolumeFacts) -> Result<Scene, SceneError> {
        self.resolve_among(facts, &[])
    }

    /// Fills what was left out from the facts of the first volume and of the `others` that are there beside it.
    ///
    /// # Errors
    /// If a volume is not there or has no such channel, a number is out of its range, or the mode shows one volume only.
    pub fn resolve_among(&self, facts: &VolumeFacts, others: &[FurtherFacts]) -> Result<Scene, SceneError> {
        self.check()?;
        if let Some(file) = &self.transfer_file {
            return Err(SceneError::File { field: "transfer_file", file: file.clone() });
        }
        let channel = facts.channel_index(self.channel.as_ref())?;
        let of = &facts.channels[channel];
        let filled;
        let file = match &self.preset {
            Some(preset) => {
                filled = Preset::named(preset)?.applied(self, facts, of)?;
                &filled
            }
            None => self,
        };
        let shown = self.further_volumes.iter().filter(|f| f.shown);
        let further: Vec<_> =
            shown.map(|f| f.resolve(facts, others, file.light)).collect::<Result<_, _>>()?;
        further::check_shown(file.mode.unwrap_or(Mode::EmissionAbsorption), self.shown, further.len())?;
        Ok(Scene { further, ..file.filled(channel, of)? })
    }

    /// The first volume alone, with what is left out filled from the channel.
    fn filled(&self, channel: usize, of: &ChannelFacts) -> Result<Scene, SceneError> {
        let window = self.window.unwrap_or_else(|| default_window(of));
        // A label that has no look is not seen.
        let labels =
            self.label_looks(of)?.map(|looks| if self.shown { looks } else { LabelLooks::default() });
        let transfer = match &self.transfer {
            // Without a point it is transparent everywhere.
            _ if !self.shown => TransferFunction::default(),
            Some(transfer) => transfer.clone(),
            None => default_transfer(window, self.mode)?,
        };
        let threshold = self.threshold.unwrap_or((window.low + window.high) / 2.0);
        let surface_color = self.surface_color.unwrap_or_else(|| match &self.transfer {
            Some(transfer) if !transfer.points().is_empty() => transfer.at(threshold).color,
            _ => [0.95, 0.9, 0.8],
        });
        Ok(Scene {
            channel,
            mode: self.mode.unwrap_or(Mode::EmissionAbsorption),
            transfer,
            labels,
            threshold,
            surface_color,
            surface_opacity: self.surface_opacity.unwrap_or(match self.mode {
                Some(Mode::Cumulated) => 0.6,
                _ => 1.0,
            }),
            window,
            light: (self.shade || self.light.is_some()).then(|| self.light.unwrap_or_default()),
            placement: self.placement.unwrap_or_default(),
            background: self.background.unwrap_or_default(),
            further: Vec::new(),
        })
    }

    fn label_looks(&self, of: &ChannelFacts) -> Result<Option<LabelLooks>, SceneError> {
        let channel = || of.name.clone();
        let Some(facts) = &of.labels else {
            return match self.labels {
                Some(_) => Err(SceneError::NotLabels { channel: channel() }),
                None => Ok(None),
            };
        };
        if let Some(mode) = self.mode.filter(|&mode| mode != Mode::EmissionAbsorption) {
            return Err(SceneError::LabelMode { channel: channel(), mode: mode.name() });
        }
        let labels = self.labels.as_ref();
        if let Some(file) = labels.and_then(|labels| labels.file.as_ref()) {
            let file = file.display().to_string();
            return Err(SceneError::File { field: "labels.file", file });
        }
        labels.unwrap_or(&LabelsFile::default()).resolve(facts, self.transfer.as_ref()).map(Some)
    }
}

/// The range without its outliers; the whole range, or one value wide, where that is empty.
pub(crate) fn default_window(of: &ChannelFacts) -> Window {
    let (low, high) = (of.percentile_2, of.percentile_99_8);
    if low < high {
        Window { low, high }
    } else if of.minimum < of.maximum {
        Window { low: of.minimum, high: of.maximum }
    } else {
        Window { low: of.minimum - 0.5, high: of.minimum + 0.5 }
    }
}

/// A grey ramp over the window; thin enough for volume rendering that the inside shows, or the window itself for the
/// maximum.
pub(crate) fn default_transfer(window: Window, mode: Option<Mode>) -> Result<TransferFunction, SceneError> {
    let densest = if mode == Some(Mode::Maximum) { 1.0 } else { 0.12 };
    TransferFunction::new(vec![
        [window.low, 0.0, 0.0, 0.0, 0.0].into(),
        [window.high, 1.0, 1.0, 1.0, densest].into(),
    ])
}

/// The JSON Schema of [`SceneFile`], as text; `docs/scene.schema.json` holds it.
#[must_use]
pub fn schema_json() -> String {
    let schema = schemars::schema_for!(SceneFile);
    // A schema is plain JSON: there is nothing in it that could fail to be written.
    serde_json::to_string_pretty(&schema).unwrap_or_default() + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> VolumeFacts {
        let channel = |name: &str| ChannelFacts {
            name: name.into(),
            minimum: -1000.0,
            maximum: 3000.0,
            percentile_2: -1000.0,
            percentile_99_8: 1200.0,
            labels: None,
        };
        VolumeFacts { channels: vec![channel("ct"), channel("pet")], modality: None }
    }

    #[test]
    fn an_empty_scene_shows_the_first_channel() {
        let scene = SceneFile::from_json("{}").unwrap().resolve(&facts()).unwrap();
        assert_eq!((scene.channel, scene.mode), (0, Mode::EmissionAbsorption));
        assert_eq!(scene.window, Window { low: -1000.0, high: 1200.0 });
        assert_eq!(scene.threshold, 100.0);
        assert_eq!(scene.background, [0.0; 3]);
        assert!(scene.light.is_none());
    }

    #[test]
    fn peer_scenes_are_scene_files() {
        let text = r#"{"description": "d", "volume": "../ct/x.nii.gz", "mode": "mip",
            "transfer": [[-1000, 0, 0, 0, 0], [1500, 1, 1, 1, 0.95]], "shade": false,
            "camera": {"eye": [1, 2, 3], "target": [0, 0, 0], "up": [0, 0, 1], "fov_y_deg": 30},
            "size": [640, 360], "step_mm": 1.5624, "background": [0, 0, 0]}"#;
        let file = SceneFile::from_json(text).unwrap();
        assert_eq!(file.mode, Some(Mode::Maximum));
        assert_eq!(file.transfer.as_ref().unwrap().points()[1].opacity_per_mm, 0.95);
        file.resolve(&facts()).unwrap();
    }

    #[test]
    fn says_what_is_wrong() {
        let message = |text: &str| SceneFile::from_json(text).unwrap_err().to_string();
        assert!(message(r#"{"colour": 1}"#).contains("unknown field `colour`"));
        assert!(message(" []").contains("found a list"));
        assert!(message(r#"{"threshold": NaN}"#).contains("line 1"));
        assert!(message(r#"{"threshold": 1e999}"#).contains("line 1"));
        assert!(message(r#"{"window": [5, 5]}"#).contains("low below high"));
        assert!(
            message(r#"{"transfer": [[1,0,0,0,0],[0,0,0,0,0]]}"#).contains("in the order of their values")
        );
        assert!(message(r#"{"transfer": [[1,0,0,0]]}"#).contains("array of length 5"));
        assert!(message(r#"{"placement": {"scale": 0}}"#).contains("placement.scale"));
        assert!(
            message(r#"{"camera": {"eye":[0,0,0],"target":[0,0,0],"up":[0,0,1],"fov_y_deg":30}}"#)
                .contains("span a picture")
        );
        assert!(message(&" ".repeat(LARGEST_FILE + 1)).contains("256 KiB"));
    }

    #[test]
    fn names_the_channels_there_are() {
        let file = SceneFile::from_json(r#"{"channel": "mr"}"#).unwrap();
        let message = file.resolve(&facts()).unwrap_err().to_string();
        assert!(message.contains("'mr'") && message.contains("0 'ct', 1 'pet'"), "{message}");
        let by_name = SceneFile::from_json(r#"{"channel": "pet"}"#).unwrap().resolve(&facts()).unwrap();
        assert_eq!(by_name.channel, 1);
    }

    #[test]
    fn the_labels_that_a_scene_can_name_are_those_of_the_first_step() {
        let step = |numbers: [u8; 2]| {
            let channel = volume::Channel {
                name: "organs".into(),
                kind: volume::ChannelKind::Label,
                voxels: volume::Voxels::U8(numbers.to_vec().into()),
                slope: 1.0,
                intercept: 0.0,
            };
            let grid = volume::Grid::axis_aligned([2, 1, 1], spatial::DVec3::ONE).unwrap();
            volume::Volume::new(grid, vec![channel]).unwrap()
        };
        let first = VolumeFacts::of(&step([0, 7]));
        let second = first.with_step(&step([0, 3]));
        let scene = SceneFile::from_json(r#"{"labels": {"only": [7]}}"#).unwrap();
        let looks = scene.resolve(&second).unwrap().labels.unwrap();
        assert!(looks.at(7).opacity_per_mm > 0.0);
        assert_eq!(looks.at(3).opacity_per_mm, 0.0);
        // One that comes later is seen, and is as unknown to a scene as it was at the beginning.
        let looks =
            SceneFile::from_json(r#"{"labels": {}}"#).unwrap().resolve(&second).unwrap().labels.unwrap();
        assert_eq!(looks.at(3).opacity_per_mm, 1.0);
        let early = SceneFile::from_json(r#"{"labels": {"only": [3]}}"#).unwrap();
        for facts in [&first, &second] {
            assert!(early.resolve(facts).unwrap_err().to_string().contains('3'));
        }
        let with_table =
            SceneFile::from_json(r#"{"labels": {"only": [3], "table": [{"number": 3}]}}"#).unwrap();
        assert_eq!(with_table.resolve(&second).unwrap().labels.unwrap().at(3).opacity_per_mm, 1.0);
    }

    #[test]
    fn what_is_written_is_read_again() {
        let file = SceneFile::from_json(
            r#"{"mode": "threshold", "threshold": 300, "window": [0, 1], "shade": true}"#,
        )
        .unwrap();
        assert_eq!(SceneFile::from_json(&file.to_json()).unwrap(), file);
    }

    #[test]
    fn the_committed_schema_is_that_of_the_code() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/scene.schema.json");
        if std::env::var_os("UPDATE_SCHEMA").is_some() {
            std::fs::write(path, schema_json()).unwrap();
        }
        let committed = std::fs::read_to_string(path).unwrap();
        assert!(
            committed == schema_json(),
            "run UPDATE_SCHEMA=1 cargo test -p scene, and look at the difference"
        );
    }
}
