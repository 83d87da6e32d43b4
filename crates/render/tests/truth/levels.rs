//! The levels of quality on every scene of the suite.

use crate::scenes::{Case, made, scans};
use crate::setting::{keep_failure, tell};
use crate::tolerances::{self, BALANCED_DB, DRAFT_DB, DRAFT_NOISE_DB, FINE_RMSE, MOST_JUMPS};
use reference::{Picture, Tolerance, Uncertainty, compare, judge};
use render::Quality;

/// Holds a case's picture at a level against the exact one, pixel by pixel.
fn pixels_of(
    case: &Case,
    exact: &Picture,
    level: &str,
    drawn: &Picture,
    tolerance: &Tolerance,
) -> Vec<String> {
    let reference = case.shown.reference();
    let uncertainty = Uncertainty::of_float32(&reference);
    let rays = case.shown.rays(case.eye);
    let verdict = judge(&reference, &rays, exact, drawn, tolerance, &uncertainty).unwrap();
    let all = compare(exact, drawn).unwrap();
    tell(&format!(
        "{:56} {level:8}: at most {:.3}/255, rmse {:.4}/255, depth {:.4} voxels, {} jumps",
        case.name,
        all.max_abs_error * 255.0,
        all.rmse * 255.0,
        verdict.depth_error_mm / case.voxel_mm(),
        verdict.jumps.len()
    ));
    let mut failures = Vec::new();
    if !verdict.wrong.is_empty() {
        let some = &verdict.wrong[..verdict.wrong.len().min(9)];
        failures.push(format!("{}: {level}: wrong at {some:?}", case.name));
    }
    if verdict.jumps.len() as f64 > MOST_JUMPS * verdict.pixels as f64 {
        failures.push(format!("{}: {level}: jumps at {:?}", case.name, verdict.jumps));
    }
    if !failures.is_empty() {
        keep_failure(&format!("{} {level}", case.name), exact, drawn);
    }
    failures
}

/// Holds a case at `balanced` and at `draft` against their decibels, and the depths of the first.
fn in_decibels(case: &Case, exact: &Picture) -> Vec<String> {
    let mut failures = Vec::new();
    let draft_db = if case.is_noise() { DRAFT_NOISE_DB } else { DRAFT_DB };
    for (level, quality, least) in
        [("balanced", Quality::BALANCED, BALANCED_DB), ("draft", Quality::DRAFT, draft_db)]
    {
        let drawn = case.shown.drawn(case.eye, case.size, quality, None);
        let found = compare(exact, &drawn).unwrap().psnr_db;
        tell(&format!("{:56} {level}: {found:.1} dB", case.name));
        if found < least {
            keep_failure(&format!("{} {level}", case.name), exact, &drawn);
            failures.push(format!("{}: {level}: {found} dB, expected {least}", case.name));
        }
        if level == "balanced" {
            failures.extend(pixels_of(case, exact, level, &drawn, &tolerances::balanced(case.voxel_mm())));
        }
    }
    failures
}

#[track_caller]
fn check(cases: &[Case]) {
    let mut failures = Vec::new();
    for case in cases {
        let exact = case.shown.exact(case.eye, case.size);
        let hit = exact.pixels().iter().filter(|p| p.rgba[3] > 0.01).count();
        assert!(hit * 20 > exact.pixels().len(), "{}: too little is seen: {hit} pixels", case.name);
        let drawn = |quality| case.shown.drawn(case.eye, case.size, quality, None);
        let tolerance = tolerances::exact(case.voxel_mm());
        failures.extend(pixels_of(case, &exact, "exact", &drawn(Quality::EXACT), &tolerance));
        let fine = drawn(Quality::FINE);
        failures.extend(pixels_of(case, &exact, "fine", &fine, &tolerances::fine(case.voxel_mm())));
        let rmse = compare(&exact, &fine).unwrap().rmse;
        if rmse > FINE_RMSE {
            failures.push(format!("{}: fine: rmse {rmse}", case.name));
        }
        failures.extend(in_decibels(case, &exact));
    }
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn every_mode_of_every_made_volume() {
    check(&made());
}

#[test]
fn the_bundled_scans_as_the_bundled_scenes_show_them() {
    check(&scans());
}
