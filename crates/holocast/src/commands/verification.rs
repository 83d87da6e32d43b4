//! `holocast headset --verify`: decoded pictures against the exact ones.

use crate::cli::{HeadsetArguments, Look};
use crate::commands::shown::Shown;
use crate::terminal::{progress, progress_done};
use headset::{HeadsetRun, SampledFrame};
use report::{PictureError, Verification, VerifiedFrame};
use truth::Exact;

/// What the server shows, as the command line says.
pub(crate) struct Known(Shown);

impl Known {
    pub(crate) fn load(arguments: &HeadsetArguments) -> anyhow::Result<Self> {
        Ok(Self(Shown::load(
            arguments.scene.as_deref(),
            arguments.volume.as_deref(),
            &arguments.chosen,
            &Look::default(),
        )?))
    }

    pub(crate) fn exact(&self) -> anyhow::Result<Exact<'_>> {
        Ok(Exact::of_several(&self.0.loaded.volume, &self.0.others(), &self.0.scene)?)
    }
}

/// Looks at the pictures that a run has put aside.
pub(crate) fn verified(known: &Known, run: &HeadsetRun) -> anyhow::Result<Verification> {
    let exact = known.exact()?;
    // A scene that came later is not the one that is known here.
    let first = run.session.as_ref().map(|session| session.scene_revision);
    let (same, other): (Vec<_>, Vec<_>) =
        run.sampled.iter().partition(|sampled| Some(sampled.scene_revision) == first);
    let mut frames = Vec::new();
    for (index, sampled) in same.iter().enumerate() {
        progress(format!("exact pictures: {index} of {}", same.len()));
        frames.push(verified_frame(&exact, sampled)?);
    }
    progress_done();
    Ok(Verification { frames, skipped: other.len() as u64 })
}

fn verified_frame(exact: &Exact<'_>, sampled: &SampledFrame) -> anyhow::Result<VerifiedFrame> {
    let verdict = exact.verify(&truth::Shown {
        rendered: sampled.rendered,
        seen_from: sampled.seen_from,
        eye_size_px: sampled.eye_size_px,
        rgb8: sampled.rgb8.clone(),
    })?;
    let error = |error: truth::PictureError| PictureError {
        psnr_db: error.psnr_db,
        rmse: error.rmse,
        max_error: error.max,
    };
    Ok(VerifiedFrame {
        frame: sampled.frame,
        at_rendered_pose: error(verdict.at_rendered_pose),
        at_display_pose: error(verdict.at_display_pose),
        offset_px: verdict.offset_px,
        display_offset_px: verdict.display_offset_px,
    })
}
