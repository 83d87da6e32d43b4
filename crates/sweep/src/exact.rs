//! Exact pictures, kept by what they show.

use crate::sweep::SweepError;
use crate::{Progress, Subject};
use picture_io::{Precision, save_data};
use rayon::prelude::*;
use reference::{Answers, Picture, RaySetup, Reference, Uncertainty};
use std::collections::HashMap;
use std::fs;
use std::path::Path;

/// Pixels of a kept picture that are computed again, to notice that it is not what would be computed today.
const SPOT_CHECKS: usize = 64;

/// The exact picture of a subject, and what else its pixels may rightly show.
pub(crate) struct Exact<'a> {
    pub(crate) picture: Picture,
    reference: Reference<'a>,
    rays: RaySetup,
    uncertainty: Uncertainty,
    /// Answers that were asked for, by the pixel's number.
    answers: HashMap<usize, Answers>,
}

impl<'a> Exact<'a> {
    /// Takes the picture from the folder, or computes it and puts it there.
    pub(crate) fn of(
        subject: &Subject<'a>,
        folder: &Path,
        progress: &(dyn Fn(Progress<'_>) + Sync),
    ) -> Result<Self, SweepError> {
        let reference = subject.reference()?;
        let (rays, [width, height]) = (subject.rays(), subject.size_px);
        let path = folder.join(format!("{}.npy", subject.key()));
        let kept = kept(&path).filter(|picture| is_still_right(picture, &reference, &rays, subject.size_px));
        let picture = match kept {
            Some(picture) => picture,
            None => {
                let told = |p: reference::Progress| {
                    let part = p.rows_done as f64 / p.rows as f64;
                    progress(Progress { subject: subject.name, doing: "exact picture", part });
                };
                let picture = reference.picture(&rays, width, height, &told)?;
                keep(&path, &picture)?;
                picture
            }
        };
        let uncertainty = Uncertainty::of_float32(&reference);
        Ok(Self { picture, reference, rays, uncertainty, answers: HashMap::new() })
    }

    /// All answers of some pixels that are right within float32, each computed once.
    pub(crate) fn answers(&mut self, pixels: &[usize]) -> Vec<&Answers> {
        let missing: Vec<usize> =
            pixels.iter().copied().filter(|pixel| !self.answers.contains_key(pixel)).collect();
        let found: Vec<(usize, Answers)> = missing
            .into_par_iter()
            .map(|pixel| {
                let (width, height) = (self.picture.width(), self.picture.height());
                let (x, y) = (pixel as u32 % width, pixel as u32 / width);
                let ray = self.rays.pixel_ray(x, y, width, height);
                (pixel, self.reference.answers(&ray, &self.uncertainty))
            })
            .collect();
        self.answers.extend(found);
        pixels.iter().map(|pixel| &self.answers[pixel]).collect()
    }
}

/// The picture of that file, if there is one; what cannot be read is computed again.
fn kept(path: &Path) -> Option<Picture> {
    picture_io::load(path).ok().map(|loaded| loaded.picture)
}

/// Whether some of its pixels are, bit for bit, what the reference gives: it may have learnt better since.
fn is_still_right(
    picture: &Picture,
    reference: &Reference<'_>,
    rays: &RaySetup,
    [width, height]: [u32; 2],
) -> bool {
    let count = picture.pixels().len();
    (picture.width(), picture.height()) == (width, height)
        && (0..SPOT_CHECKS.min(count)).into_par_iter().all(|i| {
            // In the middles of equal parts of the picture, so that they lie in columns of all kinds.
            let at = (2 * i + 1) * count / (2 * SPOT_CHECKS.min(count));
            let (x, y) = (at as u32 % width, at as u32 / width);
            reference.pixel(&rays.pixel_ray(x, y, width, height)) == picture.pixels()[at]
        })
}

/// Writes beside and renames, so that no half of a picture is ever kept.
fn keep(path: &Path, picture: &Picture) -> Result<(), SweepError> {
    let beside = path.with_extension("part");
    save_data(&beside, picture, Precision::Float64)?;
    fs::rename(&beside, path).map_err(|source| SweepError::File { path: path.to_owned(), source })
}
