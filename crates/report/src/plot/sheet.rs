//! Many small pictures with captions, as one PNG.

use super::canvas::{Anchor, TextStyle};
use super::font;
use tiny_skia::{Color, FillRule, Paint, PathBuilder, Pixmap, PremultipliedColorU8, Transform};

/// Between tiles and around them, pixels.
const GAP: u32 = 8;
/// Size of the captions' letters and distance of their lines, pixels.
const LETTERS: f64 = 10.5;
const LINE: u32 = 14;
/// Lines of a caption.
const LINES: usize = 3;
/// What stands behind all, and the colours of a caption's first line and the others; of one that tells of a failure.
const BEHIND: u8 = 24;
const FIRST: [u8; 4] = [240, 240, 240, 255];
const OTHERS: [u8; 4] = [165, 170, 178, 255];
const FAILED: [u8; 4] = [255, 120, 100, 255];

/// A picture with its caption.
#[derive(Clone, Debug, PartialEq)]
pub struct Tile {
    /// RGB, row by row, of [`Sheet::tile_px`]; none where there is no picture.
    pub rgb: Option<Vec<u8>>,
    /// Up to three lines; what is too long for the tile is cut, and says so.
    pub caption: Vec<String>,
}

/// A sheet of pictures of one size.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Pixels of a picture across and down; above 0.
    pub tile_px: [u32; 2],
    /// Pictures in a row; above 0.
    pub columns: u32,
    /// The pictures, row by row.
    pub tiles: Vec<Tile>,
}

impl Sheet {
    /// Pixels of the whole across and down.
    #[must_use]
    pub fn size_px(&self) -> [u32; 2] {
        let columns = self.columns.min(self.tiles.len() as u32).max(1);
        let rows = (self.tiles.len() as u32).div_ceil(columns).max(1);
        let [width, height] = self.cell_px();
        [GAP + columns * width, GAP + rows * height]
    }

    /// The sheet as PNG.
    ///
    /// # Panics
    /// If the sheet does not fit memory.
    #[must_use]
    pub fn to_png(&self) -> Vec<u8> {
        let [width, height] = self.size_px();
        let mut pixels = Pixmap::new(width, height).expect("a sheet's size fits memory");
        pixels.fill(Color::from_rgba8(BEHIND, BEHIND, BEHIND, 255));
        let [cell_width, cell_height] = self.cell_px();
        let columns = self.columns.min(self.tiles.len() as u32).max(1);
        for (tile, i) in self.tiles.iter().zip(0..) {
            let at = [GAP + i % columns * cell_width, GAP + i / columns * cell_height];
            self.paint(&mut pixels, tile, at);
        }
        // All is painted over opaque grey, so that nothing is left of the premultiplied alpha.
        // 64 levels a channel: nobody sees it at this size, and the file is a third smaller.
        let level = |c: &u8| c & 0xfc | c >> 6;
        let rgb: Vec<u8> = pixels.data().chunks_exact(4).flat_map(|p| p[..3].iter().map(level)).collect();
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&rgb));
        // The size is right and memory does not fail to be written.
        written.expect("a picture in memory can be encoded");
        bytes
    }

    fn cell_px(&self) -> [u32; 2] {
        [self.tile_px[0] + GAP, self.tile_px[1] + LINES as u32 * LINE + GAP]
    }

    fn paint(&self, pixels: &mut Pixmap, tile: &Tile, [left, top]: [u32; 2]) {
        let [width, height] = self.tile_px;
        let row_px = pixels.width();
        let black = [0; 3];
        let rgb = |x: u32, y: u32| {
            let at = (y * width + x) as usize * 3;
            tile.rgb.as_ref().and_then(|rgb| rgb.get(at..at + 3)).unwrap_or(&black)
        };
        for y in 0..height {
            for x in 0..width {
                let [r, g, b] = [0, 1, 2].map(|i| rgb(x, y)[i]);
                let at = ((top + y) * row_px + left + x) as usize;
                if let Some(color) = PremultipliedColorU8::from_rgba(r, g, b, 255) {
                    pixels.pixels_mut()[at] = color;
                }
            }
        }
        for (i, line) in tile.caption.iter().take(LINES).enumerate() {
            let colour = match i {
                0 => FIRST,
                _ if tile.rgb.is_none() => FAILED,
                _ => OTHERS,
            };
            let style =
                TextStyle { size: LETTERS, bold: i == 0, colour, anchor: Anchor::Start, upwards: false };
            let text = fitted(line, f64::from(width), style.bold);
            let at = [f64::from(left), f64::from(top + height + (i as u32 + 1) * LINE) - 3.0];
            let mut outlines = PathBuilder::new();
            font::outline(&mut outlines, at, &text, style);
            if let Some(path) = outlines.finish() {
                let mut paint = Paint::default();
                paint.set_color_rgba8(colour[0], colour[1], colour[2], colour[3]);
                pixels.fill_path(&path, &paint, FillRule::Winding, Transform::identity(), None);
            }
        }
    }
}

/// As much of a line as fits.
fn fitted(line: &str, width: f64, bold: bool) -> String {
    if font::width(line, LETTERS, bold) <= width {
        return line.to_owned();
    }
    let mut kept: Vec<char> = line.chars().collect();
    loop {
        kept.pop();
        let cut: String = kept.iter().chain(&['…']).collect();
        if kept.is_empty() || font::width(&cut, LETTERS, bold) <= width {
            return cut;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_and_captions_are_where_they_should_be() {
        let tile = |value: u8| Tile { rgb: Some(vec![value; 40 * 30 * 3]), caption: vec!["A name".into()] };
        let failed = Tile { rgb: None, caption: vec!["a".into(), "why".into()] };
        let sheet = Sheet { tile_px: [40, 30], columns: 2, tiles: vec![tile(200), tile(100), failed] };
        assert_eq!(sheet.size_px(), [8 + 2 * 48, 8 + 2 * 80]);
        let mut reader = png::Decoder::new(std::io::Cursor::new(sheet.to_png())).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        let at = |x: usize, y: usize| pixels[(y * 104 + x) * 3];
        assert_eq!([at(10, 10), at(58, 10), at(10, 90), at(2, 2)], [203, 101, 0, BEHIND]);
        let bright = |x: std::ops::Range<usize>, y: std::ops::Range<usize>| {
            y.flat_map(|y| x.clone().map(move |x| (x, y))).filter(|&(x, y)| at(x, y) > 130).count()
        };
        assert!(bright(8..48, 38..52) > 10, "the caption is there");
        assert_eq!(bright(8..48, 53..80), 0, "and no more lines than it has");
    }

    #[test]
    fn a_line_that_is_too_long_is_cut() {
        assert_eq!(fitted("short", 100.0, false), "short");
        let cut = fitted("a name that is much too long for its tile", 100.0, false);
        assert!(cut.ends_with('…') && font::width(&cut, LETTERS, false) <= 100.0, "{cut}");
    }
}
