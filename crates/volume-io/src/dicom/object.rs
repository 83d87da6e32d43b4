//! What a DICOM file says, and where its pixels are.
//!
//! The data set is read as dicom-rs's tokens, and of its values only those that are needed, so that a length that lies
//! takes no memory: `dicom-object` would take what it says before it reads.

use super::files::Files;
use super::syntax::Syntax;
use super::tags;
use crate::LoadError;
use crate::samples::ByteOrder;
use crate::source::{Part, read_full};
use crate::stream::MOST_EXPANSION;
use crate::text::short;
use dicom_core::Tag;
use dicom_core::header::{HasLength as _, Header as _};
use dicom_parser::dataset::LazyDataToken;
use dicom_parser::dataset::lazy_read::LazyDataSetReader;
use dicom_parser::stateful::decode::StatefulDecode as _;
use flate2::bufread::DeflateDecoder;
use std::collections::BTreeMap;
use std::io::{Cursor, Read as _, Seek as _, SeekFrom};

/// Bytes before the letters that say what a file is.
const PREAMBLE: usize = 128;
/// Most bytes of the group about the file.
const LONGEST_META: u64 = 64 << 10;
/// Longest value that is read, in bytes. Lists of frame offsets are the longest.
const LONGEST_VALUE: u32 = 256 << 10;
/// Most bytes of a deflated file before its pixels.
const LONGEST_DEFLATED_HEADER: u64 = 32 << 20;
/// Most pieces of compressed pixels.
const MOST_FRAGMENTS: usize = 1 << 20;

/// Whether a file that starts like this is DICOM.
pub(crate) fn is_file(start: &[u8]) -> bool {
    start.get(PREAMBLE..PREAMBLE + 4) == Some(b"DICM")
}

/// Values by their tag, as they stand in the file.
#[derive(Default)]
pub(super) struct Values(BTreeMap<Tag, Box<[u8]>>);

impl Values {
    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        let bytes = self.0.get(&tag)?;
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
        (!text.is_empty()).then(|| text.to_owned())
    }

    /// Decimal strings.
    pub(super) fn numbers(&self, tag: Tag) -> Option<Vec<f64>> {
        self.text(tag)?.split('\\').map(|n| n.trim().parse().ok().filter(|n: &f64| n.is_finite())).collect()
    }

    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.numbers(tag)?.first().copied()
    }

    fn short(&self, tag: Tag, order: ByteOrder) -> Option<u16> {
        let bytes = self.0.get(&tag)?.get(..2)?.try_into().ok()?;
        Some(if order == ByteOrder::Big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    fn bytes(&self, tag: Tag) -> &[u8] {
        self.0.get(&tag).map_or(&[], |b| b)
    }
}

/// Where pixels are, as bytes in the file, or in the unpacked data set of a deflated one.
pub(super) enum Pixels {
    /// One frame after the other, as they are.
    Native { at: u64, length: u64 },
    /// In fragments, compressed; with the place of each frame's first one if the file says so.
    Encapsulated { offsets: Vec<u32>, fragments: Vec<Fragment> },
}

/// A piece of compressed pixels.
#[derive(Clone, Copy)]
pub(super) struct Fragment {
    /// Where its bytes begin in the file.
    pub(super) at: u64,
    pub(super) length: u32,
    /// Where its item begins, counted from the first one.
    pub(super) offset: u64,
}

/// One file: what it says, and where its pixels are. It has no `Debug`, since it holds the patient's name.
pub(super) struct Object {
    /// Which of the files it is.
    pub(super) file: usize,
    pub(super) syntax: Syntax,
    pub(super) syntax_uid: String,
    pub(super) top: Values,
    pub(super) shared: Values,
    pub(super) per_frame: Vec<Values>,
    pub(super) injected: Values,
    pub(super) pixels: Option<Pixels>,
    /// Where the data set begins, in bytes.
    pub(super) data_set_at: u64,
}

impl Object {
    /// Reads a file up to its pixels; `None` if it is no DICOM file.
    pub(super) fn read(files: &Files<'_>, file: usize) -> Result<Option<Self>, LoadError> {
        let mut part = files.open_for_header(file)?;
        let mut start = [0; PREAMBLE + 4];
        let found = read_full(&mut part, &mut start).map_err(|e| unreadable(&part, e))?;
        if !is_file(&start[..found]) {
            return Ok(None);
        }
        let uid = read_meta(&mut part)?;
        let syntax = Syntax::named(&uid);
        let mut object = Self {
            file,
            syntax,
            syntax_uid: uid,
            top: Values::default(),
            shared: Values::default(),
            per_frame: Vec::new(),
            injected: Values::default(),
            pixels: None,
            data_set_at: part.input.stream_position().map_err(|e| unreadable(&part, e))?,
        };
        if syntax.is_deflated() {
            let at = object.data_set_at;
            let may_hold = part.length.saturating_sub(at).saturating_mul(MOST_EXPANSION);
            let most = LONGEST_DEFLATED_HEADER.min(may_hold);
            let mut header = Vec::new();
            DeflateDecoder::new(&mut part.input)
                .take(most)
                .read_to_end(&mut header)
                .map_err(|e| damaged(&part.name, "deflated data set", &e))?;
            let length = header.len() as u64;
            let mut inner = Part { name: part.name, length, input: Box::new(Cursor::new(header)) };
            object.read_data_set(&mut inner)?;
        } else {
            object.read_data_set(&mut part)?;
        }
        Ok(Some(object))
    }

    /// Reads tokens up to the pixels.
    fn read_data_set(&mut self, part: &mut Part<'_>) -> Result<(), LoadError> {
        let file = part.name.clone();
        // What the library says may quote the file, and so the patient.
        let broken = |at: u64| LoadError::Damaged {
            file: file.clone(),
            what: "data set",
            reason: format!("no element can be read near byte {at}"),
        };
        let syntax = self.syntax.data_set();
        let mut tokens = LazyDataSetReader::new_with_ts(&mut part.input, &syntax).map_err(|_| broken(0))?;
        // Tags of the sequences that are open, innermost last.
        let mut open: Vec<Tag> = Vec::new();
        let mut last = 0;
        let pixels = loop {
            let token = match tokens.advance() {
                None => break None,
                Some(token) => token.map_err(|_| broken(last))?,
            };
            match token {
                LazyDataToken::SequenceStart { tag, .. } => open.push(tag),
                LazyDataToken::SequenceEnd => {
                    open.pop();
                }
                LazyDataToken::ItemStart { .. } if *open == [tags::PER_FRAME] => {
                    self.per_frame.push(Values::default());
                }
                LazyDataToken::PixelSequenceStart if open.is_empty() => break Some(None),
                LazyDataToken::ElementHeader(header)
                    if open.is_empty() && header.tag() == tags::PIXEL_DATA =>
                {
                    break Some(header.length().get());
                }
                LazyDataToken::ElementHeader(header)
                    if open.is_empty() && tags::FLOAT_PIXELS.contains(&header.tag()) =>
                {
                    return Err(LoadError::field(&file, "pixels", "integers", "floating-point numbers"));
                }
                LazyDataToken::LazyValue { header, decoder } => {
                    let (tag, length) = (header.tag(), header.length().get().unwrap_or(0));
                    last = decoder.position();
                    match self.place(&open, tag).filter(|_| length <= LONGEST_VALUE) {
                        Some(values) => {
                            let mut bytes = Vec::new();
                            decoder.read_to_vec(length, &mut bytes).map_err(|_| broken(last))?;
                            values.0.insert(tag, bytes.into());
                        }
                        None => decoder.skip_bytes(length).map_err(|_| broken(last))?,
                    }
                }
                LazyDataToken::LazyItemValue { len, decoder } => {
                    decoder.skip_bytes(len).map_err(|_| broken(last))?;
                }
                _ => {}
            }
        };
        let at = tokens.into_decoder().position();
        // What is passed over may lie beyond the end: no pixels were found then, but not because there are none.
        if at > part.length {
            return Err(LoadError::Truncated { file, what: "data set", expected: at, found: part.length });
        }
        self.pixels = match pixels {
            None => None,
            Some(Some(length)) => Some(Pixels::Native { at, length: length.into() }),
            Some(None) if self.syntax.is_encapsulated() => Some(fragments(part, at)?),
            Some(None) => {
                let expected = "pixels of a known length in this transfer syntax";
                return Err(LoadError::field(&file, "pixel data", expected, "pieces of compressed pixels"));
            }
        };
        Ok(())
    }

    /// Where a value is kept, if it is one that is needed.
    fn place(&mut self, open: &[Tag], tag: Tag) -> Option<&mut Values> {
        match *open {
            [] => tags::READ.contains(&tag).then_some(&mut self.top),
            [tags::RADIOPHARMACEUTICAL] => tags::READ.contains(&tag).then_some(&mut self.injected),
            [of @ (tags::SHARED | tags::PER_FRAME), group] => {
                let needed = tags::GROUPS.iter().any(|(g, needed)| *g == group && needed.contains(&tag));
                if !needed {
                    None
                } else if of == tags::SHARED {
                    Some(&mut self.shared)
                } else {
                    self.per_frame.last_mut()
                }
            }
            _ => None,
        }
    }

    /// A value of a frame: its own, else what all frames share, else that of the whole file.
    pub(super) fn of_frame(&self, frame: usize, tag: Tag) -> Option<Vec<f64>> {
        let own = self.per_frame.get(frame).and_then(|values| values.numbers(tag));
        own.or_else(|| self.shared.numbers(tag)).or_else(|| self.top.numbers(tag))
    }

    /// Which step in time a frame is of: an unsigned number of 32 bits (VR UL).
    pub(super) fn step_of_frame(&self, frame: usize) -> Option<f64> {
        let tag = tags::TEMPORAL_POSITION_INDEX;
        let values = [self.per_frame.get(frame), Some(&self.shared), Some(&self.top)];
        let bytes = values.into_iter().flatten().find_map(|v| <[u8; 4]>::try_from(v.bytes(tag)).ok())?;
        let big = self.syntax.order() == ByteOrder::Big;
        Some(if big { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }.into())
    }

    /// A small number of the image's description.
    pub(super) fn short(&self, tag: Tag) -> Option<u16> {
        self.top.short(tag, self.syntax.order())
    }

    /// What tells patients apart: never shown.
    pub(super) fn patient(&self) -> [&[u8]; 2] {
        [self.top.bytes(tags::PATIENT_ID), self.top.bytes(tags::PATIENT_NAME)]
    }
}

/// The transfer syntax, from the group about the file: explicit, little-endian, whatever follows.
fn read_meta(part: &mut Part<'_>) -> Result<String, LoadError> {
    const WHAT: &str = "the group about the file";
    let file = part.name.clone();
    let start = part.input.stream_position().map_err(|e| unreadable(part, e))?;
    let mut at = start;
    let mut syntax = None;
    // From where the reader stands to another place. What has been buffered stays: the whole group is in it.
    let go = |part: &mut Part<'_>, from: u64, to: u64| {
        part.input.seek_relative(to.cast_signed() - from.cast_signed()).map_err(|e| unreadable(part, e))
    };
    loop {
        let mut head = [0; 12];
        let found = read_full(part, &mut head).map_err(|e| unreadable(part, e))?;
        let here = at + found as u64;
        if found < 8 || head[..2] != [2, 0] {
            go(part, here, at)?;
            return syntax.ok_or_else(|| {
                LoadError::field(&file, "transfer syntax (0002,0010)", "such an element", "none")
            });
        }
        let [_, _, e0, e1, _, _, s0, s1, l0, l1, l2, l3] = head;
        let (value_at, length) = if matches!(&head[4..6], b"OB" | b"OW" | b"SQ" | b"UN" | b"UT") {
            (at + 12, u32::from_le_bytes([l0, l1, l2, l3]).into())
        } else {
            (at + 8, u64::from(u16::from_le_bytes([s0, s1])))
        };
        at = value_at + length;
        if at - start > LONGEST_META {
            let found = u128::from(at - start);
            return Err(LoadError::TooLarge { file, what: WHAT, found, allowed: LONGEST_META });
        }
        if at > part.length {
            return Err(LoadError::Truncated { file, what: WHAT, expected: at, found: part.length });
        }
        if [e0, e1] == [0x10, 0] {
            let mut value = vec![0; length as usize];
            go(part, here, value_at)?;
            let read = read_full(part, &mut value).map_err(|e| unreadable(part, e))?;
            syntax = Some(String::from_utf8_lossy(&value).trim_matches(['\0', ' ']).to_owned());
            go(part, value_at + read as u64, at)?;
        } else {
            go(part, here, at)?;
        }
    }
}

/// The items of compressed pixels that begin at `at`: the first one holds the offsets of frames, if any.
fn fragments(part: &mut Part<'_>, at: u64) -> Result<Pixels, LoadError> {
    let mut offsets = None;
    let (mut fragments, mut first) = (Vec::new(), at);
    let mut at = at;
    loop {
        part.input.seek(SeekFrom::Start(at)).map_err(|e| unreadable(part, e))?;
        let mut head = [0; 8];
        let found = read_full(part, &mut head).map_err(|e| unreadable(part, e))?;
        let [.., l0, l1, l2, l3] = head;
        let length = u32::from_le_bytes([l0, l1, l2, l3]);
        // Files that lack the last delimiter are common; their pieces are there.
        let ends = found == 0 && !fragments.is_empty();
        if ends || (found == head.len() && head[..4] == [0xfe, 0xff, 0xdd, 0xe0]) {
            return Ok(Pixels::Encapsulated { offsets: offsets.unwrap_or_default(), fragments });
        }
        if found < head.len() || head[..4] != [0xfe, 0xff, 0x00, 0xe0] || fragments.len() == MOST_FRAGMENTS {
            let found = short(&format!("{:02x?} at byte {at}", &head[..found]));
            return Err(LoadError::field(&part.name, "pixel data", "items of compressed pixels", &found));
        }
        let end = at + 8 + u64::from(length);
        if end > part.length {
            let what = "compressed pixels";
            return Err(LoadError::Truncated {
                file: part.name.clone(),
                what,
                expected: end,
                found: part.length,
            });
        }
        if offsets.is_none() {
            let mut table = vec![0; length as usize];
            read_full(part, &mut table).map_err(|e| unreadable(part, e))?;
            offsets = Some(table.as_chunks().0.iter().map(|&b| u32::from_le_bytes(b)).collect());
            first = end;
        } else {
            fragments.push(Fragment { at: at + 8, length, offset: at - first });
        }
        at = end;
    }
}

pub(super) fn unreadable(part: &Part<'_>, source: std::io::Error) -> LoadError {
    LoadError::Unreadable { file: part.name.clone(), source }
}

pub(super) fn damaged(file: &str, what: &'static str, reason: &impl ToString) -> LoadError {
    LoadError::Damaged { file: file.to_owned(), what, reason: reason.to_string() }
}
