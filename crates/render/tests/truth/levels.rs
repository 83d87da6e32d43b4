//! The levels of quality on every scene of the suite.

use crate::scenes::{Case, made, scans};
use crate::setting::{keep_failure, tell};
use crate::tolerances::{self, MOST_JUMPS};
use reference::{Picture, Uncertainty, compare, judge};
use render::Quality;

/// Draws a case at a level and holds it against the exact picture of it.
fn at_exact(case: &Case, exact: &Picture) -> Vec<String> {
    let drawn = case.shown.drawn(case.eye, case.size, Quality::EXACT, None);
    let reference = case.shown.reference();
    let voxel_mm = case.shown.volume.grid().spacing_mm().min_element();
    let verdict = judge(
        &reference,
        &case.shown.rays(case.eye),
        exact,
        &drawn,
        &tolerances::exact(voxel_mm),
        &Uncertainty::of_float32(&reference),
    )
    .unwrap();
    let all = compare(exact, &drawn).unwrap();
    tell(&format!(
        "{:58} exact: at most {:.3}/255, rmse {:.4}/255, depth {:.4} voxels, {} jumps",
        case.name,
        all.max_abs_error * 255.0,
        all.rmse * 255.0,
        verdict.depth_error_mm / voxel_mm,
        verdict.jumps.len()
    ));
    let mut failures = Vec::new();
    if !verdict.wrong.is_empty() {
        failures.push(format!("{}: wrong at {:?}", case.name, &verdict.wrong[..verdict.wrong.len().min(9)]));
    }
    if verdict.jumps.len() as f64 > MOST_JUMPS * verdict.pixels as f64 {
        failures.push(format!("{}: jumps at {:?}", case.name, verdict.jumps));
    }
    if !failures.is_empty() {
        keep_failure(&case.name, exact, &drawn);
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
        failures.extend(at_exact(case, &exact));
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
