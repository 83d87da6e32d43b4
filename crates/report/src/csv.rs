//! The frames of a run as a table, one line a frame.

use crate::{CsvError, FrameRecord, Run, StageNames};
use std::io::{BufRead, Write};

/// Columns before the stages.
const BEFORE: [&str; 3] = ["headset", "frame", "decoded_at_secs"];
/// Columns after the stages.
const AFTER: [&str; 14] = [
    "clock_error_us",
    "pose_age_at_render_us",
    "pose_to_decoded_us",
    "lateness_us",
    "bytes",
    "key_frame",
    "resolution_scale",
    "step_scale",
    "prediction_error_mm",
    "prediction_error_deg",
    "pose_to_shown_us",
    "head_deg_per_sec",
    "registration_px",
    "registration_deg",
];

/// Writes all frames of all headsets as comma-separated values (RFC 4180, lines end in `\n`): a header, then one line a
/// frame, headset by headset. The columns are those of [`FrameRecord`], with the headset's name before them and one
/// column `NAME_us` for each stage; `key_frame` is 0 or 1; what is not known is empty.
///
/// # Errors
/// If writing fails, or a frame does not have the run's stages.
pub fn write_frames_csv(run: &Run, out: &mut impl Write) -> Result<(), CsvError> {
    let stages: Vec<String> = run.stages.iter().map(|name| quoted(&format!("{name}_us"))).collect();
    let header: Vec<&str> =
        BEFORE.iter().copied().chain(stages.iter().map(String::as_str)).chain(AFTER).collect();
    writeln!(out, "{}", header.join(","))?;
    for headset in &run.headsets {
        let name = quoted(&headset.name);
        for frame in &headset.frames {
            if frame.stages_us.len() != run.stages.len() {
                return Err(CsvError::StageCount {
                    headset: headset.name.clone(),
                    frame: frame.frame,
                    found: frame.stages_us.len(),
                    expected: run.stages.len(),
                });
            }
            write!(out, "{name},{},{}", frame.frame, frame.decoded_at_secs)?;
            for micros in &frame.stages_us {
                write!(out, ",{micros}")?;
            }
            writeln!(
                out,
                ",{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
                frame.clock_error_us,
                frame.pose_age_at_render_us,
                frame.pose_to_decoded_us,
                frame.lateness_us,
                frame.bytes,
                u8::from(frame.key_frame),
                frame.resolution_scale,
                frame.step_scale,
                known(frame.prediction_error_mm),
                known(frame.prediction_error_deg),
                frame.pose_to_shown_us,
                known(frame.head_deg_per_sec),
                known(frame.registration_px),
                known(frame.registration_deg),
            )?;
        }
    }
    Ok(())
}

/// Reads what [`write_frames_csv`] wrote: the stages' names, and each frame with its headset's name.
///
/// # Errors
/// If reading fails, a column is missing or a field is not what its column holds.
pub fn read_frames_csv(input: impl BufRead) -> Result<(StageNames, Vec<(String, FrameRecord)>), CsvError> {
    let mut lines = input.lines();
    let header = fields(&lines.next().transpose()?.unwrap_or_default());
    let stages = header.len().saturating_sub(BEFORE.len() + AFTER.len());
    let expected = BEFORE.iter().copied().chain(std::iter::repeat_n("*_us", stages)).chain(AFTER);
    for (index, expected) in expected.enumerate() {
        let found = header.get(index).map_or("", String::as_str);
        let fits = if expected == "*_us" { found.ends_with("_us") } else { found == expected };
        if !fits {
            return Err(CsvError::Header {
                at: index + 1,
                found: found.to_owned(),
                expected: expected.to_owned(),
            });
        }
    }
    let names = header[BEFORE.len()..BEFORE.len() + stages].iter().map(|name| name.trim_end_matches("_us"));
    let mut frames = Vec::new();
    for (index, line) in lines.enumerate() {
        let line = Line { number: index + 2, fields: fields(&line?), header: &header };
        if line.fields.len() != header.len() {
            return Err(CsvError::Width {
                line: line.number,
                found: line.fields.len(),
                expected: header.len(),
            });
        }
        frames.push((line.fields[0].clone(), line.frame(stages)?));
    }
    Ok((StageNames::new(names), frames))
}

struct Line<'table> {
    number: usize,
    fields: Vec<String>,
    header: &'table [String],
}

impl Line<'_> {
    fn frame(&self, stages: usize) -> Result<FrameRecord, CsvError> {
        let after = BEFORE.len() + stages;
        let float = |column| self.parse::<f64>(column, "number");
        let signed = |column| self.parse::<i64>(column, "whole number");
        let unsigned = |column| self.parse::<u64>(column, "whole number from 0");
        let maybe =
            |column: usize| if self.fields[column].is_empty() { Ok(None) } else { float(column).map(Some) };
        Ok(FrameRecord {
            frame: unsigned(1)?,
            decoded_at_secs: float(2)?,
            stages_us: (BEFORE.len()..after).map(signed).collect::<Result<_, _>>()?,
            clock_error_us: unsigned(after)?,
            pose_age_at_render_us: signed(after + 1)?,
            pose_to_decoded_us: signed(after + 2)?,
            lateness_us: signed(after + 3)?,
            bytes: unsigned(after + 4)?,
            key_frame: self.parse::<u8>(after + 5, "0 or 1")? != 0,
            resolution_scale: float(after + 6)?,
            step_scale: float(after + 7)?,
            prediction_error_mm: maybe(after + 8)?,
            prediction_error_deg: maybe(after + 9)?,
            pose_to_shown_us: signed(after + 10)?,
            head_deg_per_sec: maybe(after + 11)?,
            registration_px: maybe(after + 12)?,
            registration_deg: maybe(after + 13)?,
        })
    }

    fn parse<T: std::str::FromStr>(&self, column: usize, expected: &'static str) -> Result<T, CsvError> {
        self.fields[column].parse().map_err(|_| CsvError::Field {
            line: self.number,
            column: self.header[column].clone(),
            found: self.fields[column].clone(),
            expected,
        })
    }
}

fn known(value: Option<f64>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

/// A field, in quotes if it must be. Line breaks become blanks, so that a line is a frame.
pub(crate) fn quoted(text: &str) -> String {
    let text = text.replace(['\n', '\r'], " ");
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}

/// The fields of one line.
pub(crate) fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut in_quotes = false;
    let mut characters = line.chars().peekable();
    while let Some(character) = characters.next() {
        match character {
            '"' if in_quotes && characters.peek() == Some(&'"') => {
                characters.next();
                fields.last_mut().expect("begins with one").push('"');
            }
            '"' => in_quotes = !in_quotes,
            ',' if !in_quotes => fields.push(String::new()),
            other => fields.last_mut().expect("begins with one").push(other),
        }
    }
    fields
}
