//! What the colours and lines of a picture mean.

use super::canvas::{Frame, Picture, Stroke, TextStyle};
use super::font;
use super::palette::{self, Colour};

const TEXT: f64 = 14.0;

/// What the colours and lines mean, in as many rows as it takes.
pub(super) struct Legend {
    left: f64,
    rows: Vec<Vec<(Swatch, String)>>,
}

#[derive(Clone, Copy)]
pub(super) enum Swatch {
    Filled(Colour),
    Line(Stroke),
    Triangle,
}

impl Legend {
    const ROW: f64 = 22.0;
    const SWATCH: f64 = 20.0;
    const GAP: f64 = 18.0;

    /// Lays `items` out between two edges, in pixels.
    pub(super) fn new(left: f64, right: f64, items: Vec<(Swatch, String)>) -> Self {
        let (mut rows, mut x) = (vec![Vec::new()], left);
        for item in items {
            let width = Self::width(&item.1);
            if x + width > right + Self::GAP && x > left {
                rows.push(Vec::new());
                x = left;
            }
            x += width;
            rows.last_mut().expect("begins with one").push(item);
        }
        Self { left, rows }
    }

    fn width(text: &str) -> f64 {
        Self::SWATCH + 6.0 + font::width(text, TEXT, false) + Self::GAP
    }

    pub(super) fn height(&self) -> f64 {
        self.rows.len() as f64 * Self::ROW
    }

    pub(super) fn draw(&self, picture: &mut Picture, top: f64) {
        for (row, items) in self.rows.iter().enumerate() {
            let middle = top + (row as f64 + 0.5) * Self::ROW;
            let mut left = self.left;
            for (swatch, text) in items {
                let right = left + Self::SWATCH;
                match swatch {
                    Swatch::Filled(colour) => {
                        let frame = Frame { left, right, top: middle - 6.0, bottom: middle + 6.0 };
                        picture.rectangle(frame, *colour);
                        picture.outline(frame, Stroke::solid(palette::GRID, 1.0));
                    }
                    Swatch::Line(stroke) => picture.line(vec![[left, middle], [right, middle]], *stroke),
                    Swatch::Triangle => {
                        let x = f64::midpoint(left, right);
                        let foot = middle + 4.0;
                        picture.area(vec![[x - 4.5, foot], [x + 4.5, foot], [x, foot - 8.0]], palette::INK);
                    }
                }
                let style = TextStyle::new(TEXT, palette::INK);
                picture.text([right + 6.0, middle + 5.0], text.as_str(), style);
                left += Self::width(text);
            }
        }
    }
}
