//! NAL units of an access unit in Annex B form.

use std::ops::Range;

/// What a NAL unit carries, as far as this project uses it (ITU-T H.264, table 7-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NalKind {
    /// A slice of a picture that refers to others (type 1).
    Slice,
    /// A slice of a key frame, at which decoding can begin (type 5).
    KeySlice,
    /// Supplemental information (type 6).
    Supplemental,
    /// Sequence parameter set (type 7).
    SequenceParameterSet,
    /// Picture parameter set (type 8).
    PictureParameterSet,
    /// Access unit delimiter (type 9).
    Delimiter,
    /// Any other type, by its number.
    Other(u8),
}

/// One NAL unit: header byte and payload, without the start code, still with emulation prevention bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NalUnit<'a> {
    /// What the header says that it carries.
    pub kind: NalKind,
    /// Header byte and payload; not empty.
    pub bytes: &'a [u8],
}

/// The NAL units of an access unit in Annex B form, in order. Bytes before the first start code are passed over, and
/// so are empty units and the zeros that may trail one: what has no start code has no units.
pub fn nal_units(access_unit: &[u8]) -> impl Iterator<Item = NalUnit<'_>> {
    nal_ranges(access_unit).map(|range| {
        let bytes = &access_unit[range];
        NalUnit { kind: kind(bytes[0]), bytes }
    })
}

/// Where the units of [`nal_units`] lie in the access unit; none is empty.
pub(crate) fn nal_ranges(access_unit: &[u8]) -> impl Iterator<Item = Range<usize>> {
    let mut next = after_start_code(access_unit, 0);
    std::iter::from_fn(move || {
        loop {
            let begin = next?;
            let end = start_code(&access_unit[begin..]).map_or(access_unit.len(), |length| begin + length);
            next = after_start_code(access_unit, end);
            // A unit ends in a stop bit, so zeros at its end belong to the next start code or are padding.
            if let Some(last) = access_unit[begin..end].iter().rposition(|&byte| byte != 0) {
                return Some(begin..begin + last + 1);
            }
        }
    })
}

fn start_code(bytes: &[u8]) -> Option<usize> {
    bytes.windows(3).position(|window| window == [0, 0, 1])
}

/// Where the first start code at or after `from` ends.
fn after_start_code(bytes: &[u8], from: usize) -> Option<usize> {
    start_code(&bytes[from..]).map(|at| from + at + 3)
}

pub(crate) fn kind(header: u8) -> NalKind {
    match header & 0x1f {
        1 => NalKind::Slice,
        5 => NalKind::KeySlice,
        6 => NalKind::Supplemental,
        7 => NalKind::SequenceParameterSet,
        8 => NalKind::PictureParameterSet,
        9 => NalKind::Delimiter,
        other => NalKind::Other(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(bytes: &[u8], expected: &[(NalKind, &[u8])]) {
        let found: Vec<_> = nal_units(bytes).map(|unit| (unit.kind, unit.bytes)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn splits_at_long_and_short_start_codes() {
        check(
            &[0, 0, 0, 1, 0x67, 1, 2, 0, 0, 1, 0x68, 3, 0, 0, 0, 1, 0x65, 4, 5],
            &[
                (NalKind::SequenceParameterSet, &[0x67, 1, 2]),
                (NalKind::PictureParameterSet, &[0x68, 3]),
                (NalKind::KeySlice, &[0x65, 4, 5]),
            ],
        );
    }

    #[test]
    fn passes_over_what_is_no_unit() {
        check(&[], &[]);
        check(&[1, 2, 3], &[]);
        check(&[0, 0, 1], &[]);
        check(&[0, 0, 1, 0, 0, 1, 0x41, 7, 0, 0], &[(NalKind::Slice, &[0x41, 7])]);
    }

    proptest! {
        #[test]
        fn units_lie_within_the_input(bytes in prop::collection::vec(0u8..4, 0..200)) {
            let total: usize = nal_units(&bytes).map(|unit| unit.bytes.len() + 3).sum();
            prop_assert!(total <= bytes.len());
            prop_assert!(nal_units(&bytes).all(|unit| !unit.bytes.is_empty()));
        }
    }
}
