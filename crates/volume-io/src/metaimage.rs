//! MetaImage: a header of text, and the voxels after it or in other files.
//!
//! Source of the layout and of what the fields mean: the MetaIO library of ITK, whose positions are in the patient's
//! space, left, posterior, superior. Why the header is read here: `docs/decisions/0016-nrrd-and-metaimage.md`.

use crate::load::{checked_axis, checked_scaling};
use crate::pieces::{Skipped, listed, numbered};
use crate::recorded::Recorded;
use crate::samples::{ByteOrder, StoredType};
use crate::source::{Part, Source};
use crate::stream::{self, Encoding, Stream};
use crate::text::{Lines, integers, numbers, short};
use crate::{Format, LoadError, LoadOptions, Loaded};
use spatial::{DAffine3, DMat3, DVec3};
use std::collections::BTreeMap;
use std::io::Read;
use volume::Grid;

/// Most axes of a file, as in MetaIO.
const MOST_AXES: i64 = 10;
/// The field that ends the header.
const DATA: &str = "ElementDataFile";
/// Fields that matter, and their other spellings.
const FIELDS: &[&str] = &[
    "ObjectType",
    "NDims",
    "DimSize",
    "BinaryData",
    "BinaryDataByteOrderMSB",
    "ElementByteOrderMSB",
    "CompressedData",
    "CompressedDataSize",
    "TransformMatrix",
    "Rotation",
    "Orientation",
    "Offset",
    "Position",
    "Origin",
    "ElementSpacing",
    "ElementSize",
    "HeaderSize",
    "ElementNumberOfChannels",
    "ElementType",
    "ElementToIntensityFunctionSlope",
    "ElementToIntensityFunctionOffset",
    "DistanceUnits",
    DATA,
];
/// Fields that a header may begin with and that do not matter here.
const OTHER_FIELDS: &[&str] = &[
    "Comment",
    "ObjectSubType",
    "TransformType",
    "Name",
    "ID",
    "ParentID",
    "Color",
    "AcquisitionDate",
    "Modality",
    "AnatomicalOrientation",
    "CenterOfRotation",
    "SequenceID",
    "ElementMin",
    "ElementMax",
];

/// Whether a file that starts like this is a MetaImage: its first line is one of the fields.
pub(crate) fn is_header(start: &[u8]) -> bool {
    let line = start.trim_ascii_start().split(|b| *b == b'\n').next().unwrap_or_default();
    let Some((name, _)) = std::str::from_utf8(line).ok().and_then(|line| line.split_once('=')) else {
        return false;
    };
    FIELDS.iter().chain(OTHER_FIELDS).any(|field| *field == name.trim())
}

/// Loads the volume, of a series the one that was asked for.
pub(crate) fn load(
    source: &Source<'_>,
    mut part: Part<'_>,
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    let file = part.name.clone();
    let header = Header::read(&mut part)?;
    let mut notes = Vec::new();
    let sizes = header.sizes()?;
    let dims = [
        checked_axis(&file, "DimSize", sizes[0])?,
        checked_axis(&file, "DimSize", sizes[1])?,
        checked_axis(&file, "DimSize", sizes[2])?,
    ];
    let steps = header.steps(&sizes)?;
    let stored = header.stored_type()?;
    let encoding = header.encoding()?;
    let recorded = Recorded {
        format: Format::MetaImage,
        grid: header.grid(dims, sizes.len(), &mut notes)?,
        encoding,
        stored,
        order: header.byte_order(stored, encoding)?,
        steps,
        step: options.time,
        step_secs: header.step_secs(sizes.len())?,
        scaling: header.scaling()?,
        labels: false,
    };
    recorded.check(&file, "DimSize", options)?;
    let stream = open(source, part, &header, &sizes, &recorded)?;
    recorded.load(&file, stream, encoding == Encoding::Deflate, options, notes)
}

fn open<'s, 'a>(
    source: &'s Source<'a>,
    part: Part<'a>,
    header: &Header,
    sizes: &[i64],
    recorded: &Recorded,
) -> Result<Stream<Box<dyn Read + 's>>, LoadError> {
    let skipped = match header.integer(&["HeaderSize"], 0)? {
        -1 => Skipped::AllBeforeEnd,
        n => {
            Skipped::Bytes(u64::try_from(n).map_err(|_| header.wrong("HeaderSize", "0 or more, or -1", &n))?)
        }
    };
    let one = |part: Part<'a>, skipped| -> Result<Stream<Box<dyn Read + 's>>, LoadError> {
        stream::open(part, recorded, skipped)
    };
    let named = header.required(DATA)?;
    let words: Vec<&str> = named.split_whitespace().collect();
    let file = part.name.as_str();
    let all_axes = sizes.len();
    let (names, axes_a_file) = match words.as_slice() {
        // What HeaderSize skips is a header of the file of voxels; here that is this header, which has been read.
        ["LOCAL" | "Local" | "local"] => return one(part, Skipped::Bytes(0)),
        ["LIST", rest @ ..] if rest.len() < 2 => {
            let axes = rest
                .first()
                .map_or(Some(all_axes - 1), |axes| axes.trim_end_matches(['D', 'd']).parse().ok());
            (listed(file, DATA, header.after_data.iter().map(String::as_str))?, axes)
        }
        [pattern, range @ ..] if pattern.contains('%') && range.len() == 3 => {
            let range = integers(file, DATA, &range.join(" "), 3)?;
            (numbered(file, DATA, pattern, [range[0], range[1], range[2]])?, Some(all_axes - 1))
        }
        _ => return one(source.open_within_folder(DATA, named)?, skipped),
    };
    let Some(axes_a_file) = axes_a_file.filter(|axes| (1..=all_axes).contains(axes)) else {
        return Err(header.wrong(DATA, format!("LIST, or LIST with 1D to {all_axes}D"), &short(named)));
    };
    let files = names.len() as u64;
    let expected = sizes[axes_a_file..].iter().try_fold(1u64, |n, &s| n.checked_mul(s.unsigned_abs()));
    if expected != Some(files) {
        let expected = format!("{} files, as DimSize says", expected.unwrap_or(u64::MAX));
        return Err(header.wrong(DATA, expected, &format!("{files} files")));
    }
    if recorded.encoding != Encoding::Raw {
        let expected = "one file, or several of raw voxels";
        return Err(header.wrong(DATA, expected, &format!("{files} files that are not raw")));
    }
    recorded.in_files(source, DATA, names, skipped)
}

/// The fields as text. Names and comments, which may name the patient, are not kept.
struct Header {
    file: String,
    fields: BTreeMap<&'static str, String>,
    /// The lines that follow `ElementDataFile = LIST`.
    after_data: Vec<String>,
}

impl Header {
    /// Reads to the field that names the data, and to the end of the file if that is a list.
    fn read(part: &mut Part<'_>) -> Result<Self, LoadError> {
        let mut header = Self { file: part.name.clone(), fields: BTreeMap::new(), after_data: Vec::new() };
        let mut lines = Lines::new();
        loop {
            let Some(line) = lines.next(part)? else {
                return Err(LoadError::Truncated {
                    file: header.file,
                    what: "header",
                    expected: part.length + 1,
                    found: part.length,
                });
            };
            if line.trim().is_empty() {
                continue;
            }
            let Some((name, value)) = line.split_once('=') else {
                return Err(header.wrong("header", "lines of `Field = value`", &short(&line)));
            };
            let (name, value) = (name.trim(), value.trim());
            // Programs add fields of their own: those that are not known do not matter.
            let Some(name) = FIELDS.iter().find(|field| **field == name) else { continue };
            if header.fields.insert(name, value.to_owned()).is_some() {
                return Err(header.wrong(name, "one such field", "two"));
            }
            if *name == DATA {
                break;
            }
        }
        if header.required(DATA)?.split_whitespace().next() == Some("LIST") {
            while let Some(line) = lines.next(part)? {
                header.after_data.push(line);
            }
        }
        match header.get(&["ObjectType"]) {
            None | Some("Image") => Ok(header),
            Some(other) => Err(header.wrong("ObjectType", "Image", &short(other))),
        }
    }

    fn wrong(&self, field: &str, expected: impl Into<String>, found: &(impl ToString + ?Sized)) -> LoadError {
        LoadError::field(&self.file, field, expected, found)
    }

    /// The field, whichever of its spellings is there.
    fn get(&self, spellings: &[&str]) -> Option<&str> {
        spellings.iter().find_map(|s| self.fields.get(*s)).map(String::as_str)
    }

    fn required(&self, name: &str) -> Result<&str, LoadError> {
        self.get(&[name]).ok_or_else(|| self.wrong(name, "such a field", "none"))
    }

    fn integer(&self, spellings: &[&str], default: i64) -> Result<i64, LoadError> {
        match self.get(spellings) {
            None => Ok(default),
            Some(text) => Ok(integers(&self.file, spellings[0], text, 1)?[0]),
        }
    }

    fn numbers(&self, spellings: &[&str], count: usize) -> Result<Option<Vec<f64>>, LoadError> {
        self.get(spellings).map(|text| numbers(&self.file, spellings[0], text, count)).transpose()
    }

    fn flag(&self, spellings: &[&str], default: bool) -> Result<bool, LoadError> {
        match self.get(spellings).map(str::to_ascii_lowercase).as_deref() {
            None => Ok(default),
            Some("true" | "1") => Ok(true),
            Some("false" | "0") => Ok(false),
            Some(other) => Err(self.wrong(spellings[0], "True or False", &short(other))),
        }
    }

    fn sizes(&self) -> Result<Vec<i64>, LoadError> {
        let dimension = integers(&self.file, "NDims", self.required("NDims")?, 1)?[0];
        if !(3..=MOST_AXES).contains(&dimension) {
            return Err(self.wrong("NDims", format!("3 to {MOST_AXES} axes"), &dimension));
        }
        let channels = self.integer(&["ElementNumberOfChannels"], 1)?;
        if channels != 1 {
            return Err(self.wrong(
                "ElementNumberOfChannels",
                "1 (vectors and colours are not volumes)",
                &channels,
            ));
        }
        integers(&self.file, "DimSize", self.required("DimSize")?, dimension as usize)
    }

    /// Volumes that follow each other: the product of the axes beyond the third.
    fn steps(&self, sizes: &[i64]) -> Result<u64, LoadError> {
        sizes[3..].iter().try_fold(1u64, |steps, &size| {
            let size = u64::try_from(size).ok().filter(|&size| size > 0);
            size.and_then(|size| steps.checked_mul(size))
                .ok_or_else(|| self.wrong("DimSize", "1 or more on each axis", &format!("{sizes:?}")))
        })
    }

    /// From one volume to the next: MetaIO knows no unit of time, and programs write seconds.
    fn step_secs(&self, axes: usize) -> Result<Option<f64>, LoadError> {
        let spacing = self.numbers(&["ElementSpacing", "ElementSize"], axes)?;
        Ok(spacing.filter(|_| axes == 4).map(|spacing| spacing[3]).filter(|secs| *secs > 0.0))
    }

    /// Rows of the matrix are the directions of the axes, as ITK reads them.
    fn grid(&self, dims: [u32; 3], axes: usize, notes: &mut Vec<String>) -> Result<Grid, LoadError> {
        if let Some(unit) = self.get(&["DistanceUnits"]).filter(|u| !matches!(*u, "mm" | "" | "?")) {
            return Err(self.wrong("DistanceUnits", "mm", &short(unit)));
        }
        let three = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
        let spacing = match self.numbers(&["ElementSpacing", "ElementSize"], axes)? {
            Some(spacing) => three(&spacing),
            None => {
                notes.push("spacing is not in the file: 1 mm is used".to_owned());
                DVec3::ONE
            }
        };
        let matrix = self.numbers(&["TransformMatrix", "Rotation", "Orientation"], axes * axes)?;
        let directions = match matrix {
            Some(rows) => {
                let row = |r: usize| three(&rows[r * axes..]);
                DMat3::from_cols(row(0), row(1), row(2))
            }
            None => {
                notes.push(
                    "orientation is not in the file (no TransformMatrix): axes are taken to point to the patient's \
                     left, posterior, superior"
                        .to_owned(),
                );
                DMat3::IDENTITY
            }
        };
        let first = self.numbers(&["Offset", "Position", "Origin"], axes)?;
        let first = first.map_or(DVec3::ZERO, |first| three(&first));
        let matrix3 = directions * DMat3::from_diagonal(spacing);
        Grid::new(dims, DAffine3 { matrix3, translation: first }).map_err(|source| LoadError::Grid {
            file: self.file.clone(),
            field: "TransformMatrix and ElementSpacing",
            source,
        })
    }

    fn stored_type(&self) -> Result<StoredType, LoadError> {
        let name = self.required("ElementType")?;
        Ok(match name {
            "MET_CHAR" => StoredType::I8,
            "MET_UCHAR" => StoredType::U8,
            "MET_SHORT" => StoredType::I16,
            "MET_USHORT" => StoredType::U16,
            // MetaIO writes both for 32 bits, whatever the machine's long is.
            "MET_INT" | "MET_LONG" => StoredType::I32,
            "MET_UINT" | "MET_ULONG" => StoredType::U32,
            "MET_LONG_LONG" => StoredType::I64,
            "MET_ULONG_LONG" => StoredType::U64,
            "MET_FLOAT" => StoredType::F32,
            "MET_DOUBLE" => StoredType::F64,
            _ => {
                let expected = "MET_CHAR to MET_ULONG_LONG, MET_FLOAT or MET_DOUBLE, of one number";
                return Err(self.wrong("ElementType", expected, &short(name)));
            }
        })
    }

    fn encoding(&self) -> Result<Encoding, LoadError> {
        let binary = self.flag(&["BinaryData"], true)?;
        let compressed = self.flag(&["CompressedData"], false)?;
        match (binary, compressed) {
            (true, false) => Ok(Encoding::Raw),
            (true, true) => Ok(Encoding::Deflate),
            (false, false) => Ok(Encoding::Text),
            (false, true) => Err(self.wrong("CompressedData", "False for voxels in text", "True")),
        }
    }

    fn byte_order(&self, stored: StoredType, encoding: Encoding) -> Result<ByteOrder, LoadError> {
        if stored.bytes() == 1 || encoding == Encoding::Text {
            return Ok(ByteOrder::Little);
        }
        // MetaIO takes the machine's order where none is said; machines are little-endian today.
        let big = self.flag(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"], false)?;
        Ok(if big { ByteOrder::Big } else { ByteOrder::Little })
    }

    fn scaling(&self) -> Result<(f64, f64), LoadError> {
        let fields = ["ElementToIntensityFunctionSlope", "ElementToIntensityFunctionOffset"];
        let number =
            |field, default| self.numbers(&[field], 1).map(|n: Option<Vec<f64>>| n.map_or(default, |n| n[0]));
        checked_scaling(&self.file, fields, number(fields[0], 1.0)?, number(fields[1], 0.0)?)
    }
}
