//! What a decoder does with damaged streams: an error, never a panic, never a picture that is known to be wrong.

mod common;

use codec::{DecodeError, Decoder, NalKind, nal_units};
use common::{encoder, moving_yuv, psnr_db};

/// A key frame and a few that follow it.
fn stream() -> Vec<Vec<u8>> {
    let mut encoder = encoder(160, 90, 2_000_000);
    let mut encode = |frame| encoder.encode(moving_yuv(160, 90, frame).as_frame(), false);
    (0..4).map(|frame| encode(frame).expect("the picture has the encoder's size").bytes).collect()
}

/// A small deterministic generator: the damage is the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }
}

#[test]
fn every_truncation_is_an_error_or_the_whole_picture() {
    let stream = stream();
    let whole = Decoder::new().unwrap().decode(&stream[0]).unwrap();
    for length in 0..stream[0].len() {
        // What is cut off at the very end may be no more than padding.
        if let Ok(picture) = Decoder::new().unwrap().decode(&stream[0][..length]) {
            assert_eq!(picture, whole, "cut at {length} of {} bytes", stream[0].len());
        }
    }
}

#[test]
fn a_decoder_recovers_with_the_next_key_frame() {
    let stream = stream();
    let mut decoder = Decoder::new().unwrap();
    let first = decoder.decode(&stream[0]).unwrap();
    assert!(decoder.decode(&stream[1][..stream[1].len() / 2]).is_err());
    assert_eq!(decoder.decode(&stream[2]), Err(DecodeError::AwaitingKeyFrame));
    assert_eq!(decoder.decode(&stream[0]), Ok(first));
    assert!(decoder.decode(&stream[1]).is_ok());
}

#[test]
fn an_enormous_announced_size_is_refused() {
    let stream = stream();
    // Baseline, level 5.2, order count type 2, one reference; 8192 by 4096 pixels, which is 512 by 256 macroblocks.
    let enormous_sps =
        [0, 0, 0, 1, 0x67, 0x42, 0xc0, 0x34, 0b1110_1101, 0, 0b1000_0000, 0b0000_0100, 0, 0x13];
    let slice = nal_units(&stream[0]).find(|unit| unit.kind == NalKind::KeySlice).unwrap();
    let access_unit = [&enormous_sps[..], &[0, 0, 0, 1], slice.bytes].concat();
    let refused = Decoder::new().unwrap().decode(&access_unit);
    assert!(matches!(refused, Err(DecodeError::Sps(_))), "{refused:?}");
}

#[test]
fn flipped_bits_never_panic_and_the_decoder_lives_on() {
    let stream = stream();
    let good = Decoder::new().unwrap().decode(&stream[0]).unwrap();
    let mut random = Random(1);
    let mut decoder = Decoder::new().unwrap();
    for _ in 0..2000 {
        let mut damaged = stream[random.below(stream.len())].clone();
        for _ in 0..=random.below(8) {
            let at = random.below(damaged.len());
            damaged[at] ^= 1 << random.below(8);
        }
        // A flipped bit within the coefficients is still a stream: any outcome but a panic is right.
        let _ = decoder.decode(&damaged);
        let again = decoder.decode(&stream[0]).unwrap();
        assert!(psnr_db(again.as_frame().y(), good.as_frame().y()) > 99.0);
    }
}

#[test]
fn garbage_behind_a_true_beginning_never_panics() {
    let stream = stream();
    let headers: Vec<u8> = nal_units(&stream[0])
        .filter(|unit| unit.kind != NalKind::KeySlice)
        .flat_map(|unit| [&[0, 0, 0, 1], unit.bytes].concat())
        .collect();
    let mut random = Random(2);
    for _ in 0..500 {
        let mut access_unit = headers.clone();
        for header in [0x65, 0x41, 0x65].into_iter().take(1 + random.below(3)) {
            access_unit.extend([0, 0, 0, 1, header]);
            let length = random.below(400);
            access_unit.extend((0..length).map(|_| random.below(256) as u8));
        }
        let mut decoder = Decoder::new().unwrap();
        let _ = decoder.decode(&access_unit);
        let _ = decoder.decode(&stream[1]);
    }
}
