//! `holocast info`.

use super::shown::{load_options, load_volume};
use crate::cli::Info;
use crate::terminal::say;
use volume_io::LoadOptions;
use volume_io::describe::VolumeDescription;

pub(crate) fn run(arguments: &Info) -> anyhow::Result<()> {
    let options = LoadOptions { identity: arguments.identity, ..load_options(&arguments.chosen) };
    let loaded = load_volume(&arguments.path, options)?;
    let description = VolumeDescription::of(&arguments.path.display().to_string(), &loaded);
    if arguments.json {
        say(serde_json::to_string_pretty(&description)?);
    } else {
        say(description);
    }
    Ok(())
}
