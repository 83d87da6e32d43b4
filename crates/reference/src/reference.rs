//! The exact picture of a scene.

use crate::emission::{Emission, lit};
use crate::several::{self, Part, Shown, channel_of};
use crate::transfer::Stretches;
use crate::{Field, Picture, Pixel, Ray, RaySetup, ReferenceError};
use crate::{labels, surface};
use rayon::prelude::*;
use scene::{Mode, Scene};
use spatial::DVec3;
use std::sync::atomic::{AtomicUsize, Ordering};
use volume::Volume;

/// How much of a picture is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Rows done; they need not be done from the top.
    pub rows_done: usize,
    /// Rows of the picture.
    pub rows: usize,
}

/// The exact picture of one scene of one volume or several, as `docs/picture.md` defines it.
#[derive(Clone, Debug)]
pub struct Reference<'a> {
    field: Field<'a>,
    scene: &'a Scene,
    transfer: Stretches,
    /// What is shown beside the first volume.
    parts: Vec<Part<'a>>,
}

impl<'a> Reference<'a> {
    /// Takes a scene of a volume; looks at every sample of its channel.
    ///
    /// # Errors
    /// If the volume has no such channel, samples of it are not finite, or it holds labels and the scene shows none
    /// (or the other way round).
    pub fn new(volume: &'a Volume, scene: &'a Scene) -> Result<Self, ReferenceError> {
        Self::of_several(&[volume], scene)
    }

    /// Takes a scene of several volumes, in the order in which the scene counts them; looks at every sample of the channels
    /// that are shown.
    ///
    /// # Errors
    /// If a volume is not there or has no such channel, samples are not finite, a channel holds labels and the scene shows
    /// none (or the other way round), or a registration leaves no grid.
    pub fn of_several(volumes: &[&'a Volume], scene: &'a Scene) -> Result<Self, ReferenceError> {
        let volume = volumes.first().ok_or(ReferenceError::NoSuchVolume { wanted: 0, found: 0 })?;
        let field = Field::new(channel_of(volume, scene.channel, scene.labels.is_some())?, volume.grid());
        let parts = scene.further.iter().map(|further| Part::new(volumes, &field, further));
        Ok(Self {
            parts: parts.collect::<Result<_, _>>()?,
            field,
            scene,
            transfer: Stretches::of(&scene.transfer),
        })
    }

    /// The field of the first volume.
    #[must_use]
    pub fn field(&self) -> &Field<'a> {
        &self.field
    }

    /// The scene that is shown.
    #[must_use]
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// What a ray sees. Colours and opacity are within 1e-10 of exact in mode emission-absorption; in the others they,
    /// and all depths, are exact to rounding.
    #[must_use]
    pub fn pixel(&self, ray: &Ray) -> Pixel {
        self.seen(&self.field, &self.parts, ray, 0.5)
    }

    /// The whole picture, on all cores. `progress` is called from any of them after each row.
    ///
    /// # Errors
    /// If the picture has no pixel, or the setup gives rays that are none.
    pub fn picture(
        &self,
        setup: &RaySetup,
        width: u32,
        height: u32,
        progress: &(dyn Fn(Progress) + Sync),
    ) -> Result<Picture, ReferenceError> {
        if width == 0 || height == 0 {
            return Err(ReferenceError::Empty { width, height });
        }
        for (x, y) in [(0, 0), (width - 1, height - 1)] {
            setup.pixel_ray(x, y, width, height).check()?;
        }
        let mut pixels = vec![Pixel::NOTHING; width as usize * height as usize];
        let rows_done = AtomicUsize::new(0);
        pixels.par_chunks_mut(width as usize).with_max_len(1).zip(0..height).for_each(|(row, y)| {
            for (pixel, x) in row.iter_mut().zip(0..) {
                *pixel = self.pixel(&setup.pixel_ray(x, y, width, height));
            }
            let rows_done = rows_done.fetch_add(1, Ordering::Relaxed) + 1;
            progress(Progress { rows_done, rows: height as usize });
        });
        Picture::new(width, height, pixels)
    }

    /// What a ray sees if every value is higher by `offset`, in the units of the first volume, and the depth is where
    /// `depth_at` of the light is left in mode emission-absorption.
    pub(crate) fn seen_off(&self, offset: f64, ray: &Ray, depth_at: f64) -> Pixel {
        let parts: Vec<_> = self.parts.iter().map(|part| part.raised(offset)).collect();
        self.seen(&self.field.raised(offset), &parts, ray, depth_at)
    }

    /// The corners of all volumes' borders, as index of the first.
    pub(crate) fn borders(&self) -> Vec<DVec3> {
        let of_parts = self.parts.iter().flat_map(Part::corners_in_first_index);
        self.field.border().into_iter().chain(of_parts).collect()
    }

    fn seen(&self, field: &Field<'_>, parts: &[Part<'_>], ray: &Ray, depth_at: f64) -> Pixel {
        match self.scene.mode {
            Mode::EmissionAbsorption => {
                let (transfer, light) = (&self.transfer, self.scene.light.as_ref());
                match &self.scene.labels {
                    labels if !parts.is_empty() => {
                        let first = Shown { field, transfer, labels: labels.as_ref(), light };
                        several::pixel(first, parts, ray, depth_at)
                    }
                    Some(looks) => labels::pixel(field, looks, light, depth_at, ray),
                    None => Emission { transfer, light, depth_at }.pixel(field, ray),
                }
            }
            Mode::Threshold => self.surface(field, ray).unwrap_or(Pixel::NOTHING),
            Mode::XRay => self.x_ray(field, ray).unwrap_or(Pixel::NOTHING),
            Mode::Maximum => self.maximum(field, ray).unwrap_or(Pixel::NOTHING),
            Mode::Cumulated => match (self.surface(field, ray), self.x_ray(field, ray)) {
                (Some(front), Some(behind)) => {
                    let over = |i: usize| front.rgba[i] + (1.0 - front.rgba[3]) * behind.rgba[i];
                    Pixel { rgba: [over(0), over(1), over(2), over(3)], depth_mm: front.depth_mm }
                }
                (None, behind) => behind.unwrap_or(Pixel::NOTHING),
                (Some(front), None) => front,
            },
        }
    }

    fn surface(&self, field: &Field<'_>, ray: &Ray) -> Option<Pixel> {
        let way = ray.inside(field.dims())?;
        let depth_mm = surface::first_at_or_above(field, ray, way, self.scene.threshold)?;
        let light = self.scene.light.unwrap_or_default();
        let lit = lit(&light, self.scene.surface_color, surface::cosine_at(field, ray, depth_mm));
        let alpha = self.scene.surface_opacity;
        let [r, g, b] = lit.map(|c| c * alpha);
        Some(Pixel { rgba: [r, g, b, alpha], depth_mm: Some(depth_mm) })
    }

    fn x_ray(&self, field: &Field<'_>, ray: &Ray) -> Option<Pixel> {
        let way = ray.inside(field.dims())?;
        let w = self.scene.window.fraction(surface::mean(field, ray, way));
        Some(Pixel { rgba: [w; 4], depth_mm: Some(way.from_mm + way.length_mm() / 2.0) })
    }

    fn maximum(&self, field: &Field<'_>, ray: &Ray) -> Option<Pixel> {
        let way = ray.inside(field.dims())?;
        let (depth_mm, value) = surface::highest(field, ray, way);
        let optical = self.scene.transfer.at(value);
        let alpha = optical.opacity_per_mm;
        let [r, g, b] = optical.color.map(|c| c * alpha);
        Some(Pixel { rgba: [r, g, b, alpha], depth_mm: Some(depth_mm) })
    }
}

/// The exact picture of a scene; see [`Reference::picture`].
///
/// # Errors
/// As [`Reference::new`] and [`Reference::picture`].
pub fn render(
    volume: &Volume,
    scene: &Scene,
    setup: &RaySetup,
    width: u32,
    height: u32,
    progress: &(dyn Fn(Progress) + Sync),
) -> Result<Picture, ReferenceError> {
    Reference::new(volume, scene)?.picture(setup, width, height, progress)
}
