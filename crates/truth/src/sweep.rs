//! The registration error of a recorded head, by the age of its pose.

use spatial::{DVec3, Displacement, HeadGeometry, Pose, PoseAt, Predictor, displacement};
use trace::{Ending, Trace};

/// Time over which the head's speed is told. It is the same for every age, so that each has the same heads in each
/// speed's class.
const SPEED_SECS: f64 = 0.1;
/// Before a pose, a prediction may hang on poses of this long ago: that long a jump of the recording spoils it.
const LOOKS_BACK_SECS: f64 = 0.15;

/// What is swept.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepSettings {
    /// Poses that the headset sends, a second.
    pub poses_hz: f64,
    /// Ages: seconds from the pose to the display of its picture.
    pub ages_secs: Vec<f64>,
    /// The headset's eyes.
    pub geometry: HeadGeometry,
    /// Width and height of one eye's picture, in pixels.
    pub size_px: [u32; 2],
    /// How far before the head the points are whose displacement is told, in metres.
    pub distance_m: f64,
    /// Where these points stand for the head at display time: tangents to the right and up of straight ahead. They go
    /// with the head, so that there is always something to be seen, wherever a person looks.
    pub points: Vec<[f64; 2]>,
}

/// One pose of the recording at one age.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// When the pose was taken, in seconds of the recording.
    pub at_secs: f64,
    /// From the pose to the display.
    pub age_secs: f64,
    /// How fast the head turned in the tenth of a second after the pose, degrees a second.
    pub speed_deg_per_sec: f64,
    /// Where the head was at display time.
    pub truth: Pose,
    /// Without prediction.
    pub as_it_came: Pair,
    /// With it.
    pub predicted: Pair,
}

/// A head's pose that a picture is made for, and what comes of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// The pose.
    pub pose: Pose,
    /// Mean over the points and both eyes; `None` if the picture has nothing of what is before the head at display time.
    pub displacement: Option<Displacement>,
}

/// Goes through a recording from beginning to end, and through all ages at each pose. Where the recording jumps nothing is
/// told: nobody can foresee that. The same settings give the same samples, to the last bit.
#[must_use]
pub fn sweep(trace: &Trace, settings: &SweepSettings) -> Vec<Sample> {
    let mut predictor = Predictor::default();
    let mut samples = Vec::new();
    let longest_secs = settings.ages_secs.iter().copied().fold(SPEED_SECS, f64::max);
    let pose_at = |time_secs: f64| trace.sample(time_secs, Ending::Hold);
    let mut tick = 0u32;
    loop {
        let at_secs = f64::from(tick) / settings.poses_hz;
        tick += 1;
        if at_secs + longest_secs > trace.duration_secs() {
            return samples;
        }
        let pose = pose_at(at_secs);
        predictor.take(PoseAt { time_secs: at_secs, pose });
        if at_secs < LOOKS_BACK_SECS
            || trace.jumps_between(at_secs - LOOKS_BACK_SECS, at_secs + longest_secs, Ending::Hold)
        {
            continue;
        }
        let speed_deg_per_sec = pose.angle_to(&pose_at(at_secs + SPEED_SECS)).to_degrees() / SPEED_SECS;
        for &age_secs in &settings.ages_secs {
            let truth = pose_at(at_secs + age_secs);
            let pair = |pose: Pose| Pair { pose, displacement: settings.mean_displacement(&pose, &truth) };
            samples.push(Sample {
                at_secs,
                age_secs,
                speed_deg_per_sec,
                truth,
                as_it_came: pair(pose),
                predicted: pair(predictor.predicted(age_secs).unwrap_or(pose)),
            });
        }
    }
}

impl SweepSettings {
    /// What a picture made for one head shows wrongly to another, on the mean over the points and both eyes.
    fn mean_displacement(&self, rendered: &Pose, shown: &Pose) -> Option<Displacement> {
        let [rendered_view, shown_view] = [rendered, shown].map(|head| self.geometry.view(head));
        let (mut sum, mut count) = (Displacement::default(), 0.0);
        for &[right, up] in &self.points {
            let point = shown.position_m
                + shown.orientation * (DVec3::new(right, up, -1.0).normalize() * self.distance_m);
            for (rendered, shown) in rendered_view.eyes.iter().zip(&shown_view.eyes) {
                if let Some(found) = displacement(rendered, shown, point, self.size_px) {
                    sum.angle_deg += found.angle_deg;
                    sum.px += found.px;
                    count += 1.0;
                }
            }
        }
        (count > 0.0).then(|| Displacement { angle_deg: sum.angle_deg / count, px: sum.px / count })
    }
}

/// Two heads, moved together so that the second has `target_in_world` straight ahead and level at a distance in metres:
/// what the first sees of the room's hologram is then as wrong for the second as it was in the recording, and the
/// hologram is there to be seen.
#[must_use]
pub fn facing(heads: [Pose; 2], target_in_world: DVec3, distance_m: f64) -> [Pose; 2] {
    let [first, second] = heads;
    let there = Pose { position_m: target_in_world + DVec3::Z * distance_m, ..Pose::IDENTITY };
    let from_second = second.orientation.conjugate();
    let first_on_second = Pose {
        position_m: from_second * (first.position_m - second.position_m),
        orientation: from_second * first.orientation,
    };
    [there.then(&first_on_second), there]
}

#[cfg(test)]
mod tests {
    use super::*;
    use spatial::{DQuat, Fov};

    const AGES_SECS: [f64; 5] = [0.0, 0.0166, 0.033, 0.05, 0.1];

    /// HoloLens 1 with both eyes in the middle of the head, and one point straight ahead.
    fn settings() -> SweepSettings {
        let fov = Fov::symmetric(30f64.to_radians(), 17.5f64.to_radians()).unwrap();
        SweepSettings {
            poses_hz: 60.0,
            ages_secs: AGES_SECS.to_vec(),
            geometry: HeadGeometry::parallel(0.0, fov),
            size_px: [1268, 720],
            distance_m: 2.0,
            points: vec![[0.0, 0.0]],
        }
    }

    /// Two seconds of a head, ten poses a second apart from each other: between them it moves evenly.
    fn trace(pose_at: impl Fn(f64) -> Pose) -> Trace {
        let line = |i: u32| {
            let time = f64::from(i) / 100.0;
            let Pose { position_m: p, orientation: q } = pose_at(time);
            format!("{time} {} {} {} {} {} {} {}\n", p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        };
        Trace::parse("made", (0..=200).map(line).collect::<String>().as_bytes()).unwrap()
    }

    fn turning(degrees_a_second: f64) -> Trace {
        trace(|time| Pose {
            orientation: DQuat::from_rotation_y((degrees_a_second * time).to_radians()),
            ..Pose::IDENTITY
        })
    }

    #[test]
    fn a_steady_turn_displaces_by_speed_times_age_and_prediction_takes_all_of_it() {
        let focal_px = 634.0 / 15f64.to_radians().tan();
        for degrees_a_second in [10.0, 50.0, 100.0] {
            let samples = sweep(&turning(degrees_a_second), &settings());
            assert!(samples.len() > 90 * AGES_SECS.len());
            for sample in samples {
                let expected_deg = degrees_a_second * sample.age_secs;
                let found = sample.as_it_came.displacement.unwrap();
                assert!((found.angle_deg - expected_deg).abs() < 1e-6, "{sample:?}");
                assert!((found.px - focal_px * expected_deg.to_radians().tan()).abs() < 1e-3, "{sample:?}");
                assert!((sample.speed_deg_per_sec - degrees_a_second).abs() < 1e-6);
                let found = sample.predicted.displacement.unwrap();
                assert!(found.angle_deg < 1e-6 && found.px < 1e-3, "{sample:?}");
            }
        }
    }

    #[test]
    fn at_50_degrees_a_second_and_50_ms_a_picture_is_two_and_a_half_degrees_off() {
        let samples = sweep(&turning(50.0), &SweepSettings { ages_secs: vec![0.05], ..settings() });
        let found = samples[0].as_it_came.displacement.unwrap();
        assert!((found.angle_deg - 2.5).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn a_step_aside_displaces_by_the_angle_that_it_takes_up() {
        let walking = trace(|time| Pose { position_m: DVec3::new(0.8 * time, 1.6, 0.0), ..Pose::IDENTITY });
        for sample in sweep(&walking, &settings()) {
            let found = sample.as_it_came.displacement.unwrap();
            let expected = (0.8 * sample.age_secs / 2.0).atan().to_degrees();
            assert!((found.angle_deg - expected).abs() < 1e-6, "{sample:?}");
            assert!(sample.predicted.displacement.unwrap().angle_deg < 1e-6);
        }
    }

    #[test]
    fn prediction_overshoots_a_head_that_stops_at_once() {
        let stopping = trace(|time| Pose {
            orientation: DQuat::from_rotation_y((50.0 * time.min(1.0)).to_radians()),
            ..Pose::IDENTITY
        });
        let worst = |of: fn(&Sample) -> Pair| {
            let samples = sweep(&stopping, &SweepSettings { ages_secs: vec![0.05], ..settings() });
            let after = samples.iter().filter(|sample| sample.at_secs > 0.999).map(of);
            after.filter_map(|pair| pair.displacement).map(|d| d.angle_deg).fold(0.0, f64::max)
        };
        assert!(worst(|sample| sample.as_it_came) < 1e-6, "a head at rest");
        assert!((worst(|sample| sample.predicted) - 2.5).abs() < 0.1, "a head that was thought to go on");
    }

    #[test]
    fn a_jump_of_the_recording_is_left_out() {
        let jumping = trace(|time| Pose {
            position_m: DVec3::new(if time < 1.0 { 0.0 } else { 3.0 }, 1.6, 0.0),
            ..Pose::IDENTITY
        });
        let samples = sweep(&jumping, &settings());
        assert!(samples.len() > 60 * AGES_SECS.len());
        assert!(samples.iter().all(|sample| sample.at_secs < 0.91 || sample.at_secs > 1.14));
        assert!(samples.iter().all(|s| s.predicted.displacement.unwrap().angle_deg < 1e-9));
    }

    #[test]
    fn heads_are_moved_together() {
        let second = Pose { position_m: DVec3::new(4.0, 1.0, 2.0), orientation: DQuat::from_rotation_y(2.0) };
        let on_second =
            Pose { position_m: DVec3::new(0.02, 0.0, 0.01), orientation: DQuat::from_rotation_x(0.1) };
        let target = DVec3::new(0.0, 1.5, -2.0);
        let [first, there] = facing([second.then(&on_second), second], target, 1.6);
        assert!((there.position_m - DVec3::new(0.0, 1.5, -0.4)).length() < 1e-12);
        assert_eq!(there.orientation, DQuat::IDENTITY);
        assert!((first.position_m - there.position_m - on_second.position_m).length() < 1e-12);
        assert!(first.angle_to(&on_second) < 1e-12);
    }
}
