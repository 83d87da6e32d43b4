//! Voxels beside their header: in another file, or in several that follow each other.

use crate::LoadError;
use crate::source::{Part, Source};
use std::io::{self, Read, SeekFrom};

/// Most files that a header may name: one a slice of the longest axis.
const MOST_FILES: usize = 32_767;
/// Widest number in the name of a numbered file, in digits.
const WIDEST_NUMBER: usize = 9;

/// What stands before the voxels in each file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Skipped {
    /// So many bytes.
    Bytes(u64),
    /// Everything but the voxels, which are at the end.
    AllBeforeEnd,
}

impl Skipped {
    /// Where the voxels begin in a file of `length` bytes that must hold `bytes` of them.
    pub(crate) fn offset(self, file: &str, length: u64, bytes: u64) -> Result<u64, LoadError> {
        let offset = match self {
            Self::Bytes(offset) => offset,
            Self::AllBeforeEnd => length.saturating_sub(bytes),
        };
        let expected = offset.saturating_add(bytes);
        if length < expected {
            let file = file.to_owned();
            return Err(LoadError::Truncated { file, what: "header and voxels", expected, found: length });
        }
        Ok(offset)
    }
}

/// Files of raw voxels, each with as many bytes as the others.
pub(crate) struct Pieces<'s, 'a> {
    pub(crate) source: &'s Source<'a>,
    /// The field of the header that names them.
    pub(crate) field: &'static str,
    pub(crate) names: Vec<String>,
    pub(crate) skipped: Skipped,
    /// Bytes of voxels in each.
    pub(crate) bytes: u64,
}

impl<'s, 'a> Pieces<'s, 'a> {
    /// Checks that every file is there and long enough, and gives their voxels as one stream.
    pub(crate) fn open(self) -> Result<Chain<'s, 'a>, LoadError> {
        for name in &self.names {
            self.open_one(name)?;
        }
        Ok(Chain { pieces: self, next: 0, current: None })
    }

    fn open_one(&self, name: &str) -> Result<Part<'a>, LoadError> {
        let mut part = self.source.open_within_folder(self.field, name)?;
        let offset = self.skipped.offset(&part.name, part.length, self.bytes)?;
        part.input
            .seek(SeekFrom::Start(offset))
            .map_err(|source| LoadError::Unreadable { file: part.name.clone(), source })?;
        Ok(part)
    }
}

/// The voxels of several files, one after the other; one file is open at a time.
pub(crate) struct Chain<'s, 'a> {
    pieces: Pieces<'s, 'a>,
    next: usize,
    current: Option<io::Take<Part<'a>>>,
}

impl Read for Chain<'_, '_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        loop {
            if let Some(current) = &mut self.current {
                let n = current.read(buffer)?;
                if n > 0 || buffer.is_empty() {
                    return Ok(n);
                }
                // The file was long enough when it was looked at.
                if current.limit() > 0 {
                    return Ok(0);
                }
            }
            let Some(name) = self.pieces.names.get(self.next) else { return Ok(0) };
            let part = self.pieces.open_one(name).map_err(io::Error::other)?;
            self.current = Some(part.take(self.pieces.bytes));
            self.next += 1;
        }
    }
}

/// The names of numbered files: a pattern with one `%d`, such as `slice%03d.raw`, for each number from `first` to `last`.
pub(crate) fn numbered(
    file: &str,
    field: &str,
    pattern: &str,
    [first, last, step]: [i64; 3],
) -> Result<Vec<String>, LoadError> {
    let wrong = |expected: &str| LoadError::field(file, field, expected, &format!("{pattern:?}"));
    let Some((before, after)) = pattern.split_once('%') else { return Err(wrong("a name with one %d")) };
    let digits = after.bytes().take_while(u8::is_ascii_digit).count();
    let (width, rest) = after.split_at(digits);
    let Some(rest) = rest.strip_prefix(['d', 'i', 'u']).filter(|rest| !rest.contains('%')) else {
        return Err(wrong("a name with one %d"));
    };
    let zeros = width.starts_with('0');
    let width = if width.is_empty() { 0 } else { width.parse().unwrap_or(usize::MAX) };
    if width > WIDEST_NUMBER {
        return Err(wrong("a number of at most nine digits"));
    }
    let range = format!("{first} {last} {step}");
    let count = if step == 0 { None } else { last.checked_sub(first).and_then(|d| d.checked_div(step)) };
    let Some(count) = count.filter(|count| (0..MOST_FILES as i64).contains(count)) else {
        let expected = format!("first, last and step of 1 to {MOST_FILES} files");
        return Err(LoadError::field(file, field, expected, &range));
    };
    // No sum leaves the range between first and last.
    let name = |i: i64| {
        let number = first + i * step;
        if zeros {
            format!("{before}{number:0width$}{rest}")
        } else {
            format!("{before}{number:width$}{rest}")
        }
    };
    Ok((0..=count).map(name).collect())
}

/// The names of a list, one a line, to the end of the header.
pub(crate) fn listed<'t>(
    file: &str,
    field: &str,
    lines: impl Iterator<Item = &'t str>,
) -> Result<Vec<String>, LoadError> {
    let names: Vec<String> = lines
        .map(str::trim)
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .take(MOST_FILES + 1)
        .collect();
    if !(1..=MOST_FILES).contains(&names.len()) {
        return Err(LoadError::field(file, field, format!("1 to {MOST_FILES} files"), &names.len()));
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbered_files_have_their_names() {
        let names = |pattern, range| numbered("x", "data file", pattern, range);
        assert_eq!(names("a%03d.raw", [8, 10, 1]).unwrap(), ["a008.raw", "a009.raw", "a010.raw"]);
        assert_eq!(names("%d", [5, 1, -2]).unwrap(), ["5", "3", "1"]);
        assert_eq!(names("s%2i", [1, 1, 1]).unwrap(), ["s 1"]);
        for pattern in ["a", "a%", "a%s", "a%d%d", "a%99999999999999999999d", "a%010d"] {
            assert!(names(pattern, [1, 2, 1]).is_err(), "{pattern}");
        }
        for range in [[1, 2, 0], [1, 1 << 40, 1], [i64::MIN, i64::MAX, 1], [2, 1, 1], [i64::MIN, 0, -1]] {
            assert!(names("a%d", range).is_err(), "{range:?}");
        }
    }
}
