//! Volume to file: NIfTI, NRRD, slice atlas.

mod atlas;
mod nifti;
mod nrrd;
mod samples;

use crate::Progress;
use spatial::{DAffine3, DVec3};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use volume::{Channel, Grid, GridError, Volume, Voxels};

pub use samples::Depth;

/// Bytes that are written between two calls of the progress callback.
const BYTES_A_CALL: usize = 4 << 20;

/// What of a volume is written, and how.
#[derive(Clone, Default)]
pub struct SaveOptions {
    /// Voxels along x, y and z that are written; all if not said.
    pub crop: Option<[Range<u32>; 3]>,
    /// The channel that is written; it must be said if there are several.
    pub channel: Option<String>,
    /// Bits of a sample.
    pub depth: Depth,
    /// Lowest and highest value that 8 or 16 bits stand for; those of the channel if not said.
    pub window: Option<[f64; 2]>,
    /// Replace a file that is there.
    pub overwrite: bool,
    /// Called with the part that has been written, 0 to 1.
    pub progress: Option<Progress>,
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Voxels along x, y and z.
    pub dims: [u32; 3],
    /// Files, with their bytes.
    pub files: Vec<(PathBuf, u64)>,
    /// What a person should know: conversions, and what they lose.
    pub notes: Vec<String>,
}

/// Why a volume could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The name does not say a format that is written.
    #[error("{}: expected a name that ends in .nii, .nii.gz, .nrrd or .png", .0.display())]
    Format(PathBuf),
    /// The file is there, and nobody said that it may be replaced.
    #[error("{}: is there already", .0.display())]
    Exists(PathBuf),
    /// The file cannot be written.
    #[error("{}: cannot be written: {source}", .file.display())]
    Unwritable {
        /// The file.
        file: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The voxels to cut out are not there.
    #[error("crop: expected ranges within 0 to {dims:?} voxels, found {found:?}")]
    Crop {
        /// Voxels that there are.
        dims: [u32; 3],
        /// What was asked for.
        found: [Range<u32>; 3],
    },
    /// There is no such channel, or several and none was named.
    #[error("channel: expected one of {}, found {}", .there.join(", "), .found.as_deref().unwrap_or("none"))]
    Channel {
        /// The channels' names.
        there: Vec<String>,
        /// What was asked for.
        found: Option<String>,
    },
    /// Lowest and highest value do not make a window.
    #[error("window: expected two values, the lower first, found {0:?}")]
    Window([f64; 2]),
    /// The samples do not fit what was asked for.
    #[error("channel '{channel}': {reason}")]
    Samples {
        /// The channel.
        channel: String,
        /// Why not.
        reason: String,
    },
    /// What was cut out makes no grid.
    #[error("crop: {0}")]
    Grid(#[from] GridError),
}

/// One channel on its grid, as it is written.
struct Picture {
    grid: Grid,
    channel: Channel,
    notes: Vec<String>,
}

/// Writes a channel of a volume; the name's end says the format: `.nii`, `.nii.gz`, `.nrrd` (gzip), `.png` (with its
/// JSON). Takes the volume, so that no voxel is held twice unless it is converted.
///
/// # Errors
/// If the format is not known, the file is there, what was asked for is not in the volume, or the disk fails. A file
/// that could not be finished is removed.
pub fn save(path: &Path, volume: Volume, options: &SaveOptions) -> Result<Saved, SaveError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    let write: fn(&Path, Picture, &SaveOptions) -> Result<Saved, SaveError> = match name.as_str() {
        n if n.ends_with(".nii") || n.ends_with(".nii.gz") => nifti::save,
        n if n.ends_with(".nrrd") => nrrd::save,
        n if n.ends_with(".png") => atlas::save,
        _ => return Err(SaveError::Format(path.to_owned())),
    };
    if path.exists() && !options.overwrite {
        return Err(SaveError::Exists(path.to_owned()));
    }
    let picture = cut_out(volume, options)?;
    write(path, samples::converted(picture, options)?, options)
}

/// The channel and the voxels that were asked for.
fn cut_out(volume: Volume, options: &SaveOptions) -> Result<Picture, SaveError> {
    let (grid, mut channels) = volume.into_parts();
    let there = |channels: &[Channel]| channels.iter().map(|c| c.name.clone()).collect();
    let at = match &options.channel {
        Some(name) => channels.iter().position(|c| c.name == *name),
        None if channels.len() == 1 => Some(0),
        None => None,
    };
    let Some(at) = at else {
        return Err(SaveError::Channel { there: there(&channels), found: options.channel.clone() });
    };
    let mut channel = channels.swap_remove(at);
    drop(channels);
    let Some(crop) = &options.crop else { return Ok(Picture { grid, channel, notes: Vec::new() }) };
    let dims = grid.dims();
    if crop.iter().zip(dims).any(|(range, length)| range.is_empty() || range.end > length) {
        return Err(SaveError::Crop { dims, found: crop.clone() });
    }
    let first = DVec3::from_array([0, 1, 2].map(|axis| f64::from(crop[axis].start)));
    let volume_from_index = grid.volume_from_index() * DAffine3::from_translation(first);
    let cropped = Grid::new([0, 1, 2].map(|axis| crop[axis].len() as u32), volume_from_index)?;
    channel.voxels = match &channel.voxels {
        Voxels::U8(v) => Voxels::U8(cropped_samples(v, dims, crop).into()),
        Voxels::I16(v) => Voxels::I16(cropped_samples(v, dims, crop).into()),
        Voxels::U16(v) => Voxels::U16(cropped_samples(v, dims, crop).into()),
        Voxels::F32(v) => Voxels::F32(cropped_samples(v, dims, crop).into()),
        Voxels::F64(v) => Voxels::F64(cropped_samples(v, dims, crop).into()),
    };
    Ok(Picture { grid: cropped, channel, notes: Vec::new() })
}

fn cropped_samples<T: Copy>(samples: &[T], dims: [u32; 3], [x, y, z]: &[Range<u32>; 3]) -> Vec<T> {
    let [width, height, _] = dims.map(|n| n as usize);
    let mut kept = Vec::with_capacity(x.len() * y.len() * z.len());
    for row in z.clone().flat_map(|z| y.clone().map(move |y| z as usize * height + y as usize)) {
        let start = row * width;
        kept.extend_from_slice(&samples[start + x.start as usize..start + x.end as usize]);
    }
    kept
}

/// Writes a file; what fails half-way is removed again.
fn write_file(
    path: &Path,
    overwrite: bool,
    content: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>,
) -> Result<(PathBuf, u64), SaveError> {
    let unwritable = |source| SaveError::Unwritable { file: path.to_owned(), source };
    let mut how = OpenOptions::new();
    how.write(true);
    if overwrite {
        how.create(true).truncate(true)
    } else {
        how.create_new(true)
    };
    let file = how.open(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::AlreadyExists => SaveError::Exists(path.to_owned()),
        _ => unwritable(e),
    })?;
    let mut file = BufWriter::new(file);
    let written = content(&mut file).and_then(|()| file.flush()).and_then(|()| file.get_ref().metadata());
    match written {
        Ok(found) => Ok((path.to_owned(), found.len())),
        Err(e) => {
            drop(file);
            // The first error is the one to tell.
            let _ = std::fs::remove_file(path);
            Err(unwritable(e))
        }
    }
}

/// Writes samples little-endian, and tells how far it is.
fn write_samples(out: &mut impl Write, voxels: &Voxels, options: &SaveOptions) -> std::io::Result<()> {
    let total = voxels.as_bytes().len().max(1);
    let mut done = 0;
    let mut buffer = Vec::with_capacity(BYTES_A_CALL);
    macro_rules! each {
        ($samples:expr) => {
            for samples in $samples.chunks(BYTES_A_CALL / size_of_val(&$samples[0])) {
                buffer.clear();
                buffer.extend(samples.iter().flat_map(|s| s.to_le_bytes()));
                out.write_all(&buffer)?;
                done += buffer.len();
                options.progressed(done as f32 / total as f32);
            }
        };
    }
    match voxels {
        Voxels::U8(v) => each!(v),
        Voxels::I16(v) => each!(v),
        Voxels::U16(v) => each!(v),
        Voxels::F32(v) => each!(v),
        Voxels::F64(v) => each!(v),
    }
    Ok(())
}

impl SaveOptions {
    fn progressed(&self, part: f32) {
        if let Some(progress) = &self.progress {
            progress(part);
        }
    }
}
