//! Where bytes come from: a file with its folder, or memory.

use crate::LoadError;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::path::{Component, Path, PathBuf};

/// Bytes read at a time from a file.
pub(crate) const BUFFER: usize = 128 << 10;

/// Buffered bytes that can be read again from the start.
pub(crate) trait Input: BufRead + Seek {}
impl<T: BufRead + Seek> Input for T {}

/// One file, open at its start.
pub(crate) struct Part<'a> {
    /// Path or name, for messages.
    pub(crate) name: String,
    /// Bytes of the file.
    pub(crate) length: u64,
    /// Its bytes.
    pub(crate) input: Box<dyn Input + 'a>,
}

impl Read for Part<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.input.read(buffer)
    }
}

/// What is to be loaded, and what lies beside it.
pub(crate) enum Source<'a> {
    /// A file; others may lie in its folder.
    Disk(&'a Path),
    /// Bytes with a name, and others with theirs.
    Memory { name: &'a str, bytes: &'a [u8], beside: &'a [(&'a str, &'a [u8])] },
}

impl<'a> Source<'a> {
    /// Path or name, for messages.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Disk(path) => path.display().to_string(),
            Self::Memory { name, .. } => (*name).to_owned(),
        }
    }

    /// Whether it is a folder of files.
    pub(crate) fn is_folder(&self) -> bool {
        matches!(self, Self::Disk(path) if path.is_dir())
    }

    /// Opens the file itself.
    pub(crate) fn open(&self) -> Result<Part<'a>, LoadError> {
        match self {
            Self::Disk(path) => open_file(path, BUFFER),
            Self::Memory { name, bytes, .. } => Ok(in_memory(name, bytes)),
        }
    }

    /// Opens the file of the same name that ends in `.json`; `None` where there is none.
    pub(crate) fn open_json_beside(&self) -> Result<Option<Part<'a>>, LoadError> {
        match self {
            Self::Disk(path) => {
                let json = path.with_extension("json");
                if json == *path || !json.exists() { Ok(None) } else { open_file(&json, BUFFER).map(Some) }
            }
            Self::Memory { name, beside, .. } => {
                let json = Path::new(name).with_extension("json");
                Ok(beside
                    .iter()
                    .find(|(other, _)| Path::new(other) == json)
                    .map(|(name, bytes)| in_memory(name, bytes)))
            }
        }
    }

    /// Opens the file that a header's `field` calls `relative`. It must lie in the header's folder or below it, also
    /// after links are followed: a header must not make the loader read what its author could not name. Nor may it be
    /// the header itself, whose text would be shown as voxels.
    pub(crate) fn open_within_folder(
        &self,
        field: &'static str,
        relative: &str,
    ) -> Result<Part<'a>, LoadError> {
        let named = relative;
        let outside = || LoadError::OutsideFolder { file: self.name(), field, found: named.to_owned() };
        // `./` is what some writers begin with, and says nothing.
        let parts = Path::new(relative).components().filter(|c| !matches!(c, Component::CurDir));
        let relative: PathBuf = parts.clone().collect();
        if relative.as_os_str().is_empty() || !parts.clone().all(|c| matches!(c, Component::Normal(_))) {
            return Err(outside());
        }
        let itself =
            || LoadError::field(&self.name(), field, "another file than the header", "the header itself");
        match self {
            Self::Disk(path) => {
                let folder = folder_of(path);
                let wanted = folder.join(&relative);
                let real = |path: &Path| {
                    path.canonicalize()
                        .map_err(|source| LoadError::Unreadable { file: path.display().to_string(), source })
                };
                let (real_folder, real_file) = (real(&folder)?, real(&wanted)?);
                if !real_file.starts_with(&real_folder) {
                    return Err(outside());
                }
                if real_file == real(path)? {
                    return Err(itself());
                }
                open_file(&real_file, BUFFER)
            }
            Self::Memory { name, .. } if Path::new(name) == relative => Err(itself()),
            Self::Memory { beside, .. } => {
                beside.iter().find(|(name, _)| Path::new(name) == relative).map_or_else(
                    || {
                        Err(LoadError::Unreadable {
                            file: relative.display().to_string(),
                            source: io::ErrorKind::NotFound.into(),
                        })
                    },
                    |(name, bytes)| Ok(in_memory(name, bytes)),
                )
            }
        }
    }
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

pub(crate) fn in_memory<'a>(name: &str, bytes: &'a [u8]) -> Part<'a> {
    Part { name: name.to_owned(), length: bytes.len() as u64, input: Box::new(Cursor::new(bytes)) }
}

pub(crate) fn open_file(path: &Path, buffer: usize) -> Result<Part<'static>, LoadError> {
    let unreadable = |source| LoadError::Unreadable { file: path.display().to_string(), source };
    // Asked before opening: to open a pipe would wait for its writer.
    let found = path.metadata().map_err(unreadable)?;
    if found.is_dir() {
        return Err(unreadable(io::ErrorKind::IsADirectory.into()));
    }
    if !found.is_file() {
        return Err(unreadable(io::Error::other("neither a file nor a folder")));
    }
    let file = File::open(path).map_err(unreadable)?;
    Ok(Part {
        name: path.display().to_string(),
        length: found.len(),
        input: Box::new(BufReader::with_capacity(buffer, file)),
    })
}

/// Fills `buffer` as far as the data go and says how far that was. Compressed data that end in the midst end there.
pub(crate) fn read_full(reader: &mut (impl Read + ?Sized), buffer: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            Err(e) if e.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(e),
        }
    }
    Ok(filled)
}
