//! Figures against figures: lines and points with linear or logarithmic axes.

use super::axis::{Ruler, Scale};
use super::canvas::{Anchor, Frame, Picture, Stroke, TextStyle};
use super::pareto::pareto_front;
use super::{font, palette};
use crate::CsvError;
use crate::csv::{fields, quoted};
use std::fmt::Write;
use std::io::BufRead;

/// One axis of a [`Plot`].
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Axis {
    /// What is laid along it, with its unit: `error, mm`.
    pub label: String,
    /// How.
    pub scale: Scale,
}

impl Axis {
    /// An axis on which equal differences are equal lengths.
    pub fn linear(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Linear }
    }

    /// An axis on which equal ratios are equal lengths. Values of 0 or less stand at its lower end, hollow.
    pub fn log(label: impl Into<String>) -> Self {
        Self { label: label.into(), scale: Scale::Log }
    }
}

/// A point of a [`Plot`], in the units of its axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Point {
    /// Along the horizontal axis.
    pub x: f64,
    /// Along the vertical axis.
    pub y: f64,
    /// Written beside the point; empty for nothing.
    pub label: String,
}

impl Point {
    /// A point without a label.
    #[must_use]
    pub fn new(x: f64, y: f64) -> Self {
        Self { x, y, label: String::new() }
    }

    /// A point with a label.
    pub fn labelled(x: f64, y: f64, label: impl Into<String>) -> Self {
        Self { x, y, label: label.into() }
    }
}

/// Series of points on two axes, such as milliseconds against error. Points that are not finite are not drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plot {
    title: String,
    x: Axis,
    y: Axis,
    series: Vec<Series>,
    front: bool,
}

#[derive(Clone, Debug, PartialEq)]
struct Series {
    name: String,
    points: Vec<Point>,
    joined: bool,
}

const WIDTH: f64 = 1000.0;
const HEIGHT: f64 = 680.0;
const TEXT: f64 = 14.0;
/// Width and height of one of many plots.
const SMALL: [f64; 2] = [440.0, 350.0];
const HEADER: [&str; 4] = ["series", "x", "y", "label"];

impl Plot {
    /// An empty plot.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, series: Vec::new(), front: false }
    }

    /// Adds points that are joined by a line in the order in which they stand.
    #[must_use]
    pub fn lines(self, name: impl Into<String>, points: impl IntoIterator<Item = Point>) -> Self {
        self.with(name.into(), points.into_iter().collect(), true)
    }

    /// Adds points that stand alone.
    #[must_use]
    pub fn scatter(self, name: impl Into<String>, points: impl IntoIterator<Item = Point>) -> Self {
        self.with(name.into(), points.into_iter().collect(), false)
    }

    /// Joins the points of all series that no other beats in both x and y, see [`pareto_front`].
    #[must_use]
    pub fn with_pareto_front(self) -> Self {
        Self { front: true, ..self }
    }

    fn with(mut self, name: String, points: Vec<Point>, joined: bool) -> Self {
        self.series.push(Series { name, points, joined });
        self
    }

    /// The points as comma-separated values: a header `series,x,y,label`, then one line a point.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut csv = HEADER.join(",") + "\n";
        for series in &self.series {
            for point in &series.points {
                // Writing to a string does not fail.
                let _ = writeln!(
                    csv,
                    "{},{},{},{}",
                    quoted(&series.name),
                    point.x,
                    point.y,
                    quoted(&point.label)
                );
            }
        }
        csv
    }

    /// Adds the series of a table that [`Plot::to_csv`] wrote, as [`Plot::scatter`] does: a series is all lines of one
    /// name, in the order of their first line.
    ///
    /// # Errors
    /// If reading fails, the header is another one, or `x` or `y` is no number.
    pub fn scatter_csv(mut self, input: impl BufRead) -> Result<Self, CsvError> {
        let begin = self.series.len();
        for (index, line) in input.lines().enumerate() {
            let (line, fields) = (index + 1, fields(&line?));
            if fields.len() != HEADER.len() {
                return Err(CsvError::Width { line, found: fields.len(), expected: HEADER.len() });
            }
            if index == 0 {
                if let Some(at) = (0..HEADER.len()).find(|at| fields[*at] != HEADER[*at]) {
                    let (found, expected) = (fields[at].clone(), HEADER[at].to_owned());
                    return Err(CsvError::Header { at: at + 1, found, expected });
                }
                continue;
            }
            let number = |column: usize| {
                fields[column].parse::<f64>().map_err(|_| CsvError::Field {
                    line,
                    column: HEADER[column].to_owned(),
                    found: fields[column].clone(),
                    expected: "number",
                })
            };
            let point = Point::labelled(number(1)?, number(2)?, fields[3].clone());
            match self.series[begin..].iter_mut().find(|series| series.name == fields[0]) {
                Some(series) => series.points.push(point),
                None => {
                    self.series.push(Series { name: fields[0].clone(), points: vec![point], joined: false });
                }
            }
        }
        Ok(self)
    }

    /// Lays the plot out.
    #[must_use]
    pub fn picture(&self) -> Picture {
        let mut picture = Picture::new(WIDTH, HEIGHT);
        let frame = Frame { left: 92.0, top: 96.0, right: WIDTH - 36.0, bottom: HEIGHT - 68.0 };
        picture.text_within(
            [frame.left, 34.0],
            frame.width(),
            &self.title,
            TextStyle::new(20.0, palette::INK).bold(),
        );
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = Ruler::around(self.x.scale, points().map(|point| point.x)).laid(frame.left, frame.right);
        let y = Ruler::around(self.y.scale, points().map(|point| point.y)).laid(frame.bottom, frame.top);
        self.axes(&mut picture, frame, x, y, [9, 8]);
        if self.draw(&mut picture, frame, x, y) {
            self.legend(&mut picture, frame, self.has_hollow(x, y));
        }
        picture
    }

    /// Lays several plots out in `columns`, over the same axes and under one legend; all have the same series in the same
    /// order, and the first one's axes are everyone's.
    #[must_use]
    pub fn many(title: &str, plots: &[Self], columns: usize) -> Picture {
        let columns = columns.max(1);
        let [width, height] = SMALL;
        let top = 90.0;
        let rows = plots.len().div_ceil(columns).max(1);
        let mut picture = Picture::new(width * columns as f64, top + height * rows as f64);
        let whole = Frame { left: 24.0, top, right: width * columns as f64 - 24.0, bottom: top };
        let style = TextStyle::new(20.0, palette::INK).bold();
        picture.text_within([whole.left, 34.0], whole.width(), title, style);
        let Some(first) = plots.first() else { return picture };
        let points = || plots.iter().flat_map(|plot| &plot.series).flat_map(|series| &series.points);
        let x = Ruler::around(first.x.scale, points().map(|point| point.x));
        let y = Ruler::around(first.y.scale, points().map(|point| point.y));
        first.legend(&mut picture, whole, plots.iter().any(|plot| plot.has_hollow(x, y)));
        for (at, plot) in plots.iter().enumerate() {
            let (left, upper) = ((at % columns) as f64 * width, top + (at / columns) as f64 * height);
            let frame = Frame {
                left: left + 84.0,
                top: upper + 30.0,
                right: left + width - 16.0,
                bottom: upper + height - 62.0,
            };
            let (x, y) = (x.laid(frame.left, frame.right), y.laid(frame.bottom, frame.top));
            let style = TextStyle::new(15.0, palette::INK).bold();
            picture.text_within([frame.left, frame.top - 9.0], frame.width(), &plot.title, style);
            let axes = Self { x: first.x.clone(), y: first.y.clone(), ..Self::default() };
            axes.axes(&mut picture, frame, x, y, [6, 8]);
            plot.draw(&mut picture, frame, x, y);
        }
        picture
    }

    /// Draws what stands between the axes; whether there is anything.
    fn draw(&self, picture: &mut Picture, frame: Frame, x: Ruler, y: Ruler) -> bool {
        let points = || self.series.iter().flat_map(|series| &series.points);
        if !points().any(drawn) {
            let style = TextStyle::new(24.0, palette::FAINT_INK).anchored(Anchor::Middle);
            let middle = [f64::midpoint(frame.left, frame.right), f64::midpoint(frame.top, frame.bottom)];
            picture.text(middle, "no points", style);
            return false;
        }
        if self.front {
            self.draw_front(picture, x, y);
        }
        for (index, series) in self.series.iter().enumerate() {
            series.draw(picture, palette::series(index), x, y);
        }
        // Over the points, so that none hides a label.
        let mut taken = Vec::new();
        for point in points().filter(|point| drawn(point) && !point.label.is_empty()) {
            label(picture, frame, [x.place(point.x), y.place(point.y)], &point.label, &mut taken);
        }
        true
    }

    /// Whether a point stands at an axis's end instead of at its own place.
    fn has_hollow(&self, x: Ruler, y: Ruler) -> bool {
        let hollow = |point: &Point| drawn(point) && !(x.holds(point.x) && y.holds(point.y));
        self.series.iter().flat_map(|series| &series.points).any(hollow)
    }

    fn axes(&self, picture: &mut Picture, frame: Frame, x: Ruler, y: Ruler, ticks: [usize; 2]) {
        let grid = Stroke::solid(palette::GRID, 1.0);
        let style = TextStyle::new(TEXT, palette::INK);
        for (value, text) in x.ticks(ticks[0]) {
            let at = x.place(value);
            picture.line(vec![[at, frame.top], [at, frame.bottom]], grid);
            picture.text([at, frame.bottom + 20.0], text, style.anchored(Anchor::Middle));
        }
        for (value, text) in y.ticks(ticks[1]) {
            let at = y.place(value);
            picture.line(vec![[frame.left, at], [frame.right, at]], grid);
            picture.text([frame.left - 8.0, at + 5.0], text, style.anchored(Anchor::End));
        }
        picture.outline(frame, Stroke::solid(palette::FAINT_INK, 1.0));
        let title = TextStyle::new(15.0, palette::INK).anchored(Anchor::Middle);
        let middle = [f64::midpoint(frame.left, frame.right), f64::midpoint(frame.top, frame.bottom)];
        picture.text([middle[0], frame.bottom + 48.0], self.x.label.as_str(), title);
        picture.text([frame.left - 64.0, middle[1]], self.y.label.as_str(), title.upwards());
    }

    fn draw_front(&self, picture: &mut Picture, x: Ruler, y: Ruler) {
        let all: Vec<Point> = self.series.iter().flat_map(|series| series.points.iter().cloned()).collect();
        let mut stairs: Vec<[f64; 2]> = Vec::new();
        for index in pareto_front(&all) {
            let [at_x, at_y] = [x.place(all[index].x), y.place(all[index].y)];
            // Between two points of the front only the worse of both is known to be reached.
            if let Some([_, last_y]) = stairs.last().copied() {
                stairs.push([at_x, last_y]);
            }
            stairs.push([at_x, at_y]);
        }
        if stairs.len() > 1 {
            picture.line(stairs, Stroke::dashed(palette::INK, 1.4));
        }
    }

    fn legend(&self, picture: &mut Picture, frame: Frame, has_hollow: bool) {
        let middle = 66.0;
        let mut left = frame.left;
        let style = TextStyle::new(TEXT, palette::INK);
        let mut item = |picture: &mut Picture, text: &str, draw: &dyn Fn(&mut Picture, f64)| {
            draw(picture, left);
            picture.text_within([left + 28.0, middle + 5.0], frame.right - left - 28.0, text, style);
            left += 28.0 + font::width(text, TEXT, false) + 20.0;
        };
        for (index, series) in self.series.iter().enumerate() {
            let colour = palette::series(index);
            item(picture, &series.name, &|picture, left| {
                if series.joined {
                    picture.line(vec![[left, middle], [left + 22.0, middle]], Stroke::solid(colour, 2.0));
                }
                picture.dot([left + 11.0, middle], 4.0, colour);
            });
        }
        if self.front {
            item(picture, "Pareto front", &|picture, left| {
                picture.line(vec![[left, middle], [left + 22.0, middle]], Stroke::dashed(palette::INK, 1.4));
            });
        }
        if has_hollow {
            item(picture, "0, at the axis's end", &|picture, left| {
                picture.ring([left + 11.0, middle], 4.0, palette::FAINT_INK);
            });
        }
    }
}

impl Series {
    fn draw(&self, picture: &mut Picture, colour: palette::Colour, x: Ruler, y: Ruler) {
        let place = |point: &Point| [x.place(point.x), y.place(point.y)];
        if self.joined {
            for run in self.points.split(|point| !drawn(point)).filter(|run| run.len() > 1) {
                picture.line(run.iter().map(place).collect(), Stroke::solid(colour, 2.0));
            }
        }
        for point in self.points.iter().filter(|point| drawn(point)) {
            if x.holds(point.x) && y.holds(point.y) {
                picture.dot(place(point), 4.0, colour);
            } else {
                picture.ring(place(point), 4.0, colour);
            }
        }
    }
}

fn drawn(point: &Point) -> bool {
    point.x.is_finite() && point.y.is_finite()
}

/// Writes a label beside a point: above its right, or where there is room that no other label has taken.
fn label(picture: &mut Picture, frame: Frame, [x, y]: [f64; 2], text: &str, taken: &mut Vec<Frame>) {
    let style = TextStyle::new(13.0, palette::FAINT_INK);
    let width = font::width(text, style.size, false);
    let sides = [-6.0, 15.0, -21.0, 30.0, -36.0];
    let places: Vec<Frame> = sides
        .into_iter()
        .flat_map(|down| [x + 9.0, x - 9.0 - width].map(|left| (left, y + down)))
        .map(|(left, base)| Frame { left, top: base - 11.0, right: left + width, bottom: base + 3.0 })
        .filter(|f| {
            f.left > frame.left && f.right < frame.right && f.top > frame.top && f.bottom < frame.bottom
        })
        .collect();
    let overlap =
        |a: &Frame, b: &Frame| a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom;
    let free = places.iter().find(|place| !taken.iter().any(|other| overlap(place, other)));
    let beside = Frame { left: x + 9.0, top: y - 17.0, right: x + 9.0 + width, bottom: y - 3.0 };
    let place = *free.or(places.first()).unwrap_or(&beside);
    picture.text([place.left, place.bottom - 3.0], text, style);
    taken.push(place);
}
