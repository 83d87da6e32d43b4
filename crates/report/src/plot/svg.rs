//! A picture as SVG.

use super::canvas::{Anchor, Picture, Shape};
use super::font;
use super::palette::Colour;
use std::fmt::Write;

pub(super) fn write(picture: &Picture) -> String {
    let [width, height] = picture.size_px();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} \
         {height}\" font-family=\"Roboto, 'DejaVu Sans', Helvetica, Arial, sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    );
    for shape in &picture.shapes {
        svg += &element(shape);
        svg.push('\n');
    }
    svg + "</svg>\n"
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Area { points, fill } => {
            format!("<polygon points=\"{}\" {}/>", listed(points), coloured("fill", *fill))
        }
        Shape::Line { points, stroke } => {
            let dash = if stroke.dashed { " stroke-dasharray=\"5 4\"" } else { "" };
            format!(
                "<polyline points=\"{}\" fill=\"none\" {} stroke-width=\"{}\" stroke-linejoin=\"round\"{dash}/>",
                listed(points),
                coloured("stroke", stroke.colour),
                stroke.width,
            )
        }
        Shape::Dot { centre: [x, y], radius, colour, hollow } => {
            let fill = if *hollow { [255; 4] } else { *colour };
            format!(
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" {} {} stroke-width=\"1.6\"/>",
                coloured("fill", fill),
                coloured("stroke", *colour),
            )
        }
        Shape::Text { at: [x, y], text, style } => {
            let anchor = match style.anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let weight = if style.bold { " font-weight=\"bold\"" } else { "" };
            let turn = if style.upwards {
                format!(" transform=\"rotate(-90 {x:.1} {y:.1})\"")
            } else {
                String::new()
            };
            // The viewer may have another font; the layout holds all the same.
            let length = font::width(text, style.size, style.bold);
            format!(
                "<text xml:space=\"preserve\" x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{}\" text-anchor=\"{anchor}\" textLength=\"{length:.1}\" lengthAdjust=\"spacingAndGlyphs\" {}{weight}{turn}>{}</text>",
                style.size,
                coloured("fill", style.colour),
                escaped(text),
            )
        }
    }
}

fn listed(points: &[[f64; 2]]) -> String {
    let mut list = String::with_capacity(points.len() * 12);
    for [x, y] in points {
        // Writing to a string does not fail.
        let _ = write!(list, "{x:.1},{y:.1} ");
    }
    list.truncate(list.trim_end().len());
    list
}

fn coloured(attribute: &str, [red, green, blue, alpha]: Colour) -> String {
    let colour = format!("{attribute}=\"#{red:02x}{green:02x}{blue:02x}\"");
    if alpha == 255 {
        colour
    } else {
        format!("{colour} {attribute}-opacity=\"{:.3}\"", f64::from(alpha) / 255.0)
    }
}

/// Text as XML allows it; characters that XML forbids are left out.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '\u{fffe}' | '\u{ffff}' => {}
            other if other.is_control() => {}
            other => escaped.push(other),
        }
    }
    escaped
}
