//! How the labels of a volume look.

use crate::error::{SceneError, within};
use crate::{Optical, TransferFunction};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use volume::{Label, LabelTable};

/// The number that stands for no structure: hidden unless the scene says otherwise.
const BACKGROUND: i64 = 0;
/// Labels that a message names when one is not found.
const NAMED_IN_MESSAGE: usize = 12;
/// Most entries of a scene's own table.
const MOST_ENTRIES: usize = 65_536;

/// How a scene shows the labels of its channel. Names and colours are those of the scene's table, else of the volume's
/// own, else made up from the number.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LabelsFile {
    /// A file of names and colours, relative to the scene file: a colour table of 3D Slicer or ITK-SNAP, or JSON.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
    /// Names and colours; these go before the file's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub table: Vec<LabelEntry>,
    /// Labels that are shown, all others hidden, by number or name. Default: all but 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub only: Option<Vec<LabelRef>>,
    /// Labels that are hidden, by number or name.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub hide: Vec<LabelRef>,
    /// Colours of their own (RGB, 0 to 1) for labels, by number or name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub tint: BTreeMap<String, [f64; 3]>,
    /// Opacities of a millimetre of their own (0 to 1) for labels, by number or name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub opacity: BTreeMap<String, f64>,
}

/// A label by number or by name.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(untagged)]
pub enum LabelRef {
    /// As voxels hold it.
    Number(i64),
    /// As the table calls it.
    Name(String),
}

/// A line of a table of labels.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LabelEntry {
    /// As voxels hold it.
    pub number: i64,
    /// What it is called.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// RGB, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f64; 3]>,
    /// Opacity of a millimetre, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub opacity: Option<f64>,
}

impl From<LabelEntry> for Label {
    fn from(LabelEntry { number, name, color, opacity }: LabelEntry) -> Self {
        Self { number, name, color, opacity }
    }
}

impl From<Label> for LabelEntry {
    fn from(Label { number, name, color, opacity }: Label) -> Self {
        Self { number, name, color, opacity }
    }
}

/// What a scene needs to know of a channel's labels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelFacts {
    /// The numbers that voxels hold, in order.
    pub present: Vec<i64>,
    /// The numbers in the step of a series in time that is on view. They have a look, but only those that are `present` in
    /// the first step or in a table can be named: whether a scene is right does not depend on when it comes.
    pub in_step: Vec<i64>,
    /// What the volume's own file says of them.
    pub table: LabelTable,
}

/// What each label of a channel does to light: nothing is between two labels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LabelLooks {
    /// In the order of their numbers.
    looks: Vec<(i64, Optical)>,
}

impl LabelLooks {
    /// Takes looks in any order; of two with one number the later one holds.
    #[must_use]
    pub fn new(looks: impl IntoIterator<Item = (i64, Optical)>) -> Self {
        let sorted: BTreeMap<i64, Optical> = looks.into_iter().collect();
        Self { looks: sorted.into_iter().collect() }
    }

    /// The same with every opacity multiplied by `factor`, 0 to 1.
    pub(crate) fn thinned(self, factor: f64) -> Self {
        let thin = |(number, o): (i64, Optical)| {
            (number, Optical { opacity_per_mm: o.opacity_per_mm * factor, ..o })
        };
        Self { looks: self.looks.into_iter().map(thin).collect() }
    }

    /// What matter of a label does to light; nothing, if the label is not known.
    #[must_use]
    pub fn at(&self, number: i64) -> Optical {
        self.looks.binary_search_by_key(&number, |l| l.0).map_or(Optical::NOTHING, |at| self.looks[at].1)
    }
}

/// A colour for a label that nobody gave one: neighbours in number differ in hue by the golden angle.
#[must_use]
pub fn made_up_color(number: i64) -> [f64; 3] {
    let hue = (number.rem_euclid(1 << 20) as f64 * 0.618_033_988_749_894_9).fract() * 6.0;
    let (low, high) = (0.35, 0.92);
    [5.0, 3.0, 1.0].map(|offset| {
        let k: f64 = (offset + hue) % 6.0;
        high - (high - low) * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

impl LabelsFile {
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        if self.table.len() > MOST_ENTRIES {
            return Err(SceneError::Range {
                field: "labels.table".into(),
                found: format!("{} entries", self.table.len()),
                expected: "at most 65536",
            });
        }
        let color = |field: &str, color: [f64; 3]| {
            color.into_iter().try_for_each(|c| within(field, c, 0.0..=1.0, "0 to 1").map(|_| ()))
        };
        for entry in &self.table {
            color("labels.table color", entry.color.unwrap_or_default())?;
            within("labels.table opacity", entry.opacity.unwrap_or_default(), 0.0..=1.0, "0 to 1")?;
        }
        for (label, &tint) in &self.tint {
            color(&format!("labels.tint {label}"), tint)?;
        }
        for (label, &opacity) in &self.opacity {
            within(&format!("labels.opacity {label}"), opacity, 0.0..=1.0, "0 to 1")?;
        }
        Ok(())
    }

    /// The look of each label that voxels hold. `transfer`, where the scene has one, gives colour and opacity by number.
    pub(crate) fn resolve(
        &self,
        facts: &LabelFacts,
        transfer: Option<&TransferFunction>,
    ) -> Result<LabelLooks, SceneError> {
        let table = facts.table.with(&LabelTable::new(self.table.iter().cloned().map(Label::from)));
        let find = |label: &LabelRef| -> Result<Vec<i64>, SceneError> {
            let found: Vec<i64> = match label {
                LabelRef::Number(n) if facts.present.binary_search(n).is_ok() || table.get(*n).is_some() => {
                    vec![*n]
                }
                LabelRef::Number(_) => Vec::new(),
                LabelRef::Name(name) => table.numbered(name).collect(),
            };
            if found.is_empty() {
                return Err(no_such_label(label, facts, &table));
            }
            Ok(found)
        };
        // A key that is a number means the label of that number, unless one is called so.
        let key = |key: &str| match key.parse() {
            Ok(number) if table.numbered(key).next().is_none() => LabelRef::Number(number),
            _ => LabelRef::Name(key.to_owned()),
        };
        let all = |labels: &[LabelRef]| -> Result<BTreeSet<i64>, SceneError> {
            Ok(labels.iter().map(&find).collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
        };
        let only = self.only.as_deref().map(all).transpose()?;
        let hidden = all(&self.hide)?;
        let mut tints = BTreeMap::new();
        for (label, tint) in &self.tint {
            tints.extend(find(&key(label))?.into_iter().map(|n| (n, *tint)));
        }
        let mut opacities = BTreeMap::new();
        for (label, opacity) in &self.opacity {
            opacities.extend(find(&key(label))?.into_iter().map(|n| (n, *opacity)));
        }
        let look = |&number: &i64| {
            let entry = table.get(number);
            let by_value = transfer.map(|t| t.at(number as f64));
            let color = tints
                .get(&number)
                .copied()
                .or(by_value.map(|o| o.color))
                .or(entry.and_then(|e| e.color))
                .unwrap_or_else(|| made_up_color(number));
            let opacity = opacities
                .get(&number)
                .copied()
                .or(by_value.map(|o| o.opacity_per_mm))
                .or(entry.and_then(|e| e.opacity))
                .unwrap_or(1.0);
            let is_shown = match &only {
                Some(only) => only.contains(&number),
                None => number != BACKGROUND || opacities.contains_key(&number) || by_value.is_some(),
            } && !hidden.contains(&number);
            (number, Optical { color, opacity_per_mm: if is_shown { opacity } else { 0.0 } })
        };
        Ok(LabelLooks::new(facts.present.iter().chain(&facts.in_step).map(look)))
    }
}

fn no_such_label(wanted: &LabelRef, facts: &LabelFacts, table: &LabelTable) -> SceneError {
    let described = |&number: &i64| match table.get(number) {
        Some(label) if !label.name.is_empty() => format!("{number} '{}'", label.name),
        _ => number.to_string(),
    };
    let mut available: Vec<String> = facts.present.iter().take(NAMED_IN_MESSAGE).map(described).collect();
    if facts.present.len() > NAMED_IN_MESSAGE {
        available.push(format!("and {} more", facts.present.len() - NAMED_IN_MESSAGE));
    }
    SceneError::NoSuchLabel {
        wanted: match wanted {
            LabelRef::Number(n) => n.to_string(),
            LabelRef::Name(name) => format!("'{name}'"),
        },
        available: available.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts() -> LabelFacts {
        let label = |number, name: &str, color| Label { number, name: name.into(), color, opacity: None };
        LabelFacts {
            present: vec![0, 1, 5, 6],
            table: LabelTable::new([
                label(1, "spleen", Some([0.0, 1.0, 0.0])),
                label(5, "liver", None),
                label(7, "aorta", None),
            ]),
            ..LabelFacts::default()
        }
    }

    fn looks(json: &str) -> Result<LabelLooks, SceneError> {
        let file: LabelsFile = serde_json::from_str(json).unwrap();
        file.check()?;
        file.resolve(&facts(), None)
    }

    #[test]
    fn all_but_the_background_are_shown_in_the_tables_colours_or_made_up_ones() {
        let looks = looks("{}").unwrap();
        assert_eq!(looks.at(0).opacity_per_mm, 0.0);
        assert_eq!(looks.at(1), Optical { color: [0.0, 1.0, 0.0], opacity_per_mm: 1.0 });
        assert_eq!(looks.at(5).color, made_up_color(5));
        assert_ne!(made_up_color(5), made_up_color(6));
        assert_eq!(looks.at(99), Optical::NOTHING);
    }

    #[test]
    fn labels_are_hidden_tinted_and_thinned_by_number_or_name() {
        let shown = looks(
            r#"{"hide": ["spleen"], "tint": {"liver": [1, 0, 0]}, "opacity": {"6": 0.1, "liver": 0.05}}"#,
        )
        .unwrap();
        assert_eq!(shown.at(1).opacity_per_mm, 0.0);
        assert_eq!(shown.at(5), Optical { color: [1.0, 0.0, 0.0], opacity_per_mm: 0.05 });
        assert_eq!(shown.at(6).opacity_per_mm, 0.1);
        let only = looks(r#"{"only": [6]}"#).unwrap();
        assert_eq!([1, 5, 6].map(|n| only.at(n).opacity_per_mm), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn the_scenes_table_goes_before_the_volumes() {
        let looks = looks(
            r#"{"table": [{"number": 1, "color": [0, 0, 1]}, {"number": 6, "name": "vein", "opacity": 0.3}],
                "tint": {"vein": [0.2, 0.2, 0.9]}}"#,
        )
        .unwrap();
        assert_eq!(looks.at(1).color, [0.0, 0.0, 1.0]);
        assert_eq!(looks.at(6), Optical { color: [0.2, 0.2, 0.9], opacity_per_mm: 0.3 });
    }

    #[test]
    fn a_label_of_the_table_that_this_volume_lacks_is_no_mistake_but_an_unknown_one_is() {
        looks(r#"{"hide": ["aorta"]}"#).unwrap();
        let message = looks(r#"{"only": ["livr"]}"#).unwrap_err().to_string();
        assert!(message.contains("'livr'") && message.contains("5 'liver'"), "{message}");
        assert!(looks(r#"{"opacity": {"12": 0.5}}"#).is_err());
        assert!(looks(r#"{"opacity": {"5": 1.5}}"#).is_err());
    }
}
