//! What JSON files say about channels and geometry, for the formats that need one.

use crate::LoadError;
use crate::load::checked_scaling;
use crate::source::{Part, read_full};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use spatial::{DAffine3, DMat3, DVec3};
use volume::{Channel, ChannelKind, Grid, Voxels};

/// Longest JSON that is read, in bytes.
const LONGEST_JSON: usize = 1 << 20;
/// Longest name of a channel, in bytes.
const LONGEST_NAME: usize = 64;

/// What the samples of a channel are.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum KindJson {
    /// Measured.
    #[default]
    Intensity,
    /// Named.
    Label,
}

impl From<KindJson> for ChannelKind {
    fn from(kind: KindJson) -> Self {
        match kind {
            KindJson::Intensity => Self::Intensity,
            KindJson::Label => Self::Label,
        }
    }
}

/// A channel but for its samples.
#[derive(Clone, Debug)]
pub(crate) struct Meaning {
    pub(crate) name: String,
    pub(crate) kind: ChannelKind,
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

impl Meaning {
    /// Stored values that stand for themselves.
    pub(crate) fn plain(name: &str, kind: ChannelKind) -> Self {
        Self { name: name.to_owned(), kind, slope: 1.0, intercept: 0.0 }
    }

    /// What a JSON says, checked; what it leaves out has its default.
    pub(crate) fn checked(
        file: &str,
        name: Option<String>,
        kind: Option<KindJson>,
        slope: Option<f64>,
        intercept: Option<f64>,
    ) -> Result<Self, LoadError> {
        let name = name.unwrap_or_else(|| "image".to_owned());
        if name.is_empty() || name.len() > LONGEST_NAME || name.contains(char::is_control) {
            let expected = format!("1 to {LONGEST_NAME} bytes of text without control characters");
            return Err(LoadError::field(file, "name", expected, &format!("{name:?}")));
        }
        let (slope, intercept) =
            checked_scaling(file, ["slope", "intercept"], slope.unwrap_or(1.0), intercept.unwrap_or(0.0))?;
        Ok(Self { name, kind: kind.unwrap_or_default().into(), slope, intercept })
    }

    /// The channel with its samples.
    pub(crate) fn with(self, voxels: Voxels) -> Channel {
        let Self { name, kind, slope, intercept } = self;
        Channel { name, kind, voxels, slope, intercept }
    }
}

/// Rows of the transform from voxel index to patient millimetres.
pub(crate) type Rows = [[f64; 4]; 3];

/// Where the voxels lie: spacing along the patient's axes, or a whole transform, not both; `None` if neither.
pub(crate) fn grid(
    file: &str,
    dims: [u32; 3],
    spacing_mm: Option<[f64; 3]>,
    volume_from_index: Option<Rows>,
) -> Result<Option<Grid>, LoadError> {
    let (field, transform) = match (spacing_mm, volume_from_index) {
        (None, None) => return Ok(None),
        (Some(_), Some(_)) => {
            let expected = "spacing_mm or volume_from_index, which holds the spacing too";
            return Err(LoadError::field(file, "spacing_mm", expected, "both"));
        }
        (Some(spacing), None) => ("spacing_mm", DAffine3::from_scale(DVec3::from_array(spacing))),
        (None, Some(rows)) => {
            let column = |c: usize| DVec3::from_array(rows.map(|row| row[c]));
            let matrix3 = DMat3::from_cols(column(0), column(1), column(2));
            ("volume_from_index", DAffine3 { matrix3, translation: column(3) })
        }
    };
    // A spacing is a distance; a transform may flip.
    if let Some(negative) = spacing_mm.and_then(|s| s.into_iter().find(|s| *s <= 0.0)) {
        return Err(LoadError::field(file, field, "three positive distances", &negative));
    }
    Grid::new(dims, transform).map(Some).map_err(|source| LoadError::Grid {
        file: file.to_owned(),
        field,
        source,
    })
}

/// Reads a JSON file. Unknown fields are refused by the types that are read.
pub(crate) fn read_json<T: DeserializeOwned>(part: &mut Part<'_>) -> Result<T, LoadError> {
    if part.length > LONGEST_JSON as u64 {
        return Err(LoadError::TooLarge {
            file: part.name.clone(),
            what: "the JSON",
            found: part.length.into(),
            allowed: LONGEST_JSON as u64,
        });
    }
    let mut bytes = vec![0; LONGEST_JSON];
    let length = read_full(&mut part.input, &mut bytes)
        .map_err(|source| LoadError::Unreadable { file: part.name.clone(), source })?;
    serde_json::from_slice(&bytes[..length])
        .map_err(|source| LoadError::Json { file: part.name.clone(), source })
}
