//! What this machine is, as Linux tells it.

use std::fs;

/// For reports.
pub(crate) fn facts() -> report::Machine {
    let read = |path: &str| fs::read_to_string(path).unwrap_or_default();
    let os = read("/etc/os-release")
        .lines()
        .find_map(|line| Some(line.strip_prefix("PRETTY_NAME=")?.trim_matches('"').to_owned()))
        .unwrap_or_else(|| std::env::consts::OS.to_owned());
    let after_colon = |line: &str| line.split_once(':').map(|(_, value)| value.trim().to_owned());
    let cpu = read("/proc/cpuinfo").lines().find(|line| line.starts_with("model name")).and_then(after_colon);
    let memory_bytes = read("/proc/meminfo")
        .lines()
        .find(|line| line.starts_with("MemTotal:"))
        .and_then(after_colon)
        .and_then(|value| value.strip_suffix("kB")?.trim().parse::<u64>().ok())
        .map(|kilobytes| kilobytes * 1024);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    report::Machine { os, cpu, cores: u32::try_from(cores).unwrap_or(u32::MAX), memory_bytes, adapter: None }
}

/// Processes that wanted a processor in the last minute, on the mean: how quiet the machine was.
pub(crate) fn load_average() -> Option<f64> {
    fs::read_to_string("/proc/loadavg").ok()?.split_whitespace().next()?.parse().ok()
}

/// Bytes of memory that are free, or would be if they were asked for.
pub(crate) fn available_bytes() -> Option<u64> {
    let memory = fs::read_to_string("/proc/meminfo").ok()?;
    let line = memory.lines().find(|line| line.starts_with("MemAvailable:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}
