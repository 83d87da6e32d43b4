//! The exact picture of a scene.

use crate::emission::{Emission, lit};
use crate::transfer::Stretches;
use crate::{Field, Picture, Pixel, Ray, RaySetup, ReferenceError};
use crate::{labels, surface};
use rayon::prelude::*;
use scene::{Mode, Scene};
use std::sync::atomic::{AtomicUsize, Ordering};
use volume::{ChannelKind, Volume};

/// How much of a picture is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Rows done; they need not be done from the top.
    pub rows_done: usize,
    /// Rows of the picture.
    pub rows: usize,
}

/// The exact picture of one scene of one volume, as `docs/picture.md` defines it.
#[derive(Clone, Debug)]
pub struct Reference<'a> {
    field: Field<'a>,
    scene: &'a Scene,
    transfer: Stretches,
}

impl<'a> Reference<'a> {
    /// Takes a scene of a volume; looks at every sample of its channel.
    ///
    /// # Errors
    /// If the volume has no such channel, samples of it are not finite, or it holds labels and the scene shows none
    /// (or the other way round).
    pub fn new(volume: &'a Volume, scene: &'a Scene) -> Result<Self, ReferenceError> {
        let channels = volume.channels();
        let channel = channels
            .get(scene.channel)
            .ok_or(ReferenceError::NoSuchChannel { wanted: scene.channel, found: channels.len() })?;
        let count = (0..channel.voxels.len()).filter(|&at| !channel.value(at).is_finite()).count();
        if count > 0 {
            return Err(ReferenceError::NotFinite { channel: channel.name.clone(), count });
        }
        if scene.labels.is_some() != (channel.kind == ChannelKind::Label) {
            return Err(ReferenceError::Kind { channel: channel.name.clone() });
        }
        Ok(Self {
            field: Field::new(channel, volume.grid()),
            scene,
            transfer: Stretches::of(&scene.transfer),
        })
    }

    /// The field that is shown.
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
        self.seen(&self.field, ray, 0.5)
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

    /// What a ray sees of a field; in mode emission-absorption the depth is where `depth_at` of the light is left.
    pub(crate) fn seen(&self, field: &Field<'_>, ray: &Ray, depth_at: f64) -> Pixel {
        if let Some(looks) = &self.scene.labels {
            return labels::pixel(field, looks, self.scene.light.as_ref(), depth_at, ray);
        }
        match self.scene.mode {
            Mode::EmissionAbsorption => {
                let light = self.scene.light.as_ref();
                Emission { transfer: &self.transfer, light, depth_at }.pixel(field, ray)
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
