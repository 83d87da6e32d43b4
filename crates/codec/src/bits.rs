//! Reading bits and exponential-Golomb codes (ITU-T H.264, section 9.1).

/// The NAL unit ended within a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Truncated;

/// Reads bits, the most significant first. Never reads beyond the end.
pub(crate) struct BitReader<'a> {
    bytes: &'a [u8],
    position_bits: usize,
}

impl<'a> BitReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, position_bits: 0 }
    }

    pub(crate) fn bit(&mut self) -> Result<bool, Truncated> {
        let byte = self.bytes.get(self.position_bits / 8).ok_or(Truncated)?;
        let bit = byte >> (7 - self.position_bits % 8) & 1;
        self.position_bits += 1;
        Ok(bit == 1)
    }

    /// `count` bits as a number, at most 32.
    pub(crate) fn bits(&mut self, count: u32) -> Result<u32, Truncated> {
        debug_assert!(count <= 32, "a field of {count} bits does not fit");
        let mut value = 0u64;
        for _ in 0..count {
            value = value << 1 | u64::from(self.bit()?);
        }
        Ok(value as u32)
    }

    /// An unsigned code, ue(v). One that does not fit 32 bits counts as cut off: it is no value of any field.
    pub(crate) fn unsigned(&mut self) -> Result<u32, Truncated> {
        let mut zeros = 0;
        while !self.bit()? {
            zeros += 1;
            if zeros > 31 {
                return Err(Truncated);
            }
        }
        // At most 2^31 - 1 + 2^31 - 1: fits.
        Ok((1u32 << zeros) - 1 + self.bits(zeros)?)
    }

    /// A signed code, se(v).
    pub(crate) fn signed(&mut self) -> Result<i64, Truncated> {
        let code = i64::from(self.unsigned()?);
        Ok(if code % 2 == 1 { (code + 1) / 2 } else { -(code / 2) })
    }
}

/// A NAL unit's payload without its emulation prevention bytes (section 7.4.1.1).
pub(crate) fn unescaped(payload: &[u8]) -> Vec<u8> {
    let mut raw = Vec::with_capacity(payload.len());
    let mut zeros = 0;
    for &byte in payload {
        if zeros >= 2 && byte == 3 {
            zeros = 0;
            continue;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        raw.push(byte);
    }
    raw
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn codes_of_the_standard_read_as_its_table_says() {
        // Table 9-2: 1, 010, 011, 00100, 00101 are 0 to 4; then one byte's worth of padding.
        let mut reader = BitReader::new(&[0b1010_0110, 0b0100_0010, 0b1000_0000]);
        let codes: Vec<_> = (0..5).map(|_| reader.unsigned().unwrap()).collect();
        assert_eq!(codes, [0, 1, 2, 3, 4]);
        // Table 9-3: the same codes signed are 0, 1, -1, 2, -2.
        let mut reader = BitReader::new(&[0b1010_0110, 0b0100_0010, 0b1000_0000]);
        let codes: Vec<_> = (0..5).map(|_| reader.signed().unwrap()).collect();
        assert_eq!(codes, [0, 1, -1, 2, -2]);
    }

    #[test]
    fn a_code_without_an_end_is_cut_off() {
        assert_eq!(BitReader::new(&[0; 100]).unsigned(), Err(Truncated));
        assert_eq!(BitReader::new(&[0b0000_1000]).unsigned(), Err(Truncated));
        assert_eq!(BitReader::new(&[]).bit(), Err(Truncated));
    }

    #[test]
    fn emulation_prevention_is_taken_out() {
        assert_eq!(unescaped(&[0, 0, 3, 1, 0, 0, 3, 0, 0, 3]), [0, 0, 1, 0, 0, 0, 0]);
        assert_eq!(unescaped(&[0, 3, 0, 3]), [0, 3, 0, 3]);
    }

    proptest! {
        #[test]
        fn any_bytes_read_to_an_end(bytes in prop::collection::vec(0u8.., 0..64)) {
            let mut reader = BitReader::new(&bytes);
            let mut codes = 0;
            while reader.unsigned().is_ok() {
                codes += 1;
            }
            prop_assert!(codes <= bytes.len() * 8);
        }
    }
}
