//! The text of a picture: the compiled-in fonts, their widths and outlines.

use super::canvas::{Anchor, Spot, TextStyle};
use ab_glyph::{Font, FontRef, OutlineCurve, Point};
use std::sync::LazyLock;
use tiny_skia::PathBuilder;

static REGULAR: LazyLock<FontRef<'static>> =
    LazyLock::new(|| load(include_bytes!("../../fonts/Roboto-Regular.ttf")));
static BOLD: LazyLock<FontRef<'static>> =
    LazyLock::new(|| load(include_bytes!("../../fonts/Roboto-Bold.ttf")));

fn load(bytes: &'static [u8]) -> FontRef<'static> {
    // The bytes are compiled in and every test that paints a picture loads them.
    FontRef::try_from_slice(bytes).expect("a compiled-in font is a font")
}

fn font(bold: bool) -> &'static FontRef<'static> {
    if bold { &BOLD } else { &REGULAR }
}

/// Pixels for one unit of the font's outlines at a size in pixels to the em.
fn scale(font: &FontRef<'_>, size: f64) -> f64 {
    size / f64::from(font.units_per_em().unwrap_or(1000.0))
}

/// How wide a line of text is, in pixels.
pub(super) fn width(text: &str, size: f64, bold: bool) -> f64 {
    let font = font(bold);
    let advances = text.chars().map(|character| f64::from(font.h_advance_unscaled(font.glyph_id(character))));
    advances.sum::<f64>() * scale(font, size)
}

/// Adds the outlines of a line of text to a path.
pub(super) fn outline(path: &mut PathBuilder, at: Spot, text: &str, style: TextStyle) {
    let font = font(style.bold);
    let scale = scale(font, style.size);
    let mut pen = match style.anchor {
        Anchor::Start => 0.0,
        Anchor::Middle => -width(text, style.size, style.bold) / 2.0,
        Anchor::End => -width(text, style.size, style.bold),
    };
    for character in text.chars() {
        let glyph = font.glyph_id(character);
        let place = |point: Point| {
            // Along the line and up from it, in pixels.
            let (along, up) = (pen + f64::from(point.x) * scale, f64::from(point.y) * scale);
            let [x, y] =
                if style.upwards { [at[0] - up, at[1] - along] } else { [at[0] + along, at[1] - up] };
            (x as f32, y as f32)
        };
        let mut last = None;
        for curve in font.outline(glyph).map(|outline| outline.curves).unwrap_or_default() {
            let (from, to) = match curve {
                OutlineCurve::Line(from, to)
                | OutlineCurve::Quad(from, _, to)
                | OutlineCurve::Cubic(from, _, _, to) => (from, to),
            };
            if last != Some(from) {
                if last.is_some() {
                    path.close();
                }
                let (x, y) = place(from);
                path.move_to(x, y);
            }
            last = Some(to);
            let (x, y) = place(to);
            match curve {
                OutlineCurve::Line(..) => path.line_to(x, y),
                OutlineCurve::Quad(_, by, _) => {
                    let (x1, y1) = place(by);
                    path.quad_to(x1, y1, x, y);
                }
                OutlineCurve::Cubic(_, by, then, _) => {
                    let ((x1, y1), (x2, y2)) = (place(by), place(then));
                    path.cubic_to(x1, y1, x2, y2, x, y);
                }
            }
        }
        if last.is_some() {
            path.close();
        }
        pen += f64::from(font.h_advance_unscaled(glyph)) * scale;
    }
}
