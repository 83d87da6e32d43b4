//! One coded picture, and what a stream says about itself.

use crate::{NalKind, Sps, SpsError, nal_units};

/// One coded picture: NAL units in Annex B form (ITU-T H.264, annex B).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AccessUnit {
    /// Start codes and NAL units. A key frame carries its parameter sets.
    pub bytes: Vec<u8>,
    /// Whether decoding can begin here.
    pub key_frame: bool,
}

/// The two parameter sets that a decoder needs before the first picture: NAL units without start codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterSets<'a> {
    /// The sequence parameter set, read.
    pub sps: Sps,
    /// The sequence parameter set's bytes.
    pub sps_bytes: &'a [u8],
    /// The picture parameter set's bytes.
    pub pps_bytes: &'a [u8],
}

/// Why no parameter sets were found in an access unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParameterSetError {
    /// It holds none: it is no key frame.
    #[error("access unit of {bytes} bytes holds no parameter sets, expected a key frame")]
    Missing {
        /// Length of the access unit.
        bytes: usize,
    },
    /// The sequence parameter set is refused.
    #[error(transparent)]
    Sps(#[from] SpsError),
}

impl<'a> ParameterSets<'a> {
    /// Finds them in an access unit.
    ///
    /// # Errors
    /// If one of them is missing, or the sequence parameter set is refused.
    pub fn find(access_unit: &'a [u8]) -> Result<Self, ParameterSetError> {
        let first = |kind| nal_units(access_unit).find(|unit| unit.kind == kind).map(|unit| unit.bytes);
        let sets = (first(NalKind::SequenceParameterSet), first(NalKind::PictureParameterSet));
        let (Some(sps_bytes), Some(pps_bytes)) = sets else {
            return Err(ParameterSetError::Missing { bytes: access_unit.len() });
        };
        Ok(Self { sps: Sps::parse(sps_bytes)?, sps_bytes, pps_bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_access_unit_without_parameter_sets_says_so() {
        let slice = [0, 0, 0, 1, 0x41, 1, 2];
        assert_eq!(ParameterSets::find(&slice), Err(ParameterSetError::Missing { bytes: 7 }));
        let garbled = [0, 0, 0, 1, 0x67, 66, 0, 0, 1, 0x68, 1];
        assert!(matches!(ParameterSets::find(&garbled), Err(ParameterSetError::Sps(_))));
    }
}
