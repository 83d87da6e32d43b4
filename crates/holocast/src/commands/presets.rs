//! `holocast presets`.

use crate::terminal::say;
use scene::Preset;

pub(crate) fn run(json: bool) -> anyhow::Result<()> {
    if json {
        let of = |p: &Preset| {
            serde_json::json!({
                "name": p.name, "description": p.description, "modalities": p.modalities, "units": p.units.name(),
            })
        };
        let all: Vec<serde_json::Value> = Preset::all().iter().map(of).collect();
        say(serde_json::to_string_pretty(&all)?);
        return Ok(());
    }
    for preset in Preset::all() {
        let Preset { name, description, modalities, units, .. } = preset;
        let modalities = if modalities.is_empty() { "any".to_owned() } else { modalities.join(", ") };
        say(format!("{name:<16} {modalities:<4} {description}"));
        say(format!("{:21} values in {}", "", units.name()));
    }
    Ok(())
}
