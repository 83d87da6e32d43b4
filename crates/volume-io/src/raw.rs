//! Raw voxels with a JSON header. The fields are documented in `docs/volume-formats.md`.

use crate::load::{checked_axis, finish};
use crate::samples::{self, ByteOrder, Run, StoredType};
use crate::sidecar::{self, KindJson, Meaning, Rows};
use crate::source::{Part, Source};
use crate::{Format, LoadError, LoadOptions, Loaded};
use serde::Deserialize;
use std::io::SeekFrom;

/// Most channels in one file.
const MOST_CHANNELS: usize = 16;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawJson {
    raw: String,
    dims: [i64; 3],
    r#type: RawType,
    endian: Option<Endian>,
    #[serde(default)]
    offset_bytes: u64,
    spacing_mm: Option<[f64; 3]>,
    volume_from_index: Option<Rows>,
    channels: Option<Vec<RawChannel>>,
    name: Option<String>,
    kind: Option<KindJson>,
    slope: Option<f64>,
    intercept: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawChannel {
    name: String,
    kind: Option<KindJson>,
    slope: Option<f64>,
    intercept: Option<f64>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum RawType {
    Uint8,
    Int16,
    Uint16,
    Float32,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Endian {
    Little,
    Big,
}

/// Loads the voxels that a JSON header names.
pub(crate) fn load(
    source: &Source<'_>,
    mut part: Part<'_>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let header: RawJson = sidecar::read_json(&mut part)?;
    let file = part.name.as_str();
    let dims = [
        checked_axis(file, "dims[0]", header.dims[0])?,
        checked_axis(file, "dims[1]", header.dims[1])?,
        checked_axis(file, "dims[2]", header.dims[2])?,
    ];
    let grid = sidecar::grid(file, dims, header.spacing_mm, header.volume_from_index)?.ok_or_else(|| {
        LoadError::field(file, "spacing_mm", "[x, y, z] in millimetres, or volume_from_index", "neither")
    })?;
    let stored = match header.r#type {
        RawType::Uint8 => StoredType::U8,
        RawType::Int16 => StoredType::I16,
        RawType::Uint16 => StoredType::U16,
        RawType::Float32 => StoredType::F32,
    };
    let order = match header.endian {
        Some(Endian::Little) => ByteOrder::Little,
        Some(Endian::Big) => ByteOrder::Big,
        None if stored.bytes() == 1 => ByteOrder::Little,
        None => {
            let expected = format!("\"little\" or \"big\" for {}", stored.name());
            return Err(LoadError::field(file, "endian", expected, "nothing"));
        }
    };
    let mut meanings = meanings(file, &header)?;
    if let ([only], Some(kind)) = (meanings.as_mut_slice(), options.kind) {
        only.kind = kind;
    }

    // Three axes of 15 bits, 16 channels, 4 bytes: no product overflows 64 bits.
    let count = grid.voxel_count();
    let bytes_a_channel = count as u64 * stored.bytes() as u64;
    let bytes = bytes_a_channel * meanings.len() as u64;
    options.check_size(file, bytes.into())?;
    let mut voxels = source.open_within_folder("raw", &header.raw)?;
    let expected = header.offset_bytes.saturating_add(bytes);
    if voxels.length != expected {
        return Err(LoadError::FileSize { file: voxels.name, expected, found: voxels.length });
    }
    voxels
        .input
        .seek(SeekFrom::Start(header.offset_bytes))
        .map_err(|source| LoadError::Unreadable { file: voxels.name.clone(), source })?;

    let run = Run { file: &voxels.name, stored, order, count, holds_at_most: bytes_a_channel, packed: None };
    let mut channels = Vec::with_capacity(meanings.len());
    for meaning in meanings {
        channels.push(meaning.with(samples::read(&mut voxels.input, &run, options)?.voxels));
    }
    finish(file, Format::Raw, grid, channels, Vec::new())
}

/// The channels, in the order in which their voxels lie in the file.
fn meanings(file: &str, header: &RawJson) -> Result<Vec<Meaning>, LoadError> {
    let RawJson { name, kind, slope, intercept, .. } = header;
    let Some(channels) = &header.channels else {
        return Ok(vec![Meaning::checked(file, name.clone(), *kind, *slope, *intercept)?]);
    };
    if name.is_some() || kind.is_some() || slope.is_some() || intercept.is_some() {
        let expected = "name, kind, slope and intercept in channels";
        return Err(LoadError::field(file, "channels", expected, "one of them beside channels"));
    }
    if !(1..=MOST_CHANNELS).contains(&channels.len()) {
        return Err(LoadError::field(file, "channels", format!("1 to {MOST_CHANNELS}"), &channels.len()));
    }
    channels
        .iter()
        .map(|c| Meaning::checked(file, Some(c.name.clone()), c.kind, c.slope, c.intercept))
        .collect()
}
