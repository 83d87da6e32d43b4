//! Running the binary.

use std::ffi::OsStr;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

/// Far longer than anything takes on a loaded machine.
pub(crate) const PATIENCE: Duration = Duration::from_secs(120);

/// The binary with arguments, away from whatever this machine is set up with.
pub(crate) fn holocast<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_holocast"));
    // Some Vulkan drivers complain without a folder of their own.
    command.args(arguments).env("XDG_RUNTIME_DIR", std::env::temp_dir()).env_remove("RUST_LOG");
    command
}

/// What the binary said, and how it ended.
#[derive(Debug)]
pub(crate) struct Said {
    pub(crate) status: ExitStatus,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl From<Output> for Said {
    fn from(output: Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self { status: output.status, out: text(&output.stdout), err: text(&output.stderr) }
    }
}

/// Runs the binary to its end.
pub(crate) fn run<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Said {
    holocast(arguments).stdin(Stdio::null()).output().unwrap().into()
}

impl Said {
    /// Panics unless it went well; gives what came on standard output.
    #[track_caller]
    pub(crate) fn well(self) -> String {
        assert!(self.status.success(), "{}:\n{}{}", self.status, self.out, self.err);
        self.out
    }

    /// Panics unless it went well and said JSON and nothing else.
    #[track_caller]
    pub(crate) fn json(self) -> serde_json::Value {
        let out = self.well();
        serde_json::from_str(&out).unwrap_or_else(|error| panic!("{error} in:\n{out}"))
    }

    /// Panics unless it failed, said nothing on standard output, and why on standard error.
    #[track_caller]
    pub(crate) fn failed(self, why: &[&str]) {
        assert!(self.status.code().is_some_and(|code| code != 0), "{}: {}", self.status, self.err);
        assert_eq!(self.out, "", "what went wrong goes to standard error");
        for part in why {
            assert!(self.err.contains(part), "expected '{part}' in:\n{}", self.err);
        }
        assert!(!self.err.contains("panicked"), "{}", self.err);
    }
}

impl Said {
    /// Panics unless it failed and said why, whatever it had to report before.
    #[track_caller]
    pub(crate) fn failed_after_report(self, why: &[&str]) {
        Self { out: String::new(), ..self }.failed(why);
    }
}

/// Text of a path, which the tests themselves have made.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A server that runs beside the test; killed if the test forgets it.
pub(crate) struct Running {
    child: Child,
    out: BufReader<ChildStdout>,
}

impl Running {
    pub(crate) fn start<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Self {
        let mut child = holocast(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self { child, out }
    }

    /// The next line on its standard output.
    pub(crate) fn line(&mut self) -> String {
        let mut line = String::new();
        self.out.read_line(&mut line).unwrap();
        if line.is_empty() {
            let mut err = String::new();
            self.child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
            panic!("it ended without a word on standard output:\n{err}");
        }
        line
    }

    /// What Ctrl-C does.
    pub(crate) fn interrupt(&self) {
        let status = Command::new("kill").args(["-INT", &self.child.id().to_string()]).status().unwrap();
        assert!(status.success());
    }

    /// Waits for its end.
    pub(crate) fn end(mut self) -> Said {
        let begun = Instant::now();
        let status = loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(begun.elapsed() < PATIENCE, "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        };
        let (mut out, mut err) = (String::new(), String::new());
        self.out.read_to_string(&mut out).unwrap();
        self.child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        Said { status, out, err }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
