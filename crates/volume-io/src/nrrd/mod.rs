//! NRRD: a header of text, and the voxels after it or in other files.
//!
//! Source of the layout and of what the fields mean: "Definition of NRRD File Format", teem,
//! <http://teem.sourceforge.net/nrrd/format.html>. Why the header is read here: `docs/decisions/0016-nrrd-and-metaimage.md`.

mod geometry;
mod header;

use crate::load::checked_axis;
use crate::pieces::{Skipped, listed, numbered};
use crate::recorded::Recorded;
use crate::samples::StoredType;
use crate::source::{Part, Source};
use crate::stream::{self, Encoding, Stream};
use crate::text::{integers, short};
use crate::{Format, LoadError, LoadOptions, Loaded};
use header::Header;
use std::io::{BufRead as _, Read};

pub(crate) use header::is_header;

/// Most axes of a file, as in the definition.
const MOST_AXES: i64 = 16;
/// Most lines that are skipped before voxels.
const MOST_LINES: i64 = 1 << 20;

/// Loads the volume, of a series the one that was asked for.
pub(crate) fn load(
    source: &Source<'_>,
    mut part: Part<'_>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let header = Header::read(&mut part)?;
    let file = part.name.clone();
    let mut notes = Vec::new();
    let axes = geometry::axes(&file, &header)?;
    let dims = [
        checked_axis(&file, "sizes", axes.sizes[axes.spatial[0]])?,
        checked_axis(&file, "sizes", axes.sizes[axes.spatial[1]])?,
        checked_axis(&file, "sizes", axes.sizes[axes.spatial[2]])?,
    ];
    let steps = axes.steps(&file)?;
    let stored = stored_type(&file, header.required("type")?)?;
    let encoding = encoding(&file, header.required("encoding")?)?;
    let labels = header.segments.clone().table(&mut notes);
    let recorded = Recorded {
        format: Format::Nrrd,
        grid: geometry::grid(&file, &header, &axes, dims, &mut notes)?,
        encoding,
        stored,
        order: header.byte_order(stored, encoding)?,
        steps,
        step: options.time,
        step_secs: axes.step_secs(&header),
        scaling: (1.0, 0.0),
        labels: header.segments.any(),
    };
    recorded.check(&file, "sizes", options)?;
    let stream = open(source, part, &header, &axes, &recorded)?;
    let mut loaded = recorded.load(&file, stream, encoding == Encoding::Deflate, options, notes)?;
    loaded.report.labels = labels;
    Ok(loaded)
}

fn open<'s, 'a>(
    source: &'s Source<'a>,
    part: Part<'a>,
    header: &Header,
    axes: &geometry::Axes,
    recorded: &Recorded,
) -> Result<Stream<Box<dyn Read + 's>>, LoadError> {
    let file = part.name.clone();
    let lines = header.integer(&["line skip", "lineskip"], 0)?;
    if !(0..=MOST_LINES).contains(&lines) {
        return Err(LoadError::field(&file, "line skip", format!("0 to {MOST_LINES}"), &lines));
    }
    let skipped = match header.integer(&["byte skip", "byteskip"], 0)? {
        -1 => Skipped::AllBeforeEnd,
        n => Skipped::Bytes(u64::try_from(n).map_err(|_| {
            LoadError::field(
                &file,
                "byte skip",
                "0 or more, or -1 for what precedes the voxels at the end",
                &n,
            )
        })?),
    };
    let one = |mut part: Part<'a>| {
        for _ in 0..lines {
            skip_line(&mut part)?;
        }
        stream::open(part, recorded, skipped)
    };
    let Some(named) = header.get(&["data file", "datafile"]) else { return one(part) };
    const FIELD: &str = "data file";
    let names = match file_names(&file, named, header, axes, recorded)? {
        Names::One(name) => return one(source.open_within_folder(FIELD, &name)?),
        Names::Several(names) => names,
    };
    if recorded.encoding != Encoding::Raw || lines > 0 {
        let expected = "one file, or several of raw voxels without lines to skip";
        let found = format!("{} files that are not raw", names.len());
        return Err(LoadError::field(&file, FIELD, expected, &found));
    }
    recorded.in_files(source, FIELD, names, skipped)
}

enum Names {
    One(String),
    Several(Vec<String>),
}

/// The files that `data file` names: one, a list, or a pattern with first, last and step.
fn file_names(
    file: &str,
    named: &str,
    header: &Header,
    axes: &geometry::Axes,
    recorded: &Recorded,
) -> Result<Names, LoadError> {
    const FIELD: &str = "data file";
    let words: Vec<&str> = named.split_whitespace().collect();
    let (names, axes_a_file) = match words.as_slice() {
        ["LIST", rest @ ..] if rest.len() < 2 => {
            (listed(file, FIELD, header.after_data_file.iter().map(String::as_str))?, rest.first())
        }
        [pattern, rest @ ..] if pattern.contains('%') && matches!(rest.len(), 3 | 4) => {
            let range = integers(file, FIELD, &rest[..3].join(" "), 3)?;
            (numbered(file, FIELD, pattern, [range[0], range[1], range[2]])?, rest.get(3))
        }
        _ => return Ok(Names::One(named.to_owned())),
    };
    let all_axes = axes.sizes.len();
    let axes_a_file = match axes_a_file {
        None => all_axes - 1,
        Some(text) => text.parse().ok().filter(|n| (1..=all_axes).contains(n)).ok_or_else(|| {
            LoadError::field(file, FIELD, format!("1 to {all_axes} axes a file"), &short(text))
        })?,
    };
    // With all axes in each file, the files follow each other along the slowest one.
    let files = names.len() as u64;
    let slices = axes.sizes[axes_a_file..].iter().try_fold(1u64, |n, &s| n.checked_mul(s.unsigned_abs()));
    let slowest = axes.sizes[all_axes - 1].unsigned_abs();
    let fits = if axes_a_file == all_axes { slowest.is_multiple_of(files) } else { slices == Some(files) };
    if !fits || !recorded.whole().is_multiple_of(files) {
        let expected = match slices {
            Some(slices) if axes_a_file < all_axes => format!("{slices} files, as sizes say"),
            _ => format!("files that share {slowest} slices evenly"),
        };
        return Err(LoadError::field(file, FIELD, expected, &format!("{files} files")));
    }
    Ok(Names::Several(names))
}

fn skip_line(part: &mut Part<'_>) -> Result<(), LoadError> {
    let passed = part.input.skip_until(b'\n');
    let passed = passed.map_err(|source| LoadError::Unreadable { file: part.name.clone(), source })?;
    if passed == 0 {
        let file = part.name.clone();
        return Err(LoadError::Truncated {
            file,
            what: "lines to skip",
            expected: part.length + 1,
            found: part.length,
        });
    }
    Ok(())
}

fn stored_type(file: &str, name: &str) -> Result<StoredType, LoadError> {
    Ok(match name {
        "signed char" | "int8" | "int8_t" => StoredType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => StoredType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => StoredType::I16,
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => StoredType::U16,
        "int" | "signed int" | "int32" | "int32_t" => StoredType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => StoredType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => StoredType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            StoredType::U64
        }
        "float" => StoredType::F32,
        "double" => StoredType::F64,
        _ => {
            let expected = "integers of 8 to 64 bits, float or double";
            return Err(LoadError::field(file, "type", expected, &short(name)));
        }
    })
}

fn encoding(file: &str, name: &str) -> Result<Encoding, LoadError> {
    Ok(match name.to_ascii_lowercase().as_str() {
        "raw" => Encoding::Raw,
        "txt" | "text" | "ascii" => Encoding::Text,
        "gz" | "gzip" => Encoding::Deflate,
        _ => {
            return Err(LoadError::field(file, "encoding", "raw, gzip or ascii", &short(name)));
        }
    })
}
