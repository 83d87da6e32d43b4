//! `holocast bench registration`.

use crate::cli::{Look, Registration};
use crate::commands::shown::Shown;
use crate::terminal::{progress, progress_done, say};
use anyhow::{Context as _, bail};
use headset::DeviceModel;
use report::{Axis, Distribution, Picture, Plot, Point};
use serde::Serialize;
use spatial::{DVec3, Pose};
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use trace::Trace;
use truth::{Exact, Pair, PictureError, Sample, SweepSettings, facing, sweep};

/// Name and version of what is written.
const FORMAT: &str = "holocast-registration/1";
/// Longest age that is swept: beyond, the server predicts no farther.
const LONGEST_MS: f64 = 100.0;
/// Classes of the head's speed begin at these, degrees a second.
const SPEEDS_DEG_PER_SEC: [f64; 5] = [0.0, 10.0, 30.0, 60.0, 120.0];
/// Where the points stand: straight ahead, and half way to each corner of the picture.
const HALF_WAY: f64 = 0.5;
/// What is worse by less than this, in degrees, is rounding.
const ROUNDING_DEG: f64 = 1e-6;
/// Scale of the plot as PNG.
const PLOT_SCALE: u32 = 2;

/// All figures.
#[derive(Serialize)]
struct Figures {
    format: &'static str,
    device: String,
    eye_size_px: [u32; 2],
    poses_hz: f64,
    distance_m: f64,
    ages_ms: Vec<f64>,
    traces: Vec<TraceFigures>,
    /// All traces together.
    all: TraceFigures,
}

#[derive(Serialize)]
struct TraceFigures {
    trace: String,
    seconds: f64,
    /// Poses that were looked at; those at a jump of the recording are not.
    poses: usize,
    speed_deg_per_sec: Option<Distribution>,
    by_age: Vec<AgeFigures>,
    by_speed: Vec<SpeedFigures>,
    pictures: Vec<PictureFigures>,
}

#[derive(Serialize)]
struct AgeFigures {
    age_ms: f64,
    #[serde(flatten)]
    both: Both,
    /// Share of poses at which prediction made it worse, 0 to 1.
    worse_share: f64,
}

/// At one age and for one class of speeds.
#[derive(Serialize)]
struct SpeedFigures {
    from_deg_per_sec: f64,
    below_deg_per_sec: Option<f64>,
    age_ms: f64,
    #[serde(flatten)]
    both: Both,
    worse_share: f64,
}

#[derive(Serialize)]
struct Both {
    as_it_came: Option<Displaced>,
    predicted: Option<Displaced>,
}

#[derive(Serialize)]
struct Displaced {
    deg: Distribution,
    px: Distribution,
}

/// Exact pictures of the pose and of the predicted pose against that of the true one.
#[derive(Serialize)]
struct PictureFigures {
    age_ms: f64,
    size_px: [u32; 2],
    as_it_came_psnr_db: Option<Distribution>,
    predicted_psnr_db: Option<Distribution>,
}

pub(crate) fn run(arguments: &Registration) -> anyhow::Result<()> {
    let settings = settings(arguments)?;
    let shown = match (&arguments.scene, &arguments.volume) {
        (None, None) => None,
        (scene, volume) => {
            Some(Shown::load(scene.as_deref(), volume.as_deref(), &arguments.chosen, &Look::default())?)
        }
    };
    let mut csv = String::from(CSV_HEADER);
    let (mut traces, mut everything, mut every_picture, mut seconds) =
        (Vec::new(), Vec::new(), Vec::new(), 0.0);
    for path in &arguments.trace {
        let trace = Trace::load(path)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let samples = sweep(&trace, &settings);
        if samples.is_empty() {
            bail!("{}: too short, or jumping all the time", path.display());
        }
        write_csv(&mut csv, &name, &samples);
        let pictures = match &shown {
            Some(shown) => compared(arguments, shown, &name, &samples, &settings)?,
            None => Vec::new(),
        };
        traces.push(figures(&name, trace.duration_secs(), &samples, &pictures, arguments));
        seconds += trace.duration_secs();
        everything.extend(samples);
        every_picture.extend(pictures);
    }
    let figures = Figures {
        format: FORMAT,
        device: arguments.device.clone(),
        eye_size_px: settings.size_px,
        poses_hz: settings.poses_hz,
        distance_m: settings.distance_m,
        ages_ms: settings.ages_secs.iter().map(|secs| rounded(secs * 1e3)).collect(),
        all: figures("all", seconds, &everything, &every_picture, arguments),
        traces,
    };
    let json = serde_json::to_string_pretty(&figures)? + "\n";
    if let Some(path) = &arguments.out {
        write(path, json.as_bytes())?;
    }
    if let Some(path) = &arguments.csv {
        write(path, csv.as_bytes())?;
    }
    if let Some(path) = &arguments.plot {
        for (more, picture) in plots(&figures) {
            let path = beside(path, more);
            match path.extension().and_then(|extension| extension.to_str()) {
                Some("svg") => write(&path, picture.to_svg().as_bytes())?,
                _ => write(&path, &picture.to_png(PLOT_SCALE))?,
            }
        }
    }
    say(if arguments.json { json } else { table(&figures) });
    Ok(())
}

fn settings(arguments: &Registration) -> anyhow::Result<SweepSettings> {
    let model: DeviceModel = arguments.device.parse()?;
    if !(1.0..=240.0).contains(&arguments.hz) {
        bail!("--hz is {}, expected 1 to 240", arguments.hz);
    }
    if !(0.05..=100.0).contains(&arguments.distance_m) {
        bail!("--distance-m is {}, expected 0.05 to 100", arguments.distance_m);
    }
    let (longest, step) = (arguments.longest_ms, arguments.step_ms);
    if !(0.0..=LONGEST_MS).contains(&longest) {
        bail!("--longest-ms is {longest}, expected 0 to {LONGEST_MS}: the server predicts no farther");
    }
    if !(0.1..=LONGEST_MS).contains(&step) {
        bail!("--step-ms is {step}, expected 0.1 to {LONGEST_MS}");
    }
    if let Some(age) = arguments.picture_ages_ms.iter().find(|age| !(0.0..=LONGEST_MS).contains(*age)) {
        bail!("--picture-ages-ms has {age}, expected 0 to {LONGEST_MS}");
    }
    let mut ages_ms: Vec<f64> =
        (0..).map(|i| f64::from(i) * step).take_while(|age| *age <= longest + 1e-9).collect();
    ages_ms.extend(&arguments.picture_ages_ms);
    ages_ms.sort_by(f64::total_cmp);
    ages_ms.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    let device = model.device(arguments.hz)?;
    let [left, right, up, down] = device.geometry.fov[0].tangents().map(|tangent| HALF_WAY * tangent);
    Ok(SweepSettings {
        poses_hz: f64::from(arguments.hz),
        ages_secs: ages_ms.iter().map(|ms| ms * 1e-3).collect(),
        geometry: device.geometry,
        size_px: model.eye_size_px(),
        distance_m: arguments.distance_m,
        points: vec![[0.0, 0.0], [left, up], [right, up], [left, down], [right, down]],
    })
}

/// Exact pictures at one pose and one age.
struct Compared {
    age_secs: f64,
    as_it_came: PictureError,
    predicted: PictureError,
}

/// Compares pictures at poses spread over the recording. Heads are moved so that the hologram stands before the true one:
/// so all of them see it, and the exact picture of the true pose is always the same.
fn compared(
    arguments: &Registration,
    shown: &Shown,
    name: &str,
    samples: &[Sample],
    settings: &SweepSettings,
) -> anyhow::Result<Vec<Compared>> {
    let exact = Exact::of_several(&shown.loaded.volume, &shown.others(), &shown.scene)?;
    let target = DVec3::from_array(shown.scene.placement.position_m);
    let size = arguments.picture_size.0;
    let pair_of = |head: &Pose| -> anyhow::Result<_> {
        let view = settings.geometry.view(head);
        Ok([exact.picture(view.eyes[0], size)?, exact.picture(view.eyes[1], size)?])
    };
    let [_, there] = facing([Pose::IDENTITY; 2], target, settings.distance_m);
    let truth = pair_of(&there)?;
    let ages = settings.ages_secs.len();
    let poses = samples.len() / ages;
    let count = arguments.pictures.clamp(1, poses);
    let mut all = Vec::new();
    for index in 0..count {
        let pose = (2 * index + 1) * poses / (2 * count);
        for sample in &samples[pose * ages..(pose + 1) * ages] {
            let is_asked = |age: &f64| (age * 1e-3 - sample.age_secs).abs() < 1e-9;
            if !arguments.picture_ages_ms.iter().any(is_asked) {
                continue;
            }
            progress(format!("{name}: exact pictures, pose {index} of {count}"));
            let error = |pair: &Pair| -> anyhow::Result<PictureError> {
                let [head, _] = facing([pair.pose, sample.truth], target, settings.distance_m);
                let found = pair_of(&head)?;
                Ok(PictureError::of([(&found[0], &truth[0]), (&found[1], &truth[1])])?)
            };
            all.push(Compared {
                age_secs: sample.age_secs,
                as_it_came: error(&sample.as_it_came)?,
                predicted: error(&sample.predicted)?,
            });
        }
    }
    progress_done();
    Ok(all)
}

fn figures(
    name: &str,
    seconds: f64,
    samples: &[Sample],
    compared: &[Compared],
    arguments: &Registration,
) -> TraceFigures {
    let ages = distinct(samples.iter().map(|sample| sample.age_secs));
    let of_age = |age: f64| samples.iter().filter(move |sample| sample.age_secs == age);
    let first_age = || of_age(ages.first().copied().unwrap_or_default());
    let by_age = ages.iter().map(|&age| {
        let here: Vec<_> = of_age(age).collect();
        AgeFigures { age_ms: rounded(age * 1e3), both: both(&here), worse_share: worse_share(&here) }
    });
    let by_speed = SPEEDS_DEG_PER_SEC.iter().enumerate().flat_map(|(index, &from)| {
        let below = SPEEDS_DEG_PER_SEC.get(index + 1).copied();
        let belongs = move |sample: &&Sample| {
            sample.speed_deg_per_sec >= from && below.is_none_or(|below| sample.speed_deg_per_sec < below)
        };
        ages.iter().filter_map(move |&age| {
            let here: Vec<_> = of_age(age).filter(belongs).collect();
            (!here.is_empty()).then(|| SpeedFigures {
                from_deg_per_sec: from,
                below_deg_per_sec: below,
                age_ms: rounded(age * 1e3),
                both: both(&here),
                worse_share: worse_share(&here),
            })
        })
    });
    let pictures = distinct(compared.iter().map(|pictures| pictures.age_secs)).into_iter().map(|age| {
        let of = |error: fn(&Compared) -> PictureError| {
            let here = compared.iter().filter(|pictures| pictures.age_secs == age);
            Distribution::of(here.filter_map(|pictures| error(pictures).psnr_db))
        };
        PictureFigures {
            age_ms: rounded(age * 1e3),
            size_px: arguments.picture_size.0,
            as_it_came_psnr_db: of(|pictures| pictures.as_it_came),
            predicted_psnr_db: of(|pictures| pictures.predicted),
        }
    });
    TraceFigures {
        trace: name.to_owned(),
        seconds,
        poses: first_age().count(),
        speed_deg_per_sec: Distribution::of(first_age().map(|sample| sample.speed_deg_per_sec)),
        by_age: by_age.collect(),
        by_speed: by_speed.collect(),
        pictures: pictures.collect(),
    }
}

fn both(samples: &[&Sample]) -> Both {
    let of = |pair: fn(&Sample) -> Pair| {
        let found = || samples.iter().filter_map(|sample| pair(sample).displacement);
        Some(Displaced {
            deg: Distribution::of(found().map(|d| d.angle_deg))?,
            px: Distribution::of(found().map(|d| d.px))?,
        })
    };
    Both { as_it_came: of(|sample| sample.as_it_came), predicted: of(|sample| sample.predicted) }
}

#[expect(clippy::cast_precision_loss, reason = "a count of poses")]
fn worse_share(samples: &[&Sample]) -> f64 {
    let is_worse = |sample: &&&Sample| {
        let [came, predicted] =
            [sample.as_it_came, sample.predicted].map(|pair| pair.displacement.map(|d| d.angle_deg));
        predicted.zip(came).is_some_and(|(predicted, came)| predicted > came + ROUNDING_DEG)
    };
    samples.iter().filter(is_worse).count() as f64 / samples.len() as f64
}

fn distinct(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    values
}

/// Milliseconds without the last bits of a product.
fn rounded(ms: f64) -> f64 {
    (ms * 1e6).round() / 1e6
}

const CSV_HEADER: &str =
    "trace,at_secs,age_ms,speed_deg_per_sec,as_it_came_deg,as_it_came_px,predicted_deg,predicted_px\n";

fn write_csv(csv: &mut String, name: &str, samples: &[Sample]) {
    for sample in samples {
        let [came, predicted] = [sample.as_it_came, sample.predicted].map(|pair| {
            pair.displacement.map_or(",".to_owned(), |d| format!("{:.5},{:.3}", d.angle_deg, d.px))
        });
        // Writing to a string does not fail.
        let _ = writeln!(
            csv,
            "{},{:.4},{},{:.3},{came},{predicted}",
            name.replace([',', '"', '\n'], "_"),
            sample.at_secs,
            rounded(sample.age_secs * 1e3),
            sample.speed_deg_per_sec,
        );
    }
}

/// One plot of several: what is added to the file's name, and the picture.
fn plots(figures: &Figures) -> Vec<(&'static str, Picture)> {
    let heads = figures.traces.iter().chain((figures.traces.len() > 1).then_some(&figures.all));
    let title = |what: &str| {
        format!("{what} of {} recorded heads, {} m away", figures.traces.len(), figures.distance_m)
    };
    let many = |what: &str, plots: &[Plot], columns| Plot::many(&title(what), plots, columns);
    let by_head = |unit: &str, of: fn(&Displaced) -> Distribution| -> Vec<Plot> {
        let label = format!("error, {unit}");
        heads.clone().map(|head| of_head(head, &label, of)).collect()
    };
    let mut all = vec![
        ("", many("Registration error", &by_head("degrees", |d| d.deg), 2)),
        ("-px", many("Registration error", &by_head(&pixels(figures), |d| d.px), 2)),
        ("-speed", many("Registration error by speed", &by_speed(&figures.all), 3)),
    ];
    if !figures.all.pictures.is_empty() {
        all.push(("-db", many("Exact pictures", &heads.clone().map(in_decibels).collect::<Vec<_>>(), 2)));
    }
    all
}

fn pixels(figures: &Figures) -> String {
    format!("pixels of {}x{}", figures.eye_size_px[0], figures.eye_size_px[1])
}

const AGE: &str = "age of the pose when its picture is seen, ms";

fn came(both: &Both) -> Option<&Displaced> {
    both.as_it_came.as_ref()
}

fn predicted(both: &Both) -> Option<&Displaced> {
    both.predicted.as_ref()
}

/// Error against the age of the pose, of one head.
fn of_head(head: &TraceFigures, label: &str, of: fn(&Displaced) -> Distribution) -> Plot {
    let line = |which: fn(&Both) -> Option<&Displaced>, part: fn(Distribution) -> f64| {
        let point = move |age: &AgeFigures| Some(Point::new(age.age_ms, part(of(which(&age.both)?))));
        head.by_age.iter().filter_map(point).collect::<Vec<_>>()
    };
    Plot::new(head.trace.clone(), Axis::linear(AGE), Axis::linear(label))
        .lines("pose as it came, 95 %", line(came, |d| d.p95))
        .lines("pose as it came, median", line(came, |d| d.p50))
        .lines("predicted, 95 %", line(predicted, |d| d.p95))
        .lines("predicted, median", line(predicted, |d| d.p50))
}

/// Error against the age of the pose, a plot for each class of speeds.
fn by_speed(all: &TraceFigures) -> Vec<Plot> {
    let of_class = |from: f64| {
        let of = |which: fn(&Both) -> Option<&Displaced>, part: fn(Distribution) -> f64| {
            // Without age there is no error but rounding, which a logarithm would show.
            let belongs = move |class: &&SpeedFigures| class.from_deg_per_sec == from && class.age_ms > 0.0;
            let classes = all.by_speed.iter().filter(belongs);
            let point =
                move |class: &SpeedFigures| Some(Point::new(class.age_ms, part(which(&class.both)?.deg)));
            classes.filter_map(point).collect::<Vec<_>>()
        };
        let name = match SPEEDS_DEG_PER_SEC.iter().find(|next| **next > from) {
            Some(next) => format!("{from} to {next} degrees a second"),
            None => format!("over {from} degrees a second"),
        };
        Plot::new(name, Axis::linear(AGE), Axis::log("error, degrees"))
            .lines("pose as it came, 95 %", of(came, |d| d.p95))
            .lines("pose as it came, median", of(came, |d| d.p50))
            .lines("predicted, 95 %", of(predicted, |d| d.p95))
            .lines("predicted, median", of(predicted, |d| d.p50))
    };
    SPEEDS_DEG_PER_SEC.into_iter().map(of_class).collect()
}

/// What an error does to exact pictures, of one head.
fn in_decibels(head: &TraceFigures) -> Plot {
    let line = |of: fn(&PictureFigures) -> Option<Distribution>, part: fn(Distribution) -> f64| {
        let point = move |at: &PictureFigures| Some(Point::new(at.age_ms, part(of(at)?)));
        head.pictures.iter().filter_map(point).collect::<Vec<_>>()
    };
    let axis = Axis::linear("PSNR against the true view's, dB");
    Plot::new(head.trace.clone(), Axis::linear(AGE), axis)
        .lines("pose as it came, median", line(|p| p.as_it_came_psnr_db, |d| d.p50))
        .lines("pose as it came, least", line(|p| p.as_it_came_psnr_db, |d| d.min))
        .lines("predicted, median", line(|p| p.predicted_psnr_db, |d| d.p50))
        .lines("predicted, least", line(|p| p.predicted_psnr_db, |d| d.min))
}

/// A file beside another: its name with something before the extension.
fn beside(path: &Path, more: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = match path.extension() {
        Some(extension) => format!("{stem}{more}.{}", extension.to_string_lossy()),
        None => format!("{stem}{more}"),
    };
    path.with_file_name(name)
}

fn table(figures: &Figures) -> String {
    let mut text = format!(
        "Registration error on {} ({}×{} an eye), {} poses a second, hologram {} m away\n",
        figures.device, figures.eye_size_px[0], figures.eye_size_px[1], figures.poses_hz, figures.distance_m
    );
    let row = |text: &mut String, name: &str, both: &Both, worse_share: f64| {
        let cells = |displaced: &Option<Displaced>| match displaced {
            Some(Displaced { deg, px }) => {
                format!("{:>7.2} {:>6.2} {:>6.2} {:>6.0}", deg.p50, deg.p95, deg.max, px.p95)
            }
            None => format!("{:>7} {:>6} {:>6} {:>6}", "–", "–", "–", "–"),
        };
        let worse = 100.0 * worse_share;
        let _ = writeln!(
            text,
            "  {name:<22}{} |{} |{worse:>5.0} %",
            cells(&both.as_it_came),
            cells(&both.predicted)
        );
    };
    let header = |text: &mut String, first: &str| {
        let columns = format!("{:>7} {:>6} {:>6} {:>6}", "° p50", "p95", "max", "px p95");
        let _ = writeln!(text, "  {first:<22}{columns} |{columns} | worse");
    };
    for of in figures.traces.iter().chain((figures.traces.len() > 1).then_some(&figures.all)) {
        let speed = of.speed_deg_per_sec.map_or(String::new(), |speed| {
            format!(", turning at {:.0}°/s at the median, {:.0}°/s at 95 %", speed.p50, speed.p95)
        });
        let _ = writeln!(
            text,
            "\n{}: {:.0} s, {} poses{speed}\n  {:22}{:<31}predicted",
            of.trace, of.seconds, of.poses, "", "pose as it came"
        );
        header(&mut text, "age");
        for age in &of.by_age {
            row(&mut text, &format!("{} ms", age.age_ms), &age.both, age.worse_share);
        }
        for pictures in &of.pictures {
            let db = |d: Option<Distribution>| {
                d.map_or("equal".to_owned(), |d| format!("{:.1} dB ({:.1} least)", d.p50, d.min))
            };
            let _ = writeln!(
                text,
                "  exact pictures at {} ms: {} as it came, {} predicted, against that of the true pose",
                pictures.age_ms,
                db(pictures.as_it_came_psnr_db),
                db(pictures.predicted_psnr_db)
            );
        }
    }
    let _ = writeln!(text, "\n{}, by speed, at 50 ms or the nearest age", figures.all.trace);
    header(&mut text, "speed");
    let nearest = |a: &f64, b: &f64| (a - 50.0).abs().total_cmp(&(b - 50.0).abs());
    if let Some(age) = figures.ages_ms.iter().copied().min_by(nearest) {
        for class in figures.all.by_speed.iter().filter(|class| class.age_ms == age) {
            let to = class.below_deg_per_sec.map_or("…".to_owned(), |below| below.to_string());
            row(
                &mut text,
                &format!("{} to {to} °/s", class.from_deg_per_sec),
                &class.both,
                class.worse_share,
            );
        }
    }
    text.push_str("  worse: share of poses at which prediction made it worse.");
    text
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    fs::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}
