//! The fields of a NRRD header.

use super::MOST_AXES;
use crate::LoadError;
use crate::labels::Segments;
use crate::samples::{ByteOrder, StoredType};
use crate::source::Part;
use crate::stream::Encoding;
use crate::text::{Lines, integers, short};
use std::collections::BTreeMap;

/// How a file begins, before the version.
const MAGIC: &[u8] = b"NRRD000";
/// The fields of the definition, version 5, and their other spellings. Those that are not used are passed over.
const FIELDS: &[&str] = &[
    "dimension",
    "type",
    "block size",
    "blocksize",
    "encoding",
    "endian",
    "content",
    "min",
    "max",
    "old min",
    "oldmin",
    "old max",
    "oldmax",
    "data file",
    "datafile",
    "line skip",
    "lineskip",
    "byte skip",
    "byteskip",
    "number",
    "sample units",
    "sampleunits",
    "sizes",
    "spacings",
    "thicknesses",
    "axis mins",
    "axismins",
    "axis maxs",
    "axismaxs",
    "centers",
    "centerings",
    "labels",
    "units",
    "kinds",
    "space",
    "space dimension",
    "space units",
    "space origin",
    "space directions",
    "measurement frame",
];

/// Whether a file that starts like this is NRRD.
pub(crate) fn is_header(start: &[u8]) -> bool {
    start.starts_with(MAGIC)
}

/// The fields as text. Keys and values, which may name the patient, are not kept, but for what they say of segments.
pub(super) struct Header {
    file: String,
    fields: BTreeMap<String, String>,
    /// The lines that follow `data file: LIST`.
    pub(super) after_data_file: Vec<String>,
    /// The segments that keys describe.
    pub(super) segments: Segments,
}

impl Header {
    /// Reads to the line before the voxels, or to the end of a header that stands alone.
    pub(super) fn read(part: &mut Part<'_>) -> Result<Self, LoadError> {
        let file = part.name.clone();
        let mut lines = Lines::new();
        let first = lines.next(part)?.unwrap_or_default();
        if !matches!(first.as_str(), "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005") {
            return Err(LoadError::field(&file, "the first line", "NRRD0001 to NRRD0005", &short(&first)));
        }
        let mut header = Self {
            file,
            fields: BTreeMap::new(),
            after_data_file: Vec::new(),
            segments: Segments::default(),
        };
        let mut ended = false;
        while let Some(line) = lines.next(part)? {
            if line.is_empty() {
                ended = true;
                break;
            }
            if line.starts_with('#') {
                continue;
            }
            if header.is_list() {
                header.after_data_file.push(line);
                continue;
            }
            header.take(&line)?;
        }
        if !ended && header.get(&["data file", "datafile"]).is_none() {
            let (file, found) = (header.file, part.length);
            return Err(LoadError::Truncated { file, what: "header", expected: found + 1, found });
        }
        Ok(header)
    }

    fn is_list(&self) -> bool {
        self.get(&["data file", "datafile"]).is_some_and(|d| d.split_whitespace().next() == Some("LIST"))
    }

    fn take(&mut self, line: &str) -> Result<(), LoadError> {
        let file = &self.file;
        let Some((name, value)) = line.split_once(':') else {
            return Err(LoadError::field(file, "header", "lines of `field: value`", &short(line)));
        };
        if let Some(value) = value.strip_prefix('=') {
            self.segments.take(name, value);
            return Ok(());
        }
        let name = name.trim().to_ascii_lowercase();
        if !FIELDS.contains(&name.as_str()) {
            return Err(LoadError::field(file, "header", "a field of the NRRD definition", &short(line)));
        }
        if self.fields.insert(name.clone(), value.trim().to_owned()).is_some() {
            return Err(LoadError::field(file, name, "one such field", "two"));
        }
        Ok(())
    }

    /// The field, whichever of its spellings is there.
    pub(super) fn get(&self, spellings: &[&str]) -> Option<&str> {
        spellings.iter().find_map(|s| self.fields.get(*s)).map(String::as_str)
    }

    /// A field that must be there.
    pub(super) fn required(&self, name: &str) -> Result<&str, LoadError> {
        self.get(&[name]).ok_or_else(|| LoadError::field(&self.file, name, "such a field", "none"))
    }

    /// A whole number, `default` where the field is not there.
    pub(super) fn integer(&self, spellings: &[&str], default: i64) -> Result<i64, LoadError> {
        match self.get(spellings) {
            None => Ok(default),
            Some(text) => Ok(integers(&self.file, spellings[0], text, 1)?[0]),
        }
    }

    /// Number of axes.
    pub(super) fn dimension(&self) -> Result<usize, LoadError> {
        let found = integers(&self.file, "dimension", self.required("dimension")?, 1)?[0];
        if !(1..=MOST_AXES).contains(&found) {
            return Err(LoadError::field(&self.file, "dimension", format!("1 to {MOST_AXES}"), &found));
        }
        Ok(found as usize)
    }

    /// Order of bytes; it must be said where samples have more than one and are not text.
    pub(super) fn byte_order(&self, stored: StoredType, encoding: Encoding) -> Result<ByteOrder, LoadError> {
        if stored.bytes() == 1 || encoding == Encoding::Text {
            return Ok(ByteOrder::Little);
        }
        match self.required("endian")? {
            "little" => Ok(ByteOrder::Little),
            "big" => Ok(ByteOrder::Big),
            other => Err(LoadError::field(&self.file, "endian", "little or big", &short(other))),
        }
    }
}
