//! `holocast info`.

use crate::cli::Info;
use crate::terminal::say;
use volume_io::LoadOptions;
use volume_io::describe::VolumeDescription;

pub(crate) fn run(arguments: &Info) -> anyhow::Result<()> {
    let loaded = volume_io::load(&arguments.path, &LoadOptions::default())?;
    let description = VolumeDescription::of(&arguments.path.display().to_string(), &loaded);
    if arguments.json {
        say(serde_json::to_string_pretty(&description)?);
    } else {
        say(description);
    }
    Ok(())
}
