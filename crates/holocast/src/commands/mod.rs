//! What each command does.

mod accuracy;
mod adapters;
mod bench_registration;
mod bench_render;
mod bench_scale;
mod compare;
mod contact_sheet;
mod convert;
mod headset;
mod info;
mod load;
mod presets;
mod render;
mod reporting;
mod series;
mod serve;
mod shown;
mod simulated;
mod verification;
mod viewpoint;

use crate::cli::{Bench, Command};

/// Does what was asked.
pub(crate) fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Headset(arguments) => headset::run(&arguments),
        Command::Load(arguments) => load::run(&arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Compare(arguments) => compare::run(&arguments),
        Command::Bench(Bench::Accuracy(arguments)) => accuracy::run(&arguments),
        Command::Bench(Bench::Render(arguments)) => bench_render::run(&arguments),
        Command::Bench(Bench::Scale(arguments)) => bench_scale::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Bench(Bench::Registration(arguments)) => bench_registration::run(&arguments),
        Command::Presets { json } => presets::run(json),
        Command::ContactSheet(arguments) => contact_sheet::run(&arguments),
        Command::Adapters { json } => adapters::run(json),
    }
}
