//! Measurements as they were made, one JSON object a line, so that an interrupted sweep goes on.

use crate::Row;
use crate::sweep::SweepError;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A measurement with what it was made of.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Entry {
    /// Subject, quality, program and device: a measurement holds for these alone.
    pub(crate) key: String,
    pub(crate) row: Row,
}

/// The file, and what it holds.
#[derive(Debug)]
pub(crate) struct Journal {
    path: PathBuf,
    file: File,
    pub(crate) entries: Vec<Entry>,
}

impl Journal {
    /// Opens or begins the file. Lines that are no measurement, such as one that was cut off, are passed over: what they
    /// were is measured again.
    pub(crate) fn open(path: PathBuf) -> Result<Self, SweepError> {
        let failed = |source| SweepError::File { path: path.clone(), source };
        let mut file = OpenOptions::new().create(true).append(true).read(true).open(&path).map_err(failed)?;
        let text = std::fs::read(&path).map_err(failed)?;
        if text.last().is_some_and(|last| *last != b'\n') {
            file.write_all(b"\n").map_err(failed)?;
        }
        let entries =
            text.split(|byte| *byte == b'\n').filter_map(|line| serde_json::from_slice(line).ok()).collect();
        Ok(Self { path, file, entries })
    }

    /// The latest measurement of that key.
    pub(crate) fn find(&self, key: &str) -> Option<&Row> {
        self.entries.iter().rev().find(|entry| entry.key == key).map(|entry| &entry.row)
    }

    pub(crate) fn add(&mut self, entry: Entry) -> Result<(), SweepError> {
        // Numbers of a row are finite, and its types are plain.
        let mut line = serde_json::to_vec(&entry).expect("a row can be written as JSON");
        line.push(b'\n');
        let path: &Path = &self.path;
        self.file.write_all(&line).map_err(|source| SweepError::File { path: path.to_owned(), source })?;
        self.entries.push(entry);
        Ok(())
    }
}
