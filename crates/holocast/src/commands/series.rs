//! The steps of a series in time, for who plays it.

use crate::commands::shown::Shown;
use anyhow::Context as _;
use server::Series;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use volume::Volume;
use volume_io::LoadOptions;

/// Loads steps, and keeps the first ones that it has loaded as long as there is room: compressed files are read through
/// from their beginning for each step.
struct Steps {
    path: PathBuf,
    options: LoadOptions,
    most_kept_bytes: usize,
    kept: Mutex<Kept>,
}

#[derive(Default)]
struct Kept {
    steps: HashMap<u32, Arc<Volume>>,
    bytes: usize,
}

/// The series that the first volume of a scene is a step of, if it is. At most `most_kept_bytes` of its steps stay in this
/// machine's memory.
pub(crate) fn series_of(
    shown: &Shown,
    options: &LoadOptions,
    most_kept_bytes: usize,
) -> anyhow::Result<Option<Series>> {
    let Some(sequence) = shown.loaded.report.sequence else { return Ok(None) };
    let number =
        |n: u64| u32::try_from(n).with_context(|| format!("a series of {n} steps is longer than any"));
    let (steps, loaded) = (number(sequence.steps)?, number(sequence.loaded)?);
    let from = Steps {
        path: shown.volume_path.clone(),
        options: LoadOptions { progress: None, ..options.clone() },
        most_kept_bytes,
        kept: Mutex::default(),
    };
    let load = move |step| from.step(step).map_err(Into::into);
    Ok(Some(Series::new(steps, loaded, Arc::new(load))))
}

impl Steps {
    fn step(&self, step: u32) -> Result<Arc<Volume>, volume_io::LoadError> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(volume) = kept().steps.get(&step) {
            return Ok(volume.clone());
        }
        let options = LoadOptions { time: u64::from(step), ..self.options.clone() };
        let volume = Arc::new(volume_io::load(&self.path, &options)?.volume);
        let mut kept = kept();
        let bytes = kept.bytes.saturating_add(volume.sample_bytes());
        if bytes <= self.most_kept_bytes {
            kept.bytes = bytes;
            kept.steps.insert(step, volume.clone());
        }
        Ok(volume)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A raw series would have no time: a NIfTI-1 of three steps of 2x2x2 bytes.
    fn series() -> Vec<u8> {
        let mut bytes = vec![0; 352];
        bytes[..4].copy_from_slice(&348i32.to_le_bytes());
        for (i, d) in [4i16, 2, 2, 2, 3, 1, 1, 1].iter().enumerate() {
            bytes[40 + 2 * i..][..2].copy_from_slice(&d.to_le_bytes());
        }
        bytes[70..72].copy_from_slice(&2i16.to_le_bytes());
        bytes[72..74].copy_from_slice(&8i16.to_le_bytes());
        for i in 0..4 {
            bytes[76 + 4 * i..][..4].copy_from_slice(&1f32.to_le_bytes());
        }
        bytes[108..112].copy_from_slice(&352f32.to_le_bytes());
        bytes[344..348].copy_from_slice(b"n+1\0");
        bytes.extend((0..24).map(|i| i as u8));
        bytes
    }

    #[test]
    fn steps_are_kept_as_long_as_there_is_room_and_are_the_same_when_they_are_not() {
        let path = std::env::temp_dir().join(format!("holocast-series-{}.nii", std::process::id()));
        std::fs::write(&path, series()).unwrap();
        for (most_kept_bytes, expected_kept) in [(0, 0), (20, 2), (1000, 3)] {
            let steps = Steps {
                path: path.clone(),
                options: LoadOptions::default(),
                most_kept_bytes,
                kept: Mutex::default(),
            };
            for step in [1, 0, 2, 1, 0, 2] {
                let first = steps.step(step).unwrap().channels()[0].voxels.as_bytes()[0];
                assert_eq!(u32::from(first), step * 8);
            }
            assert_eq!(steps.kept.lock().unwrap().steps.len(), expected_kept);
            let error = steps.step(3).unwrap_err().to_string();
            assert!(error.contains("0 to 2") && error.contains("time"), "{error}");
        }
        std::fs::remove_file(path).unwrap();
    }
}
