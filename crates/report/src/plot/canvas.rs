//! A picture as a list of shapes.

use super::palette::Colour;
use super::{font, raster, svg};

/// A picture that is laid out: shapes in pixels from the upper left corner, later ones over earlier ones. It is written
/// as SVG or painted as PNG; both look alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) shapes: Vec<Shape>,
}

/// A point in pixels: to the right, down.
pub(super) type Spot = [f64; 2];

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// A filled area; its last point is joined to its first.
    Area { points: Vec<Spot>, fill: Colour },
    /// A line through points.
    Line { points: Vec<Spot>, stroke: Stroke },
    /// A disc, or a ring if it is hollow.
    Dot { centre: Spot, radius: f64, colour: Colour, hollow: bool },
    /// One line of text.
    Text { at: Spot, text: String, style: TextStyle },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stroke {
    pub(super) colour: Colour,
    pub(super) width: f64,
    pub(super) dashed: bool,
}

impl Stroke {
    pub(super) fn solid(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: false }
    }

    pub(super) fn dashed(colour: Colour, width: f64) -> Self {
        Self { colour, width, dashed: true }
    }
}

/// How text stands at its point, which lies on its baseline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TextStyle {
    pub(super) size: f64,
    pub(super) bold: bool,
    pub(super) colour: Colour,
    pub(super) anchor: Anchor,
    /// Whether it reads upwards.
    pub(super) upwards: bool,
}

impl TextStyle {
    pub(super) fn new(size: f64, colour: Colour) -> Self {
        Self { size, bold: false, colour, anchor: Anchor::Start, upwards: false }
    }

    pub(super) fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    pub(super) fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    pub(super) fn upwards(self) -> Self {
        Self { upwards: true, ..self }
    }
}

/// What of a text stands at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// A rectangle in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

impl Frame {
    pub(super) fn width(&self) -> f64 {
        self.right - self.left
    }

    pub(super) fn height(&self) -> f64 {
        self.bottom - self.top
    }
}

impl Picture {
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self { width, height, shapes: Vec::new() }
    }

    /// Width and height in pixels at a scale of 1.
    #[must_use]
    pub fn size_px(&self) -> [u32; 2] {
        [self.width.ceil() as u32, self.height.ceil() as u32]
    }

    /// The picture as an SVG document. It names the font Roboto and falls back to the viewer's sans-serif.
    #[must_use]
    pub fn to_svg(&self) -> String {
        svg::write(self)
    }

    /// The picture as a PNG file, RGB on white. `scale` is how many pixels make one of the layout's, 1 to 4 (other
    /// values are clamped): 2 is sharp on any screen.
    #[must_use]
    pub fn to_png(&self, scale: u32) -> Vec<u8> {
        raster::png(self, scale.clamp(1, 4))
    }

    pub(super) fn area(&mut self, points: Vec<Spot>, fill: Colour) {
        self.shapes.push(Shape::Area { points, fill });
    }

    pub(super) fn rectangle(&mut self, frame: Frame, fill: Colour) {
        let Frame { left, top, right, bottom } = frame;
        self.area(vec![[left, top], [right, top], [right, bottom], [left, bottom]], fill);
    }

    pub(super) fn line(&mut self, points: Vec<Spot>, stroke: Stroke) {
        self.shapes.push(Shape::Line { points, stroke });
    }

    pub(super) fn outline(&mut self, frame: Frame, stroke: Stroke) {
        let Frame { left, top, right, bottom } = frame;
        self.line(vec![[left, top], [right, top], [right, bottom], [left, bottom], [left, top]], stroke);
    }

    pub(super) fn dot(&mut self, centre: Spot, radius: f64, colour: Colour) {
        self.shapes.push(Shape::Dot { centre, radius, colour, hollow: false });
    }

    pub(super) fn ring(&mut self, centre: Spot, radius: f64, colour: Colour) {
        self.shapes.push(Shape::Dot { centre, radius, colour, hollow: true });
    }

    /// Puts one line of text with its baseline at a point.
    pub(super) fn text(&mut self, at: Spot, text: impl Into<String>, style: TextStyle) {
        self.shapes.push(Shape::Text { at, text: text.into(), style });
    }

    /// As [`Picture::text`], shortened with an ellipsis to fit `width`.
    pub(super) fn text_within(&mut self, at: Spot, width: f64, text: &str, style: TextStyle) {
        let mut text = text.to_owned();
        if font::width(&text, style.size, style.bold) > width {
            while !text.is_empty() && font::width(&format!("{text}…"), style.size, style.bold) > width {
                text.pop();
            }
            text.push('…');
        }
        self.text(at, text, style);
    }
}
