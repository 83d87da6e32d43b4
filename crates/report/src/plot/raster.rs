//! A picture as PNG.

use super::canvas::{Picture, Shape, Stroke};
use super::font;
use super::palette::Colour;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, StrokeDash, Transform,
};

pub(super) fn png(picture: &Picture, scale: u32) -> Vec<u8> {
    let [width, height] = picture.size_px().map(|pixels| pixels * scale);
    // A picture's layout is a few thousand pixels at most and never empty.
    let mut pixels = Pixmap::new(width, height).expect("a layout's size fits memory");
    pixels.fill(Color::WHITE);
    let transform = Transform::from_scale(scale as f32, scale as f32);
    for shape in &picture.shapes {
        draw(&mut pixels, shape, transform);
    }
    // All is painted over opaque white, so that nothing is left of the premultiplied alpha.
    let rgb: Vec<u8> = pixels.data().chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Balanced);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&rgb));
    // The size is right and memory does not fail to be written.
    written.expect("a picture in memory can be encoded");
    bytes
}

fn draw(pixels: &mut Pixmap, shape: &Shape, transform: Transform) {
    match shape {
        Shape::Area { points, fill } => {
            if let Some(path) = path(points, true) {
                pixels.fill_path(&path, &paint(*fill), FillRule::Winding, transform, None);
            }
        }
        Shape::Line { points, stroke } => {
            if let Some(path) = path(points, false) {
                pixels.stroke_path(&path, &paint(stroke.colour), &skia_stroke(*stroke), transform, None);
            }
        }
        Shape::Dot { centre: [x, y], radius, colour, hollow } => {
            if let Some(path) = PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32) {
                pixels.fill_path(
                    &path,
                    &paint(if *hollow { [255; 4] } else { *colour }),
                    FillRule::Winding,
                    transform,
                    None,
                );
                let stroke = skia_stroke(Stroke::solid(*colour, 1.6));
                pixels.stroke_path(&path, &paint(*colour), &stroke, transform, None);
            }
        }
        Shape::Text { at, text, style } => {
            let mut outlines = PathBuilder::new();
            font::outline(&mut outlines, *at, text, *style);
            if let Some(path) = outlines.finish() {
                pixels.fill_path(&path, &paint(style.colour), FillRule::Winding, transform, None);
            }
        }
    }
}

fn path(points: &[[f64; 2]], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::with_capacity(points.len() + 1, points.len());
    for (index, [x, y]) in points.iter().enumerate() {
        if index == 0 {
            path.move_to(*x as f32, *y as f32);
        } else {
            path.line_to(*x as f32, *y as f32);
        }
    }
    if closed {
        path.close();
    }
    path.finish()
}

fn paint([red, green, blue, alpha]: Colour) -> Paint<'static> {
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color_rgba8(red, green, blue, alpha);
    paint
}

fn skia_stroke(stroke: Stroke) -> tiny_skia::Stroke {
    tiny_skia::Stroke {
        width: stroke.width as f32,
        line_cap: LineCap::Butt,
        line_join: LineJoin::Round,
        dash: if stroke.dashed { StrokeDash::new(vec![5.0, 4.0], 0.0) } else { None },
        ..tiny_skia::Stroke::default()
    }
}
