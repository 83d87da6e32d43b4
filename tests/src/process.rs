//! What this process holds, as Linux tells it.

use std::fs;

/// Resident memory in bytes.
#[must_use]
pub fn resident_bytes() -> u64 {
    headset::ProcessUsage::now().rss_bytes.expect("Linux tells a process's memory")
}

/// Names of its threads, sorted.
#[must_use]
pub fn threads() -> Vec<String> {
    let tasks = fs::read_dir("/proc/self/task").expect("Linux tells a process's threads");
    let mut names: Vec<String> = tasks
        .flatten()
        .filter_map(|task| fs::read_to_string(task.path().join("comm")).ok())
        .map(|name| name.trim().to_owned())
        .collect();
    names.sort();
    names
}

/// How many files and sockets it has open.
#[must_use]
pub fn open_files() -> usize {
    fs::read_dir("/proc/self/fd").expect("Linux tells a process's open files").count()
}
