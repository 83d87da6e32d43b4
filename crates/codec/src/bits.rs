//! Reading and writing bits and exponential-Golomb codes (ITU-T H.264, section 9.1).

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

    /// Bits read so far.
    pub(crate) fn position_bits(&self) -> usize {
        self.position_bits
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

/// Writes bits, the most significant first.
#[derive(Default)]
pub(crate) struct BitWriter {
    bits: Vec<bool>,
}

impl BitWriter {
    pub(crate) fn bit(&mut self, bit: bool) {
        self.bits.push(bit);
    }

    /// The lower `count` bits of a number.
    pub(crate) fn bits(&mut self, count: u32, value: u64) {
        self.bits.extend((0..count).rev().map(|i| value >> i & 1 == 1));
    }

    /// An unsigned code, ue(v).
    pub(crate) fn unsigned(&mut self, value: u32) {
        let code = u64::from(value) + 1;
        let length = 64 - code.leading_zeros();
        self.bits(2 * length - 1, code);
    }

    /// The bytes, the last one filled with zeros.
    pub(crate) fn into_bytes(self) -> Vec<u8> {
        let byte = |bits: &[bool]| (0..8).fold(0, |byte, i| byte << 1 | u8::from(bits.get(i) == Some(&true)));
        self.bits.chunks(8).map(byte).collect()
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

/// A payload with emulation prevention bytes, so that no start code can be found in it (section 7.4.1.1).
pub(crate) fn escaped(raw: &[u8]) -> Vec<u8> {
    let mut payload = Vec::with_capacity(raw.len());
    let mut zeros = 0;
    for &byte in raw {
        if zeros >= 2 && byte <= 3 {
            payload.push(3);
            zeros = 0;
        }
        zeros = if byte == 0 { zeros + 1 } else { 0 };
        payload.push(byte);
    }
    payload
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

        #[test]
        fn what_is_written_reads_back(codes in prop::collection::vec(0..u32::MAX, 0..20)) {
            let mut writer = BitWriter::default();
            codes.iter().for_each(|&code| writer.unsigned(code));
            let bytes = writer.into_bytes();
            let mut reader = BitReader::new(&bytes);
            for code in codes {
                prop_assert_eq!(reader.unsigned(), Ok(code));
            }
            prop_assert!(bytes.len() * 8 - reader.position_bits() < 8);
        }

        #[test]
        fn an_escaped_payload_holds_no_start_code_and_reads_back(raw in prop::collection::vec(0u8..5, 0..64)) {
            let payload = escaped(&raw);
            prop_assert!(!payload.windows(3).any(|bytes| bytes[..2] == [0, 0] && bytes[2] <= 2));
            prop_assert_eq!(unescaped(&payload), raw);
        }
    }
}
