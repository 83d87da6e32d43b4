//! Tables of labels: names and colours.
//!
//! Sources of the layouts: 3D Slicer's colour tables (`.ctbl`, `.txt`: number, name, and red, green, blue, alpha from 0 to
//! 255), ITK-SNAP's label descriptions (number, red, green, blue, alpha from 0 to 1, two switches, and a name in quotes), and JSON:
//! our own list of entries, or NiiVue's lists by column (`R`, `G`, `B`, `labels`, and `I` for the numbers).

use crate::ColourError;
use crate::error::read;
use scene::LabelEntry;
use serde::Deserialize;
use std::path::Path;
use volume::{Label, LabelTable};

/// Most labels of a table.
const MOST: usize = 65_536;
/// Longest name that is kept, in characters.
const LONGEST_NAME: usize = 120;
/// What files of labels may be.
const KNOWN: &str = "a table of labels: lines of `number name red green blue alpha` (3D Slicer), of `number red green blue \
                     alpha visible mesh \"name\"` (ITK-SNAP), or JSON";

/// Reads a table of labels.
///
/// # Errors
/// If it cannot be read, is none of the known ones, or something in it is wrong. See [`ColourError`].
pub fn load_labels(path: &Path) -> Result<LabelTable, ColourError> {
    labels(&path.display().to_string(), &read(path)?)
}

/// The same from text; `file` stands for the file in messages.
///
/// # Errors
/// As [`load_labels`].
pub fn labels(file: &str, text: &str) -> Result<LabelTable, ColourError> {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    let mut labels = if text.starts_with(['[', '{']) { json(file, text)? } else { lines(file, text)? };
    if labels.is_empty() {
        return Err(ColourError::Unknown { file: file.to_owned(), expected: KNOWN });
    }
    if labels.len() > MOST {
        let (expected, found) = (format!("at most {MOST}"), labels.len().to_string());
        return Err(ColourError::wrong(file, "labels", expected, &found));
    }
    for label in &mut labels {
        // As people should see it, on a terminal too.
        label.name = label.name.trim().chars().filter(|c| !c.is_control()).take(LONGEST_NAME).collect();
    }
    Ok(LabelTable::new(labels))
}

/// A JSON table.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Json {
    Bare(Vec<LabelEntry>),
    Columns {
        #[serde(rename = "R")]
        red: Vec<f64>,
        #[serde(rename = "G")]
        green: Vec<f64>,
        #[serde(rename = "B")]
        blue: Vec<f64>,
        #[serde(rename = "I")]
        numbers: Option<Vec<i64>>,
        labels: Vec<String>,
    },
    Named {
        labels: Vec<LabelEntry>,
    },
}

fn json(file: &str, text: &str) -> Result<Vec<Label>, ColourError> {
    let parsed: Json =
        serde_json::from_str(text).map_err(|source| ColourError::Json { file: file.to_owned(), source })?;
    match parsed {
        Json::Bare(entries) | Json::Named { labels: entries } => {
            for entry in &entries {
                let all = entry.color.into_iter().flatten().chain(entry.opacity);
                if let Some(found) = all.into_iter().find(|c| !(0.0..=1.0).contains(c)) {
                    let what = format!("label {}", entry.number);
                    return Err(ColourError::wrong(file, what, "0 to 1", &found.to_string()));
                }
            }
            Ok(entries.into_iter().map(Label::from).collect())
        }
        Json::Columns { red, green, blue, numbers, labels } => {
            let count = labels.len();
            let numbers = numbers.unwrap_or_else(|| (0..count as i64).collect());
            if [red.len(), green.len(), blue.len(), numbers.len()].iter().any(|&n| n != count) {
                let expected = format!("R, G, B and labels of one length, {count}");
                return Err(ColourError::wrong(file, "columns", expected, "others"));
            }
            (0..count)
                .map(|i| {
                    let number = numbers[i];
                    let color = of_bytes(file, number, [red[i], green[i], blue[i]])?;
                    Ok(Label { number, name: labels[i].clone(), color: Some(color), opacity: None })
                })
                .collect()
        }
    }
}

fn lines(file: &str, text: &str) -> Result<Vec<Label>, ColourError> {
    let of_line = |line: &str| if line.ends_with('"') { snap(file, line) } else { slicer(file, line) };
    text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#')).map(of_line).collect()
}

/// `5 liver 221 130 101 255`; a name may have several words.
fn slicer(file: &str, line: &str) -> Result<Label, ColourError> {
    let wrong = || ColourError::wrong(file, "a line", KNOWN, line);
    let words: Vec<&str> = line.split_whitespace().collect();
    let [number, name @ .., red, green, blue, alpha] = words.as_slice() else { return Err(wrong()) };
    let number: i64 = number.parse().map_err(|_| wrong())?;
    let mut channels = [0.0; 4];
    for (channel, word) in channels.iter_mut().zip([red, green, blue, alpha]) {
        *channel = word.parse().map_err(|_| wrong())?;
    }
    let [r, g, b, a] = channels;
    let [opacity, _, _] = of_bytes(file, number, [a, 0.0, 0.0])?;
    let name = name.join(" ").trim_matches('"').to_owned();
    Ok(Label { number, name, color: Some(of_bytes(file, number, [r, g, b])?), opacity: Some(opacity) })
}

/// `5  221 130 101  1  1 0  "liver"`.
fn snap(file: &str, line: &str) -> Result<Label, ColourError> {
    let wrong = || ColourError::wrong(file, "a line", KNOWN, line);
    let (numbers, name) = line.trim_end_matches('"').split_once('"').ok_or_else(wrong)?;
    let numbers: Vec<f64> =
        numbers.split_whitespace().map(str::parse).collect::<Result<_, _>>().map_err(|_| wrong())?;
    let [number, r, g, b, alpha, visible, _] = numbers[..] else { return Err(wrong()) };
    if number.fract() != 0.0 || number.abs() > 1.0e15 || !(0.0..=1.0).contains(&alpha) {
        return Err(wrong());
    }
    let number = number as i64;
    let opacity = Some(if visible == 0.0 { 0.0 } else { alpha });
    Ok(Label { number, name: name.to_owned(), color: Some(of_bytes(file, number, [r, g, b])?), opacity })
}

/// Channels from 0 to 255 as 0 to 1.
fn of_bytes(file: &str, number: i64, channels: [f64; 3]) -> Result<[f64; 3], ColourError> {
    if let Some(found) = channels.iter().find(|c| !(0.0..=255.0).contains(*c)) {
        return Err(ColourError::wrong(file, format!("label {number}"), "0 to 255", &found.to_string()));
    }
    Ok(channels.map(|c| c / 255.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn liver(text: &str) -> Label {
        labels("table", text).unwrap().get(5).unwrap().clone()
    }

    #[test]
    fn every_form_gives_the_same_label() {
        let expected =
            Label { number: 5, name: "left liver".into(), color: Some([1.0, 0.2, 0.0]), opacity: Some(1.0) };
        assert_eq!(liver("# Color table file\n0 air 0 0 0 0\n5 left liver 255 51 0 255\n"), expected);
        assert_eq!(liver("5 255 51 0 1 1 0 \"left liver\"\r\n"), expected);
        let own = r#"{"number": 5, "name": "left liver", "color": [1, 0.2, 0], "opacity": 1}"#;
        assert_eq!(liver(&format!("[{own}]")), expected);
        assert_eq!(liver(&format!(r#"{{"labels": [{own}]}}"#)), expected);
        let columns =
            r#"{"R": [0, 255], "G": [0, 51], "B": [0, 0], "I": [0, 5], "labels": ["air", "left liver"]}"#;
        assert_eq!(liver(columns), Label { opacity: None, ..expected });
        let table = labels("table", &columns.replace(r#""I": [0, 5], "#, "")).unwrap();
        assert_eq!(table.get(1).unwrap().name, "left liver", "numbered by place");
    }

    #[test]
    fn hidden_labels_of_itk_snap_are_transparent() {
        assert_eq!(liver("5 255 51 0 1 0 0 \"x\"").opacity, Some(0.0));
    }

    #[test]
    fn a_name_cannot_steer_the_terminal() {
        let name = "\\u001b[2Jliver ".repeat(40);
        let found = liver(&format!(r#"[{{"number": 5, "name": "{name}"}}]"#)).name;
        assert!(found.starts_with("[2Jliver [2J") && found.chars().count() == LONGEST_NAME, "{found}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, part) in [
            ("", "a table of labels"),
            ("# nothing\n", "a table of labels"),
            ("liver 1 2 3 4", "'liver 1 2 3 4'"),
            ("5 liver 1 2 3", "'5 liver 1 2 3'"),
            ("5 liver 1 2 300 255", "0 to 255"),
            ("5 1 2 3 2 1 0 \"x\"", "a line"),
            ("[{\"number\": 1, \"color\": [2, 0, 0]}]", "0 to 1"),
            ("[{\"nummer\": 1}]", "not valid JSON"),
            (r#"{"R": [1], "G": [], "B": [], "labels": ["a"]}"#, "of one length"),
        ] {
            let message = labels("table", text).unwrap_err().to_string();
            assert!(message.starts_with("table") && message.contains(part), "{text}: {message}");
        }
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "[0-9 .<>/\"=\\-a-zA-Z\\[\\]{}:,#\n]{0,200}") {
            let _ = labels("x", &text);
            let _ = crate::transfer("x", &text, None);
            let _ = crate::transfer("x", &format!("<MRML><VolumeProperty scalarOpacity='{text}' colorTransfer='{text}'/></MRML>"), None);
        }
    }
}
