//! Compressed pixels of one frame become samples.

use super::jpeg_ls;
use super::syntax::Codec;
use dicom_toolkit_jpeg2000::{DecodeSettings, Image};
use jpeg_decoder::{Decoder, PixelFormat};
use std::panic::{UnwindSafe, catch_unwind};

/// Samples of 8 or 16 bits, little-endian.
pub(super) struct Samples {
    pub(super) bytes: Vec<u8>,
    pub(super) bytes_a_sample: usize,
}

/// Decodes a frame of `width` × `height` samples of `allocated` bits. A picture of another size is refused before it
/// takes any memory.
pub(super) fn decode(
    codec: Codec,
    data: &[u8],
    [width, height]: [usize; 2],
    allocated: u32,
) -> Result<Samples, String> {
    match codec {
        Codec::Rle => rle(data, width * height, allocated as usize / 8),
        Codec::Jpeg => contained(|| jpeg(data, width, height)),
        Codec::JpegLs => {
            let samples = jpeg_ls::decode(data, width, height)?;
            let bytes = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
            Ok(Samples { bytes, bytes_a_sample: 2 })
        }
        Codec::Jpeg2000 => contained(|| jpeg_2000(data, width, height)),
    }
}

/// What a library's decoder makes of data. Some of them assert what damaged data do not keep to (openjph-core does, for
/// HTJ2K): to the reader of a folder that is one more file that cannot be decoded, not the end of the server.
fn contained(decode: impl FnOnce() -> Result<Samples, String> + UnwindSafe) -> Result<Samples, String> {
    catch_unwind(decode).unwrap_or_else(|_| Err("the decoder stopped at something that cannot be".to_owned()))
}

/// Which codec's data these are, for messages.
pub(super) fn name(codec: Codec) -> &'static str {
    match codec {
        Codec::Rle => "RLE pixels",
        Codec::Jpeg => "JPEG pixels",
        Codec::JpegLs => "JPEG-LS pixels",
        Codec::Jpeg2000 => "JPEG 2000 pixels",
    }
}

/// DICOM PS3.5, annex G: a run-length code for each byte of the samples, the highest first.
fn rle(data: &[u8], count: usize, bytes_a_sample: usize) -> Result<Samples, String> {
    let word = |i: usize| data.get(4 * i..4 * i + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let segments = word(0).unwrap_or_default() as usize;
    if segments != bytes_a_sample || bytes_a_sample > 2 || data.len() < 64 {
        return Err(format!("expected {bytes_a_sample} segments, found {segments}"));
    }
    let mut bytes = vec![0; count * bytes_a_sample];
    for segment in 0..segments {
        let start = word(1 + segment).unwrap_or_default() as usize;
        let end = if segment + 1 < segments { word(2 + segment).map(|e| e as usize) } else { None };
        let code = data.get(start..end.unwrap_or(data.len())).ok_or("a segment lies outside the data")?;
        let plane = bytes.iter_mut().skip(segments - 1 - segment).step_by(bytes_a_sample);
        let filled = unpack(code, plane);
        if filled < count {
            return Err(format!("expected {count} samples, found {filled}"));
        }
    }
    Ok(Samples { bytes, bytes_a_sample })
}

/// PackBits: how many bytes of the plane were filled.
fn unpack<'p>(code: &[u8], mut plane: impl Iterator<Item = &'p mut u8>) -> usize {
    let (mut at, mut filled) = (0, 0);
    while let Some(&head) = code.get(at) {
        at += 1;
        let (copied, repeated) = match head {
            0..=127 => (usize::from(head) + 1, 0),
            128 => continue,
            129..=255 => (0, 257 - usize::from(head)),
        };
        let literal = code.get(at..).unwrap_or_default();
        let literal = &literal[..copied.min(literal.len())];
        let same = if repeated > 0 { code.get(at).copied() } else { None };
        at += copied.max(usize::from(repeated > 0));
        for &byte in literal.iter().chain(std::iter::repeat_n(&same.unwrap_or_default(), repeated)) {
            let Some(place) = plane.next() else { return filled };
            *place = byte;
            filled += 1;
        }
    }
    filled
}

fn jpeg(data: &[u8], width: usize, height: usize) -> Result<Samples, String> {
    let mut decoder = Decoder::new(data);
    decoder.set_max_decoding_buffer_size(4 * width * height);
    let words = |e: jpeg_decoder::Error| match e {
        jpeg_decoder::Error::Unsupported(jpeg_decoder::UnsupportedFeature::SamplePrecision(bits)) => {
            format!("lossy JPEG of {bits} bits a sample is not read, only of 8, and lossless JPEG")
        }
        other => other.to_string(),
    };
    decoder.read_info().map_err(words)?;
    let info = decoder.info().ok_or("no frame header")?;
    check_size([info.width.into(), info.height.into()], [width, height])?;
    let bytes_a_sample = match info.pixel_format {
        PixelFormat::L8 => 1,
        PixelFormat::L16 => 2,
        _ => return Err("several components: one is read".to_owned()),
    };
    let mut bytes = decoder.decode().map_err(words)?;
    if bytes_a_sample == 2 && cfg!(target_endian = "big") {
        bytes.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    }
    Ok(Samples { bytes, bytes_a_sample })
}

fn jpeg_2000(data: &[u8], width: usize, height: usize) -> Result<Samples, String> {
    // A code stream, or one in a JP2 file, which some writers put there against the standard.
    let start = data.windows(4).position(|w| w == [0xff, 0x4f, 0xff, 0x51]).ok_or("no code stream")?;
    let stream = &data[start..];
    let long = |at: usize| stream.get(at..at + 4).map_or(0, |b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]));
    let word = |at: usize| stream.get(at..at + 2).map_or(0, |b| u16::from_be_bytes([b[0], b[1]]));
    // SIZ: the image's area and where it begins, then the components.
    let side = |at: usize| long(at).saturating_sub(long(at + 8)) as usize;
    check_size([side(8), side(12)], [width, height])?;
    let components = word(40);
    if components != 1 {
        return Err(format!("{components} components: one is read"));
    }
    let described = stream.get(42).copied().unwrap_or_default();
    let (signed, bits) = (described & 0x80 != 0, u32::from(described & 0x7f) + 1);
    if bits > 16 {
        return Err(format!("{bits} bits a sample: at most 16 are read"));
    }
    let settings = DecodeSettings { resolve_palette_indices: false, strict: false, target_resolution: None };
    let image = Image::new(stream, &settings).map_err(|e| e.to_string())?;
    let mut raw = image.decode_native().map_err(|e| e.to_string())?;
    drop(image);
    let bytes_a_sample = usize::from(raw.bytes_per_sample);
    check_size([raw.width as usize, raw.height as usize], [width, height])?;
    if raw.data.len() != width * height * bytes_a_sample {
        return Err(format!("expected {} bytes, found {}", width * height * bytes_a_sample, raw.data.len()));
    }
    if !signed {
        return Ok(Samples { bytes: raw.data, bytes_a_sample });
    }
    // The library takes signed samples for unsigned ones, half their range higher; HTJ2K it leaves as they are.
    let high_throughput = word(4 + usize::from(word(4))) == 0xff50;
    let half = 1u16 << (bits - 1);
    let extended = |sample: u16| {
        let sample = if high_throughput { sample } else { sample ^ half };
        (sample & (half | (half - 1)) ^ half).wrapping_sub(half).to_le_bytes()
    };
    if bytes_a_sample == 1 {
        let bytes = raw.data.iter().flat_map(|&b| extended(b.into())).collect();
        return Ok(Samples { bytes, bytes_a_sample: 2 });
    }
    for sample in raw.data.as_chunks_mut().0 {
        *sample = extended(u16::from_le_bytes(*sample));
    }
    Ok(Samples { bytes: raw.data, bytes_a_sample })
}

fn check_size(
    [width, height]: [usize; 2],
    [expected_width, expected_height]: [usize; 2],
) -> Result<(), String> {
    if [width, height] == [expected_width, expected_height] {
        return Ok(());
    }
    Err(format!(
        "expected {expected_width} × {expected_height} px as the header says, found {width} × {height}"
    ))
}
