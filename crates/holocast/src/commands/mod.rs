//! What each command does.

mod adapters;
mod compare;
mod convert;
mod headset;
mod info;
mod load;
mod render;
mod reporting;
mod serve;
mod shown;
mod simulated;
mod viewpoint;

use crate::cli::Command;

/// Does what was asked.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Headset(arguments) => headset::run(&arguments),
        Command::Load(arguments) => load::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Adapters { json } => adapters::run(json),
    }
}
