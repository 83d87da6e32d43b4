//! What files say of their labels: segments of 3D Slicer, and label tables in NIfTI headers.

use std::collections::BTreeMap;
use volume::{Label, LabelTable};

/// Longest name that is kept, in characters.
const LONGEST_NAME: usize = 120;
/// Most labels that are taken from a file.
const MOST: usize = 65_536;

/// A name as people should see it.
fn name(text: &str) -> String {
    text.trim().chars().filter(|c| !c.is_control()).take(LONGEST_NAME).collect()
}

fn color(parts: [Option<f64>; 3]) -> Option<[f64; 3]> {
    let [r, g, b] = parts;
    Some([r?, g?, b?]).filter(|c| c.iter().all(|c| (0.0..=1.0).contains(c)))
}

/// The segments that the keys of a NRRD header describe, as 3D Slicer writes them: `Segment5_Name`, `Segment5_Color`,
/// `Segment5_LabelValue`. Other keys are not kept: they may name the patient.
#[derive(Clone, Debug, Default)]
pub(crate) struct Segments {
    found: BTreeMap<u32, Segment>,
    /// Segments that lie in a second layer or a later one.
    hidden: usize,
}

#[derive(Clone, Debug, Default)]
struct Segment {
    name: String,
    color: Option<[f64; 3]>,
    number: Option<i64>,
    layer: u32,
}

impl Segments {
    /// Takes a key and its value, if it is a segment's.
    pub(crate) fn take(&mut self, key: &str, value: &str) {
        let Some((index, what)) = key.strip_prefix("Segment").and_then(|rest| rest.split_once('_')) else {
            return;
        };
        let Ok(index) = index.parse::<u32>() else { return };
        if self.found.len() >= MOST {
            return;
        }
        let segment = self.found.entry(index).or_default();
        match what {
            "Name" => segment.name = name(value),
            "Color" => {
                let mut words = value.split_whitespace().map(|w| w.parse().ok());
                let mut next = || words.next().flatten();
                segment.color = color([next(), next(), next()]);
            }
            "LabelValue" => segment.number = value.trim().parse().ok(),
            "Layer" => segment.layer = value.trim().parse().unwrap_or_default(),
            _ => {}
        }
    }

    /// Whether there is one.
    pub(crate) fn any(&self) -> bool {
        !self.found.is_empty()
    }

    /// The labels of the first layer, which is the one that is loaded. Where a segment has no number, it is one more than
    /// its place, as in files from before there were numbers.
    pub(crate) fn table(mut self, notes: &mut Vec<String>) -> LabelTable {
        let all = self.found.len();
        self.found.retain(|_, segment| segment.layer == 0);
        self.hidden = all - self.found.len();
        if self.hidden > 0 {
            notes.push(format!("{} segments lie in other layers, which are not loaded", self.hidden));
        }
        LabelTable::new(self.found.into_iter().map(|(index, segment)| Label {
            number: segment.number.unwrap_or(i64::from(index) + 1),
            name: segment.name,
            color: segment.color,
            opacity: None,
        }))
    }
}

/// The label table in a NIfTI header's extensions: the `LabelTable` of a Caret extension (XML). `None` if there is none.
pub(crate) fn caret_table(extensions: &[u8], notes: &mut Vec<String>) -> Option<LabelTable> {
    const BEGIN: &[u8] = b"<LabelTable";
    const END: &[u8] = b"</LabelTable>";
    let find = |bytes: &[u8], what: &[u8]| bytes.windows(what.len()).position(|w| w == what);
    let begin = find(extensions, BEGIN)?;
    let Some(end) = find(&extensions[begin..], END) else {
        return Some(LabelTable::default());
    };
    let text = String::from_utf8_lossy(&extensions[begin..begin + end + END.len()]).into_owned();
    let document = match roxmltree::Document::parse(&text) {
        Ok(document) => document,
        Err(e) => {
            notes.push(format!("the label table in the header cannot be read: {e}"));
            return Some(LabelTable::default());
        }
    };
    let label = |node: roxmltree::Node<'_, '_>| {
        let number = |attribute: &str| node.attribute(attribute).and_then(|text| text.parse::<f64>().ok());
        Some(Label {
            number: node.attribute("Key")?.trim().parse().ok()?,
            name: name(node.text().unwrap_or_default()),
            color: color([number("Red"), number("Green"), number("Blue")]),
            opacity: number("Alpha").filter(|a| (0.0..=1.0).contains(a)),
        })
    };
    let labels = document.descendants().filter(|node| node.has_tag_name("Label")).take(MOST);
    Some(LabelTable::new(labels.filter_map(label)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_read_from_keys_and_nothing_else_is() {
        let mut segments = Segments::default();
        for (key, value) in [
            ("Segment0_Name", " left\tlung "),
            ("Segment0_Color", "0.5 0.25 1"),
            ("Segment0_LabelValue", "3"),
            ("Segment1_Name", "tumour"),
            ("Segment1_Color", "2 0 0"),
            ("Segment2_Layer", "1"),
            ("SegmentX_Name", "?"),
            ("PatientName", "Doe^Jane"),
        ] {
            segments.take(key, value);
        }
        let mut notes = Vec::new();
        let table = segments.table(&mut notes);
        let lung = Label { number: 3, name: "leftlung".into(), color: Some([0.5, 0.25, 1.0]), opacity: None };
        let tumour = Label { number: 2, name: "tumour".into(), color: None, opacity: None };
        assert_eq!(table.labels(), [tumour, lung]);
        assert!(notes[0].contains("1 segments"), "{notes:?}");
    }

    #[test]
    fn a_caret_table_is_read_and_a_broken_one_is_noted() {
        let text = br#"junk<LabelTable><Label Key="5" Red="1" Green="0.5" Blue="0" Alpha="1"><![CDATA[liver]]></Label>
            <Label Key="x">no number</Label></LabelTable>junk"#;
        let mut notes = Vec::new();
        let table = caret_table(text, &mut notes).unwrap();
        let liver =
            Label { number: 5, name: "liver".into(), color: Some([1.0, 0.5, 0.0]), opacity: Some(1.0) };
        assert_eq!(table.labels(), [liver]);
        assert!(notes.is_empty());
        assert_eq!(caret_table(b"nothing", &mut notes), None);
        assert_eq!(caret_table(b"<LabelTable><Label></LabelTable>", &mut notes), Some(LabelTable::default()));
        assert!(notes[0].contains("cannot be read"), "{notes:?}");
    }
}
