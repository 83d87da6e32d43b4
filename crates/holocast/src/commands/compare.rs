//! `holocast compare`.

use crate::cli::Compare;
use crate::terminal::say;
use ::reference::{Comparison, Picture, compare, difference};
use anyhow::{Context as _, bail};
use picture_io::{Kind, Loaded};

/// The samples of a pixel by name.
const CHANNELS: [&str; 4] = ["red", "green", "blue", "opacity"];

pub(crate) fn run(arguments: &Compare) -> anyhow::Result<()> {
    let (a, b) = (picture_io::load(&arguments.a)?, picture_io::load(&arguments.b)?);
    let pair = Pair::of(a, b, arguments.background.0);
    let between = || format!("{} and {}", arguments.a.display(), arguments.b.display());
    let comparison = compare(&pair.a, &pair.b).with_context(between)?;
    let gain = arguments.gain.unwrap_or_else(|| gain_for(&comparison));
    if let Some(path) = &arguments.difference {
        picture_io::save_png(path, &difference(&pair.a, &pair.b, gain)?, [0.0; 3])?;
    }
    if arguments.json {
        say(serde_json::to_string_pretty(&json(arguments, &pair, &comparison, gain))?);
    } else {
        print(arguments, &pair, &comparison, gain);
    }
    if let Some(most) = arguments.max_error.filter(|most| comparison.max_abs_error > most.0) {
        bail!(
            "{} differ by {:.3}/255, more than {:.3}/255",
            between(),
            comparison.max_abs_error * 255.0,
            most.0 * 255.0
        );
    }
    Ok(())
}

/// Two pictures made comparable.
struct Pair {
    a: Picture,
    b: Picture,
    /// What both were put before, because one of them already is; opacities are not compared then.
    background: Option<[f64; 3]>,
    /// Whether both files tell depths.
    has_depth: bool,
}

impl Pair {
    fn of(a: Loaded, b: Loaded, background: [f64; 3]) -> Self {
        let has_depth = a.kind == Kind::Data && b.kind == Kind::Data;
        let opaque = |loaded: &Loaded| loaded.kind == Kind::OpaquePng;
        if opaque(&a) || opaque(&b) {
            let shown = |picture: &Picture| picture.over(background);
            return Self {
                a: shown(&a.picture),
                b: shown(&b.picture),
                background: Some(background),
                has_depth,
            };
        }
        Self { a: a.picture, b: b.picture, background: None, has_depth }
    }
}

/// The gain that shows the worst sample white.
fn gain_for(comparison: &Comparison) -> f64 {
    let worst = comparison.max_abs_error;
    if worst > 0.0 { 1.0 / worst } else { 1.0 }
}

fn json(arguments: &Compare, pair: &Pair, c: &Comparison, gain: f64) -> serde_json::Value {
    let (size, depth) = ([pair.a.width(), pair.a.height()], &c.depth);
    serde_json::json!({
        "a": arguments.a, "b": arguments.b, "size_px": size,
        "before_background": pair.background,
        "max_abs_error": c.max_abs_error,
        "worst": c.worst.map(|w| serde_json::json!({"x": w.x, "y": w.y, "channel": CHANNELS[w.channel]})),
        "rmse": c.rmse,
        // JSON has no infinity: pictures of equal colours have no PSNR.
        "psnr_db": c.psnr_db.is_finite().then_some(c.psnr_db),
        "ssim": c.ssim,
        "opacity": pair.background.is_none().then(|| serde_json::json!({
            "max_abs_error": c.opacity_max_abs_error, "rmse": c.opacity_rmse,
        })),
        "depth": pair.has_depth.then(|| serde_json::json!({
            "pixels_in_both": depth.both, "pixels_only_in_a": depth.only_first,
            "pixels_only_in_b": depth.only_second, "max_abs_error_mm": depth.max_abs_error_mm,
            "worst": depth.worst.map(|(x, y)| serde_json::json!({"x": x, "y": y})),
            "rmse_mm": depth.rmse_mm, "range_mm": depth.range_mm, "psnr_db": depth.psnr_db, "ssim": depth.ssim,
        })),
        "difference": arguments.difference.as_ref().map(|path| serde_json::json!({"path": path, "gain": gain})),
    })
}

fn print(arguments: &Compare, pair: &Pair, c: &Comparison, gain: f64) {
    let in_255ths = |x: f64| format!("{:.4}/255", x * 255.0);
    let worst = c
        .worst
        .map_or_else(String::new, |w| format!(", {} of pixel ({}, {})", CHANNELS[w.channel], w.x, w.y));
    say(format!("size          {}x{}", pair.a.width(), pair.a.height()));
    say(format!("largest error {}{worst}", in_255ths(c.max_abs_error)));
    say(format!("RMSE          {}", in_255ths(c.rmse)));
    match c.psnr_db {
        psnr if psnr.is_finite() => say(format!("PSNR          {psnr:.2} dB")),
        _ => say("PSNR          none, the colours are equal"),
    }
    say(format!("SSIM          {:.6}", c.ssim));
    match pair.background {
        None => say(format!(
            "opacity       {} largest, {} RMSE",
            in_255ths(c.opacity_max_abs_error),
            in_255ths(c.opacity_rmse)
        )),
        Some([r, g, b]) => {
            say(format!("opacity       not compared: seen before the background {r},{g},{b}"));
        }
    }
    if pair.has_depth {
        let d = &c.depth;
        let worst = d.worst.map_or_else(String::new, |(x, y)| format!(" at pixel ({x}, {y})"));
        say(format!(
            "depth         {:.4} mm largest{worst}, {:.4} mm RMSE over {} pixels",
            d.max_abs_error_mm, d.rmse_mm, d.both
        ));
        match (d.psnr_db, d.ssim) {
            (Some(psnr), Some(ssim)) => say(format!(
                "              {psnr:.2} dB PSNR of a range of {:.2} mm, SSIM {ssim:.6}",
                d.range_mm
            )),
            (Some(psnr), None) => {
                say(format!("              {psnr:.2} dB PSNR of a range of {:.2} mm", d.range_mm));
            }
            (None, _) if d.rmse_mm > 0.0 => say("              no PSNR: all depths of the first are one"),
            (None, _) => say("              no PSNR: the depths are equal"),
        }
        say(format!(
            "              {} pixels have a depth only in the first, {} only in the second",
            d.only_first, d.only_second
        ));
    } else {
        say("depth         not compared: only float data have one");
    }
    if let Some(path) = &arguments.difference {
        say(format!("difference    {}, {gain:.4} times as bright", path.display()));
    }
}
