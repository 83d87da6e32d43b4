//! A volume: a 3-D grid of samples with its geometry in patient millimetres.
//!
//! Spaces: `index` counts voxels (the centre of the first voxel is at 0, 0, 0; x runs fastest in memory);
//! `volume` is patient space in millimetres, axes to the patient's left, posterior and superior (LPS), as in DICOM.
//! The volume fills whole voxels: its border lies half a voxel outside the outermost centres, so that a volume of one
//! slice, or of one voxel, has an inside. Between centres a value is trilinear; outside the outermost centres the
//! nearest sample holds.
//!
//! This crate knows no file and no GPU.

mod buffer;
mod channel;
mod grid;
mod label;
mod statistics;

pub use buffer::{Buffer, NoMemory};
pub use channel::{Channel, ChannelKind, NonFiniteCount, VoxelType, Voxels, single};
pub use grid::{Grid, GridError};
pub use label::{Label, LabelCount, LabelTable};
pub use statistics::{Histogram, Statistics};

/// A grid and the channels of samples on it.
#[derive(Clone, Debug)]
pub struct Volume {
    grid: Grid,
    channels: Vec<Channel>,
}

/// Why channels do not make a volume on a grid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VolumeError {
    /// There is nothing on the grid.
    #[error("a volume needs at least one channel, found none")]
    NoChannel,
    /// A channel's length is not the grid's.
    #[error("channel '{channel}' has {found} samples, the grid of {dims:?} voxels needs {expected}")]
    SampleCount {
        /// The channel's name.
        channel: String,
        /// Samples in it.
        found: usize,
        /// Voxels of the grid along x, y and z.
        dims: [u32; 3],
        /// Their product.
        expected: usize,
    },
    /// A channel's values are not finite.
    #[error(
        "channel '{channel}' scales stored values by {slope} and adds {intercept}: both must be finite, \
         the slope not 0"
    )]
    Scaling {
        /// The channel's name.
        channel: String,
        /// Its slope.
        slope: f64,
        /// Its intercept.
        intercept: f64,
    },
}

impl Volume {
    /// Puts channels on a grid.
    ///
    /// # Errors
    /// If there is no channel, one has another number of samples than the grid, or its scaling is not finite.
    pub fn new(grid: Grid, channels: Vec<Channel>) -> Result<Self, VolumeError> {
        if channels.is_empty() {
            return Err(VolumeError::NoChannel);
        }
        for channel in &channels {
            let (found, expected) = (channel.voxels.len(), grid.voxel_count());
            if found != expected {
                let dims = grid.dims();
                return Err(VolumeError::SampleCount {
                    channel: channel.name.clone(),
                    found,
                    dims,
                    expected,
                });
            }
            let (slope, intercept) = (channel.slope, channel.intercept);
            if !slope.is_finite() || !intercept.is_finite() || slope == 0.0 {
                return Err(VolumeError::Scaling { channel: channel.name.clone(), slope, intercept });
            }
        }
        Ok(Self { grid, channels })
    }

    /// The grid.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The channels, at least one.
    #[must_use]
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// Bytes of all samples.
    #[must_use]
    pub fn sample_bytes(&self) -> usize {
        self.channels.iter().map(|c| c.voxels.as_bytes().len()).sum()
    }

    /// Gives the parts back.
    #[must_use]
    pub fn into_parts(self) -> (Grid, Vec<Channel>) {
        (self.grid, self.channels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::DVec3;

    #[test]
    fn refuses_channels_that_do_not_fit() {
        let grid = Grid::axis_aligned([2, 3, 4], DVec3::ONE).unwrap();
        let channel = |n: usize, slope: f64| Channel {
            name: "ct".into(),
            kind: ChannelKind::Intensity,
            voxels: Voxels::U8(vec![0; n].into()),
            slope,
            intercept: 0.0,
        };
        assert_eq!(Volume::new(grid.clone(), vec![]).unwrap_err(), VolumeError::NoChannel);
        assert!(matches!(
            Volume::new(grid.clone(), vec![channel(23, 1.0)]),
            Err(VolumeError::SampleCount { found: 23, expected: 24, .. })
        ));
        assert!(matches!(
            Volume::new(grid.clone(), vec![channel(24, f64::NAN)]),
            Err(VolumeError::Scaling { .. })
        ));
        assert_eq!(Volume::new(grid, vec![channel(24, 1.0)]).unwrap().sample_bytes(), 24);
    }
}
