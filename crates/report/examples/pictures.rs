//! Writes pictures and a report of runs that never were, to be looked at: `cargo run -p report --example pictures DIR`.

use report::{Axis, Plot, Point, Run, RunReport, latency};
use std::path::Path;

#[path = "../tests/common/mod.rs"]
mod common;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let directory = std::env::args().nth(1).unwrap_or_else(|| "out/pictures".to_owned());
    let directory = Path::new(&directory);
    std::fs::create_dir_all(directory)?;
    let write = |name: &str, picture: &report::Picture| {
        std::fs::write(directory.join(name).with_extension("svg"), picture.to_svg())?;
        std::fs::write(directory.join(name).with_extension("png"), picture.to_png(2))
    };
    let short = common::run(2, 10.0);
    std::fs::write(directory.join("report.txt"), RunReport::from(&short).to_string())?;
    std::fs::write(directory.join("report.json"), RunReport::from(&short).to_json())?;
    write("short", &latency(&short))?;
    write("long", &latency(&common::run(1, 600.0)))?;
    write("many", &latency(&common::run(9, 20.0)))?;
    write("few-frames", &latency(&common::run(1, 0.3)))?;
    write("no-frames", &latency(&common::run(1, 0.0)))?;
    write("no-headsets", &latency(&Run::default()))?;
    let levels = |name: &str, factor: f64| {
        let points = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0].map(|step: f64| {
            Point::labelled(factor * 8.0 / step, 2e-4 * step.powi(3) / factor.sqrt(), format!("step {step}"))
        });
        (name.to_owned(), points)
    };
    let axes = [Axis::log("time, ms"), Axis::log("mean error, of full brightness")];
    let [x, y] = axes;
    let mut plot = Plot::new("Milliseconds against error", x, y).with_pareto_front();
    for (name, points) in [levels("plain", 1.0), levels("pre-integrated", 1.4)] {
        plot = plot.lines(name, points);
    }
    plot = plot.scatter("exact", [Point::labelled(60.0, 0.0, "float64")]);
    write("error", &plot.picture())?;
    Ok(())
}
