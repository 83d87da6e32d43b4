//! What each command does.

mod adapters;
mod info;
mod render;
mod serve;
mod shown;

use crate::cli::Command;

/// Does what was asked.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Adapters { json } => adapters::run(json),
    }
}
