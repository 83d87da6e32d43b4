//! How a series in time is played.

use crate::error::{SceneError, within};

/// Fastest play, steps per second: displays show no more.
const MOST_STEPS_PER_SEC: f64 = 60.0;

/// How a series in time is played, round and round. It concerns who shows a scene for a while; a still shows one step.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(deny_unknown_fields, default)]
pub struct Play {
    /// Steps per second, 0 to 60; 0 stands still.
    pub steps_per_sec: f64,
    /// The step to begin with, counted from 0. Default: the one on view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<u32>,
}

impl Play {
    pub(crate) fn check(&self) -> Result<(), SceneError> {
        within(
            "play.steps_per_sec",
            self.steps_per_sec,
            0.0..=MOST_STEPS_PER_SEC,
            "0 to 60 steps per second",
        )?;
        Ok(())
    }

    /// Refuses to play what has no steps, or to begin with one that is not there. `steps` is how many the first volume's
    /// series has; `None` if it is no series.
    ///
    /// # Errors
    /// If it cannot be played, with what it has instead.
    pub fn check_among(&self, steps: Option<u32>) -> Result<(), SceneError> {
        let steps = steps.ok_or(SceneError::NoSeries)?;
        match self.from {
            Some(from) if from >= steps => Err(SceneError::NoSuchStep { wanted: from, steps }),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SceneFile;

    #[test]
    fn only_a_series_is_played_and_only_from_a_step_that_it_has() {
        let play = Play { steps_per_sec: 4.0, from: Some(9) };
        assert_eq!(play.check_among(Some(10)), Ok(()));
        assert_eq!(
            play.check_among(Some(9)).unwrap_err().to_string(),
            "play.from: expected a step of 0 to 8, found 9"
        );
        assert_eq!(
            play.check_among(None).unwrap_err().to_string(),
            "play: expected a volume that is a series in time, found one of a single step; leave the field out"
        );
        assert_eq!(Play::default().check_among(Some(2)), Ok(()));
    }

    #[test]
    fn a_rate_that_no_display_shows_is_refused() {
        for rate in ["-1", "60.5", "1e300"] {
            let error =
                SceneFile::from_json(&format!(r#"{{"play": {{"steps_per_sec": {rate}}}}}"#)).unwrap_err();
            assert!(error.to_string().contains("play.steps_per_sec"), "{error}");
        }
        assert!(SceneFile::from_json(r#"{"play": {"from": -1}}"#).is_err());
        let file = SceneFile::from_json(r#"{"play": {"steps_per_sec": 12.5}}"#).unwrap();
        assert_eq!(file.play, Some(Play { steps_per_sec: 12.5, from: None }));
        assert_eq!(SceneFile::from_json(&file.to_json()), Ok(file));
    }
}
