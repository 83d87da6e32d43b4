//! The way in: recognise a file, load it, report.

use crate::source::{Part, Source, read_full};
use crate::stream::{MOST_EXPANSION, Stream};
use crate::{LoadError, SeriesFound, atlas, dicom, metaimage, nifti, nrrd, raw};
use flate2::bufread::MultiGzDecoder;
use std::fmt;
use std::io::{Read, SeekFrom};
use std::path::Path;
use std::sync::Arc;
use volume::{ChannelKind, LabelTable, NonFiniteCount, Volume};

/// Bytes that decide what a file is: a NIfTI-2 header is the longest thing to look at.
const LOOKED_AT: usize = 540;
/// Bytes of voxels that are accepted unless the caller says otherwise: 16 GiB.
const MAX_BYTES: u64 = 16 << 30;

/// Most voxels along one axis, as in [`volume::Grid`].
const LONGEST_AXIS: u32 = 32_767;
/// Largest slope and intercept, and one over the smallest slope: with any sample that is held, the value stays
/// finite in float64.
const LARGEST_SCALE: f64 = 1.0e100;

/// Called with the fraction (0 to 1) of the voxels that have been read.
pub type Progress = Arc<dyn Fn(f32) + Send + Sync>;

/// What the caller wants.
#[derive(Clone)]
pub struct LoadOptions {
    /// Most bytes that the voxels may take in memory; a header that claims more is refused before anything is
    /// allocated. 16 GiB by default.
    pub max_bytes: u64,
    /// What the samples of a one-channel file are, where the caller knows better than the file: few label maps say
    /// that they are.
    pub kind: Option<ChannelKind>,
    /// Called now and then while voxels are read, at least once at the end. Slices are read on several threads: the
    /// fraction may then fall back by a slice.
    pub progress: Option<Progress>,
    /// Which DICOM series of a folder, by its number or its UID; the one with the most images if not said.
    pub series: Option<String>,
    /// Which volume of a series in time, counted from 0.
    pub time: u64,
    /// Load although images of several patients lie in one folder.
    pub force: bool,
    /// Give back who the patient is, in [`LoadReport::identity`].
    pub identity: bool,
}

impl Default for LoadOptions {
    fn default() -> Self {
        Self {
            max_bytes: MAX_BYTES,
            kind: None,
            progress: None,
            series: None,
            time: 0,
            force: false,
            identity: false,
        }
    }
}

impl fmt::Debug for LoadOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LoadOptions")
            .field("max_bytes", &self.max_bytes)
            .field("kind", &self.kind)
            .field("progress", &self.progress.is_some())
            .field("series", &self.series)
            .field("time", &self.time)
            .field("force", &self.force)
            .field("identity", &self.identity)
            .finish()
    }
}

/// What a file was recognised as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NIfTI-1, one file.
    Nifti1,
    /// NIfTI-2, one file.
    Nifti2,
    /// HoloM3D slice atlas: slices as tiles of a PNG.
    Atlas,
    /// Raw voxels with a JSON header.
    Raw,
    /// NRRD, with its voxels or beside them.
    Nrrd,
    /// MetaImage, with its voxels or beside them.
    MetaImage,
    /// DICOM, one file or a series of them.
    Dicom,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Nifti1 => "NIfTI-1",
            Self::Nifti2 => "NIfTI-2",
            Self::Atlas => "slice atlas (PNG)",
            Self::Raw => "raw voxels with a JSON header",
            Self::Nrrd => "NRRD",
            Self::MetaImage => "MetaImage",
            Self::Dicom => "DICOM",
        })
    }
}

/// Volumes of one file or series that follow each other in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sequence {
    /// How many there are, at least 2.
    pub steps: u64,
    /// Which of them was loaded, counted from 0.
    pub loaded: u64,
    /// Seconds from one to the next, where the file says so.
    pub step_secs: Option<f64>,
}

impl Sequence {
    /// What people are told of it.
    pub(crate) fn note(&self) -> String {
        let Self { steps, loaded, step_secs } = self;
        let apart = step_secs.map(|secs| format!(", {secs} s apart")).unwrap_or_default();
        format!("a series of {steps} volumes in time{apart}: number {loaded} of 0 to {} is loaded", steps - 1)
    }

    /// Refuses a step that is not there.
    pub(crate) fn check(file: &str, steps: u64, options: &LoadOptions) -> Result<(), LoadError> {
        if options.time < steps {
            return Ok(());
        }
        let expected = match steps {
            1 => "0, the only volume there is".to_owned(),
            _ => format!("0 to {}", steps - 1),
        };
        Err(LoadError::field(file, "time", expected, &options.time))
    }
}

/// What was done to get from the file to the volume.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadReport {
    /// What the file is.
    pub format: Format,
    /// Samples that were no numbers and were replaced, one count a channel. See
    /// [`volume::Channel::replace_non_finite`].
    pub non_finite: Vec<NonFiniteCount>,
    /// What a person should know: conversions, what the file does not say, what was left out. Sentences.
    pub notes: Vec<String>,
    /// `CT`, `MR`, `PT`, … where the file says so.
    pub modality: Option<String>,
    /// Names and colours of labels, where the file has them.
    pub labels: LabelTable,
    /// Lowest and highest value of the window that the file suggests.
    pub window: Option<[f64; 2]>,
    /// The series in time that the volume is one step of, if it is.
    pub sequence: Option<Sequence>,
    /// The DICOM series that were found; only one of them is loaded.
    pub series: Vec<SeriesFound>,
    /// Who the patient is, as pairs of what and which; empty unless [`LoadOptions::identity`] asked for it.
    pub identity: Vec<(&'static str, String)>,
}

/// A volume and how it was got.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The volume; every sample is finite.
    pub volume: Volume,
    /// How it was got.
    pub report: LoadReport,
}

/// Loads the volume in a file, or the DICOM series in a folder. What a file is, its content decides, whatever its name.
///
/// Memory stays within about 1.3 times the voxels that are given back.
///
/// # Errors
/// If the file cannot be read, is of no known format, claims what cannot be or what is larger than
/// [`LoadOptions::max_bytes`], is damaged, or ends early. See [`LoadError`].
pub fn load(path: impl AsRef<Path>, options: &LoadOptions) -> Result<Loaded, LoadError> {
    load_source(&Source::Disk(path.as_ref()), options)
}

/// Loads a volume from bytes in memory; `name` stands for the file in messages.
///
/// # Errors
/// As [`load`]; also if the bytes are a header whose voxels are in another file.
pub fn load_bytes(name: &str, bytes: &[u8], options: &LoadOptions) -> Result<Loaded, LoadError> {
    load_parts(name, bytes, &[], options)
}

/// Loads a volume from bytes in memory, with the named bytes of the files that would lie beside it: the JSON of a slice
/// atlas, the voxels of a header, the other slices of a DICOM series.
///
/// # Errors
/// As [`load`].
pub fn load_parts(
    name: &str,
    bytes: &[u8],
    beside: &[(&str, &[u8])],
    options: &LoadOptions,
) -> Result<Loaded, LoadError> {
    load_source(&Source::Memory { name, bytes, beside }, options)
}

fn load_source(source: &Source<'_>, options: &LoadOptions) -> Result<Loaded, LoadError> {
    if source.is_folder() {
        return dicom::load(source, options);
    }
    let mut part = source.open()?;
    let unreadable = |source| LoadError::Unreadable { file: part.name.clone(), source };
    let mut start = [0; LOOKED_AT];
    let length = read_full(&mut part.input, &mut start).map_err(unreadable)?;
    part.input.seek(SeekFrom::Start(0)).map_err(unreadable)?;
    let start = &start[..length];

    if start.starts_with(&[0x1f, 0x8b]) {
        return load_gzip(part, options);
    }
    if nifti::is_header(start) {
        let Part { name, length, input } = part;
        return nifti::load(&name, Stream { input, holds_at_most: length, packed: None }, options);
    }
    if start.starts_with(atlas::SIGNATURE) {
        Sequence::check(&part.name, 1, options)?;
        return atlas::load(source, part, options);
    }
    if dicom::is_file(start) {
        return dicom::load(source, options);
    }
    if nrrd::is_header(start) {
        return nrrd::load(source, part, options);
    }
    if start.trim_ascii_start().starts_with(b"{") {
        Sequence::check(&part.name, 1, options)?;
        return raw::load(source, part, options);
    }
    if metaimage::is_header(start) {
        return metaimage::load(source, part, options);
    }
    Err(LoadError::UnknownFormat { file: part.name, found: what_it_is(start) })
}

/// Compressed as a whole: only NIfTI comes like that.
fn load_gzip(mut part: Part<'_>, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let damaged = |e: std::io::Error| LoadError::Damaged {
        file: part.name.clone(),
        what: "gzip data",
        reason: e.to_string(),
    };
    let mut start = [0; LOOKED_AT];
    let length = read_full(&mut MultiGzDecoder::new(&mut part.input), &mut start);
    // A file that ends after its header is for the header's reader to judge.
    let length = length.map_err(damaged)?;
    let start = &start[..length];
    if !nifti::is_header(start) {
        let found = format!("gzip of {}", what_it_is(start));
        return Err(LoadError::UnknownFormat { file: part.name, found });
    }
    part.input.seek(SeekFrom::Start(0)).map_err(damaged)?;
    let stream = Stream {
        input: MultiGzDecoder::new(part.input),
        holds_at_most: part.length.saturating_mul(MOST_EXPANSION),
        packed: Some("gzip data"),
    };
    nifti::load(&part.name, stream, options)
}

/// What the first bytes of a file look like, for a person who wonders why it is refused.
fn what_it_is(start: &[u8]) -> String {
    let text = start.iter().all(|b| (0x20..0x7f).contains(b) || b"\t\r\n".contains(b));
    let known = match start {
        [] => "an empty file",
        _ if start.starts_with(b"PK\x03\x04") => "a ZIP archive",
        _ if start.starts_with(b"\xff\xd8\xff") => "a JPEG picture",
        _ if text => "text",
        _ => {
            let first: Vec<String> = start.iter().take(8).map(|b| format!("{b:02x}")).collect();
            return format!("unknown bytes {}", first.join(" "));
        }
    };
    known.to_owned()
}

impl LoadOptions {
    /// Tells the caller how far the loader is.
    pub(crate) fn progressed(&self, fraction: f32) {
        if let Some(progress) = &self.progress {
            progress(fraction);
        }
    }

    /// Refuses what is larger than the caller allows. `bytes` is what the voxels take in memory.
    pub(crate) fn check_size(&self, file: &str, bytes: u128) -> Result<(), LoadError> {
        // Also what this machine's addresses can count, for the products that follow.
        let allowed = self.max_bytes.min(isize::MAX as u64);
        if bytes > u128::from(allowed) {
            return Err(LoadError::TooLarge {
                file: file.to_owned(),
                what: "the volume",
                found: bytes,
                allowed,
            });
        }
        Ok(())
    }
}

/// Replaces what is no number, puts the channels on the grid, and makes the report.
pub(crate) fn finish(
    file: &str,
    format: Format,
    grid: volume::Grid,
    mut channels: Vec<volume::Channel>,
    mut notes: Vec<String>,
) -> Result<Loaded, LoadError> {
    let non_finite: Vec<NonFiniteCount> =
        channels.iter_mut().map(volume::Channel::replace_non_finite).collect();
    for (channel, count) in channels.iter().zip(&non_finite).filter(|(_, c)| c.total() > 0) {
        notes.push(format!(
            "channel '{}': {} NaN and {} -Inf replaced by the lowest, {} +Inf by the highest finite value",
            channel.name, count.nan, count.negative_infinity, count.positive_infinity
        ));
    }
    let volume =
        Volume::new(grid, channels).map_err(|source| LoadError::Volume { file: file.to_owned(), source })?;
    Ok(Loaded {
        volume,
        report: LoadReport {
            format,
            non_finite,
            notes,
            modality: None,
            labels: LabelTable::default(),
            window: None,
            sequence: None,
            series: Vec::new(),
            identity: Vec::new(),
        },
    })
}

/// The length of an axis, in voxels, that a file claims.
pub(crate) fn checked_axis(file: &str, field: &str, found: i64) -> Result<u32, LoadError> {
    u32::try_from(found)
        .ok()
        .filter(|length| (1..=LONGEST_AXIS).contains(length))
        .ok_or_else(|| LoadError::field(file, field, format!("1 to {LONGEST_AXIS} voxels"), &found))
}

/// Slope and intercept that a file claims; `fields` are their names there.
pub(crate) fn checked_scaling(
    file: &str,
    fields: [&str; 2],
    slope: f64,
    intercept: f64,
) -> Result<(f64, f64), LoadError> {
    // NaN is in no range.
    if !(1.0 / LARGEST_SCALE..=LARGEST_SCALE).contains(&slope.abs()) {
        let expected = format!("a number of size 1e-100 to {LARGEST_SCALE:e}");
        return Err(LoadError::field(file, fields[0], expected, &slope));
    }
    if !(0.0..=LARGEST_SCALE).contains(&intercept.abs()) {
        let expected = format!("a number of size up to {LARGEST_SCALE:e}");
        return Err(LoadError::field(file, fields[1], expected, &intercept));
    }
    Ok((slope, intercept))
}

/// Reads what is promised to be there, and no more.
pub(crate) fn read_promised(
    file: &str,
    reader: &mut impl Read,
    buffer: &mut [u8],
    what: &'static str,
    packed: Option<&'static str>,
) -> Result<(), LoadError> {
    let found = read_full(reader, buffer).map_err(|e| broken(file, packed, e))?;
    if found < buffer.len() {
        let (expected, found) = (buffer.len() as u64, found as u64);
        return Err(LoadError::Truncated { file: file.to_owned(), what, expected, found });
    }
    Ok(())
}

/// An error in the midst of reading: of packed data (`gzip data`) or of the disk.
pub(crate) fn broken(file: &str, packed: Option<&'static str>, e: std::io::Error) -> LoadError {
    let file = file.to_owned();
    match packed {
        Some(what) => LoadError::Damaged { file, what, reason: e.to_string() },
        None => LoadError::Unreadable { file, source: e },
    }
}
