//! Writing the file: samples as they come, the index at the end.

use crate::RecordingError;
use crate::movie::{self, Chunk, SampleTable, TICKS_PER_SECOND};
use codec::{AccessUnit, NalKind, ParameterSets, nal_units};
use mp4_atom::{Avc1, Encode};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Samples in a chunk before the next one begins, so that a player that seeks adds up few sizes: two seconds.
const SAMPLES_PER_CHUNK: u32 = 120;
/// A box of media data with a 64-bit length: 1, type, then the length.
const MEDIA_HEADER_BYTES: u64 = 16;

/// A video file in the making.
///
/// Until [`Recording::finish`], the file has `.part` after its name, and no index: no player takes it for a video. A
/// recording that is dropped unfinished takes that file away with it.
pub struct Recording {
    path: PathBuf,
    part_path: PathBuf,
    /// `None` once finished or given up.
    file: Option<BufWriter<File>>,
    /// Where the media data begin in the file, header included.
    media_offset: u64,
    /// Bytes of the media data, header included.
    media_bytes: u64,
    table: SampleTable,
    /// When the first picture was shown, and the last, and the last in ticks after the first.
    shown: Option<(Duration, Duration, u64)>,
}

/// What a finished recording is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Summary {
    /// The file.
    pub path: PathBuf,
    /// Its length.
    pub bytes: u64,
    /// Pictures in it.
    pub pictures: usize,
    /// How long it plays.
    pub duration: Duration,
}

impl Recording {
    /// Begins a recording that is going to be at `path`; a file that is there is replaced at the end.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self, RecordingError> {
        let path = path.into();
        let mut part_name = OsString::from(&path);
        part_name.push(".part");
        let part_path = PathBuf::from(part_name);
        let file =
            File::create(&part_path).map_err(|source| file_error("create the file", &part_path, source))?;
        let mut recording = Self {
            path,
            part_path,
            file: Some(BufWriter::new(file)),
            media_offset: 0,
            media_bytes: MEDIA_HEADER_BYTES,
            table: SampleTable::default(),
            shown: None,
        };
        let mut header = recording.encoded(&movie::file_type())?;
        recording.media_offset = header.len() as u64;
        header.extend(media_header(MEDIA_HEADER_BYTES));
        recording.write(&header)?;
        Ok(recording)
    }

    /// Adds a picture that was shown at `display_time`, of any one clock: the first picture's time is the recording's
    /// beginning. A picture is shown until the next one. All pictures that a later one refers to must be there, so
    /// after a loss the next one to add is a key frame; a key frame may change the size.
    ///
    /// # Errors
    /// If the first access unit is no key frame, one holds no picture, is not shown later than the one before by at
    /// least 12 µs: what was added before then stays good. If the file cannot be written, the recording is given up
    /// and its file taken away.
    pub fn add(&mut self, access_unit: &AccessUnit, display_time: Duration) -> Result<(), RecordingError> {
        let (first_time, ticks, gap) = match self.shown {
            None => (display_time, 0, None),
            Some((first, previous, previous_ticks)) => {
                let ticks = ticks(display_time.saturating_sub(first));
                if ticks <= previous_ticks {
                    return Err(RecordingError::NotLater { previous, found: display_time });
                }
                let gap = u32::try_from(ticks - previous_ticks)
                    .map_err(|_| RecordingError::TooLate { previous, found: display_time })?;
                (first, ticks, Some(gap))
            }
        };
        let new_description = self.description_if_new(access_unit)?;
        if self.table.descriptions.is_empty() && new_description.is_none() {
            return Err(RecordingError::NoKeyFrame);
        }
        let sample = sample(&access_unit.bytes)?;
        let size = u32::try_from(sample.len())
            .map_err(|_| RecordingError::TooLong { bytes: access_unit.bytes.len() })?;
        self.write(&sample)?;

        // Nothing fails from here on, so that the index says what is in the file.
        let offset = self.media_offset + self.media_bytes;
        self.media_bytes += u64::from(size);
        let begins_chunk = new_description.is_some();
        self.table.descriptions.extend(new_description);
        let description = self.table.descriptions.len() as u32 - 1;
        match self.table.chunks.last_mut() {
            Some(chunk) if !begins_chunk && chunk.samples < SAMPLES_PER_CHUNK => chunk.samples += 1,
            _ => self.table.chunks.push(Chunk { offset, samples: 1, description }),
        }
        self.table.sizes.push(size);
        self.table.gaps.extend(gap);
        if access_unit.key_frame {
            self.table.key_frames.push(self.table.sizes.len() as u32);
        }
        self.shown = Some((first_time, display_time, ticks));
        Ok(())
    }

    /// Writes the index and gives the file its name.
    ///
    /// # Errors
    /// If no picture was added, or the file cannot be written; nothing is left of it then.
    pub fn finish(mut self) -> Result<Summary, RecordingError> {
        if self.table.sizes.is_empty() {
            return Err(RecordingError::Empty);
        }
        let pictures = self.table.sizes.len();
        let duration = Duration::from_nanos(nanoseconds(self.table.duration()));
        let movie = movie::index(std::mem::take(&mut self.table));
        let index = self.encoded(&movie)?;
        self.write(&index)?;
        let media_header = media_header(self.media_bytes);
        let end = |file: &mut BufWriter<File>, media_offset: u64| -> io::Result<()> {
            file.seek(SeekFrom::Start(media_offset))?;
            file.write_all(&media_header)?;
            file.flush()
        };
        if let Some(file) = &mut self.file {
            end(file, self.media_offset)
                .map_err(|source| file_error("finish the file", &self.part_path, source))?;
        }
        fs::rename(&self.part_path, &self.path)
            .map_err(|source| file_error("give its name to the file", &self.path, source))?;
        self.file = None;
        let bytes = self.media_offset + self.media_bytes + index.len() as u64;
        Ok(Summary { path: self.path.clone(), bytes, pictures, duration })
    }

    /// The sample description, where the access unit brings other parameter sets than the last one had.
    fn description_if_new(&self, access_unit: &AccessUnit) -> Result<Option<Avc1>, RecordingError> {
        if !access_unit.key_frame {
            return Ok(None);
        }
        let sets = ParameterSets::find(&access_unit.bytes)?;
        let description = movie::description(&sets)
            .map_err(|source| RecordingError::Index { path: self.path.clone(), source })?;
        Ok((self.table.descriptions.last() != Some(&description)).then_some(description))
    }

    fn encoded(&self, item: &impl Encode) -> Result<Vec<u8>, RecordingError> {
        let mut bytes = Vec::new();
        item.encode(&mut bytes)
            .map_err(|source| RecordingError::Index { path: self.path.clone(), source })?;
        Ok(bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        let Some(file) = &mut self.file else {
            return Err(RecordingError::GivenUp { path: self.path.clone() });
        };
        file.write_all(bytes).map_err(|source| {
            // Some of the bytes may be in the file, so that the index would point beside what follows.
            self.discard();
            file_error("write to the file", &self.part_path, source)
        })
    }

    fn discard(&mut self) {
        if self.file.take().is_some() {
            // If it cannot be removed either, there is nobody to be told but by the error that led here.
            let _ = fs::remove_file(&self.part_path);
        }
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        self.discard();
    }
}

fn file_error(action: &'static str, path: &Path, source: io::Error) -> RecordingError {
    RecordingError::File { action, path: path.to_owned(), source }
}

fn media_header(bytes: u64) -> Vec<u8> {
    [&1u32.to_be_bytes()[..], b"mdat", &bytes.to_be_bytes()].concat()
}

/// An access unit as MP4 holds it (ISO/IEC 14496-15): each NAL unit after its length. Parameter sets and delimiters
/// are left out, as `avc1` demands.
fn sample(access_unit: &[u8]) -> Result<Vec<u8>, RecordingError> {
    let mut sample = Vec::with_capacity(access_unit.len() + 8);
    let mut slices = 0;
    for unit in nal_units(access_unit) {
        match unit.kind {
            NalKind::SequenceParameterSet | NalKind::PictureParameterSet | NalKind::Delimiter => continue,
            NalKind::Slice | NalKind::KeySlice => slices += 1,
            NalKind::Supplemental | NalKind::Other(_) => {}
        }
        let length = u32::try_from(unit.bytes.len())
            .map_err(|_| RecordingError::TooLong { bytes: access_unit.len() })?;
        sample.extend(length.to_be_bytes());
        sample.extend(unit.bytes);
    }
    if slices == 0 {
        return Err(RecordingError::NoSlice { bytes: access_unit.len() });
    }
    Ok(sample)
}

/// The nearest tick. Each time is rounded by itself, so that errors do not add up.
fn ticks(time: Duration) -> u64 {
    let ticks = (time.as_nanos() * u128::from(TICKS_PER_SECOND) + 500_000_000) / 1_000_000_000;
    u64::try_from(ticks).unwrap_or(u64::MAX)
}

fn nanoseconds(ticks: u64) -> u64 {
    let nanoseconds = u128::from(ticks) * 1_000_000_000 / u128::from(TICKS_PER_SECOND);
    u64::try_from(nanoseconds).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixty_frames_a_second_are_whole_ticks() {
        assert_eq!(ticks(Duration::from_secs_f64(1.0 / 60.0)), 1500);
        assert_eq!(ticks(Duration::from_secs(3600)), 3600 * 90_000);
        assert_eq!(nanoseconds(ticks(Duration::from_millis(100))), 100_000_000);
    }

    #[test]
    fn samples_hold_lengths_and_no_parameter_sets() {
        let access_unit = [0, 0, 0, 1, 9, 16, 0, 0, 0, 1, 0x67, 1, 0, 0, 1, 0x68, 2, 0, 0, 0, 1, 0x65, 7, 8];
        assert_eq!(sample(&access_unit).unwrap(), [0, 0, 0, 3, 0x65, 7, 8]);
        assert!(matches!(sample(&access_unit[..17]), Err(RecordingError::NoSlice { bytes: 17 })));
    }
}
