//! Loader: file or folder to volume, and back.
//!
//! [`load`] takes a file or a folder, recognises by its content what it is, and gives back a [`volume::Volume`] with a report of
//! what was done to get there. Formats: DICOM, NIfTI-1 and NIfTI-2 (`.nii`, `.nii.gz`), NRRD, MetaImage, the HoloM3D slice atlas
//! (`.png`), and raw voxels with a JSON header. [`save`] writes NIfTI, NRRD and slice atlases. [`describe`] says in numbers and for people what was loaded.
//!
//! What a header claims is never believed: dimensions are checked before anything is allocated, memory is taken as
//! data arrive and stays within [`LoadOptions::max_bytes`], and an error names the file, the field, what was expected
//! and what was found. Whatever a file says about a patient's identity
//! is not given to anyone unless [`LoadOptions::identity`] asks for it.
//!
//! This crate knows no GPU, no scene and no network.

mod atlas;
pub mod describe;
mod dicom;
mod error;
mod labels;
mod load;
mod metaimage;
mod nifti;
mod nrrd;
mod pieces;
mod raw;
mod recorded;
mod samples;
mod save;
mod sidecar;
mod source;
mod stream;
mod text;

pub use dicom::SeriesFound;
pub use error::LoadError;
pub use load::{Format, LoadOptions, LoadReport, Loaded, Progress, Sequence, load, load_bytes, load_parts};
pub use save::{Depth, SaveError, SaveOptions, Saved, save};
