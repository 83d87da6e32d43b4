//! The bytes of voxels as a stream, unpacked on the way.

use crate::LoadError;
use crate::load::broken;
use crate::pieces::Skipped;
use crate::recorded::Recorded;
use crate::source::Part;
use crate::text::{TextSamples, most_sample_bytes};
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use std::io::{BufRead as _, Read, Seek as _, SeekFrom};

/// A byte of deflate data holds at most 1032 bytes: a match of 258 bytes takes two bits.
pub(crate) const MOST_EXPANSION: u64 = 1032;
/// Bytes after the voxels that are read for the checksum of packed data, which stands at their end.
const TAIL: usize = 64 << 10;

/// Bytes of voxels, or of a file that holds them, unpacked.
pub(crate) struct Stream<R> {
    /// The bytes.
    pub(crate) input: R,
    /// How many they can be at most: the file's length, or what that much packed data can hold.
    pub(crate) holds_at_most: u64,
    /// What they are unpacked from on the way, such as `gzip data`.
    pub(crate) packed: Option<&'static str>,
}

/// How voxels are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// As they are.
    Raw,
    /// As numbers in text.
    Text,
    /// Compressed, with the header of gzip or of zlib.
    Deflate,
}

/// The voxels that begin where `part` stands, after what is `skipped`.
pub(crate) fn open<'a>(
    mut part: Part<'a>,
    recorded: &Recorded,
    skipped: Skipped,
) -> Result<Stream<Box<dyn Read + 'a>>, LoadError> {
    let Recorded { encoding, stored, .. } = *recorded;
    let file = part.name.clone();
    let unreadable = |source| LoadError::Unreadable { file: file.clone(), source };
    let at = part.input.stream_position().map_err(unreadable)?;
    let left = part.length.saturating_sub(at);
    let (input, holds_at_most, packed): (Box<dyn Read + 'a>, _, _) = match encoding {
        Encoding::Raw => {
            let promised = match skipped {
                Skipped::Bytes(_) => recorded.before() + recorded.bytes(),
                Skipped::AllBeforeEnd => recorded.whole(),
            };
            let offset = skipped.offset(&file, left, promised)? + recorded.before();
            part.input.seek(SeekFrom::Start(at + offset)).map_err(unreadable)?;
            return Ok(Stream { input: Box::new(part.input), holds_at_most: left - offset, packed: None });
        }
        Encoding::Text => {
            let input = Box::new(TextSamples::new(part.input, stored));
            (input, most_sample_bytes(left, stored), "text of numbers")
        }
        Encoding::Deflate => {
            let most = left.saturating_mul(MOST_EXPANSION);
            if part.input.fill_buf().map_err(unreadable)?.starts_with(&[0x1f, 0x8b]) {
                (Box::new(MultiGzDecoder::new(part.input)), most, "gzip data")
            } else {
                (Box::new(ZlibDecoder::new(part.input)), most, "zlib data")
            }
        }
    };
    let mut stream = Stream { input, holds_at_most, packed: Some(packed) };
    match skipped {
        Skipped::Bytes(0) => {}
        Skipped::Bytes(skipped) if encoding == Encoding::Deflate => {
            pass_over(&file, &mut stream, skipped, "bytes to skip")?;
        }
        _ => {
            let expected = "nothing to skip before voxels that are text or compressed";
            return Err(LoadError::field(&file, "bytes to skip", expected, &format!("{skipped:?}")));
        }
    }
    pass_over(&file, &mut stream, recorded.before(), "the volumes before")?;
    Ok(stream)
}

/// Reads over `bytes`.
pub(crate) fn pass_over(
    file: &str,
    stream: &mut Stream<impl Read>,
    bytes: u64,
    what: &'static str,
) -> Result<(), LoadError> {
    let passed = std::io::copy(&mut stream.input.by_ref().take(bytes), &mut std::io::sink());
    let found = passed.map_err(|e| broken(file, stream.packed, e))?;
    if found < bytes {
        return Err(LoadError::Truncated { file: file.to_owned(), what, expected: bytes, found });
    }
    stream.holds_at_most = stream.holds_at_most.saturating_sub(bytes);
    Ok(())
}

/// Reads on to the end of the data, where gzip and zlib have their checksum, but not far: nobody asked for what follows.
pub(crate) fn check_tail(
    file: &str,
    stream: &mut Stream<impl Read>,
    notes: &mut Vec<String>,
) -> Result<(), LoadError> {
    let mut tail = vec![0; TAIL];
    let mut length = 0;
    while length < TAIL {
        match stream.input.read(&mut tail[length..]) {
            Ok(0) => break,
            Ok(n) => length += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(broken(file, stream.packed, e)),
        }
    }
    if length > 0 {
        let or_more = if length == TAIL { " or more" } else { "" };
        notes.push(format!("{length} bytes{or_more} after the voxels were not read"));
    }
    Ok(())
}
