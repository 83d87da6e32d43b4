//! Headers of lines of text, and voxels written as numbers in text.

use crate::LoadError;
use crate::samples::StoredType;
use crate::source::Part;
use std::io::{self, BufRead, Read};

/// Longest header of text that is read, in bytes.
const LONGEST_HEADER: u64 = 1 << 20;
/// Longest number that is read, in characters.
const LONGEST_NUMBER: usize = 64;
/// Bytes of samples that are made at a time.
const BATCH: usize = 32 << 10;

/// Lines of a header, at the start of a file.
pub(crate) struct Lines {
    left: u64,
}

impl Lines {
    pub(crate) fn new() -> Self {
        Self { left: LONGEST_HEADER }
    }

    /// The next line without its end, or `None` at the end of the file.
    pub(crate) fn next(&mut self, part: &mut Part<'_>) -> Result<Option<String>, LoadError> {
        let mut line = Vec::new();
        let n = (&mut part.input)
            .take(self.left)
            .read_until(b'\n', &mut line)
            .map_err(|source| LoadError::Unreadable { file: part.name.clone(), source })?;
        self.left -= n as u64;
        if self.left == 0 {
            return Err(LoadError::TooLarge {
                file: part.name.clone(),
                what: "the header",
                found: u128::from(LONGEST_HEADER) + 1,
                allowed: LONGEST_HEADER,
            });
        }
        if n == 0 {
            return Ok(None);
        }
        while line.last().is_some_and(|b| matches!(b, b'\n' | b'\r')) {
            line.pop();
        }
        // Other bytes may stand in names and comments of old files.
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }
}

/// `count` numbers that a field holds, separated by spaces.
pub(crate) fn numbers(file: &str, field: &str, text: &str, count: usize) -> Result<Vec<f64>, LoadError> {
    list(file, field, text, count, "numbers")
}

/// `count` whole numbers that a field holds, separated by spaces.
pub(crate) fn integers(file: &str, field: &str, text: &str, count: usize) -> Result<Vec<i64>, LoadError> {
    list(file, field, text, count, "whole numbers")
}

fn list<T: std::str::FromStr>(
    file: &str,
    field: &str,
    text: &str,
    count: usize,
    what: &str,
) -> Result<Vec<T>, LoadError> {
    let wrong = || LoadError::field(file, field, format!("{count} {what}"), &short(text));
    let list: Result<Vec<T>, _> = text.split_whitespace().take(count + 1).map(str::parse).collect();
    list.ok().filter(|list| list.len() == count).ok_or_else(wrong)
}

/// What a file holds, for a message: without control characters, and not all of it.
pub(crate) fn short(text: &str) -> String {
    let start: String = text.chars().take(60).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if start.len() < text.len() { format!("{start:?}…") } else { format!("{start:?}") }
}

/// Most bytes of samples that `length` bytes of text can stand for: a digit and a space each.
pub(crate) fn most_sample_bytes(length: u64, stored: StoredType) -> u64 {
    length.div_ceil(2).saturating_mul(stored.bytes() as u64)
}

/// Numbers in text as the little-endian bytes of their type.
pub(crate) struct TextSamples<R> {
    input: R,
    stored: StoredType,
    bytes: Vec<u8>,
    given: usize,
}

impl<R: BufRead> TextSamples<R> {
    pub(crate) fn new(input: R, stored: StoredType) -> Self {
        Self { input, stored, bytes: Vec::new(), given: 0 }
    }

    /// The next number's characters, none at the end.
    fn word(&mut self) -> io::Result<Vec<u8>> {
        let mut word = Vec::new();
        loop {
            let buffer = self.input.fill_buf()?;
            if buffer.is_empty() {
                return Ok(word);
            }
            let separates = |b: &u8| b.is_ascii_whitespace() || *b == b',';
            if word.is_empty() {
                let blank = buffer.iter().take_while(|b| separates(b)).count();
                if blank > 0 {
                    self.input.consume(blank);
                    continue;
                }
            }
            let length = buffer.iter().take_while(|b| !separates(b)).count();
            word.extend_from_slice(&buffer[..length.min(LONGEST_NUMBER + 1)]);
            let ends = length < buffer.len();
            self.input.consume(length);
            if word.len() > LONGEST_NUMBER {
                let start = short(&String::from_utf8_lossy(&word));
                return Err(invalid(format!("expected a number, found {start}")));
            }
            if ends {
                return Ok(word);
            }
        }
    }
}

impl<R: BufRead> Read for TextSamples<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.given == self.bytes.len() {
            self.bytes.clear();
            self.given = 0;
            while self.bytes.len() < BATCH {
                let word = self.word()?;
                if word.is_empty() {
                    break;
                }
                let text = String::from_utf8_lossy(&word);
                push(&mut self.bytes, self.stored, &text).ok_or_else(|| {
                    invalid(format!(
                        "expected a number of type {}, found {}",
                        self.stored.name(),
                        short(&text)
                    ))
                })?;
            }
        }
        let n = buffer.len().min(self.bytes.len() - self.given);
        buffer[..n].copy_from_slice(&self.bytes[self.given..self.given + n]);
        self.given += n;
        Ok(n)
    }
}

fn invalid(message: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, message)
}

fn push(bytes: &mut Vec<u8>, stored: StoredType, text: &str) -> Option<()> {
    macro_rules! push {
        ($t:ty) => {
            bytes.extend_from_slice(&text.parse::<$t>().ok()?.to_le_bytes())
        };
    }
    match stored {
        StoredType::U8 => push!(u8),
        StoredType::I8 => push!(i8),
        StoredType::I16 => push!(i16),
        StoredType::U16 => push!(u16),
        StoredType::I32 => push!(i32),
        StoredType::U32 => push!(u32),
        StoredType::I64 => push!(i64),
        StoredType::U64 => push!(u64),
        StoredType::F32 => push!(f32),
        StoredType::F64 => push!(f64),
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, stored: StoredType) -> io::Result<Vec<u8>> {
        // A buffer of three bytes cuts numbers in two.
        let mut bytes = Vec::new();
        let input = io::BufReader::with_capacity(3, text.as_bytes());
        TextSamples::new(input, stored).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    #[test]
    fn numbers_become_bytes_wherever_the_buffer_ends() {
        assert_eq!(read(" 1, 255\n7", StoredType::U8).unwrap(), [1, 255, 7]);
        assert_eq!(read("-300 4", StoredType::I16).unwrap(), [0xd4, 0xfe, 4, 0]);
        assert_eq!(read("1.5e0", StoredType::F32).unwrap(), 1.5f32.to_le_bytes());
        assert_eq!(read("", StoredType::F32).unwrap(), [0; 0]);
    }

    #[test]
    fn what_is_no_number_of_the_type_is_named() {
        for text in ["256", "-1", "1.5", "x", &"1".repeat(5000)] {
            let error = read(text, StoredType::U8).unwrap_err();
            assert!(error.to_string().contains("expected a number"), "{error}");
        }
    }
}
