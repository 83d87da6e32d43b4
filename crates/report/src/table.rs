//! A report as tables of plain text, at most 100 columns wide.

use crate::{
    Distribution, HeadsetReport, Process, Registration, RunReport, Server, VerificationReport, VerifiedClass,
};
use comfy_table::{CellAlignment, Row, Table};
use std::fmt;

/// No line is longer.
const WIDTH: usize = 100;
/// Names of headsets, devices and traces are cut to this.
const NAME: usize = 16;

impl fmt::Display for RunReport {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        facts(self, out)?;
        stages(self, out)?;
        headsets(self, out)?;
        registration(self, out)?;
        verdict(self, out)
    }
}

fn facts(report: &RunReport, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    let title = if report.title.is_empty() { "Run" } else { &report.title };
    let count = match report.headsets.len() {
        1 => "1 headset".to_owned(),
        count => format!("{count} headsets"),
    };
    let began =
        if report.started_at.is_empty() { String::new() } else { format!(", began {}", report.started_at) };
    writeln!(out, "{}", cut(&format!("{title}: {count}, {:.1} s{began}", report.seconds), WIDTH))?;
    let machine = &report.machine;
    let mut what = vec![];
    what.extend(Some(machine.os.clone()).filter(|os| !os.is_empty()));
    what.push(format!(
        "{} cores{}",
        machine.cores,
        machine.cpu.as_ref().map(|cpu| format!(" ({cpu})")).unwrap_or_default()
    ));
    what.extend(machine.memory_bytes.map(|bytes| format!("{:.1} GB memory", bytes as f64 * 1e-9)));
    what.extend(machine.adapter.as_ref().map(|adapter| format!("adapter {adapter}")));
    fact(out, "machine", &what.join(", "))?;
    if let Some(server) = &report.server {
        fact(out, "server", &about_server(server))?;
        if let Some(volume) = &server.volume {
            let [x, y, z] = volume.dimensions;
            let spacing =
                volume.spacing_mm.map(|[x, y, z]| format!(" of {x:.2}×{y:.2}×{z:.2} mm")).unwrap_or_default();
            fact(out, "volume", &format!("{}, {x}×{y}×{z} voxels{spacing}", volume.name))?;
        }
    }
    for process in &report.processes {
        fact(out, "process", &about_process(process, report.seconds))?;
    }
    if !report.versions.is_empty() {
        let versions: Vec<_> =
            report.versions.iter().map(|(name, version)| format!("{name} {version}")).collect();
        fact(out, "versions", &versions.join(", "))?;
    }
    Ok(())
}

fn fact(out: &mut fmt::Formatter<'_>, name: &str, text: &str) -> fmt::Result {
    writeln!(out, "  {name:<9} {}", cut(text, WIDTH - 12))
}

fn about_server(server: &Server) -> String {
    let mut what = vec![format!("{} at {}", server.name, server.address), server.protocol.clone()];
    what.extend(server.codec.clone());
    what.extend(server.adapter.as_ref().map(|adapter| format!("adapter {adapter}")));
    what.retain(|part| !part.is_empty());
    what.join(", ")
}

fn about_process(process: &Process, seconds: f64) -> String {
    let mut what = Vec::new();
    if let Some(secs) = process.cpu_secs {
        let cores = if seconds > 0.0 { format!(" ({:.2} cores)", secs / seconds) } else { String::new() };
        what.push(format!("{secs:.1} s of processor time{cores}"));
    }
    what.extend(process.rss_bytes.map(|bytes| format!("{:.0} MB memory at the end", bytes as f64 * 1e-6)));
    what.extend(process.rss_peak_bytes.map(|bytes| format!("{:.0} MB at most", bytes as f64 * 1e-6)));
    if what.is_empty() {
        what.push("use not known".to_owned());
    }
    format!("{}: {}", process.name, what.join(", "))
}

fn stages(report: &RunReport, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    writeln!(out, "\nWhere the time went: every frame of every headset, milliseconds")?;
    let all = &report.all;
    let Some(total) = all.pose_to_decoded_us else {
        return writeln!(out, "  no frames were decoded");
    };
    let mut table = table(&["stage", "mean", "share", "p50", "p95", "p99", "max"]);
    for stage in &all.stages {
        table.add_row(stage_row(&stage.name, stage.us, Some(total)));
    }
    table.add_row(stage_row("pose to decoded (the sum)", all.pose_to_decoded_us, Some(total)));
    table.add_row(Row::from(vec![""]));
    table.add_row(stage_row("age of the pose at render", all.pose_age_at_render_us, None));
    table.add_row(stage_row("behind its display time", all.lateness_us, None));
    print(out, &table)?;
    writeln!(
        out,
        "  Means add up to the sum, percentiles do not. Behind its display time: negative is in time."
    )
}

fn stage_row(name: &str, us: Option<Distribution>, total: Option<Distribution>) -> Vec<String> {
    let name = cut(&name.replace('_', " "), 28);
    let Some(us) = us else { return vec![name] };
    let ms = |us: f64| decimals(us * 1e-3, 2);
    let share = match total {
        Some(total) if total.mean > 0.0 => format!("{} %", decimals(us.mean / total.mean * 100.0, 1)),
        _ => String::new(),
    };
    vec![name, ms(us.mean), share, ms(us.p50), ms(us.p95), ms(us.p99), ms(us.max)]
}

fn headsets(report: &RunReport, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    if report.headsets.is_empty() {
        return writeln!(out, "\nNo headsets");
    }
    let each =
        |out: &mut fmt::Formatter<'_>, header: &[&str], row: &dyn Fn(&HeadsetReport) -> Vec<String>| {
            let mut table = table(header);
            for headset in &report.headsets {
                let mut cells = row(headset);
                cells.insert(0, cut(&headset.name, NAME));
                table.add_row(cells);
            }
            print(out, &table)
        };
    writeln!(out, "\nHeadsets: what they are and asked for")?;
    each(out, &["headset", "device", "picture", "frames/s", "seconds", "trace"], &|headset| {
        let [width, height] = headset.eye_size_px;
        vec![
            cut(&headset.device, NAME),
            format!("2×{width}×{height}"),
            format!("{:.0}", headset.asked_hz),
            format!("{:.1}", headset.seconds),
            cut(&headset.trace, NAME),
        ]
    })?;

    writeln!(out, "\nHeadsets: frames a second, and milliseconds from the pose to the decoded picture")?;
    let header = ["headset", "asked", "got", "in time", "p50", "p95", "p99", "max", "freeze"];
    each(out, &header, &|headset| {
        let (total, interval) = (headset.pose_to_decoded_us, headset.interval_us);
        vec![
            format!("{:.0}", headset.asked_hz),
            format!("{:.1}", headset.achieved_hz),
            format!("{:.1}", headset.in_time_hz),
            ms(total.map(|total| total.p50)),
            ms(total.map(|total| total.p95)),
            ms(total.map(|total| total.p99)),
            ms(total.map(|total| total.max)),
            ms(interval.map(|interval| interval.max)),
        ]
    })?;
    writeln!(out, "  freeze: the longest time between two pictures.")?;

    writeln!(out, "\nHeadsets: how many frames")?;
    let header = [
        "headset", "skipped", "rendered", "sent", "reset", "lost", "stale", "broken", "decoded", "late",
        "wrong",
    ];
    each(out, &header, &|headset| {
        let counters = &headset.counters;
        let of_server = [counters.skipped, counters.rendered, counters.sent, counters.reset];
        let of_headset = [
            counters.lost,
            counters.stale,
            counters.undecodable,
            counters.decoded,
            counters.late,
            wrong(headset),
        ];
        let of_server = of_server.iter().map(|count| count.map_or("?".to_owned(), |count| count.to_string()));
        of_server.chain(of_headset.iter().map(u64::to_string)).collect()
    })?;
    writeln!(
        out,
        "  skipped: due and not begun. reset: given up by the server under way. lost: did not arrive whole.\n  \
         stale: overtaken by a newer one. late: decoded after its display time.\n  \
         broken: did not decode. wrong: not what was asked for. ?: the server did not tell."
    )?;

    writeln!(out, "\nHeadsets: the stream, the quality given up, the clock")?;
    let header = [
        "headset",
        "Mbit/s",
        "p95",
        "kB a frame",
        "smaller",
        "scale",
        "coarser",
        "step",
        "full step",
        "clock error",
    ];
    each(out, &header, &|headset| {
        let mbit = |bps: Option<f64>| bps.map_or("–".to_owned(), |bps| format!("{:.2}", bps * 1e-6));
        let quality = headset.quality;
        let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
        let share =
            |share: Option<f64>| share.map_or("–".to_owned(), |share| format!("{:.1} %", share * 100.0));
        vec![
            mbit(headset.bit_rate.map(|rate| rate.mean_bps)),
            mbit(headset.bit_rate.map(|rate| rate.p95_bps)),
            headset.frame_bytes.map_or("–".to_owned(), |bytes| format!("{:.1}", bytes.mean * 1e-3)),
            share(quality.map(|quality| quality.below_full_resolution_share)),
            number(quality.map(|quality| quality.mean_resolution_scale)),
            share(quality.map(|quality| quality.above_full_step_share)),
            number(quality.map(|quality| quality.mean_step_scale)),
            number(quality.map(|quality| quality.full_step_scale)),
            headset
                .clock
                .map_or("–".to_owned(), |clock| format!("±{:.2} ms", clock.error_us as f64 * 1e-3)),
        ]
    })?;
    writeln!(
        out,
        "  smaller: frames below full resolution; scale: mean width over full width.\n  \
         coarser: frames with a longer step along the ray than at full quality; step: mean, times that."
    )
}

fn registration(report: &RunReport, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    let told = || report.headsets.iter().filter_map(|h| Some((&h.name, h.registration.as_ref()?)));
    if told().next().is_some() {
        writeln!(
            out,
            "\nHeadsets: how far the hologram seemed to be from where it is, without reprojection"
        )?;
        let mut table =
            table(&["headset", "frames", "° p50", "p95", "max", "px p50", "p95", "max", "pose's age p50"]);
        for headset in &report.headsets {
            let Some(Registration { deg, px, .. }) = &headset.registration else { continue };
            table.add_row([
                cut(&headset.name, NAME),
                deg.count.to_string(),
                decimals(deg.p50, 2),
                decimals(deg.p95, 2),
                decimals(deg.max, 2),
                decimals(px.p50, 1),
                decimals(px.p95, 1),
                decimals(px.max, 1),
                format!("{} ms", ms(headset.pose_to_shown_us.map(|age| age.p50))),
            ]);
        }
        print(out, &table)?;
    }
    for headset in &report.headsets {
        let Some(verification) = &headset.verification else { continue };
        writeln!(out, "\n{}: decoded pictures against the exact ones", cut(&headset.name, NAME))?;
        let mut table =
            table(&["against that of", "pictures", "dB p50", "least", "shifted by px p50", "most"]);
        let of = |name: &str, db: Option<Distribution>, px: Option<Distribution>| {
            let number = |value: Option<f64>, places| value.map_or("–".to_owned(), |v| decimals(v, places));
            vec![
                name.to_owned(),
                verification.frames.len().to_string(),
                number(db.map(|db| db.p50), 1),
                number(db.map(|db| db.min), 1),
                number(px.map(|px| px.p50), 2),
                number(px.map(|px| px.max), 2),
            ]
        };
        table.add_row(of(
            "the view it was made for",
            verification.rendered_psnr_db,
            verification.rendered_offset_px,
        ));
        table.add_row(of(
            "the view when it was shown",
            verification.display_psnr_db,
            verification.shown_offset_px,
        ));
        print(out, &table)?;
        verified_classes(out, verification)?;
        if verification.skipped > 0 {
            writeln!(
                out,
                "  {} more show another scene, or a step that could not be had.",
                verification.skipped
            )?;
        }
        for note in &verification.notes {
            writeln!(out, "  {note}")?;
        }
    }
    Ok(())
}

/// Verified pictures by the age of their pose and by the speed of the head.
fn verified_classes(out: &mut fmt::Formatter<'_>, verification: &VerificationReport) -> fmt::Result {
    let mut table =
        table(&["p50 by class", "pictures", "dB made", "dB shown", "shifted px", "computed px", "°"]);
    let classes = |unit, classes: &[VerifiedClass]| -> Vec<Vec<String>> {
        let p50 =
            |of: Option<Distribution>, places| of.map_or("–".to_owned(), |of| decimals(of.p50, places));
        let row = |class: &VerifiedClass| {
            let to = class.below.map_or("…".to_owned(), |below| decimals(below, 0));
            vec![
                format!("{} to {to} {unit}", decimals(class.from, 0)),
                class.pictures.to_string(),
                p50(class.rendered_psnr_db, 1),
                p50(class.display_psnr_db, 1),
                p50(class.shown_offset_px, 2),
                p50(class.registration_px, 2),
                p50(class.registration_deg, 3),
            ]
        };
        classes.iter().map(row).collect()
    };
    for row in classes("ms old", &verification.by_age_ms) {
        table.add_row(row);
    }
    for row in classes("°/s", &verification.by_speed_deg_per_sec) {
        table.add_row(row);
    }
    print(out, &table)
}

fn wrong(headset: &HeadsetReport) -> u64 {
    headset.violations.values().sum()
}

fn verdict(report: &RunReport, out: &mut fmt::Formatter<'_>) -> fmt::Result {
    writeln!(out)?;
    let all = &report.all;
    if let (Some(worst), Some(worst_hz), Some(mean_hz)) = (&all.worst, all.worst_hz, all.mean_hz) {
        let share = all.worst_over_mean.map_or("–".to_owned(), |ratio| format!("{:.0} %", ratio * 100.0));
        let worst = cut(worst, NAME);
        writeln!(
            out,
            "worst headset: {worst} with {worst_hz:.1} frames a second, {share} of the mean ({mean_hz:.1})"
        )?;
    }
    let check = all.check;
    if check.sum_violations > 0 {
        writeln!(
            out,
            "FAULT: the stages of {} of {} frames do not sum to their time from pose to decoded picture",
            check.sum_violations, check.frames
        )?;
    } else if check.frames > 0 {
        writeln!(
            out,
            "the stages of all {} frames sum to their time from pose to decoded picture",
            check.frames
        )?;
    }
    if check.negative_beyond_clock_error > 0 {
        writeln!(
            out,
            "FAULT: {} stages took less than no time, by more than the clocks' error",
            check.negative_beyond_clock_error
        )?;
    }
    for headset in report.headsets.iter().filter(|headset| wrong(headset) > 0) {
        let kinds: Vec<_> = headset.violations.iter().filter(|(_, count)| **count > 0).collect();
        let kinds: Vec<_> = kinds.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        let text = format!(
            "WRONG: {} got frames that it did not ask for: {}",
            cut(&headset.name, NAME),
            kinds.join(", ")
        );
        writeln!(out, "{}", cut(&text, WIDTH))?;
    }
    Ok(())
}

/// A table without lines but for blanks between its columns: the first to the left, all others to the right.
fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(comfy_table::presets::NOTHING);
    table.set_header(header.iter().copied());
    for (index, column) in table.column_iter_mut().enumerate() {
        column.set_padding((if index == 0 { 2 } else { 0 }, 2));
        column.set_cell_alignment(if index == 0 { CellAlignment::Left } else { CellAlignment::Right });
    }
    table
}

fn print(out: &mut fmt::Formatter<'_>, table: &Table) -> fmt::Result {
    table.lines().try_for_each(|line| writeln!(out, "{}", line.trim_end()))
}

/// Microseconds in milliseconds.
fn ms(us: Option<f64>) -> String {
    us.map_or("–".to_owned(), |us| decimals(us * 1e-3, 1))
}

/// A number with so many decimals, and never −0.
fn decimals(value: f64, places: usize) -> String {
    let text = format!("{value:.places$}");
    if text.starts_with('-') && text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.')) {
        text[1..].to_owned()
    } else {
        text
    }
}

/// The text in one line of at most `most` characters, the last of them an ellipsis if something was cut off.
fn cut(text: &str, most: usize) -> String {
    let text: String =
        text.chars().map(|character| if character.is_control() { ' ' } else { character }).collect();
    if text.chars().count() <= most {
        return text;
    }
    text.chars().take(most.saturating_sub(1)).chain(['…']).collect()
}
