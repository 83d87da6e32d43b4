//! Where each frame's time went, over a run.

use super::axis::Ruler;
use super::canvas::{Anchor, Frame, Picture, Stroke, TextStyle};
use super::column::{Column, Columns};
use super::font;
use super::legend::{Legend, Swatch};
use super::palette::{self, Colour};
use crate::distribution::nearest_rank;
use crate::{Distribution, HeadsetRun, Run};

const WIDTH: f64 = 1200.0;
const LEFT: f64 = 76.0;
const RIGHT: f64 = 60.0;
const STACK_HEIGHT: f64 = 270.0;
const MARKS_HEIGHT: f64 = 13.0;
const QUALITY_HEIGHT: f64 = 46.0;
/// Of all that lies between the stack and the time axis.
const STRIPS_HEIGHT: f64 = 8.0 + MARKS_HEIGHT + 1.0 + MARKS_HEIGHT + 6.0 + QUALITY_HEIGHT;
/// More columns than this and one is hardly two pixels wide.
const MOST_COLUMNS: usize = 720;
/// As many columns as long runs are drawn with.
const BINS: usize = 320;
/// More headsets than this and the picture shows three of them.
const MOST_PANELS: usize = 4;

const BODY: f64 = 14.0;
const SMALL: f64 = 13.0;

/// The latency of each frame over the time of the run, its stages stacked, a panel for each headset. Of more than four
/// headsets it shows three: that with the least rate, the middle one and that with the highest.
///
/// x is the time in seconds since the run began, y the time from the pose to the decoded picture in milliseconds, with
/// lines at whole frame intervals (16.7 ms at 60 Hz). The same y stands for all panels; it ends a little above the p99,
/// and triangles mark what lies beyond. Each frame is a column that ends when it is decoded and begins with the frame
/// before it; a gap is a freeze. If a headset has more than 720 frames, columns of equal length show their median
/// frame's stages, and their p95 as a line. Below are marks for late and for key frames, and the quality: resolution
/// and step as shares of the full ones.
#[must_use]
pub fn latency(run: &Run) -> Picture {
    let mut by_rate: Vec<&HeadsetRun> = run.headsets.iter().collect();
    if by_rate.len() <= MOST_PANELS {
        return picture(run, &by_rate, None);
    }
    let rate = |headset: &HeadsetRun| headset.counters.decoded as f64 / headset.seconds.max(1e-9);
    by_rate.sort_by(|a, b| rate(a).total_cmp(&rate(b)));
    let shown = [by_rate[0], by_rate[(by_rate.len() - 1) / 2], by_rate[by_rate.len() - 1]];
    let note = format!("3 of {} headsets: lowest, middle and highest rate", by_rate.len());
    picture(run, &shown, Some(&note))
}

/// As [`latency`], of one headset. `None` if the run has none of that name.
#[must_use]
pub fn latency_of(run: &Run, headset: &str) -> Option<Picture> {
    let headset = run.headsets.iter().find(|candidate| candidate.name == headset)?;
    Some(picture(run, &[headset], None))
}

/// The quality's lines. Without colour, so that none is taken for a stage.
const RESOLUTION: Stroke = Stroke { colour: palette::INK, width: 2.0, dashed: false };
const FINENESS: Stroke = Stroke { colour: palette::FAINT_INK, width: 2.0, dashed: true };

/// What all panels share.
struct Sheet {
    colours: Vec<Colour>,
    time: Ruler,
    latency: Ruler,
    interval_ms: f64,
    intervals: u64,
}

/// A row of marks under the stack.
#[derive(Clone, Copy)]
struct Mark {
    name: &'static str,
    colour: Colour,
    /// Whether a mark is as wide as its column.
    wide: bool,
    /// Share of the column's frames that are marked.
    share: fn(&Column) -> f64,
}

const LATE: Mark = Mark { name: "late", colour: palette::ALARM, wide: true, share: |column| column.late };
const KEY: Mark = Mark {
    name: "key",
    colour: palette::INK,
    wide: false,
    share: |column| f64::from(u8::from(column.key_frame)),
};

struct Panel<'run> {
    headset: &'run HeadsetRun,
    columns: Columns,
}

fn picture(run: &Run, headsets: &[&HeadsetRun], note: Option<&str>) -> Picture {
    // All panels are binned alike, else their columns would mean different things.
    let bin = headsets.iter().any(|headset| headset.frames.len() > MOST_COLUMNS);
    let most = if bin { BINS } else { MOST_COLUMNS };
    let panels: Vec<Panel<'_>> =
        headsets.iter().map(|headset| Panel { headset, columns: Columns::of(headset, most) }).collect();
    let binned = panels.iter().find_map(|panel| panel.columns.bin_secs);
    let sheet = Sheet::new(run, &panels);

    let legend = legend(run, &sheet, binned.is_some());
    let top = 66.0 + legend.height() + 8.0;
    let panels_height: f64 = panels.iter().map(Panel::height).sum();
    let empty_height = if panels.is_empty() { STACK_HEIGHT + 40.0 } else { 0.0 };
    let mut picture = Picture::new(WIDTH, top + panels_height + empty_height + 8.0);
    let title = if run.title.is_empty() { "Latency" } else { &run.title };
    picture.text_within([LEFT, 30.0], WIDTH - LEFT - RIGHT, title, TextStyle::new(21.0, palette::INK).bold());
    let mut about = vec!["From the pose (bottom) to the decoded picture (top)".to_owned()];
    about.extend(note.map(str::to_owned));
    about.extend(binned.map(|secs| {
        format!("columns of {} s: their median frame, their p95 as a line", super::axis::plain(secs))
    }));
    let style = TextStyle::new(BODY, palette::FAINT_INK);
    picture.text_within([LEFT, 52.0], WIDTH - LEFT - RIGHT, &about.join("  ·  "), style);
    legend.draw(&mut picture, 66.0);
    if panels.is_empty() {
        empty(&mut picture, stack_frame(top), "no headsets, no frames");
    }
    let mut top = top;
    for panel in &panels {
        panel.draw(&mut picture, &sheet, top);
        top += panel.height();
    }
    picture
}

impl Sheet {
    fn new(run: &Run, panels: &[Panel<'_>]) -> Self {
        let columns = || panels.iter().flat_map(|panel| &panel.columns.columns);
        let asked_hz = panels.iter().map(|panel| panel.headset.asked_hz).fold(0.0, f64::max);
        let interval_ms = 1e3 / if asked_hz > 0.0 { asked_hz } else { 60.0 };
        let mut totals: Vec<f64> = columns().map(|column| column.p95_ms).collect();
        totals.sort_unstable_by(f64::total_cmp);
        let highest = match totals.last() {
            // Room for all, unless a few outliers would flatten the rest.
            Some(max) => max.min(nearest_rank(&totals, 99) * 1.3).max(interval_ms),
            None => interval_ms * 3.0,
        };
        let last = columns().map(|column| column.to_secs).fold(run.seconds, f64::max);
        let intervals = (highest * 1.04 / interval_ms).ceil().max(2.0);
        Self {
            colours: palette::stages(run.stages.iter()),
            time: Ruler::linear(0.0, if last > 0.0 { last } else { 1.0 }).laid(LEFT, WIDTH - RIGHT),
            latency: Ruler::linear(0.0, intervals * interval_ms),
            interval_ms,
            intervals: intervals as u64,
        }
    }

    /// Frame intervals that get a line.
    fn lines(&self) -> impl Iterator<Item = u64> + use<> {
        let steps = [1, 2, 3, 6, 12, 30, 60, 120, 300, 600];
        let step =
            steps.into_iter().find(|step| self.intervals / step <= 7).unwrap_or(self.intervals.div_ceil(6));
        (0..=self.intervals).step_by(usize::try_from(step).unwrap_or(1))
    }
}

fn stack_frame(top: f64) -> Frame {
    Frame { left: LEFT, top: top + 32.0, right: WIDTH - RIGHT, bottom: top + 32.0 + STACK_HEIGHT }
}

impl Panel<'_> {
    fn height(&self) -> f64 {
        let below = if self.columns.columns.is_empty() { 0.0 } else { STRIPS_HEIGHT };
        32.0 + STACK_HEIGHT + below + 54.0
    }

    fn draw(&self, picture: &mut Picture, sheet: &Sheet, top: f64) {
        self.heading(picture, top + 22.0);
        let stack = stack_frame(top);
        if self.columns.columns.is_empty() {
            empty(picture, stack, "no frames");
            time_axis(picture, sheet, stack.bottom);
            return;
        }
        let below = |above: Frame, gap: f64, height: f64| Frame {
            top: above.bottom + gap,
            bottom: above.bottom + gap + height,
            ..above
        };
        let late = below(stack, 8.0, MARKS_HEIGHT);
        let key = below(late, 1.0, MARKS_HEIGHT);
        let quality = below(key, 6.0, QUALITY_HEIGHT);
        self.stack(picture, sheet, stack);
        self.marks(picture, sheet, late, LATE);
        self.marks(picture, sheet, key, KEY);
        self.quality(picture, sheet, quality);
        time_axis(picture, sheet, quality.bottom);
    }

    fn heading(&self, picture: &mut Picture, baseline: f64) {
        let headset = self.headset;
        let [width, height] = headset.eye_size_px;
        let total = Distribution::of_whole(headset.frames.iter().map(|frame| frame.pose_to_decoded_us));
        let hz = headset.counters.decoded as f64 / headset.seconds.max(1e-9);
        let mut facts = vec![
            format!("{}, 2 × {width}×{height}", headset.device),
            format!(
                "{:.1} of {:.0} frames/s",
                if headset.seconds > 0.0 { hz } else { 0.0 },
                headset.asked_hz
            ),
            format!("{} late, {} lost", headset.counters.late, headset.counters.lost),
        ];
        if let Some(ms) = total.map(|us| us.times(1e-3)) {
            facts
                .push(format!("pose to decoded: p50 {:.1}, p95 {:.1}, max {:.1} ms", ms.p50, ms.p95, ms.max));
        }
        let name_width = (font::width(&headset.name, 16.0, true) + 14.0).min(360.0);
        picture.text_within(
            [LEFT, baseline],
            346.0,
            &headset.name,
            TextStyle::new(16.0, palette::INK).bold(),
        );
        let style = TextStyle::new(BODY, palette::INK);
        let room = WIDTH - RIGHT - LEFT - name_width;
        picture.text_within([LEFT + name_width, baseline], room, &facts.join("  ·  "), style);
    }

    fn stack(&self, picture: &mut Picture, sheet: &Sheet, frame: Frame) {
        let latency = sheet.latency.laid(frame.bottom, frame.top);
        // From the last stage down to the first, each from the ground up: neighbours leave no seam between them.
        for (stage, colour) in sheet.colours.iter().enumerate().rev() {
            for columns in self.columns.stretches() {
                let mut points = vec![[sheet.time.place(columns[0].from_secs), frame.bottom]];
                points.extend(stairs(sheet, columns, |column| {
                    latency.place(column.ends_ms.get(stage).copied().unwrap_or(0.0))
                }));
                points.push([sheet.time.place(columns[columns.len() - 1].to_secs), frame.bottom]);
                picture.area(points, *colour);
            }
        }
        for line in sheet.lines() {
            let ms = line as f64 * sheet.interval_ms;
            let y = latency.place(ms);
            picture.line(vec![[frame.left, y], [frame.right, y]], Stroke::solid(palette::GRID, 1.0));
            let style = TextStyle::new(SMALL, palette::INK);
            let text = if line == 0 { "0".to_owned() } else { format!("{ms:.1}") };
            picture.text([frame.left - 7.0, y + 4.5], text, style.anchored(Anchor::End));
            picture.text(
                [frame.right + 7.0, y + 4.5],
                format!("{line}"),
                TextStyle::new(SMALL, palette::FAINT_INK),
            );
        }
        for columns in self.columns.stretches() {
            let total =
                |value: fn(&Column) -> f64| stairs(sheet, columns, |column| latency.place(value(column)));
            // Of single frames the line is mostly risers: thin, or it hides what it bounds.
            let width = if self.columns.bin_secs.is_some() { 1.1 } else { 0.6 };
            picture.line(total(|column| column.p50_ms), Stroke::solid(palette::INK, width));
            if self.columns.bin_secs.is_some() {
                picture.line(total(|column| column.p95_ms), Stroke::dashed(palette::INK, 1.0));
            }
        }
        for column in self.columns.columns.iter().filter(|column| !latency.holds(column.p50_ms)) {
            let x = sheet.time.place((column.from_secs + column.to_secs) / 2.0);
            let y = frame.top + 2.0;
            picture.area(vec![[x - 4.5, y + 8.0], [x + 4.5, y + 8.0], [x, y]], palette::INK);
        }
        picture.outline(frame, Stroke::solid(palette::FAINT_INK, 1.0));
        let middle = f64::midpoint(frame.top, frame.bottom);
        let style = TextStyle::new(BODY, palette::INK).anchored(Anchor::Middle).upwards();
        picture.text([frame.left - 50.0, middle], "latency, ms", style);
        let style = TextStyle { colour: palette::FAINT_INK, ..style };
        let hz = 1e3 / sheet.interval_ms;
        picture.text([frame.right + 44.0, middle], format!("frame intervals at {hz:.0} Hz"), style);
    }

    fn marks(&self, picture: &mut Picture, sheet: &Sheet, frame: Frame, mark: Mark) {
        picture.rectangle(frame, palette::STRIP);
        let style = TextStyle::new(SMALL, mark.colour).anchored(Anchor::End);
        picture.text([frame.left - 7.0, frame.bottom - 2.0], mark.name, style);
        for column in &self.columns.columns {
            let share = (mark.share)(column);
            if share > 0.0 {
                let (left, right) = (sheet.time.place(column.from_secs), sheet.time.place(column.to_secs));
                // A single frame must be seen.
                let width = if mark.wide { (right - left).max(1.6) } else { 1.6 };
                let left = right - width;
                // A few of many must look unlike all of them.
                let height = frame.height() * (0.3 + 0.7 * share);
                picture.rectangle(Frame { left, right, top: frame.bottom - height, ..frame }, mark.colour);
            }
        }
    }

    fn quality(&self, picture: &mut Picture, sheet: &Sheet, frame: Frame) {
        picture.rectangle(frame, palette::STRIP);
        let share = Ruler::linear(0.0, 1.0).laid(frame.bottom - 4.0, frame.top + 4.0);
        for (value, text) in [(0.0, "0 %"), (1.0, "100 %")] {
            let style = TextStyle::new(SMALL, palette::INK).anchored(Anchor::End);
            picture.text([frame.left - 7.0, share.place(value) + 4.5], text, style);
        }
        for columns in self.columns.stretches() {
            let line =
                |value: fn(&Column) -> f64| stairs(sheet, columns, |column| share.place(value(column)));
            picture.line(line(|column| column.fineness), FINENESS);
            picture.line(line(|column| column.resolution_scale), RESOLUTION);
        }
        let style = TextStyle::new(SMALL, palette::FAINT_INK);
        picture.text([frame.right + 7.0, f64::midpoint(frame.top, frame.bottom) + 4.5], "quality", style);
    }
}

/// A level line over each column.
fn stairs(sheet: &Sheet, columns: &[Column], y: impl Fn(&Column) -> f64) -> Vec<[f64; 2]> {
    let ends = columns.iter().flat_map(|column| {
        let y = y(column);
        [[sheet.time.place(column.from_secs), y], [sheet.time.place(column.to_secs), y]]
    });
    ends.collect()
}

fn time_axis(picture: &mut Picture, sheet: &Sheet, y: f64) {
    for (secs, text) in sheet.time.ticks(12) {
        let x = sheet.time.place(secs);
        picture.line(vec![[x, y], [x, y + 5.0]], Stroke::solid(palette::FAINT_INK, 1.0));
        let style = TextStyle::new(SMALL, palette::INK).anchored(Anchor::Middle);
        picture.text([x, y + 19.0], text, style);
    }
    let style = TextStyle::new(BODY, palette::INK).anchored(Anchor::Middle);
    picture.text(
        [f64::midpoint(sheet.time.start, sheet.time.end), y + 38.0],
        "time since the run began, s",
        style,
    );
}

fn empty(picture: &mut Picture, frame: Frame, what: &str) {
    picture.rectangle(frame, palette::STRIP);
    picture.outline(frame, Stroke::solid(palette::FAINT_INK, 1.0));
    let style = TextStyle::new(24.0, palette::FAINT_INK).anchored(Anchor::Middle);
    picture.text(
        [f64::midpoint(frame.left, frame.right), f64::midpoint(frame.top, frame.bottom)],
        what,
        style,
    );
}

fn legend(run: &Run, sheet: &Sheet, binned: bool) -> Legend {
    let stages = run.stages.iter().zip(&sheet.colours);
    let mut items: Vec<_> =
        stages.map(|(name, colour)| (Swatch::Filled(*colour), name.replace('_', " "))).collect();
    let total = if binned { "total (p50)" } else { "total" };
    items.push((Swatch::Line(Stroke::solid(palette::INK, 1.4)), total.to_owned()));
    if binned {
        items.push((Swatch::Line(Stroke::dashed(palette::INK, 1.4)), "total (p95)".to_owned()));
    }
    items.push((Swatch::Triangle, "beyond the axis".to_owned()));
    items.push((Swatch::Filled(palette::ALARM), "late for its display time".to_owned()));
    items.push((Swatch::Filled(palette::INK), "key frame".to_owned()));
    items.push((Swatch::Line(RESOLUTION), "resolution, of full".to_owned()));
    items.push((Swatch::Line(FINENESS), "full step over step".to_owned()));
    Legend::new(LEFT, WIDTH - RIGHT, items)
}
