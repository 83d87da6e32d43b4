//! NumPy's array files, as far as a picture needs them: numpy.lib.format, versions 1.0 to 3.0.

use crate::NpyError;
use reference::{Picture, Pixel};

/// Numbers of a pixel: red, green, blue, opacity, depth.
const SAMPLES: usize = 5;
const MAGIC: &[u8] = b"\x93NUMPY";
/// NumPy lays the numbers at a multiple of this, so that a file can be mapped.
const ALIGNMENT: usize = 64;
/// The names of a pixel's samples but for its depth, for people.
const CHANNELS: [&str; 4] = ["red", "green", "blue", "opacity"];

/// How many digits data keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// IEEE binary32: what a renderer has.
    Float32,
    /// IEEE binary64: what the reference has.
    Float64,
}

impl Precision {
    fn bytes(self) -> usize {
        match self {
            Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }
}

/// Whether bytes begin as data do.
pub(crate) fn is_npy(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

/// A picture as the bytes of an `.npy` file, little endian.
#[must_use]
pub fn to_npy(picture: &Picture, precision: Precision) -> Vec<u8> {
    let digits = precision.bytes();
    let (width, height) = (picture.width(), picture.height());
    let mut header = format!(
        "{{'descr': '<f{digits}', 'fortran_order': False, 'shape': ({height}, {width}, {SAMPLES}), }}"
    );
    // Blanks and a line's end fill up to the alignment, with the ten bytes before.
    let before = MAGIC.len() + 4;
    let padded = (before + header.len() + 1).next_multiple_of(ALIGNMENT);
    header.extend(std::iter::repeat_n(' ', padded - before - header.len() - 1));
    header.push('\n');

    let mut bytes = Vec::with_capacity(padded + picture.pixels().len() * SAMPLES * digits);
    bytes.extend(MAGIC);
    bytes.extend([1, 0]);
    // A header of three short entries is some hundred bytes.
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    for pixel in picture.pixels() {
        let [r, g, b, a] = pixel.rgba;
        for sample in [r, g, b, a, pixel.depth_mm.unwrap_or(f64::NAN)] {
            match precision {
                Precision::Float32 => bytes.extend((sample as f32).to_le_bytes()),
                Precision::Float64 => bytes.extend(sample.to_le_bytes()),
            }
        }
    }
    bytes
}

/// The picture of the bytes of an `.npy` file: float32 or float64 of either byte order.
///
/// # Errors
/// If they are no array of shape `[height, width, 5]`, a colour or an opacity is not finite, or a depth is infinite or
/// negative.
pub fn from_npy(bytes: &[u8]) -> Result<Picture, NpyError> {
    let (header, numbers) = split(bytes)?;
    let Header { precision, little_endian, shape } = Header::parse(header)?;
    let side = |at: usize| shape.get(at).and_then(|&n| u32::try_from(n).ok()).filter(|&n| n > 0);
    let (Some(height), Some(width), &[_, _, 5]) = (side(0), side(1), &shape[..]) else {
        return Err(NpyError::Shape { found: shape });
    };
    let pixel_bytes = SAMPLES * precision.bytes();
    let expected = u128::from(width) * u128::from(height) * pixel_bytes as u128;
    if numbers.len() as u128 != expected {
        return Err(NpyError::Length { width, height, found: numbers.len(), expected });
    }
    let pixels = numbers.chunks_exact(pixel_bytes).enumerate().map(|(at, pixel)| {
        let samples: [f64; SAMPLES] = std::array::from_fn(|i| {
            let bytes = &pixel[i * precision.bytes()..(i + 1) * precision.bytes()];
            number(bytes, little_endian)
        });
        let (x, y) = ((at % width as usize) as u32, (at / width as usize) as u32);
        checked(samples, x, y)
    });
    let pixels = pixels.collect::<Result<Vec<_>, _>>()?;
    // As many pixels as the length was found to hold.
    Ok(Picture::new(width, height, pixels).expect("the pixels were counted"))
}

fn checked(samples: [f64; SAMPLES], x: u32, y: u32) -> Result<Pixel, NpyError> {
    let [rgba @ .., depth] = samples;
    for (found, channel) in rgba.into_iter().zip(CHANNELS) {
        if !found.is_finite() {
            return Err(NpyError::NotFinite { x, y, channel, found });
        }
    }
    if depth.is_infinite() || depth < 0.0 {
        return Err(NpyError::Depth { x, y, found: depth });
    }
    Ok(Pixel { rgba, depth_mm: (!depth.is_nan()).then_some(depth) })
}

fn number(bytes: &[u8], little_endian: bool) -> f64 {
    match <[u8; 4]>::try_from(bytes) {
        Ok(four) if little_endian => f64::from(f32::from_le_bytes(four)),
        Ok(four) => f64::from(f32::from_be_bytes(four)),
        Err(_) => {
            let eight = <[u8; 8]>::try_from(bytes).expect("a number has four bytes or eight");
            if little_endian { f64::from_le_bytes(eight) } else { f64::from_be_bytes(eight) }
        }
    }
}

/// The header's text and what follows it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), NpyError> {
    let cut = |expected: usize| NpyError::Cut { found: bytes.len(), expected };
    if !is_npy(bytes) {
        return Err(NpyError::Magic(bytes.iter().copied().take(MAGIC.len()).collect()));
    }
    let (&major, &minor) = bytes.get(6).zip(bytes.get(7)).ok_or_else(|| cut(MAGIC.len() + 2))?;
    let (begin, length) = match (major, minor) {
        (1, 0) => {
            let two = bytes.get(8..10).ok_or_else(|| cut(10))?;
            (10, usize::from(u16::from_le_bytes([two[0], two[1]])))
        }
        (2 | 3, 0) => {
            let four = bytes.get(8..12).ok_or_else(|| cut(12))?;
            (12, u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
        }
        _ => return Err(NpyError::Version { major, minor }),
    };
    let end = begin + length;
    let header = bytes.get(begin..end).ok_or_else(|| cut(end))?;
    let text = std::str::from_utf8(header)
        .map_err(|_| NpyError::Header(String::from_utf8_lossy(header).chars().take(200).collect()))?;
    Ok((text, &bytes[end..]))
}

/// What the header says.
struct Header {
    precision: Precision,
    little_endian: bool,
    shape: Vec<u64>,
}

impl Header {
    /// Reads the one dictionary that the format allows: its three entries, in any order, with or without a comma at the
    /// end.
    fn parse(text: &str) -> Result<Self, NpyError> {
        let wrong = || NpyError::Header(text.trim_end().chars().take(200).collect());
        let mut rest = text.trim().strip_prefix('{').and_then(|t| t.strip_suffix('}')).ok_or_else(wrong)?;
        let (mut descr, mut fortran, mut shape) = (None, None, None);
        loop {
            rest = rest.trim_start();
            if rest.is_empty() {
                break;
            }
            let (key, after) = quoted(rest).ok_or_else(wrong)?;
            let after = after.trim_start().strip_prefix(':').ok_or_else(wrong)?.trim_start();
            rest = match key {
                "descr" => {
                    let (value, after) = quoted(after).ok_or_else(wrong)?;
                    descr = Some(value);
                    after
                }
                "fortran_order" => {
                    let value = after.starts_with("True");
                    fortran = Some(value);
                    after.strip_prefix(if value { "True" } else { "False" }).ok_or_else(wrong)?
                }
                "shape" => {
                    let (value, after) =
                        after.strip_prefix('(').and_then(|t| t.split_once(')')).ok_or_else(wrong)?;
                    let sides = value.split(',').map(str::trim).filter(|side| !side.is_empty());
                    shape =
                        Some(sides.map(str::parse).collect::<Result<Vec<u64>, _>>().map_err(|_| wrong())?);
                    after
                }
                _ => return Err(wrong()),
            };
            rest = rest.trim_start();
            match rest.strip_prefix(',') {
                Some(next) => rest = next,
                None if rest.is_empty() => {}
                None => return Err(wrong()),
            }
        }
        let (Some(descr), Some(fortran), Some(shape)) = (descr, fortran, shape) else { return Err(wrong()) };
        let (precision, little_endian) = match descr {
            "<f4" => (Precision::Float32, true),
            ">f4" => (Precision::Float32, false),
            "<f8" => (Precision::Float64, true),
            ">f8" => (Precision::Float64, false),
            other => return Err(NpyError::Type(other.chars().take(40).collect())),
        };
        if fortran {
            return Err(NpyError::Order);
        }
        Ok(Self { precision, little_endian, shape })
    }
}

/// A string in either quotes, and what follows it. The format's own strings hold no escapes.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn picture() -> Picture {
        let pixel = |i: u32| Pixel {
            rgba: [f64::from(i) / 7.0, 0.25, -1.5e-30, 1.0],
            depth_mm: (!i.is_multiple_of(3)).then(|| 100.0 + f64::from(i) / 3.0),
        };
        Picture::new(3, 2, (0..6).map(pixel).collect()).unwrap()
    }

    /// An array file of another writer: any header, any numbers.
    fn file(version: [u8; 2], header: &str, numbers: &[u8]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend(version);
        match version {
            [1, _] => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        bytes.extend(header.as_bytes());
        bytes.extend(numbers);
        bytes
    }

    #[test]
    fn what_is_written_is_read_again() {
        let picture = picture();
        assert_eq!(from_npy(&to_npy(&picture, Precision::Float64)).unwrap(), picture);
        let once = from_npy(&to_npy(&picture, Precision::Float32)).unwrap();
        assert_eq!(from_npy(&to_npy(&once, Precision::Float32)).unwrap(), once);
        for (a, b) in picture.pixels().iter().zip(once.pixels()) {
            assert_eq!(b.rgba, a.rgba.map(|x| f64::from(x as f32)));
            assert_eq!(b.depth_mm, a.depth_mm.map(|x| f64::from(x as f32)));
        }
    }

    #[test]
    fn the_bytes_are_those_that_numpy_writes() {
        let pixel = Pixel { rgba: [0.0, 0.5, 1.0, 1.0], depth_mm: None };
        let bytes = to_npy(&Picture::new(1, 1, vec![pixel]).unwrap(), Precision::Float32);
        // numpy.save of numpy.array([[[0, 0.5, 1, 1, nan]]], dtype=numpy.float32), NumPy 2.4.
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 1, 5), }";
        let mut expected = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        expected.extend(format!("{header:117}\n").as_bytes());
        for number in [0.0f32, 0.5, 1.0, 1.0, f32::NAN] {
            expected.extend(number.to_le_bytes());
        }
        assert_eq!(bytes, expected);
    }

    #[test]
    fn other_writers_headers_are_read() {
        let big: Vec<u8> = [0.1f32, 0.2, 0.3, 0.4, 5.0].iter().flat_map(|x| x.to_be_bytes()).collect();
        for header in [
            "{'descr': '>f4', 'fortran_order': False, 'shape': (1, 1, 5), }\n",
            "{\"shape\":(1,1,5),\"fortran_order\":False,\"descr\":\">f4\"}",
            "  { 'shape' : ( 1 , 1 , 5 , ) , 'descr' : '>f4' , 'fortran_order' : False }   \n",
        ] {
            for version in [[1, 0], [2, 0], [3, 0]] {
                let picture = from_npy(&file(version, header, &big)).unwrap();
                assert_eq!(picture.pixel(0, 0).depth_mm, Some(5.0));
                assert_eq!(picture.pixel(0, 0).rgba[1], f64::from(0.2f32));
            }
        }
    }

    #[test]
    fn what_is_no_picture_is_refused_with_what_is_wrong() {
        let check = |version, header: &str, numbers: &[u8], expected: &str| {
            let error = from_npy(&file(version, header, numbers)).unwrap_err().to_string();
            assert!(error.contains(expected), "expected '{expected}' in: {error}");
        };
        let header = |descr: &str, order: &str, shape: &str| {
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
        };
        check([4, 0], "{}", &[], "format 4.0");
        check([1, 0], "", &[], "is not one of NumPy's");
        check([1, 0], "{'descr': '<f4', 'shape': (1, 1, 5)}", &[0; 20], "is not one of NumPy's");
        check([1, 0], "{'descr': '<f4' 'shape': (1, 1, 5)}", &[0; 20], "is not one of NumPy's");
        check([1, 0], &header("<i4", "False", "(1, 1, 5)"), &[0; 20], "'<i4'");
        check([1, 0], &header("|O", "False", "(1, 1, 5)"), &[0; 20], "'|O'");
        check([1, 0], &header("<f4", "True", "(1, 1, 5)"), &[0; 20], "Fortran");
        check([1, 0], &header("<f4", "Maybe", "(1, 1, 5)"), &[0; 20], "is not one of NumPy's");
        check([1, 0], &header("<f4", "False", "(1, 5)"), &[0; 20], "[1, 5]");
        check([1, 0], &header("<f4", "False", "(1, 1, 4)"), &[0; 16], "[1, 1, 4]");
        check([1, 0], &header("<f4", "False", "(0, 1, 5)"), &[], "[0, 1, 5]");
        check([1, 0], &header("<f4", "False", "(1, -1, 5)"), &[0; 20], "is not one of NumPy's");
        check([1, 0], &header("<f4", "False", "(2, 1, 5)"), &[0; 20], "20 bytes of numbers");
        check([1, 0], &header("<f4", "False", "(1, 1, 5)"), &[0; 24], "24 bytes of numbers");
        let huge = "(18446744073709551615, 18446744073709551615, 5)";
        check([1, 0], &header("<f8", "False", "(4294967295, 4294967295, 5)"), &[0; 40], "by 4294967295");
        check(
            [1, 0],
            &header("<f8", "False", huge),
            &[0; 40],
            "[18446744073709551615, 18446744073709551615, 5]",
        );
        let numbers = |n: [f32; 5]| n.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<_>>();
        let good = header("<f4", "False", "(1, 1, 5)");
        check([1, 0], &good, &numbers([0.0, f32::NAN, 0.0, 0.0, 1.0]), "pixel (0, 0): green is NaN");
        check([1, 0], &good, &numbers([0.0, 0.0, 0.0, f32::INFINITY, 1.0]), "opacity is inf");
        check([1, 0], &good, &numbers([0.0, 0.0, 0.0, 0.0, f32::INFINITY]), "depth is inf");
        check([1, 0], &good, &numbers([0.0, 0.0, 0.0, 0.0, -1.0]), "depth is -1");
        assert_eq!(from_npy(b"\x93NUM"), Err(NpyError::Magic(b"\x93NUM".to_vec())));
        assert_eq!(from_npy(b"\x93NUMPY\x01"), Err(NpyError::Cut { found: 7, expected: 8 }));
        assert_eq!(
            from_npy(b"\x93NUMPY\x02\0\xff\xff\xff\xff"),
            Err(NpyError::Cut { found: 12, expected: 12 + 0xffff_ffff })
        );
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(flips in proptest::collection::vec((0usize..250, any::<u8>()), 0..8), keep in 0usize..260) {
            let mut bytes = to_npy(&picture(), Precision::Float32);
            for (at, byte) in flips {
                if let Some(old) = bytes.get_mut(at) {
                    *old = byte;
                }
            }
            bytes.truncate(keep);
            // Any result will do, but none of a picture that the bytes are too few for.
            if let Ok(picture) = from_npy(&bytes) {
                prop_assert!(picture.pixels().len() * 20 < bytes.len());
            }
        }
    }
}
