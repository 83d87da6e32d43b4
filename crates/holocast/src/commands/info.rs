//! `holocast info`.

use super::shown::{Shown, facts_of, load_options, load_volume};
use crate::cli::{Info, Look};
use crate::terminal::say;
use scene::{Preset, Window};
use std::path::Path;
use volume::LabelTable;
use volume_io::LoadOptions;
use volume_io::describe::VolumeDescription;

pub(crate) fn run(arguments: &Info) -> anyhow::Result<()> {
    if is_scene(&arguments.path) {
        return of_scene(arguments);
    }
    let options = LoadOptions { identity: arguments.identity, ..load_options(&arguments.chosen) };
    let loaded = load_volume(&arguments.path, options)?;
    let description = VolumeDescription::of(&arguments.path.display().to_string(), &loaded);
    let facts = facts_of(&loaded, &LabelTable::default(), None);
    let shown = facts.channels.iter().map(|of| {
        let Window { low, high } = Preset::suggested_window(&facts, of);
        serde_json::json!({ "channel": of.name, "preset": Preset::suggested(&facts, of), "window": [low, high] })
    });
    let shown: Vec<serde_json::Value> = shown.collect();
    if arguments.json {
        let mut all = serde_json::to_value(&description)?;
        if let Some(fields) = all.as_object_mut() {
            fields.insert("suggested".into(), shown.into());
        }
        say(serde_json::to_string_pretty(&all)?);
    } else {
        say(format!("{description}\n  to begin with"));
        for (of, shown) in facts.channels.iter().zip(&shown) {
            let window =
                if of.labels.is_some() { String::new() } else { format!(", window {}", shown["window"]) };
            say(format!(
                "  · channel '{}': --preset {}{window}",
                of.name,
                shown["preset"].as_str().unwrap_or_default()
            ));
        }
    }
    Ok(())
}

/// Whether a file is JSON that is no header of raw voxels.
fn is_scene(path: &Path) -> bool {
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) {
        return false;
    }
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let is_header = |json: serde_json::Value| json.get("raw").is_some() || json.get("dims").is_some();
    !text.is_empty() && !serde_json::from_str(&text).is_ok_and(is_header)
}

/// What a scene shows: each volume, and how it lies to the first.
fn of_scene(arguments: &Info) -> anyhow::Result<()> {
    let shown = Shown::load(Some(&arguments.path), None, &arguments.chosen, &Look::default())?;
    let first = VolumeDescription::of(&shown.volume_path.display().to_string(), &shown.loaded);
    let further = shown.in_register()?;
    if arguments.json {
        say(serde_json::to_string_pretty(
            &serde_json::json!({ "volume": first, "further_volumes": further }),
        )?);
        return Ok(());
    }
    say(first);
    further.iter().for_each(|further| say(format!("with {further}")));
    Ok(())
}
