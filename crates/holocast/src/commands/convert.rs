//! `holocast convert`.

use super::shown::{load_options, load_volume};
use crate::cli::{Bits, Convert};
use crate::terminal::{progress, progress_done, say, tell};
use std::sync::Arc;
use volume_io::{Depth, SaveOptions, save};

pub(crate) fn run(arguments: &Convert) -> anyhow::Result<()> {
    // Said before a minute is spent on loading; the writer looks again.
    if arguments.output.exists() && !arguments.overwrite {
        anyhow::bail!("{}: is there already; --overwrite replaces it", arguments.output.display());
    }
    let loaded = load_volume(&arguments.input, load_options(&arguments.chosen))?;
    for note in &loaded.report.notes {
        tell(format!("note: {note}"));
    }
    let dims = loaded.volume.grid().dims();
    let crop = arguments.crop.map(|crop| {
        [0, 1, 2].map(|axis| {
            let [first, end] = crop.0[axis];
            first.unwrap_or(0)..end.unwrap_or(dims[axis])
        })
    });
    let options = SaveOptions {
        crop,
        channel: arguments.channel.clone(),
        depth: match arguments.bits {
            Bits::Keep => Depth::Kept,
            Bits::Eight => Depth::Eight,
            Bits::Sixteen => Depth::Sixteen,
        },
        window: arguments.window,
        overwrite: arguments.overwrite,
        progress: Some(Arc::new(|part| progress(format!("writing: {:.0} %", part * 100.0)))),
    };
    let saved = save(&arguments.output, loaded.volume, &options);
    progress_done();
    let saved = saved?;
    for note in &saved.notes {
        tell(format!("note: {note}"));
    }
    let [x, y, z] = saved.dims;
    if arguments.json {
        let files: Vec<_> = saved
            .files
            .iter()
            .map(|(path, bytes)| serde_json::json!({"file": path.display().to_string(), "bytes": bytes}))
            .collect();
        let notes = [&loaded.report.notes[..], &saved.notes[..]].concat();
        let said = serde_json::json!({"dims": saved.dims, "files": files, "notes": notes});
        say(serde_json::to_string_pretty(&said)?);
    } else {
        for (path, bytes) in &saved.files {
            say(format!("{}: {x} × {y} × {z} voxels, {bytes} bytes", path.display()));
        }
    }
    Ok(())
}
