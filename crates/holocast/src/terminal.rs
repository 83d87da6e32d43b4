//! What people see on the terminal: results on standard output, everything else on standard error.
#![expect(clippy::print_stderr, reason = "this is the one place that talks to the terminal")]

use std::io::{IsTerminal as _, Write as _};

/// Logs to standard error: warnings, with -v information, with -vv all. `RUST_LOG` overrides.
pub(crate) fn start_logging(verbose: u8) {
    let default = match verbose {
        // A server tells who comes and goes; everything else is quiet unless something is wrong.
        0 => "warn,server=info",
        1 => "info",
        _ => "debug",
    };
    let filter = tracing_subscriber::EnvFilter::try_from_default_env()
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new(default));
    let ansi = std::io::stderr().is_terminal();
    tracing_subscriber::fmt().with_env_filter(filter).with_ansi(ansi).with_writer(std::io::stderr).init();
}

/// Prints a result.
pub(crate) fn say(text: impl std::fmt::Display) {
    // A reader that has gone away, as in `| head`, is no error.
    let _ = writeln!(std::io::stdout(), "{text}");
}

/// Tells what went wrong and why.
pub(crate) fn complain(error: &anyhow::Error) {
    eprintln!("holocast: {}", in_words(error));
}

/// An error and its causes in one line. A library's message often holds its cause's, which is not said twice.
fn in_words(error: &anyhow::Error) -> String {
    let mut words = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if words.is_empty() {
            words = cause;
        } else if !words.contains(&cause) {
            words += ": ";
            words += &cause;
        }
    }
    words
}

/// Tells what goes on, to a person who may be waiting.
pub(crate) fn tell(text: impl std::fmt::Display) {
    eprintln!("{text}");
}

/// A line that is written over, on a terminal only.
pub(crate) fn progress(text: impl std::fmt::Display) {
    if std::io::stderr().is_terminal() {
        eprint!("\r\x1b[2K{text}");
    }
}

/// Ends a line of progress.
pub(crate) fn progress_done() {
    if std::io::stderr().is_terminal() {
        eprint!("\r\x1b[2K");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context as _;

    #[test]
    fn a_cause_is_said_once() {
        let cause = || std::io::Error::other("the disk is full");
        assert_eq!(in_words(&cause().into()), "the disk is full");
        let in_context = Err::<(), _>(cause()).context("film.mp4").unwrap_err();
        assert_eq!(in_words(&in_context), "film.mp4: the disk is full");
        let missing = volume_io::load("nowhere.nii", &volume_io::LoadOptions::default());
        let words = in_words(&missing.unwrap_err().into());
        assert_eq!(words.matches("No such file").count(), 1, "{words}");
    }
}
