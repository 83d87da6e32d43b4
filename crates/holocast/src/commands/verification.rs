//! `holocast headset --verify`: decoded pictures against the exact ones.

use crate::cli::{HeadsetArguments, Look};
use crate::commands::shown::{Shown, load_options, load_volume};
use crate::terminal::{progress, progress_done};
use headset::{FrameRecord, HeadsetRun, SampledFrame};
use report::{PictureError, Verification, VerifiedFrame};
use scene::Scene;
use std::collections::BTreeMap;
use truth::Exact;
use volume::Volume;
use volume_io::LoadOptions;

/// What the server shows, as the command line says.
pub(crate) struct Known {
    shown: Shown,
    options: LoadOptions,
}

impl Known {
    pub(crate) fn load(arguments: &HeadsetArguments) -> anyhow::Result<Self> {
        let shown = Shown::load(
            arguments.scene.as_deref(),
            arguments.volume.as_deref(),
            &arguments.chosen,
            &Look::default(),
        )?;
        Ok(Self { shown, options: load_options(&arguments.chosen) })
    }

    /// What is seen at the beginning.
    pub(crate) fn exact(&self) -> anyhow::Result<Exact<'_>> {
        Ok(Exact::of_several(&self.shown.loaded.volume, &self.shown.others(), &self.shown.scene)?)
    }

    /// A step of the series that the server plays: the volume, and the scene with its gaps filled as the server does.
    fn step(&self, step: u32) -> anyhow::Result<(Volume, Scene)> {
        let options = LoadOptions { time: u64::from(step), ..self.options.clone() };
        let volume = load_volume(&self.shown.volume_path, options)?.volume;
        let facts = self.shown.facts.with_step(&volume);
        let scene = self.shown.file.resolve_among(&facts, &self.shown.others_facts)?;
        Ok((volume, scene))
    }
}

/// Looks at the pictures that a run has put aside. Those that cannot be looked at are counted, with the reason.
pub(crate) fn verified(known: &Known, run: &HeadsetRun) -> Verification {
    // A scene that came later is not the one that is known here.
    let first = run.session.as_ref().map(|session| session.scene_revision);
    let (same, other): (Vec<_>, Vec<_>) =
        run.sampled.iter().partition(|sampled| Some(sampled.scene_revision) == first);
    let mut of_steps: BTreeMap<u32, Vec<&SampledFrame>> = BTreeMap::new();
    for sampled in &same {
        of_steps.entry(sampled.time_step).or_default().push(sampled);
    }
    let (mut frames, mut notes) = (Vec::new(), Vec::new());
    for (step, sampled) in of_steps {
        let done = frames.len();
        // Which step it is, the peer has said: it may be none.
        if let Err(error) = verified_step(known, step, &sampled, run, &mut frames, same.len()) {
            let left_out = sampled.len() - (frames.len() - done);
            notes.push(format!("{left_out} pictures of step {step} were left out: {error:#}"));
        }
    }
    frames.sort_by_key(|verified| verified.frame);
    progress_done();
    let skipped = (other.len() + same.len() - frames.len()) as u64;
    Verification { frames, skipped, notes }
}

/// Adds the pictures of one step to `frames`, which will be at most `expected`.
fn verified_step(
    known: &Known,
    step: u32,
    sampled: &[&SampledFrame],
    run: &HeadsetRun,
    frames: &mut Vec<VerifiedFrame>,
    expected: usize,
) -> anyhow::Result<()> {
    let loaded = known.shown.loaded.report.sequence.map_or(0, |sequence| sequence.loaded);
    let another = (u64::from(step) != loaded).then(|| known.step(step)).transpose()?;
    let (volume, scene) = match &another {
        Some((volume, scene)) => (volume, scene),
        None => (&known.shown.loaded.volume, &known.shown.scene),
    };
    let exact = Exact::of_several(volume, &known.shown.others(), scene)?;
    for sampled in sampled {
        progress(format!("exact pictures: {} of {expected}", frames.len()));
        frames.push(verified_frame(&exact, sampled, &run.frames)?);
    }
    Ok(())
}

/// Holds one picture against the exact ones; `records` say how old it was and how the head moved.
fn verified_frame(
    exact: &Exact<'_>,
    sampled: &SampledFrame,
    records: &[FrameRecord],
) -> anyhow::Result<VerifiedFrame> {
    let record = records.iter().find(|record| record.frame == sampled.frame);
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
        time_step: sampled.time_step,
        at_rendered_pose: error(verdict.at_rendered_pose),
        at_display_pose: error(verdict.at_display_pose),
        offset_px: verdict.offset_px,
        display_offset_px: verdict.display_offset_px,
        age_ms: record.map(|record| record.pose_to_shown_us as f64 * 1e-3),
        head_deg_per_sec: record.and_then(|record| record.head_deg_per_sec),
        registration_px: record.and_then(|record| record.registration_px),
        registration_deg: record.and_then(|record| record.registration_deg),
    })
}
