//! Encoding and decoding real pictures: size, order, quality, colour, rate.

mod common;

use codec::{
    ChromaSiting, ColourDescription, DecodeError, Decoder, EncodeError, ParameterSets, PlaneLayout, YuvFrame,
    YuvPicture,
};
use common::{encoder, moving_picture, moving_yuv, psnr_db};

#[test]
fn every_size_comes_back_as_it_went_in() {
    // HoloLens 1, small pairs, heights and widths that are no multiples of 16, the smallest.
    for (width_px, height_px) in [(2536, 720), (640, 180), (320, 90), (322, 94), (16, 16), (34, 1000)] {
        let mut encoder = encoder(width_px, height_px, 8_000_000);
        let mut decoder = Decoder::new().unwrap();
        for frame in 0..3 {
            let picture = moving_yuv(width_px, height_px, frame);
            let access_unit = encoder.encode(picture.as_frame(), false).unwrap();
            let decoded = decoder.decode(&access_unit.bytes).unwrap();
            assert_eq!(decoded.layout(), PlaneLayout::packed(width_px, height_px).unwrap());
            let found_db = psnr_db(decoded.as_frame().y(), picture.as_frame().y());
            assert!(found_db > 30.0, "{width_px}x{height_px}, frame {frame}: {found_db:.1} dB");
        }
    }
}

#[test]
fn a_moving_picture_at_three_megabits_keeps_its_quality() {
    // A stereo pair of 320x180 pixels, 60 frames a second: 50 kbit a frame.
    const BITRATE_BPS: u32 = 3_000_000;
    let mut encoder = encoder(640, 180, BITRATE_BPS);
    let mut decoder = Decoder::new().unwrap();
    let (mut worst_db, mut bytes) = (f64::INFINITY, 0);
    for frame in 0..120 {
        let rgb = moving_picture(640, 180, frame);
        let picture = YuvPicture::from_rgb8(640, 180, &rgb).unwrap();
        let access_unit = encoder.encode(picture.as_frame(), false).unwrap();
        bytes += access_unit.bytes.len();
        let decoded = decoder.decode(&access_unit.bytes).unwrap();
        worst_db = worst_db.min(psnr_db(&decoded.to_rgb8(), &rgb));
    }
    println!("worst frame {worst_db:.2} dB in RGB, {:.2} Mbit/s", bytes as f64 * 8.0 / 2.0 / 1e6);
    assert!(worst_db > 36.0, "worst frame has {worst_db:.2} dB");
    assert!(bytes as f64 * 8.0 / 2.0 < 1.1 * f64::from(BITRATE_BPS), "{bytes} bytes in two seconds");
}

#[test]
fn colours_survive() {
    // Eight saturated colours as patches. Decoded with the BT.601 matrix instead, red and green are off by up to
    // 13 dB; a swapped U and V would turn red into blue.
    let colours: [[u8; 3]; 8] = [
        [255, 0, 0],
        [0, 255, 0],
        [0, 0, 255],
        [255, 255, 0],
        [0, 255, 255],
        [255, 0, 255],
        [255, 255, 255],
        [200, 100, 40],
    ];
    let (width_px, height_px) = (256, 64);
    let rgb: Vec<u8> =
        (0..height_px * width_px).flat_map(|i| colours[(i % width_px / 32) as usize]).collect();
    let picture = YuvPicture::from_rgb8(width_px, height_px, &rgb).unwrap();
    let access_unit = encoder(width_px, height_px, 20_000_000).encode(picture.as_frame(), true).unwrap();
    let back = Decoder::new().unwrap().decode(&access_unit.bytes).unwrap().to_rgb8();
    for (i, colour) in colours.iter().enumerate() {
        let at = 3 * (32 * width_px as usize + 32 * i + 16);
        let found = &back[at..at + 3];
        assert!(
            found.iter().zip(colour).all(|(f, c)| f.abs_diff(*c) <= 5),
            "{colour:?} came back as {found:?}"
        );
    }
    assert!(psnr_db(&back, &rgb) > 38.0, "{:.1} dB", psnr_db(&back, &rgb));
}

#[test]
fn the_stream_says_how_its_colours_are_coded() {
    let picture = moving_yuv(640, 180, 0);
    let mut encoder = encoder(640, 180, 3_000_000);
    assert_eq!(encoder.codec_string(), None);
    let access_unit = encoder.encode(picture.as_frame(), false).unwrap();
    let sets = ParameterSets::find(&access_unit.bytes).unwrap();
    let srgb_by_bt709 = ColourDescription { full_range: false, primaries: 1, transfer: 13, matrix: 1 };
    assert_eq!(sets.sps.colour, Some(srgb_by_bt709));
    assert_eq!(sets.sps.chroma_siting, Some(ChromaSiting::CENTRE));
    assert_eq!((sets.sps.width_px, sets.sps.height_px), (640, 180));
    assert_eq!(sets.sps.profile_idc, 66);
    assert_eq!(encoder.codec_string(), Some(sets.sps.codec_string().as_str()));
    assert!(encoder.codec_string().unwrap().starts_with("avc1.42C0"));
}

/// The bytes of a sequence parameter set that ffprobe 5.1 was given to read, and what it found in them: so the parser
/// and the writer of this crate do not only agree with each other.
#[test]
fn the_sequence_parameter_set_is_the_one_that_another_reader_has_read() {
    let access_unit = encoder(640, 180, 3_000_000).encode(moving_yuv(640, 180, 0).as_frame(), false).unwrap();
    let found: Vec<_> = ParameterSets::find(&access_unit.bytes)
        .unwrap()
        .sps_bytes
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    assert_eq!(found.join(" "), "67 42 c0 1e 8c 68 0a 06 7e 79 a8 08 68 0d 20 f0 88 46 a0");
}

#[test]
fn key_frames_come_first_and_when_asked_and_never_else() {
    let mut encoder = encoder(320, 90, 500_000);
    let mut keys = Vec::new();
    for frame in 0..400 {
        // A cut each hundred frames: scene change detection would make a key frame of it.
        let picture = moving_yuv(320, 90, frame + 1000 * (frame / 100));
        let access_unit = encoder.encode(picture.as_frame(), frame == 130).unwrap();
        assert_eq!(access_unit.key_frame, ParameterSets::find(&access_unit.bytes).is_ok());
        if access_unit.key_frame {
            keys.push(frame);
        }
    }
    assert_eq!(keys, [0, 130]);
}

#[test]
fn a_decoder_joins_at_a_key_frame_and_not_before() {
    let mut encoder = encoder(320, 90, 2_000_000);
    let mut decoder = Decoder::new().unwrap();
    for frame in 0..6 {
        let picture = moving_yuv(320, 90, frame);
        let access_unit = encoder.encode(picture.as_frame(), frame == 4).unwrap();
        match frame {
            0 => {}
            1..4 => {
                assert_eq!(decoder.decode(&access_unit.bytes), Err(DecodeError::AwaitingKeyFrame));
            }
            _ => {
                let decoded = decoder.decode(&access_unit.bytes).unwrap();
                assert!(psnr_db(decoded.as_frame().y(), picture.as_frame().y()) > 30.0);
            }
        }
    }
}

#[test]
fn after_a_lost_frame_nothing_is_shown_until_the_next_key_frame() {
    let mut encoder = encoder(320, 90, 2_000_000);
    let mut decoder = Decoder::new().unwrap();
    for frame in 0..20 {
        let picture = moving_yuv(320, 90, frame);
        let access_unit = encoder.encode(picture.as_frame(), frame == 12).unwrap();
        if frame == 7 {
            continue; // lost on its way
        }
        let decoded = decoder.decode(&access_unit.bytes);
        match frame {
            0..=6 | 12.. => assert!(decoded.is_ok(), "frame {frame}: {:?}", decoded.err()),
            7..=8 => assert!(matches!(decoded, Err(DecodeError::Damaged { .. })), "{:?}", decoded.err()),
            _ => assert_eq!(decoded, Err(DecodeError::AwaitingKeyFrame)),
        }
    }
}

#[test]
fn the_bit_rate_follows_while_running_without_a_key_frame() {
    let mut encoder = encoder(640, 180, 6_000_000);
    let mut frame = 0;
    let mut bits_in_a_second = |encoder: &mut codec::Encoder| {
        let mut bits = 0;
        for _ in 0..60 {
            let picture = noisy(frame);
            let access_unit = encoder.encode(picture.as_frame(), false).unwrap();
            assert_eq!(access_unit.key_frame, frame == 0);
            bits += 8 * access_unit.bytes.len();
            frame += 1;
        }
        bits as f64
    };
    for bitrate_bps in [6_000_000, 600_000, 12_000_000, 1_500_000] {
        encoder.set_bitrate_bps(bitrate_bps).unwrap();
        assert_eq!(encoder.settings().bitrate_bps, bitrate_bps);
        // The first second still pays for what came before; the next two hold the rate.
        bits_in_a_second(&mut encoder);
        let held = (bits_in_a_second(&mut encoder) + bits_in_a_second(&mut encoder)) / 2.0;
        println!("asked {bitrate_bps}, got {held:.0} bit/s");
        let ratio = held / f64::from(bitrate_bps);
        assert!((0.7..1.2).contains(&ratio), "asked {bitrate_bps} bit/s, got {held:.0}");
    }
}

/// Where there is an ffprobe, it is asked too.
#[test]
fn ffprobe_reads_what_this_crate_says_of_the_colours() {
    let access_unit = encoder(640, 180, 3_000_000).encode(moving_yuv(640, 180, 0).as_frame(), false).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("key.h264");
    std::fs::write(&path, &access_unit.bytes).unwrap();
    let fields =
        "width,height,pix_fmt,color_range,color_space,color_transfer,color_primaries,chroma_location";
    let asked = std::process::Command::new("ffprobe")
        .args(["-v", "error", "-of", "default=nw=1", "-show_entries"])
        .arg(format!("stream={fields}"))
        .arg(&path)
        .output();
    let Ok(answer) = asked else {
        println!("no ffprobe here: its word is in the bytes of the test above alone");
        return;
    };
    let text = String::from_utf8_lossy(&answer.stdout).into_owned();
    for expected in [
        "width=640",
        "height=180",
        "color_range=tv",
        "color_space=bt709",
        "color_transfer=iec61966-2-1",
        "color_primaries=bt709",
        "chroma_location=center",
    ] {
        assert!(text.lines().any(|line| line == expected), "expected {expected} in:\n{text}");
    }
}

/// A picture with grain that changes each frame, so that there are bits to be spent at any rate.
fn noisy(frame: u32) -> YuvPicture {
    let mut rgb = moving_picture(640, 180, frame);
    let mut state = frame.wrapping_mul(2_654_435_761) | 1;
    for value in &mut rgb {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *value = value.saturating_add((state >> 27) as u8);
    }
    YuvPicture::from_rgb8(640, 180, &rgb).expect("the sides are even")
}

#[test]
fn the_frame_rate_sets_a_frames_share() {
    let mut encoder = encoder(640, 180, 3_000_000);
    encoder.set_frames_per_second(30.0).unwrap();
    let mut bytes = [0, 0];
    for frame in 0..120u32 {
        if frame == 60 {
            encoder.set_frames_per_second(15.0).unwrap();
        }
        let access_unit = encoder.encode(noisy(frame).as_frame(), false).unwrap();
        bytes[frame as usize / 60] += access_unit.bytes.len();
    }
    // Half the frames a second, so twice the bits a frame.
    let ratio = bytes[1] as f64 / bytes[0] as f64;
    assert!((1.6..2.4).contains(&ratio), "{bytes:?}");
}

#[test]
fn rates_set_before_the_first_picture_hold() {
    let mut encoder = encoder(640, 180, 100_000);
    encoder.set_bitrate_bps(6_000_000).unwrap();
    let access_unit = encoder.encode(noisy(0).as_frame(), false).unwrap();
    assert!(access_unit.key_frame);
    assert!(access_unit.bytes.len() > 10_000, "{} bytes", access_unit.bytes.len());
}

#[test]
fn a_padded_stride_encodes_to_the_same_bytes() {
    let packed = moving_yuv(322, 94, 3);
    let layout = PlaneLayout::with_stride(322, 94, 512).unwrap();
    let mut bytes = vec![0xaa; layout.len_bytes()];
    let from = packed.as_frame();
    let planes = [
        (layout.y_range(), layout.y_stride(), from.y(), from.layout().y_stride(), 322),
        (layout.u_range(), layout.uv_stride(), from.u(), from.layout().uv_stride(), 161),
        (layout.v_range(), layout.uv_stride(), from.v(), from.layout().uv_stride(), 161),
    ];
    for (range, stride, plane, plane_stride, width) in planes {
        for (to, from) in bytes[range].chunks_mut(stride).zip(plane.chunks(plane_stride)) {
            to[..width].copy_from_slice(&from[..width]);
        }
    }
    let encode = |frame| encoder(322, 94, 1_000_000).encode(frame, false).unwrap();
    assert_eq!(encode(YuvFrame::new(layout, &bytes).unwrap()), encode(packed.as_frame()));
}

#[test]
fn a_picture_of_another_size_is_refused() {
    let mut encoder = encoder(640, 180, 1_000_000);
    let error = encoder.encode(moving_yuv(320, 90, 0).as_frame(), false).unwrap_err();
    assert!(matches!(error, EncodeError::Size { width_px: 320, expected_width_px: 640, .. }), "{error}");
    assert!(encoder.encode(moving_yuv(640, 180, 0).as_frame(), false).is_ok());
}

#[test]
fn one_decoder_follows_a_stream_that_changes_its_size() {
    let mut decoder = Decoder::new().unwrap();
    for (width_px, height_px) in [(320, 90), (640, 180), (160, 90), (320, 90)] {
        let mut encoder = encoder(width_px, height_px, 2_000_000);
        for frame in 0..3 {
            let access_unit =
                encoder.encode(moving_yuv(width_px, height_px, frame).as_frame(), false).unwrap();
            let decoded = decoder.decode(&access_unit.bytes).unwrap();
            assert_eq!((decoded.layout().width_px(), decoded.layout().height_px()), (width_px, height_px));
        }
    }
}
