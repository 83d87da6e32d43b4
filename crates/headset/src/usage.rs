//! What this process uses of its machine.

use serde::Serialize;
use std::fs;

/// Ticks in which Linux tells processor time to programs, a second: `USER_HZ`, 100 on all that it runs on.
const TICKS_PER_SECOND: f64 = 100.0;

/// What this process has used; `None` where the system does not tell (it is read from Linux's `/proc`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ProcessUsage {
    /// Processor time of all threads, user and system, in seconds.
    pub cpu_secs: Option<f64>,
    /// Resident memory now, in bytes.
    pub rss_bytes: Option<u64>,
    /// The most resident memory so far, in bytes.
    pub rss_peak_bytes: Option<u64>,
}

impl ProcessUsage {
    /// As it is now.
    #[must_use]
    pub fn now() -> Self {
        let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
        Self {
            cpu_secs: fs::read_to_string("/proc/self/stat").ok().and_then(|stat| cpu_secs(&stat)),
            rss_bytes: kilobytes(&status, "VmRSS:"),
            rss_peak_bytes: kilobytes(&status, "VmHWM:"),
        }
    }

    /// This usage, with the processor time counted from `earlier` on.
    #[must_use]
    pub fn since(self, earlier: &Self) -> Self {
        let cpu_secs = self.cpu_secs.zip(earlier.cpu_secs).map(|(now, then)| now - then);
        Self { cpu_secs, ..self }
    }
}

/// Fields 14 and 15 of proc(5)'s `stat`. The second field is the program's name in brackets and may hold anything.
fn cpu_secs(stat: &str) -> Option<f64> {
    let after_name = &stat[stat.rfind(')')? + 1..];
    let mut fields = after_name.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / TICKS_PER_SECOND)
}

fn kilobytes(status: &str, name: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()?.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_s_name_may_hold_brackets_and_spaces() {
        let stat = "42 (a b) c) S 1 2 3 4 5 6 7 8 9 10 250 50 0 0 20 0";
        assert_eq!(cpu_secs(stat), Some(3.0));
        assert_eq!(cpu_secs("42 (cut) S 1 2"), None);
        assert_eq!(cpu_secs(""), None);
    }

    #[test]
    fn memory_is_told_in_kilobytes() {
        let status = "Name:\tx\nVmHWM:\t    2048 kB\nVmRSS:\t 1024 kB\n";
        assert_eq!(kilobytes(status, "VmRSS:"), Some(1 << 20));
        assert_eq!(kilobytes(status, "VmHWM:"), Some(2 << 20));
        assert_eq!(kilobytes(status, "VmSwap:"), None);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn this_process_uses_something() {
        let usage = ProcessUsage::now();
        assert!(usage.rss_bytes > Some(100_000) && usage.rss_peak_bytes >= usage.rss_bytes);
        assert!(usage.since(&usage).cpu_secs == Some(0.0));
    }
}
