//! The files that may be DICOM: one, those of a folder, or bytes in memory.

use crate::LoadError;
use crate::source::{BUFFER, Part, Source, in_memory, open_file};
use std::path::{Path, PathBuf};

/// Most files of a folder and what lies below it.
const MOST_FILES: usize = 100_000;
/// Bytes read at a time from the start of a file: most headers are shorter.
const HEADER_BUFFER: usize = 16 << 10;
/// Folders within folders that are looked into.
const DEEPEST: usize = 12;

/// Files by number.
pub(super) enum Files<'a> {
    Disk(Vec<PathBuf>),
    Memory(Vec<(&'a str, &'a [u8])>),
}

impl<'a> Files<'a> {
    /// The file itself and, in memory, what lies beside it.
    pub(super) fn of(source: &Source<'a>) -> Result<Self, LoadError> {
        match source {
            Source::Disk(path) if path.is_dir() => Self::of_folder(path),
            Source::Disk(path) => Ok(Self::Disk(vec![path.to_path_buf()])),
            Source::Memory { name, bytes, beside } => {
                Ok(Self::Memory(std::iter::once((*name, *bytes)).chain(beside.iter().copied()).collect()))
            }
        }
    }

    /// All files of a folder and of the folders in it, in the order of their names. Links are followed as long as they
    /// stay within the folder.
    fn of_folder(folder: &Path) -> Result<Self, LoadError> {
        let unreadable = |path: &Path| {
            let file = path.display().to_string();
            move |source| LoadError::Unreadable { file, source }
        };
        let root = folder.canonicalize().map_err(unreadable(folder))?;
        let mut files = Vec::new();
        let mut folders = vec![(folder.to_path_buf(), 0)];
        while let Some((current, depth)) = folders.pop() {
            for entry in current.read_dir().map_err(unreadable(&current))? {
                let entry = entry.map_err(unreadable(&current))?;
                let path = entry.path();
                let mut kind = entry.file_type().map_err(unreadable(&path))?;
                if kind.is_symlink() {
                    let real = path.canonicalize().ok().filter(|real| real.starts_with(&root));
                    let Some(found) = real.and_then(|real| real.metadata().ok()) else { continue };
                    // A link to a folder may lead round in circles; what it shows is within the folder anyway.
                    if found.is_dir() {
                        continue;
                    }
                    kind = found.file_type();
                }
                if kind.is_dir() && depth < DEEPEST {
                    folders.push((path, depth + 1));
                } else if kind.is_file() {
                    if files.len() == MOST_FILES {
                        let file = folder.display().to_string();
                        let expected = format!("at most {MOST_FILES}");
                        return Err(LoadError::field(&file, "files in the folder", expected, "more"));
                    }
                    files.push(path);
                }
            }
        }
        files.sort();
        Ok(Self::Disk(files))
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Disk(files) => files.len(),
            Self::Memory(files) => files.len(),
        }
    }

    /// Path or name, for errors.
    pub(super) fn path(&self, file: usize) -> String {
        match self {
            Self::Disk(files) => files[file].display().to_string(),
            Self::Memory(files) => files[file].0.to_owned(),
        }
    }

    /// Name without folders, for notes.
    pub(super) fn name(&self, file: usize) -> String {
        let path = self.path(file);
        Path::new(&path).file_name().map_or(path.clone(), |name| name.to_string_lossy().into_owned())
    }

    /// Opens a file of which only the start will be read.
    pub(super) fn open_for_header(&self, file: usize) -> Result<Part<'a>, LoadError> {
        match self {
            Self::Disk(files) => open_file(&files[file], HEADER_BUFFER),
            Self::Memory(_) => self.open(file),
        }
    }

    pub(super) fn open(&self, file: usize) -> Result<Part<'a>, LoadError> {
        match self {
            Self::Disk(files) => open_file(&files[file], BUFFER),
            Self::Memory(files) => Ok(in_memory(files[file].0, files[file].1)),
        }
    }
}
