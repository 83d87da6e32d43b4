//! Further volumes of a scene, in register with the first.

use crate::error::{SceneError, within};
use crate::file::{ChannelChoice, VolumeFacts, default_transfer, default_window};
use crate::{Headlight, LabelLooks, LabelsFile, Mode, TransferFunction, TransferPoint, Window};
use spatial::{DAffine3, DMat3, DVec3};
use std::path::{Path, PathBuf};
use volume::{ChannelKind, Grid, GridError};

/// Most volumes that are shown at a time, the first counted.
pub const MOST_VOLUMES: usize = 4;
/// Most further volumes that a scene may name, shown or hidden.
const MOST_NAMED: usize = 16;

/// A further volume as a person writes it. It lies where its own file says in the patient, as the first does.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FurtherVolume {
    /// What people call it. Default: its file's name, and its channel's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its file, relative to the scene file. Default: the scene's first volume, of which another channel is shown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume: Option<PathBuf>,
    /// Which series of a folder of DICOM files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub series: Option<String>,
    /// What its voxels hold. Default: what its file says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<VoxelKind>,
    /// Channel, by name or by number from 0. Default: the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub channel: Option<ChannelChoice>,
    /// Whether it is seen. A hidden one costs no time.
    pub shown: bool,
    /// `[[value, red, green, blue, opacity per mm], …]`, as the scene's. Default: a grey ramp over the window.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer: Option<TransferFunction>,
    /// How labels look, where the channel holds labels; as the scene's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub labels: Option<LabelsFile>,
    /// `[low, high]`: values from transparent to densest where no transfer function is given. Default: the 2nd and 99.8th
    /// percentile.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// What the opacities of the transfer function, or of the labels, are multiplied by, 0 to 1.
    pub opacity: f64,
    /// Light it by the scene's headlight.
    pub shade: bool,
    /// Three rows of four numbers: takes the patient millimetres (LPS) of this volume's file to those of the first
    /// volume's. Default: they are the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub registration: Option<Registration>,
}

impl Default for FurtherVolume {
    fn default() -> Self {
        Self {
            name: None,
            volume: None,
            series: None,
            kind: None,
            channel: None,
            shown: true,
            transfer: None,
            labels: None,
            window: None,
            opacity: 1.0,
            shade: false,
            registration: None,
        }
    }
}

/// What the voxels of a file hold.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum VoxelKind {
    /// Measured values.
    Intensity,
    /// Labels.
    Label,
}

impl From<VoxelKind> for ChannelKind {
    fn from(kind: VoxelKind) -> Self {
        match kind {
            VoxelKind::Intensity => Self::Intensity,
            VoxelKind::Label => Self::Label,
        }
    }
}

/// An affine transform as three rows of four numbers; the fourth of each is a shift in millimetres.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(transparent)]
pub struct Registration(pub [[f64; 4]; 3]);

impl Registration {
    /// The same as a transform of points.
    #[must_use]
    pub fn first_from_own(&self) -> DAffine3 {
        let column = |i: usize| DVec3::new(self.0[0][i], self.0[1][i], self.0[2][i]);
        DAffine3::from_mat3_translation(DMat3::from_cols(column(0), column(1), column(2)), column(3))
    }

    fn check(&self, field: &str) -> Result<(), SceneError> {
        for x in self.0.into_iter().flatten() {
            within(field, x, -1.0e6..=1.0e6, "numbers within 1e6")?;
        }
        let volume = self.first_from_own().matrix3.determinant().abs();
        within(
            field,
            volume,
            1.0e-6..=1.0e6,
            "a transform whose determinant is 1e-6 to 1e6, or the negative of it",
        )?;
        Ok(())
    }
}

/// A file that a further volume is read from.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct VolumeSource {
    /// As the scene names it.
    pub path: PathBuf,
    /// Which series of a folder of DICOM files.
    pub series: Option<String>,
    /// What its voxels are said to hold.
    pub kind: Option<VoxelKind>,
}

impl std::fmt::Display for VolumeSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.path.display())?;
        match &self.series {
            Some(series) => write!(f, " (series {series})"),
            None => Ok(()),
        }
    }
}

/// A volume that is there beside the first.
#[derive(Clone, Debug, PartialEq)]
pub struct FurtherFacts {
    /// Where it came from: scenes name it so.
    pub source: VolumeSource,
    /// What is in it.
    pub facts: VolumeFacts,
}

/// A further volume that is shown, complete and checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Further {
    /// What people call it.
    pub name: String,
    /// Which volume: 0 for the first, then those that are there beside it, in their order.
    pub volume: usize,
    /// Which channel of it.
    pub channel: usize,
    /// Colour and opacity by value; the file's factor is in it.
    pub transfer: TransferFunction,
    /// What each label does to light, where the channel holds labels: then the transfer function is not looked at. The
    /// file's factor is in it.
    pub labels: Option<LabelLooks>,
    /// Its light, if it is lit.
    pub light: Option<Headlight>,
    /// From the patient millimetres of its file to those of the first volume's.
    pub first_from_own: DAffine3,
}

impl Further {
    /// Its grid in the patient space of the first volume. No voxel is touched: only where they lie is another.
    ///
    /// # Errors
    /// If the transform takes the grid's spacing or axes out of what a grid may have.
    pub fn grid(&self, own: &Grid) -> Result<Grid, GridError> {
        Grid::new(own.dims(), self.first_from_own * own.volume_from_index())
    }

    /// How much of it lies within the border of the first volume, 0 to 1: of 16³ points spread over it. 0 tells of files that
    /// do not belong to one patient and one visit, or of a registration that is none.
    ///
    /// # Errors
    /// As [`Self::grid`].
    pub fn share_within(&self, first: &Grid, own: &Grid) -> Result<f64, GridError> {
        const POINTS: u32 = 16;
        let grid = self.grid(own)?;
        let first_texture_from_own = (first.volume_from_index() * first.index_from_texture()).inverse()
            * grid.volume_from_index()
            * grid.index_from_texture();
        let at = |i: u32| (f64::from(i) + 0.5) / f64::from(POINTS);
        let count = (0..POINTS.pow(3)).filter(|i| {
            let place = DVec3::new(at(i % POINTS), at(i / POINTS % POINTS), at(i / POINTS / POINTS));
            let p = first_texture_from_own.transform_point3(place);
            p.min_element() >= 0.0 && p.max_element() <= 1.0
        });
        Ok(count.count() as f64 / f64::from(POINTS.pow(3)))
    }
}

impl FurtherVolume {
    /// The file that it is read from; `None` for the first volume's.
    #[must_use]
    pub fn source(&self) -> Option<VolumeSource> {
        let path = self.volume.clone()?;
        Some(VolumeSource { path, series: self.series.clone(), kind: self.kind })
    }

    pub(crate) fn check(&self, index: usize) -> Result<(), SceneError> {
        let field = |name: &str| format!("further_volumes[{index}].{name}");
        if let Some(transfer) = &self.transfer {
            transfer.check()?;
        }
        if let Some(window) = &self.window {
            window.check(&field("window"))?;
        }
        within(&field("opacity"), self.opacity, 0.0..=1.0, "0 to 1")?;
        if let Some(registration) = &self.registration {
            registration.check(&field("registration"))?;
        }
        if let Some(labels) = &self.labels {
            labels.check()?;
        }
        let of_a_file = [("series", self.series.is_some()), ("kind", self.kind.is_some())];
        for (name, is_given) in of_a_file {
            if is_given && self.volume.is_none() {
                return Err(SceneError::Range {
                    field: field(name),
                    found: "without 'volume'".into(),
                    expected: "a 'volume' that it is said of",
                });
            }
        }
        Ok(())
    }

    pub(crate) fn resolve(
        &self,
        first: &VolumeFacts,
        others: &[FurtherFacts],
        light: Option<Headlight>,
    ) -> Result<Further, SceneError> {
        let (volume, facts) = match self.source() {
            None => (0, first),
            Some(source) => {
                let at = others.iter().position(|other| other.source == source);
                let found = at.and_then(|at| Some((at + 1, &others.get(at)?.facts)));
                found.ok_or_else(|| SceneError::NoSuchVolume {
                    wanted: source.to_string(),
                    available: match others {
                        [] => "none beside the first".into(),
                        _ => others.iter().map(|o| o.source.to_string()).collect::<Vec<_>>().join(", "),
                    },
                })?
            }
        };
        let channel = facts.channel_index(self.channel.as_ref())?;
        let of = &facts.channels[channel];
        let transfer = match &self.transfer {
            Some(transfer) => transfer.clone(),
            None => default_transfer(self.window.unwrap_or_else(|| default_window(of)), None)?,
        };
        let labels = match (&of.labels, &self.labels) {
            (None, Some(_)) => return Err(SceneError::NotLabels { channel: of.name.clone() }),
            (None, None) => None,
            (Some(_), Some(LabelsFile { file: Some(file), .. })) => {
                let (field, file) = ("further_volumes.labels.file", file.display().to_string());
                return Err(SceneError::File { field, file });
            }
            (Some(facts), looks) => {
                let looks = looks.clone().unwrap_or_default().resolve(facts, self.transfer.as_ref())?;
                Some(looks.thinned(self.opacity))
            }
        };
        let file = self.volume.as_deref().and_then(Path::file_name).map(|f| f.to_string_lossy().into_owned());
        Ok(Further {
            name: self.name.clone().unwrap_or_else(|| match file {
                Some(file) if facts.channels.len() == 1 => file,
                Some(file) => format!("{file}, {}", of.name),
                None => of.name.clone(),
            }),
            volume,
            channel,
            transfer: transfer.thinned(self.opacity)?,
            labels,
            light: self.shade.then(|| light.unwrap_or_default()),
            first_from_own: self.registration.map_or(DAffine3::IDENTITY, |r| r.first_from_own()),
        })
    }
}

/// Checks a list of further volumes.
pub(crate) fn check(list: &[FurtherVolume]) -> Result<(), SceneError> {
    if list.len() > MOST_NAMED {
        return Err(SceneError::VolumeCount { what: "names", found: list.len() + 1, max: MOST_NAMED + 1 });
    }
    list.iter().enumerate().try_for_each(|(index, further)| further.check(index))
}

/// Refuses more volumes than are shown at a time, and modes that show one only.
pub(crate) fn check_shown(mode: Mode, first_is_shown: bool, further: usize) -> Result<(), SceneError> {
    if mode != Mode::EmissionAbsorption && (further > 0 || !first_is_shown) {
        let found = further + usize::from(first_is_shown);
        return Err(SceneError::SeveralInMode { mode: mode.name(), found, first_is_shown });
    }
    let found = further + usize::from(first_is_shown);
    if found > MOST_VOLUMES {
        return Err(SceneError::VolumeCount { what: "shows", found, max: MOST_VOLUMES });
    }
    Ok(())
}

impl TransferFunction {
    /// The same with every opacity multiplied by `factor`, 0 to 1.
    fn thinned(self, factor: f64) -> Result<Self, SceneError> {
        let thin = |p: &TransferPoint| TransferPoint { opacity_per_mm: p.opacity_per_mm * factor, ..*p };
        if factor == 1.0 { Ok(self) } else { Self::new(self.points().iter().map(thin).collect()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::ChannelFacts;
    use crate::{LabelFacts, Scene, SceneFile};

    fn facts(names: &[&str]) -> VolumeFacts {
        let channel = |name: &&str| ChannelFacts {
            name: (*name).into(),
            minimum: 0.0,
            maximum: 100.0,
            percentile_2: 0.0,
            percentile_99_8: 80.0,
            labels: None,
        };
        VolumeFacts { channels: names.iter().map(channel).collect(), modality: None }
    }

    fn others() -> Vec<FurtherFacts> {
        let source = |path: &str, series: Option<&str>| VolumeSource {
            path: path.into(),
            series: series.map(str::to_owned),
            kind: None,
        };
        vec![
            FurtherFacts { source: source("pet.nii", None), facts: facts(&["pet"]) },
            FurtherFacts { source: source("mr", Some("1.2.3")), facts: facts(&["t1", "t2"]) },
        ]
    }

    fn resolve(json: &str) -> Result<Scene, SceneError> {
        SceneFile::from_json(json)?.resolve_among(&facts(&["ct", "labels"]), &others())
    }

    #[test]
    fn volumes_are_found_by_what_the_scene_calls_them() {
        let scene = resolve(
            r#"{"further_volumes": [
                {"volume": "mr", "series": "1.2.3", "channel": "t2"},
                {"volume": "pet.nii", "name": "PET", "opacity": 0.5, "shade": true,
                    "transfer": [[0, 0, 0, 0, 0], [10, 1, 0, 0, 0.5]]},
                {"channel": 1}]}"#,
        )
        .unwrap();
        let of = |f: &Further| (f.volume, f.channel, f.name.clone());
        let found: Vec<_> = scene.further.iter().map(of).collect();
        assert_eq!(found, [(2, 1, "mr, t2".into()), (1, 0, "PET".into()), (0, 1, "labels".into())]);
        assert_eq!(scene.further[1].transfer.at(10.0).opacity_per_mm, 0.25);
        assert_eq!(scene.further[1].light, Some(Headlight::default()));
        assert_eq!(scene.further[2].transfer.value_range(), Some((0.0, 80.0)));
        assert!(scene.further[2].light.is_none());
    }

    #[test]
    fn the_sources_of_a_scene_are_told_once_each() {
        let file = SceneFile::from_json(
            r#"{"volume": "ct.nii", "further_volumes": [{"volume": "a"}, {"volume": "b", "shown": false},
                {"channel": 1}, {"volume": "a", "channel": 2}, {"volume": "a", "series": "x"}]}"#,
        )
        .unwrap();
        let names =
            |shown_only| file.further_sources(shown_only).iter().map(ToString::to_string).collect::<Vec<_>>();
        assert_eq!(names(false), ["a", "b", "a (series x)"]);
        assert_eq!(names(true), ["a", "a (series x)"]);
    }

    #[test]
    fn a_hidden_volume_is_not_in_the_scene() {
        let scene = resolve(r#"{"further_volumes": [{"volume": "pet.nii", "shown": false}]}"#).unwrap();
        assert_eq!(scene, resolve("{}").unwrap());
        // It need not even be there.
        resolve(r#"{"further_volumes": [{"volume": "nowhere", "shown": false}]}"#).unwrap();
        let first_hidden = resolve(r#"{"shown": false, "transfer": [[0, 1, 1, 1, 1]]}"#).unwrap();
        assert!(!first_hidden.transfer.is_visible_within(-1e9, 1e9));
    }

    #[test]
    fn a_registration_moves_the_grid_and_not_the_voxels() {
        let scene = resolve(
            r#"{"further_volumes": [{"volume": "pet.nii",
                "registration": [[0, -1, 0, 5], [1, 0, 0, -7], [0, 0, 1, 11]]}]}"#,
        )
        .unwrap();
        let own = Grid::axis_aligned([4, 5, 6], DVec3::new(1.0, 2.0, 3.0)).unwrap();
        let moved = scene.further[0].grid(&own).unwrap();
        assert_eq!(moved.dims(), own.dims());
        let at = moved.volume_from_index().transform_point3(DVec3::new(1.0, 1.0, 1.0));
        assert!((at - DVec3::new(3.0, -6.0, 14.0)).length() < 1e-12, "{at}");
        let share = |first: &Grid| scene.further[0].share_within(first, &own).unwrap();
        assert_eq!(share(&moved), 1.0);
        assert_eq!(share(&own), 0.0);
        let half = Grid::new([40, 40, 3], DAffine3::from_translation(DVec3::new(-20.0, -20.0, 10.0)));
        assert_eq!(share(&half.unwrap()), 3.0 / 16.0);
    }

    #[test]
    fn labels_beside_a_volume_have_their_own_looks() {
        let source = VolumeSource { path: "seg.nii".into(), series: None, kind: Some(VoxelKind::Label) };
        let mut seg = facts(&["organs"]);
        seg.channels[0].labels = Some(LabelFacts { present: vec![0, 2, 5, 9], ..LabelFacts::default() });
        let others = [FurtherFacts { source, facts: seg }];
        let of = |labels: &str| {
            let json = format!(
                r#"{{"further_volumes": [{{"volume": "seg.nii", "kind": "label", "opacity": 0.5, "labels": {labels}}}]}}"#
            );
            SceneFile::from_json(&json)?.resolve_among(&facts(&["ct"]), &others)
        };
        let json = r#"{"table": [{"number": 2, "name": "liver", "color": [0.5, 0.2, 0.1]}], "hide": [5],
            "opacity": {"liver": 0.25}, "tint": {"9": [0, 1, 0]}}"#;
        let looks = of(json).unwrap().further[0].labels.clone().unwrap();
        let found = [0, 2, 5, 9].map(|number| looks.at(number).opacity_per_mm);
        assert_eq!(found, [0.0, 0.125, 0.0, 0.5], "the scene's factor is in them");
        assert_eq!((looks.at(2).color, looks.at(9).color), ([0.5, 0.2, 0.1], [0.0, 1.0, 0.0]));
        let unknown = of(r#"{"only": ["spleen"]}"#).unwrap_err().to_string();
        assert!(unknown.contains("'spleen'") && unknown.contains("2, 5, 9"), "{unknown}");
        let file = of(r#"{"file": "names.txt"}"#).unwrap_err().to_string();
        assert!(file.contains("names.txt") && file.contains("further_volumes.labels.file"), "{file}");
    }

    #[test]
    fn bad_lists_are_refused_with_what_was_expected() {
        let message = |json: &str| resolve(json).unwrap_err().to_string();
        let missing = message(r#"{"further_volumes": [{"volume": "spect.nii"}]}"#);
        assert!(
            missing.contains("'spect.nii'") && missing.contains("pet.nii, mr (series 1.2.3)"),
            "{missing}"
        );
        let channel = message(r#"{"further_volumes": [{"volume": "pet.nii", "channel": 3}]}"#);
        assert!(channel.contains("channel '3'") && channel.contains("0 'pet'"), "{channel}");
        let five = message(r#"{"further_volumes": [{}, {}, {}, {}]}"#);
        assert!(five.contains("shows 5 volumes, at most 4"), "{five}");
        resolve(r#"{"further_volumes": [{}, {}, {}]}"#).unwrap();
        resolve(r#"{"shown": false, "further_volumes": [{}, {}, {}, {}]}"#).unwrap();
        let many = format!(r#"{{"further_volumes": [{}]}}"#, vec![r#"{"shown": false}"#; 17].join(", "));
        assert!(message(&many).contains("names 18 volumes, at most 17"), "{}", message(&many));
        let of = |field: &str| message(&format!(r#"{{"further_volumes": [{{}}, {{{field}}}]}}"#));
        assert!(of(r#""opacity": 1.5"#).contains("further_volumes[1].opacity"));
        assert!(of(r#""window": [3, 3]"#).contains("further_volumes[1].window"));
        assert!(of(r#""series": "1.2""#).contains("a 'volume' that it is said of"));
        assert!(of(r#""kind": "label""#).contains("further_volumes[1].kind"));
        assert!(of(r#""volume": "pet.nii", "labels": {}"#).contains("channel 'pet' holds measured values"));
        assert!(of(r#""registration": [[1,0,0,0],[0,1,0,0],[0,0,0,0]]"#).contains("determinant"));
        assert!(of(r#""registration": [[1,0,0,0],[0,1,0,0]]"#).contains("array of length 3"));
        assert!(of(r#""colour": 1"#).contains("unknown field `colour`"));
    }

    #[test]
    fn modes_that_show_one_volume_say_so() {
        for mode in ["threshold", "x-ray", "maximum", "cumulated"] {
            let json = format!(r#"{{"mode": "{mode}", "further_volumes": [{{}}]}}"#);
            let message = resolve(&json).unwrap_err().to_string();
            assert!(message.contains(mode) && message.contains("emission-absorption"), "{message}");
            let hidden = format!(r#"{{"mode": "{mode}", "shown": false}}"#);
            assert!(resolve(&hidden).unwrap_err().to_string().contains("hidden"));
            resolve(&format!(r#"{{"mode": "{mode}", "further_volumes": [{{"shown": false}}]}}"#)).unwrap();
        }
    }
}
