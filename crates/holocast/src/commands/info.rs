//! `holocast info`.

use super::shown::{facts_of, load_options, load_volume};
use crate::cli::Info;
use crate::terminal::say;
use scene::{Preset, Window};
use volume::LabelTable;
use volume_io::LoadOptions;
use volume_io::describe::VolumeDescription;

pub(crate) fn run(arguments: &Info) -> anyhow::Result<()> {
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
