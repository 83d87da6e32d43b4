//! Whether the frames' numbers hold together.

use crate::{CheckError, FrameRecord, HeadsetRun, Run, StageNames};
use serde::{Deserialize, Serialize};

/// What was found when every frame's numbers were held against each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Check {
    /// Frames that were looked at.
    pub frames: u64,
    /// Frames whose stages do not sum to the time from pose to decoded picture, to the microsecond, or that have more
    /// or fewer stages than the run. Anything but 0 is a fault of the program.
    pub sum_violations: u64,
    /// Stages that took less than no time, by no more than the clocks' error: harmless.
    pub negative_within_clock_error: u64,
    /// Stages that took less than no time by more than that: the server's times or the clock's bound are wrong.
    pub negative_beyond_clock_error: u64,
}

impl Check {
    pub(crate) fn of(headset: &HeadsetRun, names: &StageNames) -> Self {
        let mut check = Self { frames: headset.frames.len() as u64, ..Self::default() };
        for frame in &headset.frames {
            check.sum_violations += u64::from(check_frame(headset, names, frame).is_err());
            for micros in frame.stages_us.iter().filter(|micros| **micros < 0) {
                if micros.unsigned_abs() <= frame.clock_error_us {
                    check.negative_within_clock_error += 1;
                } else {
                    check.negative_beyond_clock_error += 1;
                }
            }
        }
        check
    }

    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            sum_violations: self.sum_violations + other.sum_violations,
            negative_within_clock_error: self.negative_within_clock_error + other.negative_within_clock_error,
            negative_beyond_clock_error: self.negative_beyond_clock_error + other.negative_beyond_clock_error,
        }
    }
}

impl Run {
    /// Whether each frame's stages sum to its time from pose to decoded picture. The tolerance is 0: both are whole
    /// microseconds of one clock and share their boundaries. Negative stages are counted, see [`Check`].
    ///
    /// # Errors
    /// The first frame that breaks the rule, with its numbers.
    pub fn check(&self) -> Result<Check, CheckError> {
        let mut sum = Check::default();
        for headset in &self.headsets {
            for frame in &headset.frames {
                check_frame(headset, &self.stages, frame)?;
            }
            sum = sum.plus(Check::of(headset, &self.stages));
        }
        Ok(sum)
    }
}

fn check_frame(headset: &HeadsetRun, names: &StageNames, frame: &FrameRecord) -> Result<(), CheckError> {
    if frame.stages_us.len() != names.len() {
        return Err(CheckError::StageCount {
            headset: headset.name.clone(),
            frame: frame.frame,
            found: frame.stages_us.len(),
            expected: names.len(),
        });
    }
    let sum_us: i128 = frame.stages_us.iter().copied().map(i128::from).sum();
    if sum_us != i128::from(frame.pose_to_decoded_us) {
        return Err(CheckError::Sum {
            headset: headset.name.clone(),
            frame: frame.frame,
            sum_us,
            pose_to_decoded_us: frame.pose_to_decoded_us,
        });
    }
    Ok(())
}
