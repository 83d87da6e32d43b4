//! What is looked at.

use reference::{RaySetup, Reference, ReferenceError};
use render::Placed;
use scene::{Mode, Scene};
use sha2::{Digest as _, Sha256};
use spatial::EyeView;
use std::fmt::Write as _;
use volume::Volume;

/// A scene of a volume, seen by one eye.
#[derive(Clone, Copy, Debug)]
pub struct Subject<'a> {
    /// For people; of its own in a sweep.
    pub name: &'a str,
    /// The volume.
    pub volume: &'a Volume,
    /// What is shown of it.
    pub scene: &'a Scene,
    /// Where it lies.
    pub placed: Placed,
    /// Who looks.
    pub eye: EyeView,
    /// Pixels across and down.
    pub size_px: [u32; 2],
}

impl<'a> Subject<'a> {
    /// What the picture depends on, as the first 128 bits of SHA-256 in hexadecimal: voxels, geometry, scene, eye and
    /// size; not the name.
    #[must_use]
    pub fn key(&self) -> String {
        let mut hash = Sha256::new();
        let grid = self.volume.grid();
        // Rust writes floats so that they are read back as they were: equal text is equal numbers.
        let mut text =
            format!("{:?} {:?} {:?} {:?} {:?}", self.size_px, self.placed, self.eye, self.scene, grid);
        if let Some(channel) = self.volume.channels().get(self.scene.channel) {
            // Writing to a string does not fail.
            let _ = write!(
                text,
                " {:?} {:?} {:?} {:?}",
                channel.kind,
                channel.voxels.voxel_type(),
                channel.slope,
                channel.intercept
            );
            hash.update(channel.voxels.as_bytes());
        }
        hash.update(text);
        hex(&hash.finalize()[..16])
    }

    /// The mode as scene files name it, and whether it is lit: what kind of picture it is.
    #[must_use]
    pub fn kind(&self) -> String {
        let lit = self.scene.mode == Mode::EmissionAbsorption && self.scene.light.is_some();
        format!("{}{}", self.scene.mode.name(), if lit { ", lit" } else { "" })
    }

    pub(crate) fn reference(&self) -> Result<Reference<'a>, ReferenceError> {
        Reference::new(self.volume, self.scene)
    }

    pub(crate) fn rays(&self) -> RaySetup {
        RaySetup::new(self.volume.grid(), self.placed.index_from_world, self.eye)
    }
}

pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02x}");
        text
    })
}
