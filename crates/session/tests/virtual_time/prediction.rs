//! Whether frames are made for where the head will be.

use crate::world::*;
use session::{Prediction, ServerSettings};
use spatial::DVec3;
use std::time::Duration;

/// Mean error of the left eye against where it really was at the display time: metres and radians.
fn errors(prediction: Prediction) -> (f64, f64) {
    let settings = ServerSettings { prediction, ..ServerSettings::default() };
    let mut world = World::new(Setup { settings, ..Setup::default() });
    world.run_until(10.0);
    let shown: Vec<_> = world.shown.iter().filter(|shown| shown.decoded_at > 1_000_000).collect();
    assert!(shown.len() > 500);
    let geometry = device().geometry;
    let (mut metres, mut radians) = (0.0, 0.0);
    for frame in &shown {
        let head = walk(frame.display_at as f64 * 1e-6);
        let truth = geometry.view(&head).eyes[0].world_from_eye;
        metres += (frame.left_eye.position_m - truth.position_m).length();
        radians += frame.left_eye.angle_to(&truth);
    }
    (metres / shown.len() as f64, radians / shown.len() as f64)
}

#[test]
fn prediction_brings_the_picture_nearer_to_the_truth() {
    let (metres, radians) = errors(Prediction::default());
    let (metres_without, radians_without) = errors(Prediction { enabled: false, ..Prediction::default() });
    assert!(metres < metres_without / 5.0, "{metres} m against {metres_without} m");
    assert!(radians < radians_without / 5.0, "{radians} rad against {radians_without} rad");
}

#[test]
fn a_shorter_horizon_predicts_less() {
    let (metres, _) = errors(Prediction::default());
    let half = Prediction { enabled: true, horizon: Duration::from_millis(25) };
    let (metres_half, _) = errors(half);
    assert!(metres < metres_half, "{metres} m against {metres_half} m");
}

#[test]
fn without_prediction_the_pose_is_used_as_it_came() {
    let settings = ServerSettings {
        prediction: Prediction { enabled: false, ..Prediction::default() },
        ..ServerSettings::default()
    };
    let mut world = World::new(Setup { settings, ..Setup::default() });
    world.run_until(2.0);
    let last = world.shown.last().expect("frames have come");
    let sampled_at = last.display_at - 50_000;
    let eye = device().geometry.view(&walk(sampled_at as f64 * 1e-6)).eyes[0].world_from_eye;
    assert!((last.left_eye.position_m - eye.position_m).abs().cmple(DVec3::splat(1e-6)).all());
}
