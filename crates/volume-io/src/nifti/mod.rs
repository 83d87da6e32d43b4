//! NIfTI-1 and NIfTI-2 in one file: header, extensions, voxels.
//!
//! Source of the layout and of what the fields mean: the NIfTI-1 and NIfTI-2 standards (`nifti1.h`, `nifti2.h`).
//! Why the headers are read here and not by the `nifti` crate: `docs/decisions/0004-nifti.md`.

mod geometry;
mod header;

use crate::labels;
use crate::load::{broken, read_promised};
use crate::recorded::Recorded;
use crate::stream::{self, Encoding, Stream};
use crate::{Format, LoadError, LoadOptions, Loaded};
use header::{Header, Version};
use std::io::Read;
use volume::LabelTable;

pub(crate) use header::is_header;

/// `intent_code` of a label map.
const INTENT_LABEL: i64 = 1002;
/// Bytes of extensions that are looked at for a label table; longer ones are passed over.
const EXTENSIONS_LOOKED_AT: usize = 1 << 20;

/// Loads the volume, of a series in time the one that was asked for.
pub(crate) fn load(
    file: &str,
    mut stream: Stream<impl Read>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let packed = stream.packed;
    let header = Header::read(file, &mut stream.input, packed)?;
    let mut notes = Vec::new();
    let dims = header.dims(file)?;
    let mut recorded = Recorded {
        format: match header.version {
            Version::One => Format::Nifti1,
            Version::Two => Format::Nifti2,
        },
        stored: header.stored_type(file)?,
        grid: geometry::grid(file, &header, dims, &mut notes)?,
        encoding: Encoding::Raw,
        order: header.order,
        steps: header.steps(),
        step: options.time,
        step_secs: header.step_secs(),
        scaling: header.scaling(file, &mut notes)?,
        labels: header.intent_code == INTENT_LABEL,
    };
    recorded.check(file, "dim", options)?;
    let offset = header.voxel_offset(file, &mut notes)?;
    let promised = offset.saturating_add(recorded.before()).saturating_add(recorded.bytes());
    if packed.is_none() && promised > stream.holds_at_most {
        return Err(LoadError::Truncated {
            file: file.to_owned(),
            what: "header and voxels",
            expected: promised,
            found: stream.holds_at_most,
        });
    }
    let label_table = pass_extensions(file, &mut stream, offset - header.length(), &mut notes)?;
    recorded.labels |= label_table.is_some();
    stream::pass_over(file, &mut stream, recorded.before(), "the volumes before")?;
    let mut loaded = recorded.load(file, stream, true, options, notes)?;
    loaded.report.labels = label_table.unwrap_or_default();
    Ok(loaded)
}

/// Passes over what lies between header and voxels. Gives back a label table, if there is one: few label maps say in their
/// header that they are one, but some carry a table of names in a Caret extension.
fn pass_extensions(
    file: &str,
    stream: &mut Stream<impl Read>,
    length: u64,
    notes: &mut Vec<String>,
) -> Result<Option<LabelTable>, LoadError> {
    let looked_at = length.min(EXTENSIONS_LOOKED_AT as u64);
    let mut extensions = vec![0; looked_at as usize];
    read_promised(file, &mut stream.input, &mut extensions, "header extensions", stream.packed)?;
    let passed = std::io::copy(&mut stream.input.by_ref().take(length - looked_at), &mut std::io::sink());
    let passed = passed.map_err(|e| broken(file, stream.packed, e))?;
    if looked_at + passed < length {
        return Err(LoadError::Truncated {
            file: file.to_owned(),
            what: "header extensions",
            expected: length,
            found: looked_at + passed,
        });
    }
    Ok(labels::caret_table(&extensions, notes))
}
