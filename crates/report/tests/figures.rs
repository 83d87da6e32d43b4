//! What the report says of a run.

use common::Chance;
use report::{
    CheckError, CsvError, FORMAT, FrameRecord, HeadsetRun, JsonError, Run, RunReport, StageNames,
    read_frames_csv, write_frames_csv,
};

mod common;

/// A headset that decoded a frame every 10 ms for a second, `frames` of them.
fn steady(name: &str, frames: u64) -> HeadsetRun {
    let record = |frame: u64| FrameRecord {
        frame,
        decoded_at_secs: 0.01 * frame as f64,
        stages_us: vec![1_000 + frame as i64, 2_000],
        pose_to_decoded_us: 3_000 + frame as i64,
        bytes: 1_000,
        resolution_scale: if frame.is_multiple_of(2) { 1.0 } else { 0.5 },
        step_scale: 0.5,
        ..FrameRecord::default()
    };
    let mut headset = HeadsetRun {
        name: name.to_owned(),
        seconds: 1.0,
        asked_hz: 100.0,
        full_step_scale: 0.5,
        frames: (0..frames).map(record).collect(),
        ..HeadsetRun::default()
    };
    headset.counters.decoded = frames;
    headset
}

fn run_of(headsets: Vec<HeadsetRun>) -> Run {
    Run { stages: StageNames::new(["first", "second"]), headsets, ..Run::default() }
}

#[test]
fn figures_of_each_headset_and_of_all_are_those_of_their_frames() {
    let report = RunReport::from(&run_of(vec![steady("a", 100), steady("b", 50)]));
    let [a, b] = &report.headsets[..] else { panic!("{report:?}") };
    assert_eq!((a.achieved_hz, b.achieved_hz), (100.0, 50.0));
    let first = a.stages[0].us.unwrap();
    assert_eq!(
        (first.count, first.min, first.p50, first.p99, first.max),
        (100, 1_000.0, 1_049.0, 1_098.0, 1_099.0)
    );
    assert_eq!(report.all.stages[0].us.unwrap().count, 150);
    assert_eq!(report.all.pose_to_decoded_us.unwrap().max, 3_099.0);
    assert_eq!(a.bit_rate.unwrap().mean_bps, 800_000.0);
    let quality = a.quality.unwrap();
    assert_eq!((quality.below_full_resolution_share, quality.mean_resolution_scale), (0.5, 0.75));
    assert_eq!((quality.above_full_step_share, quality.mean_step_scale), (0.0, 0.5));
    assert!((a.interval_us.unwrap().max - 10_000.0).abs() < 1e-6);
}

#[test]
fn the_worst_headset_is_that_with_the_least_rate() {
    let report = RunReport::from(&run_of(vec![steady("a", 100), steady("b", 60), steady("c", 80)]));
    assert_eq!(report.worst().unwrap().name, "b");
    let all = &report.all;
    assert_eq!((all.worst.as_deref(), all.worst_hz, all.mean_hz), (Some("b"), Some(60.0), Some(80.0)));
    assert_eq!(all.worst_over_mean, Some(0.75));
}

#[test]
fn the_p95_bit_rate_is_that_of_a_busy_second() {
    let mut headset = steady("a", 0);
    headset.seconds = 20.0;
    headset.started_at_secs = 5.0;
    for second in 0..20 {
        let bytes = if second < 2 { 10_000 } else { 1_000 };
        let decoded_at_secs = 5.5 + f64::from(second);
        headset.frames.push(FrameRecord { decoded_at_secs, bytes, ..FrameRecord::default() });
    }
    let rate = RunReport::from(&run_of(vec![headset])).headsets[0].bit_rate.unwrap();
    assert_eq!((rate.mean_bps, rate.p95_bps), (8.0 * 38_000.0 / 20.0, 80_000.0));
}

#[test]
fn stages_that_sum_pass_the_check() {
    let run = common::run(2, 2.0);
    let check = run.check().unwrap();
    assert_eq!(check.frames, run.headsets.iter().map(|headset| headset.frames.len() as u64).sum::<u64>());
    assert_eq!((check.sum_violations, check.negative_beyond_clock_error), (0, 0));
    assert_eq!(RunReport::from(&run).all.check, check);
}

#[test]
fn a_tampered_stage_fails_the_check() {
    let mut run = common::run(2, 2.0);
    run.headsets[1].frames[7].stages_us[3] += 1;
    let frame = run.headsets[1].frames[7].frame;
    let CheckError::Sum { headset, frame: found, sum_us, pose_to_decoded_us } = run.check().unwrap_err()
    else {
        panic!("another rule was broken");
    };
    assert_eq!(
        (headset, found, sum_us),
        (run.headsets[1].name.clone(), frame, i128::from(pose_to_decoded_us) + 1)
    );
    let report = RunReport::from(&run);
    assert_eq!((report.all.check.sum_violations, report.headsets[0].check.sum_violations), (1, 0));
    assert!(report.to_string().contains("FAULT: the stages of 1 of "), "{report}");
}

#[test]
fn a_missing_stage_fails_the_check() {
    let mut run = common::run(1, 1.0);
    run.headsets[0].frames[0].stages_us.pop();
    assert!(matches!(run.check(), Err(CheckError::StageCount { found: 9, expected: 10, .. })));
}

#[test]
fn negative_stages_are_told_apart_by_the_clocks_error() {
    let mut run = run_of(vec![steady("a", 3)]);
    for (frame, [first, second]) in run.headsets[0].frames.iter_mut().zip([[-5, 10], [-20, 30], [-21, 50]]) {
        frame.stages_us = vec![first, second];
        frame.pose_to_decoded_us = first + second;
        frame.clock_error_us = 20;
    }
    let check = run.check().unwrap();
    assert_eq!((check.negative_within_clock_error, check.negative_beyond_clock_error), (2, 1));
}

#[test]
fn json_is_read_back_as_it_was() {
    for run in [common::run(2, 3.0), common::run(1, 0.0), Run::default()] {
        let report = RunReport::from(&run);
        assert_eq!(RunReport::from_json(&report.to_json()).unwrap(), report);
    }
}

#[test]
fn json_of_another_format_is_refused() {
    let json = RunReport::from(&Run::default()).to_json();
    let other = json.replace(FORMAT, "holocast-report/999");
    assert!(
        matches!(RunReport::from_json(&other), Err(JsonError::Format { found, .. }) if found.ends_with("999"))
    );
    assert!(matches!(RunReport::from_json("{}"), Err(JsonError::Malformed(_))));
    assert!(matches!(RunReport::from_json("no"), Err(JsonError::Malformed(_))));
}

#[test]
fn every_field_of_the_json_is_documented() {
    let mut run = common::run(1, 1.0);
    run.headsets[0].violations.insert("size".to_owned(), 1);
    let report: serde_json::Value = serde_json::from_str(&RunReport::from(&run).to_json()).unwrap();
    let mut names = std::collections::BTreeSet::new();
    collect_names(&report, &mut names);
    let document = include_str!("../../../docs/report-format.md");
    // Keys of maps are data, not fields.
    let missing: Vec<_> = names
        .iter()
        .filter(|name| {
            !["size", "holocast"].contains(&name.as_str()) && !document.contains(&format!("`{name}`"))
        })
        .collect();
    assert!(missing.is_empty(), "docs/report-format.md does not tell of {missing:?}");
    let mut table = Vec::new();
    write_frames_csv(&run, &mut table).unwrap();
    let header = String::from_utf8(table).unwrap().lines().next().unwrap().to_owned();
    let columns = header
        .split(',')
        .filter(|column| !common::STAGES.iter().any(|stage| *column == format!("{stage}_us")));
    let missing: Vec<_> = columns.filter(|column| !document.contains(&format!("`{column}`"))).collect();
    assert!(missing.is_empty(), "docs/report-format.md does not tell of the columns {missing:?}");
}

fn collect_names(value: &serde_json::Value, names: &mut std::collections::BTreeSet<String>) {
    match value {
        serde_json::Value::Object(fields) => {
            names.extend(fields.keys().cloned());
            fields.values().for_each(|value| collect_names(value, names));
        }
        serde_json::Value::Array(values) => values.iter().for_each(|value| collect_names(value, names)),
        _ => {}
    }
}

#[test]
fn the_table_of_frames_is_read_back_as_it_was() {
    let mut run = common::run(2, 1.0);
    run.headsets[0].name = "a \"quoted\", long\nname".to_owned();
    let mut chance = Chance::seeded(3);
    for frame in &mut run.headsets[1].frames {
        frame.decoded_at_secs *= chance.share();
    }
    let mut table = Vec::new();
    write_frames_csv(&run, &mut table).unwrap();
    let (stages, frames) = read_frames_csv(&table[..]).unwrap();
    assert_eq!(stages, run.stages);
    let names = ["a \"quoted\", long name", &run.headsets[1].name];
    let expected =
        run.headsets.iter().zip(names).flat_map(|(headset, name)| {
            headset.frames.iter().map(move |frame| (name.to_owned(), frame.clone()))
        });
    assert_eq!(frames, expected.collect::<Vec<_>>());
}

#[test]
fn a_broken_table_of_frames_says_where() {
    let mut table = Vec::new();
    write_frames_csv(&common::run(1, 0.1), &mut table).unwrap();
    let table = String::from_utf8(table).unwrap();
    let read = |table: String| read_frames_csv(table.as_bytes()).unwrap_err();
    assert!(matches!(read(String::new()), CsvError::Header { at: 1, .. }));
    assert!(
        matches!(read(table.replace("bytes", "octets")), CsvError::Header { expected, .. } if expected == "bytes")
    );
    assert!(matches!(read(table.clone() + "desk,1\n"), CsvError::Width { found: 2, .. }));
    let broken = table.replacen("desk-1,0,", "desk-1,first,", 1);
    assert!(matches!(read(broken), CsvError::Field { line: 2, column, .. } if column == "frame"));
}

#[test]
fn the_tables_are_as_they_were() {
    let mut run = common::run(3, 10.0);
    run.headsets[1].violations.insert("black where the volume is".to_owned(), 3);
    run.headsets[2] = HeadsetRun {
        name: "one-with-a-very-long-name-indeed".to_owned(),
        device: "4096x4096".to_owned(),
        ..HeadsetRun::default()
    };
    let found = RunReport::from(&run).to_string();
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("tables.txt");
    std::fs::write(&path, &found).unwrap();
    assert!(found == include_str!("tables.txt"), "tests/tables.txt is not as {}:\n{found}", path.display());
}

#[test]
fn no_line_of_a_table_is_longer_than_a_hundred_characters() {
    let mut run = common::run(2, 5.0);
    let long = "a long name ".repeat(20);
    run.title.clone_from(&long);
    run.machine.cpu = Some(long.clone());
    for headset in &mut run.headsets {
        headset.name.clone_from(&long);
        headset.device.clone_from(&long);
        headset.trace.clone_from(&long);
        headset.violations.insert(long.clone(), 1);
        headset.counters.decoded = 10_000_000;
        headset.counters.sent = Some(10_000_000);
    }
    for line in RunReport::from(&run).to_string().lines() {
        assert!(line.chars().count() <= 100, "{} characters: {line}", line.chars().count());
    }
}

#[test]
fn a_run_without_frames_or_headsets_is_told_plainly() {
    let report = RunReport::from(&common::run(1, 0.0));
    assert_eq!((report.headsets[0].achieved_hz, report.headsets[0].quality), (0.0, None));
    assert_eq!((report.all.pose_to_decoded_us, report.all.worst_over_mean), (None, None));
    assert!(report.to_string().contains("no frames were decoded"), "{report}");
    let nobody = RunReport::from(&Run::default());
    assert_eq!((nobody.all.mean_hz, nobody.worst()), (None, None));
    assert!(nobody.to_string().contains("No headsets"), "{nobody}");
}
