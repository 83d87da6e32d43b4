//! Numbers and histograms as text.

use std::fmt;

/// Columns of a histogram.
const COLUMNS: usize = 64;
/// Rows of a histogram.
const ROWS: usize = 8;
/// Parts of a cell, empty to full.
const EIGHTHS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];

/// Draws counts as columns of blocks on a logarithmic scale, with an axis below. A bin that holds anything shows.
pub(super) fn histogram(f: &mut fmt::Formatter<'_>, counts: &[u64], low: f64, high: f64) -> fmt::Result {
    let heights = heights(counts);
    for row in (0..ROWS).rev() {
        let line: String = heights.iter().map(|h| EIGHTHS[h.saturating_sub(row * 8).min(8)]).collect();
        let label = match row {
            7 => "log count",
            _ => "",
        };
        writeln!(f, "  {label:<11} │{}", line.trim_end())?;
    }
    writeln!(f, "  {:<11} └{}", "", "─".repeat(COLUMNS))?;
    let (low, middle, high) = (number(low), number((low + high) / 2.0), number(high));
    let half = COLUMNS / 2;
    // The middle is written round the middle of the axis.
    let before_middle = half.saturating_sub(low.chars().count() + middle.chars().count() / 2);
    let used = low.chars().count() + before_middle + middle.chars().count();
    let before_high = (COLUMNS + 1).saturating_sub(used + high.chars().count()).max(1);
    writeln!(f, "  {:<11} {low}{}{middle}{}{high}", "", " ".repeat(before_middle), " ".repeat(before_high))
}

/// Heights of the columns in eighths of a cell.
fn heights(counts: &[u64]) -> Vec<usize> {
    let columns: Vec<u64> = (0..COLUMNS)
        .map(|c| counts[c * counts.len() / COLUMNS..(c + 1) * counts.len() / COLUMNS].iter().sum())
        .collect();
    let highest = columns.iter().copied().max().unwrap_or_default().max(1);
    let scale = (ROWS * 8) as f64 / (1.0 + highest as f64).ln();
    columns
        .into_iter()
        .map(|n| if n == 0 { 0 } else { (((1.0 + n as f64).ln() * scale).round() as usize).max(1) })
        .collect()
}

/// A number as people write it: at most six significant digits, no trailing zeros.
pub(super) fn number(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1.0e-4..1.0e7).contains(&size) {
        return format!("{value:.3e}");
    }
    let before = if size < 1.0 { 1 } else { size.log10().floor() as usize + 1 };
    let text = format!("{value:.*}", 6usize.saturating_sub(before));
    if !text.contains('.') {
        return text;
    }
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A large count in words.
pub(super) fn count(n: f64) -> String {
    match n {
        n if n >= 1.0e9 => format!("{:.2} thousand million", n / 1.0e9),
        n if n >= 1.0e6 => format!("{:.2} million", n / 1.0e6),
        n if n >= 1.0e4 => format!("{:.1} thousand", n / 1.0e3),
        n => format!("{n}"),
    }
}

/// A number of bytes with its unit.
pub(super) fn bytes(n: usize) -> String {
    const UNITS: [&str; 4] = ["bytes", "KiB", "MiB", "GiB"];
    let mut size = n as f64;
    let mut unit = 0;
    while size >= 1024.0 && unit + 1 < UNITS.len() {
        size /= 1024.0;
        unit += 1;
    }
    if unit == 0 { format!("{n} bytes") } else { format!("{size:.1} {}", UNITS[unit]) }
}

/// Text in lines of at most `width` characters, broken at spaces.
pub(super) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.last_mut();
        match line {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let check = |value: f64, expected: &str| assert_eq!(number(value), expected);
        check(0.0, "0");
        check(-0.000_000_1, "-1.000e-7");
        check(-1207.0, "-1207");
        check(0.9996, "0.9996");
        check(0.482_421_88, "0.48242");
        check(1_234_567.8, "1234568");
        check(2.0e9, "2.000e9");
        check(3.270_000_1, "3.27");
        check(-0.000_4, "-0.0004");
    }

    #[test]
    fn a_bin_with_one_sample_shows_beside_a_million() {
        let mut counts = vec![0; 256];
        counts[0] = 1_000_000;
        counts[255] = 1;
        let heights = heights(&counts);
        assert_eq!((heights[0], heights[1], heights.len()), (64, 0, 64));
        assert!(heights[63] >= 1);
    }

    #[test]
    fn sizes_have_units() {
        assert_eq!(bytes(12), "12 bytes");
        assert_eq!(bytes(3 << 20), "3.0 MiB");
        assert_eq!(count(1_380_000.0), "1.38 million");
    }

    #[test]
    fn text_is_broken_at_spaces() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("unbreakable", 3), ["unbreakable"]);
    }
}
