//! A file with a transfer function, whichever it is.

use crate::error::{read, shown};
use crate::{ColourError, paraview, slicer};
use scene::{Headlight, TransferFunction, Window};
use std::path::Path;

/// What files of transfer functions may be.
const KNOWN: &str =
    "a volume property (.vp) or presets.xml of 3D Slicer, or a colour map of ParaView (JSON or XML)";
/// Most entries that a message names: the presets of 3D Slicer are some thirty.
const MOST_NAMED: usize = 64;

/// A transfer function and what else its file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Imported {
    /// What its entry is called, where it has a name.
    pub name: Option<String>,
    /// Colour, and opacity of a millimetre.
    pub transfer: TransferFunction,
    /// The light, where the file has one and it is on.
    pub light: Option<Headlight>,
    /// What its values are.
    pub values: Values,
    /// What the file says that a scene cannot show. Sentences.
    pub notes: Vec<String>,
}

/// What the values of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// Those of a volume: Hounsfield units and the like.
    Absolute,
    /// A colour map's: it is stretched over the window.
    Stretched,
}

impl Imported {
    /// The function for a volume that is shown through a window.
    ///
    /// # Errors
    /// If the stretched values are no numbers that a scene takes.
    pub fn over(&self, window: Window) -> Result<TransferFunction, scene::SceneError> {
        match (self.values, self.transfer.value_range()) {
            (Values::Stretched, Some((low, high))) if high > low => {
                let moved =
                    |value: f64| window.low + (window.high - window.low) * ((value - low) / (high - low));
                let points = self.transfer.points().iter();
                TransferFunction::new(
                    points.map(|p| scene::TransferPoint { value: moved(p.value), ..*p }).collect(),
                )
            }
            _ => Ok(self.transfer.clone()),
        }
    }
}

/// Reads a file; `name` chooses among several entries.
///
/// # Errors
/// If it cannot be read, is none of the known ones, or something in it is wrong. See [`ColourError`].
pub fn load_transfer(path: &Path, name: Option<&str>) -> Result<Imported, ColourError> {
    transfer(&path.display().to_string(), &read(path)?, name)
}

/// The same from text; `file` stands for the file in messages.
///
/// # Errors
/// As [`load_transfer`].
pub fn transfer(file: &str, text: &str, name: Option<&str>) -> Result<Imported, ColourError> {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if text.starts_with('<') {
        let document = roxmltree::Document::parse(text)
            .map_err(|source| ColourError::Xml { file: file.to_owned(), source })?;
        let has = |tag: &str| document.descendants().any(|node| node.has_tag_name(tag));
        return match () {
            () if has("VolumeProperty") => slicer::presets(file, &document, name),
            () if has("ColorMap") => paraview::xml(file, &document, name),
            () => Err(ColourError::Unknown { file: file.to_owned(), expected: KNOWN }),
        };
    }
    if text.starts_with(['[', '{']) {
        return paraview::json(file, text, name);
    }
    if slicer::is_property(text) {
        return slicer::property(file, text);
    }
    Err(ColourError::Unknown { file: file.to_owned(), expected: KNOWN })
}

/// The entry of a name, or the only one.
pub(crate) fn chosen<'a, T>(
    file: &str,
    entries: &'a [(String, T)],
    name: Option<&str>,
) -> Result<&'a (String, T), ColourError> {
    let found = match (name, entries) {
        (None, [only]) => Some(only),
        (None, _) => None,
        (Some(name), _) => entries.iter().find(|(n, _)| n == name),
    };
    found.ok_or_else(|| {
        let mut available: Vec<String> = entries.iter().take(MOST_NAMED).map(|(n, _)| shown(n)).collect();
        if entries.len() > MOST_NAMED {
            available.push(format!("and {} more", entries.len() - MOST_NAMED));
        }
        let available = available.join(", ");
        ColourError::Choice { file: file.to_owned(), wanted: name.map(shown), available }
    })
}

/// Numbers between spaces or commas.
pub(crate) fn numbers(file: &str, what: &str, text: &str) -> Result<Vec<f64>, ColourError> {
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty());
    words
        .map(|word| {
            let number = word.parse::<f64>().ok().filter(|n| n.is_finite());
            number.ok_or_else(|| ColourError::wrong(file, what, "finite numbers", word))
        })
        .collect()
}
