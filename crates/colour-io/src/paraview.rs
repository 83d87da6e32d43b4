//! Colour maps of ParaView: JSON as it exports them, and the older XML.
//!
//! Source of the layout: ParaView's guide, "Color maps and transfer functions", and its `vtkSMTransferFunctionProxy`. `RGBPoints` is value, red, green,
//! blue; `Points` is value, opacity, midpoint, sharpness.

use crate::ColourError;
use crate::error::shown;
use crate::knots::{Knots, joined};
use crate::transfer::{Imported, Values, chosen};
use serde::Deserialize;

/// Opacity of a millimetre at the upper end of a map that has none: thin enough that the inside shows.
const DENSEST: f64 = 0.12;
/// Millimetres that opacities are for: ParaView's unit is the voxel's size, which a file does not say.
const UNIT_MM: f64 = 1.0;

/// An entry of a JSON file; what is not used is passed over, for ParaView adds fields with each version.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Entry {
    #[serde(rename = "Name")]
    name: String,
    #[serde(rename = "ColorSpace")]
    space: String,
    #[serde(rename = "RGBPoints")]
    colors: Vec<f64>,
    #[serde(rename = "Points")]
    opacities: Vec<f64>,
}

/// A JSON file: a list of maps, or one.
pub(crate) fn json(file: &str, text: &str, name: Option<&str>) -> Result<Imported, ColourError> {
    let wrong = |source| ColourError::Json { file: file.to_owned(), source };
    let entries: Vec<Entry> = if text.starts_with('[') {
        serde_json::from_str(text).map_err(wrong)?
    } else {
        vec![serde_json::from_str(text).map_err(wrong)?]
    };
    let entries: Vec<(String, Entry)> = entries.into_iter().map(|e| (e.name.clone(), e)).collect();
    let (name, entry) = chosen(file, &entries, name)?;
    let colors = groups::<4>(file, "RGBPoints", &entry.colors)?;
    let colors = colors.iter().map(|&[value, r, g, b]| (value, [r, g, b])).collect();
    let opacities = groups::<4>(file, "Points", &entry.opacities)?;
    let mut notes = Vec::new();
    // In VTK, 0.5 and 0 are linear.
    if opacities.iter().any(|p| p[2] != 0.5 || p[3] != 0.0) {
        notes.push(
            "midpoints and sharpness of its opacity are not applied: it is linear between points".to_owned(),
        );
    }
    let opacities = opacities.iter().map(|p| (p[0], [p[1]])).collect();
    imported(file, name, &entry.space, colors, opacities, notes)
}

/// An XML file: `ColorMap` elements with `Point x o r g b`.
pub(crate) fn xml(
    file: &str,
    document: &roxmltree::Document<'_>,
    name: Option<&str>,
) -> Result<Imported, ColourError> {
    let maps: Vec<(String, roxmltree::Node<'_, '_>)> = document
        .descendants()
        .filter(|node| node.has_tag_name("ColorMap"))
        .map(|node| (node.attribute("name").unwrap_or_default().to_owned(), node))
        .collect();
    let (name, map) = chosen(file, &maps, name)?;
    let (mut colors, mut opacities) = (Vec::new(), Vec::new());
    for point in map.children().filter(|node| node.has_tag_name("Point")) {
        let number = |attribute: &str| {
            let text = point.attribute(attribute).unwrap_or_default();
            let found = text.trim().parse::<f64>().ok().filter(|n| n.is_finite());
            found.ok_or_else(|| ColourError::wrong(file, "Point", format!("a number {attribute}"), text))
        };
        let value = number("x")?;
        colors.push((value, [number("r")?, number("g")?, number("b")?]));
        opacities.push((value, [if point.attribute("o").is_some() { number("o")? } else { 1.0 }]));
    }
    // Maps of colours alone say an opacity of 1 everywhere.
    if opacities.windows(2).all(|pair| pair[0].1 == pair[1].1) {
        opacities.clear();
    }
    imported(file, name, map.attribute("space").unwrap_or_default(), colors, opacities, Vec::new())
}

fn imported(
    file: &str,
    name: &str,
    space: &str,
    colors: Vec<(f64, [f64; 3])>,
    opacities: Vec<(f64, [f64; 1])>,
    mut notes: Vec<String>,
) -> Result<Imported, ColourError> {
    if colors.len() < 2 {
        let found = format!("{} points", colors.len());
        return Err(ColourError::wrong(file, "the colour map", "two points with colours or more", &found));
    }
    if !matches!(space, "" | "RGB" | "Step") {
        notes.push(format!("its colours are mixed in RGB between points, not in {}", shown(space)));
    }
    let values = if opacities.is_empty() {
        notes.push(format!(
            "it has no opacity: it is stretched over the window, with opacities from 0 to {DENSEST} a millimetre"
        ));
        Values::Stretched
    } else {
        Values::Absolute
    };
    let colors = Knots::checked(file, "colours", colors)?;
    let opacities = if opacities.is_empty() {
        let (low, high) = (colors.0[0].0, colors.0[colors.0.len() - 1].0);
        Knots(vec![(low, [0.0]), (high, [DENSEST])])
    } else {
        Knots::checked(file, "opacities", opacities)?
    };
    Ok(Imported {
        name: (!name.is_empty()).then(|| shown(name)),
        transfer: joined(file, &colors, &opacities, UNIT_MM)?,
        light: None,
        values,
        notes,
    })
}

fn groups<const N: usize>(file: &str, what: &str, numbers: &[f64]) -> Result<Vec<[f64; N]>, ColourError> {
    if !numbers.len().is_multiple_of(N) {
        let expected = format!("numbers in groups of {N}");
        return Err(ColourError::wrong(file, what, expected, &format!("{} numbers", numbers.len())));
    }
    Ok(numbers.chunks_exact(N).map(|group| std::array::from_fn(|i| group[i])).collect())
}

#[cfg(test)]
mod tests {
    use crate::{Values, transfer};
    use scene::Window;

    #[test]
    fn a_map_of_colours_is_stretched_over_the_window() {
        let text = r#"[{"ColorSpace": "Diverging", "Name": "Cool to Warm", "NanColor": [1, 1, 0],
            "RGBPoints": [0, 0.2, 0.3, 0.7, 0.5, 0.8, 0.8, 0.8, 1, 0.7, 0, 0.1]}]"#;
        let map = transfer("map.json", text, None).unwrap();
        assert_eq!((map.values, map.name.as_deref()), (Values::Stretched, Some("Cool to Warm")));
        assert_eq!(map.notes.len(), 2, "{:?}", map.notes);
        let over = map.over(Window { low: -100.0, high: 300.0 }).unwrap();
        assert_eq!(over.at(100.0).color, [0.8; 3]);
        assert!((over.at(300.0).opacity_per_mm - 0.12).abs() < 1e-12);
    }

    #[test]
    fn a_map_with_opacity_keeps_its_values() {
        let text = r#"{"Name": "ct", "RGBPoints": [-1000, 0, 0, 0, 1000, 1, 1, 1],
            "Points": [-1000, 0, 0.5, 0, 0, 0, 0.5, 0, 1000, 0.6, 0.5, 0]}"#;
        let map = transfer("map.json", text, Some("ct")).unwrap();
        let over = map.over(Window { low: 0.0, high: 1.0 }).unwrap();
        assert!((over.at(500.0).opacity_per_mm - 0.3).abs() < 1e-12);
        assert!(map.notes.is_empty());
    }

    #[test]
    fn xml_maps_are_read() {
        let text = r#"<ColorMaps><ColorMap name="grey" space="RGB">
            <Point x="0" o="0" r="0" g="0" b="0"/><Point x="10" o="0.5" r="1" g="1" b="1"/><NaN r="1" g="0" b="0"/>
            </ColorMap><ColorMap name="solid"><Point x="0" o="1" r="0" g="0" b="0"/>
            <Point x="1" o="1" r="1" g="0" b="0"/></ColorMap></ColorMaps>"#;
        let grey = transfer("maps.xml", text, Some("grey")).unwrap();
        assert_eq!(grey.values, Values::Absolute);
        assert!((grey.transfer.at(5.0).opacity_per_mm - 0.25).abs() < 1e-12);
        assert_eq!(transfer("maps.xml", text, Some("solid")).unwrap().values, Values::Stretched);
    }

    #[test]
    fn a_name_cannot_steer_the_terminal_nor_fill_it() {
        let entry = |name: &str| {
            format!(r#"{{"Name": "{name}", "RGBPoints": [0, 0, 0, 0, 1, 1, 1, 1], "ColorSpace": "{name}"}}"#)
        };
        let steering = "\\u001b[2J".repeat(100);
        let map = transfer("map.json", &entry(&steering), None).unwrap();
        let all = format!("{} {}", map.name.unwrap(), map.notes.join(" "));
        assert!(!all.contains('\u{1b}') && all.contains("[2J") && all.len() < 1000, "{all}");
        let many = vec![entry(&steering); 1000].join(",");
        let message = transfer("map.json", &format!("[{many}]"), None).unwrap_err().to_string();
        assert!(!message.contains('\u{1b}') && message.ends_with("and 936 more"), "{message}");
        assert!(message.len() < 20_000, "{}", message.len());
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            ("[]", "it holds"),
            (r#"[{"RGBPoints": [0, 1, 2]}]"#, "groups of 4"),
            (r#"{"RGBPoints": [0, 1, 1, 1]}"#, "two points"),
            (r#"{"RGBPoints": [0, 0, 0, 0, 1, 300, 1, 1]}"#, "0 to 1"),
            (r#"{"RGBPoints": "x"}"#, "not valid JSON"),
            ("<ColorMaps><ColorMap><Point x='a'/></ColorMap></ColorMaps>", "a number x"),
            ("<a", "not valid XML"),
            ("<a/>", "expected a volume property"),
            ("hello", "expected a volume property"),
            ("", "expected a volume property"),
        ] {
            let message = transfer("map", text, None).unwrap_err().to_string();
            assert!(message.contains(part), "{text}: {message}");
        }
    }
}
