//! Volume properties of 3D Slicer: `.vp` files and the nodes of its `presets.xml`.
//!
//! Source of the layout: Slicer's `vtkMRMLVolumePropertyStorageNode` (lines of text) and `vtkMRMLVolumePropertyNode`
//! (attributes). A function is a count and so many numbers: value and opacity, or value, red, green and blue.

use crate::ColourError;
use crate::error::shown;
use crate::knots::{Knots, joined};
use crate::transfer::{Imported, Values, chosen, numbers};
use scene::Headlight;

/// Millimetres that opacities are for where the file does not say: VTK's default.
const UNIT_MM: f64 = 1.0;
/// Lines of a `.vp` file.
const LINES: [&str; 9] = [
    "interpolation",
    "shade",
    "diffuse",
    "ambient",
    "specular",
    "specular power",
    "scalar opacity",
    "gradient opacity",
    "colour",
];

/// A volume property as text, whichever form it came in.
struct Property<'a> {
    shade: &'a str,
    diffuse: &'a str,
    ambient: &'a str,
    specular: &'a str,
    power: &'a str,
    opacity: &'a str,
    gradient_opacity: &'a str,
    color: &'a str,
    unit_mm: Option<&'a str>,
}

/// Whether a text is a `.vp` file: nine lines that begin with numbers.
pub(crate) fn is_property(text: &str) -> bool {
    let begins = |line: &str| line.split_whitespace().next().is_some_and(|w| w.parse::<f64>().is_ok());
    let mut lines = text.lines();
    let count = lines.by_ref().take(LINES.len()).filter(|line| begins(line)).count();
    count == LINES.len() && lines.all(|line| line.trim().is_empty())
}

/// A `.vp` file.
pub(crate) fn property(file: &str, text: &str) -> Result<Imported, ColourError> {
    let lines: Vec<&str> = text.lines().collect();
    let [_, shade, diffuse, ambient, specular, power, opacity, gradient_opacity, color, ..] = lines[..]
    else {
        let expected = format!("{} lines", LINES.len());
        return Err(ColourError::wrong(file, "the file", expected, &lines.len().to_string()));
    };
    let property = Property {
        shade,
        diffuse,
        ambient,
        specular,
        power,
        opacity,
        gradient_opacity,
        color,
        unit_mm: None,
    };
    imported(file, None, &property)
}

/// The `VolumeProperty` nodes of a `presets.xml`.
pub(crate) fn presets(
    file: &str,
    document: &roxmltree::Document<'_>,
    name: Option<&str>,
) -> Result<Imported, ColourError> {
    let nodes: Vec<(String, roxmltree::Node<'_, '_>)> = document
        .descendants()
        .filter(|node| node.has_tag_name("VolumeProperty"))
        .map(|node| (node.attribute("name").unwrap_or_default().to_owned(), node))
        .collect();
    let (name, node) = chosen(file, &nodes, name)?;
    let required = |attribute: &'static str| {
        node.attribute(attribute).ok_or_else(|| {
            ColourError::wrong(file, name.as_str(), format!("an attribute {attribute}"), "none")
        })
    };
    let or = |attribute: &str, default: &'static str| node.attribute(attribute).unwrap_or(default);
    let property = Property {
        shade: or("shade", "0"),
        diffuse: or("diffuse", "1"),
        ambient: or("ambient", "0.2"),
        specular: or("specular", "0"),
        power: or("specularPower", "1"),
        opacity: required("scalarOpacity")?,
        gradient_opacity: or("gradientOpacity", ""),
        color: required("colorTransfer")?,
        unit_mm: node.attribute("scalarOpacityUnitDistance"),
    };
    imported(file, Some(name), &property)
}

fn imported(file: &str, name: Option<&str>, property: &Property<'_>) -> Result<Imported, ColourError> {
    let mut notes = Vec::new();
    let opacities = Knots::checked(file, "scalar opacity", pairs(file, "scalar opacity", property.opacity)?)?;
    let colors = Knots::checked(file, "colour", quadruples(file, "colour", property.color)?)?;
    let gradient = pairs(file, "gradient opacity", property.gradient_opacity)?;
    if gradient.iter().any(|(_, [opacity])| *opacity != 1.0) {
        notes.push("its opacity by gradient is not applied".to_owned());
    }
    let number = |what: &'static str, text: &str, low: f64, high: f64| {
        let found = text.trim().parse::<f64>().ok().filter(|n| (low..=high).contains(n));
        found.ok_or_else(|| ColourError::wrong(file, what, format!("a number from {low} to {high}"), text))
    };
    let unit_mm = match property.unit_mm {
        None => UNIT_MM,
        Some(text) => number("scalarOpacityUnitDistance", text, 1.0e-6, 1.0e6)?,
    };
    let is_lit = match property.shade.trim() {
        "0" => false,
        "1" => true,
        other => return Err(ColourError::wrong(file, "shade", "0 or 1", other)),
    };
    let light = if is_lit {
        // VTK does not hold these below 1, and writes powers down to 0.
        let part = |what, text| Ok::<_, ColourError>(number(what, text, 0.0, 1.0e3)?.min(1.0));
        Some(Headlight {
            ambient: part("ambient", property.ambient)?,
            diffuse: part("diffuse", property.diffuse)?,
            specular: part("specular", property.specular)?,
            power: number("specular power", property.power, 0.0, 1.0e6)?.clamp(1.0, 256.0),
        })
    } else {
        None
    };
    Ok(Imported {
        name: name.map(shown),
        transfer: joined(file, &colors, &opacities, unit_mm)?,
        light,
        values: Values::Absolute,
        notes,
    })
}

/// A count and so many numbers, as values with `N` numbers each.
fn function<const N: usize>(file: &str, what: &str, text: &str) -> Result<Vec<(f64, [f64; N])>, ColourError> {
    let all = numbers(file, what, text)?;
    let Some((&count, rest)) = all.split_first() else { return Ok(Vec::new()) };
    if count != rest.len() as f64 || !rest.len().is_multiple_of(N + 1) {
        let expected = format!("a count of numbers, in groups of {}, and so many of them", N + 1);
        return Err(ColourError::wrong(
            file,
            what,
            expected,
            &format!("{count}, and {} numbers", rest.len()),
        ));
    }
    let group = |g: &[f64]| (g[0], std::array::from_fn(|i| g[i + 1]));
    Ok(rest.chunks_exact(N + 1).map(group).collect())
}

fn pairs(file: &str, what: &str, text: &str) -> Result<Vec<(f64, [f64; 1])>, ColourError> {
    function(file, what, text)
}

fn quadruples(file: &str, what: &str, text: &str) -> Result<Vec<(f64, [f64; 3])>, ColourError> {
    function(file, what, text)
}

#[cfg(test)]
mod tests {
    use crate::{Values, transfer};

    const VP: &str = "1\n1\n0.9\n0.1\n0.2\n10\n6 -3024 0 100 0 300 0.8\n4 0 1 255 1\n\
                      8 -3024 0 0 0 300 1 0.5 0.25\n";
    const PRESETS: &str = r#"<?xml version="1.0"?><MRML>
        <VolumeProperty name="A" shade="0" scalarOpacity="4 0 0 10 0.75" colorTransfer="8 0 0 0 0 10 1 1 1"
            gradientOpacity="4 0 0 255 1" scalarOpacityUnitDistance="2"/>
        <VolumeProperty name="B" shade="1" specularPower="0.5" scalarOpacity="4 0 0 10 1" colorTransfer="4 5 1 0 0"/>
        </MRML>"#;

    #[test]
    fn a_volume_property_is_read() {
        let read = transfer("x.vp", VP, None).unwrap();
        assert_eq!(read.values, Values::Absolute);
        assert!((read.transfer.at(200.0).opacity_per_mm - 0.4).abs() < 1e-12);
        assert_eq!(read.transfer.at(400.0).color, [1.0, 0.5, 0.25]);
        let light = read.light.unwrap();
        assert_eq!((light.diffuse, light.ambient, light.specular, light.power), (0.9, 0.1, 0.2, 10.0));
        assert!(read.notes.is_empty());
    }

    #[test]
    fn presets_are_chosen_by_name_and_their_unit_becomes_a_millimetre() {
        let a = transfer("presets.xml", PRESETS, Some("A")).unwrap();
        assert!((a.transfer.at(10.0).opacity_per_mm - 0.5).abs() < 1e-12, "1 - (1 - 0.75)^(1/2)");
        assert!(a.light.is_none());
        assert!(a.notes[0].contains("gradient"));
        assert_eq!(transfer("presets.xml", PRESETS, Some("B")).unwrap().light.unwrap().power, 1.0);
        for name in [None, Some("C")] {
            let message = transfer("presets.xml", PRESETS, name).unwrap_err().to_string();
            assert!(message.contains("A, B"), "{message}");
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (from, to, part) in [
            ("6 -3024", "7 -3024", "scalar opacity: expected a count"),
            ("0.8\n", "1.8\n", "0 to 1"),
            ("100 0 300", "100 0 nan", "finite numbers"),
            ("-3024 0 100", "200 0 100", "rising order"),
            ("1\n1\n0.9", "1\n2\n0.9", "shade: expected 0 or 1"),
            ("8 -3024 0 0 0", "7 -3024 0 0", "colour: expected a count"),
        ] {
            assert!(VP.contains(from), "{from}");
            let message = transfer("x.vp", &VP.replacen(from, to, 1), None).unwrap_err().to_string();
            assert!(message.starts_with("x.vp") && message.contains(part), "{message}");
        }
        let missing = PRESETS.replace("colorTransfer=\"4", "colour=\"4");
        let message = transfer("p.xml", &missing, Some("B")).unwrap_err().to_string();
        assert!(message.contains("an attribute colorTransfer"), "{message}");
    }
}
