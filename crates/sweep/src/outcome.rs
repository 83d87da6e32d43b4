//! What a sweep found, for people and for machines.

use crate::{Curve, Row};
use render::Quality;
use report::{Axis, Machine, Picture, Plot, Point};
use std::fmt::Write as _;

/// What the JSON says that it is.
const FORMAT: &str = "holocast accuracy 1";

/// All rows of a sweep, and what made them.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Outcome {
    format: &'static str,
    /// The command that repeats it.
    command: String,
    /// When it was measured, RFC 3339.
    measured_at: String,
    machine: Machine,
    /// One for each named level, cheapest first: what holds on every scene.
    levels: Vec<LevelBounds>,
    rows: Vec<Row>,
}

/// The worst of a named level over all scenes of a sweep; colours from 0 to 1.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct LevelBounds {
    /// The level's name.
    pub level: String,
    /// Scenes it was measured on.
    pub scenes: usize,
    /// Median milliseconds of a frame, the median of all scenes.
    pub frame_ms: f64,
    /// The largest error of any pixel, and the scene it is in.
    pub max_abs_error: f64,
    /// That scene.
    pub max_abs_error_scene: String,
    /// The same with pixels held against their nearest right answer in float32.
    pub max_abs_error_beside_doubt: f64,
    /// That scene.
    pub max_abs_error_beside_doubt_scene: String,
    /// The most pixels in doubt, as a part of a picture.
    pub part_in_doubt: f64,
    /// The largest RMSE, all pixels.
    pub rmse: f64,
    /// The largest RMSE beside pixels in doubt.
    pub rmse_beside_doubt: f64,
    /// That scene.
    pub rmse_beside_doubt_scene: String,
    /// The lowest PSNR, all pixels.
    pub psnr_db: Option<f64>,
    /// The lowest PSNR beside pixels in doubt.
    pub psnr_db_beside_doubt: Option<f64>,
    /// The lowest SSIM.
    pub ssim: f64,
    /// The largest RMSE of depth, millimetres.
    pub depth_rmse_mm: f64,
    /// The largest error of a depth beside doubt, millimetres.
    pub depth_max_mm_beside_doubt: f64,
}

impl LevelBounds {
    fn of(level: &str, rows: &[Row]) -> Self {
        let of_level = || rows.iter().filter(|row| row.curve == Curve::Level && row.setting == level);
        let largest = |of: &dyn Fn(&Row) -> f64| {
            of_level()
                .map(|row| (of(row), row.scene.as_str()))
                .fold((0.0, ""), |worst, row| if row.0 > worst.0 { row } else { worst })
        };
        let max = largest(&|row| row.errors.max_abs_error);
        let beside = largest(&|row| row.errors.beside_doubt.max_abs_error);
        let rmse_beside = largest(&|row| row.errors.beside_doubt.rmse);
        let in_doubt = |row: &Row| {
            let [width, height] = row.size_px.map(f64::from);
            row.errors.beside_doubt.pixels_in_doubt as f64 / (width * height)
        };
        let mut ms: Vec<f64> = of_level().map(|row| row.frame_ms.median).collect();
        ms.sort_by(f64::total_cmp);
        Self {
            level: level.to_owned(),
            scenes: ms.len(),
            frame_ms: ms.get(ms.len() / 2).copied().unwrap_or_default(),
            max_abs_error: max.0,
            max_abs_error_scene: max.1.to_owned(),
            max_abs_error_beside_doubt: beside.0,
            max_abs_error_beside_doubt_scene: beside.1.to_owned(),
            part_in_doubt: largest(&in_doubt).0,
            rmse: largest(&|row| row.errors.rmse).0,
            rmse_beside_doubt: rmse_beside.0,
            rmse_beside_doubt_scene: rmse_beside.1.to_owned(),
            psnr_db: of_level().filter_map(|row| row.errors.psnr_db).reduce(f64::min),
            psnr_db_beside_doubt: of_level()
                .filter_map(|row| row.errors.beside_doubt.psnr_db)
                .reduce(f64::min),
            ssim: of_level().map(|row| row.errors.ssim).fold(1.0, f64::min),
            depth_rmse_mm: largest(&|row| row.errors.depth.rmse_mm).0,
            depth_max_mm_beside_doubt: largest(&|row| row.errors.depth.max_beside_doubt_mm).0,
        }
    }
}

impl Outcome {
    /// Sums rows up.
    #[must_use]
    pub fn new(command: String, measured_at: String, machine: Machine, rows: Vec<Row>) -> Self {
        let levels = Quality::LEVELS.map(|(name, _)| LevelBounds::of(name, &rows));
        let levels = levels.into_iter().filter(|level| level.scenes > 0).collect();
        Self { format: FORMAT, command, measured_at, machine, levels, rows }
    }

    /// What holds for each named level on every scene.
    #[must_use]
    pub fn levels(&self) -> &[LevelBounds] {
        &self.levels
    }

    /// All of it as JSON.
    #[must_use]
    pub fn to_json(&self) -> String {
        // Plain types and finite numbers can be written.
        serde_json::to_string_pretty(self).expect("rows can be written as JSON")
    }

    /// The rows as comma-separated values, a header first; what is not known is empty.
    #[must_use]
    pub fn to_csv(&self) -> String {
        let mut csv = COLUMNS.map(|(name, _)| name).join(",") + "\n";
        for row in &self.rows {
            let fields = COLUMNS.map(|(_, of)| quoted(&of(row)));
            // Writing to a string does not fail.
            let _ = writeln!(csv, "{}", fields.join(","));
        }
        csv
    }

    /// Milliseconds of a frame against an error, a plot for each scene; the named levels by name.
    #[must_use]
    pub fn picture(&self, title: &str, error_label: &str, error_of: impl Fn(&Row) -> f64) -> Picture {
        let mut scenes: Vec<&str> = Vec::new();
        for row in &self.rows {
            if !scenes.contains(&row.scene.as_str()) {
                scenes.push(&row.scene);
            }
        }
        let plots: Vec<Plot> =
            scenes.into_iter().map(|scene| self.plot(scene, error_label, &error_of)).collect();
        Plot::many(title, &plots, 3)
    }

    fn plot(&self, scene: &str, error_label: &str, error_of: &impl Fn(&Row) -> f64) -> Plot {
        let rows = || self.rows.iter().filter(|row| row.scene == scene);
        let kind = rows().next().map_or("", |row| row.kind.as_str());
        let plot = Plot::new(
            format!("{scene} ({kind})"),
            Axis::log("milliseconds a frame, with read-back"),
            Axis::log(error_label),
        );
        let curves = Curve::ALL.into_iter().fold(plot, |plot, curve| {
            let points = rows().filter(|row| row.curve == curve).map(|row| {
                let label = if curve == Curve::Level { row.setting.as_str() } else { "" };
                Point::labelled(row.frame_ms.median, error_of(row), label)
            });
            match curve {
                Curve::StepHardware | Curve::StepFloat32 | Curve::Refined => plot.lines(curve.name(), points),
                _ => plot.scatter(curve.name(), points),
            }
        });
        curves.with_pareto_front()
    }
}

type Column = (&'static str, fn(&Row) -> String);

/// The columns of the table; colours from 0 to 1.
const COLUMNS: [Column; 33] = [
    ("scene", |row| row.scene.clone()),
    ("kind", |row| row.kind.clone()),
    ("width", |row| row.size_px[0].to_string()),
    ("height", |row| row.size_px[1].to_string()),
    ("curve", |row| row.curve.name().to_owned()),
    ("setting", |row| row.setting.clone()),
    ("sampling", |row| row.sampling.clone()),
    ("step_voxels", |row| row.step_voxels.to_string()),
    ("step_mm", |row| row.step_mm.to_string()),
    ("least_transmittance", |row| row.least_transmittance.to_string()),
    ("resolution_scale", |row| row.resolution_scale.to_string()),
    ("skip_empty", |row| u8::from(row.skip_empty).to_string()),
    ("frames", |row| row.frames.to_string()),
    ("frame_ms_min", |row| row.frame_ms.min.to_string()),
    ("frame_ms_median", |row| row.frame_ms.median.to_string()),
    ("frame_ms_max", |row| row.frame_ms.max.to_string()),
    ("raycast_ms_min", |row| known(row.raycast_ms.map(|ms| ms.min))),
    ("raycast_ms_median", |row| known(row.raycast_ms.map(|ms| ms.median))),
    ("max_abs_error", |row| row.errors.max_abs_error.to_string()),
    ("worst_x", |row| known(row.errors.worst.map(|worst| worst[0]))),
    ("worst_y", |row| known(row.errors.worst.map(|worst| worst[1]))),
    ("rmse", |row| row.errors.rmse.to_string()),
    ("psnr_db", |row| known(row.errors.psnr_db)),
    ("ssim", |row| row.errors.ssim.to_string()),
    ("opacity_max_abs_error", |row| row.errors.opacity_max_abs_error.to_string()),
    ("pixels_in_doubt", |row| row.errors.beside_doubt.pixels_in_doubt.to_string()),
    ("max_abs_error_beside_doubt", |row| row.errors.beside_doubt.max_abs_error.to_string()),
    ("rmse_beside_doubt", |row| row.errors.beside_doubt.rmse.to_string()),
    ("psnr_db_beside_doubt", |row| known(row.errors.beside_doubt.psnr_db)),
    ("depth_rmse_mm", |row| row.errors.depth.rmse_mm.to_string()),
    ("depth_max_mm", |row| row.errors.depth.max_abs_error_mm.to_string()),
    ("depth_max_mm_beside_doubt", |row| row.errors.depth.max_beside_doubt_mm.to_string()),
    ("depths_missing_or_extra", |row| (row.errors.depth.missing + row.errors.depth.extra).to_string()),
];

fn known(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

/// A field, in quotes if it must be. Line breaks become blanks, so that a line is a row.
fn quoted(text: &str) -> String {
    let text = text.replace(['\n', '\r'], " ");
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text }
}
