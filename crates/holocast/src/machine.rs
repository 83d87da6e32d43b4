//! What this machine is, as Linux tells it.

use rustix::process::{Pid, setpriority_process};
use std::fs;

/// How Mesa's software driver calls the threads that cast rays.
const RAY_THREADS: &str = "llvmpipe-";
/// How much nicer they are than all others of this process.
const RAYS_NICE: i32 = 5;

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

/// Lets the rays of Mesa's software driver go behind the rest of this process where both want a core. Rays want all cores
/// all the time, for milliseconds; who hands a frame on wants one for microseconds, and would wait for the end of a time
/// slice. Returns how many threads that were; what the system refuses stays as it is.
pub(crate) fn put_rays_behind() -> usize {
    let is_ray_thread = |task: &fs::DirEntry| {
        fs::read_to_string(task.path().join("comm")).is_ok_and(|name| name.starts_with(RAY_THREADS))
    };
    let tasks = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    tasks
        .filter(is_ray_thread)
        .filter_map(|task| Pid::from_raw(task.file_name().to_str()?.parse().ok()?))
        // To Linux, a thread is a process here.
        .filter(|thread| setpriority_process(Some(*thread), RAYS_NICE).is_ok())
        .count()
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    /// Field 19 of proc(5)'s `stat`, of the thread that asks.
    fn niceness() -> i32 {
        let stat = fs::read_to_string("/proc/thread-self/stat").unwrap();
        stat[stat.rfind(')').unwrap() + 1..].split_whitespace().nth(16).unwrap().parse().unwrap()
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn rays_go_behind_and_nobody_else() {
        let (begin, begun) = mpsc::channel::<()>();
        let (run, runs) = mpsc::channel();
        let before = niceness();
        let rays = std::thread::Builder::new().name(format!("{RAY_THREADS}9")).spawn(move || {
            run.send(()).unwrap();
            begun.recv().unwrap();
            niceness()
        });
        // The name is there when the thread runs, not when it is asked for.
        runs.recv().unwrap();
        assert!(put_rays_behind() >= 1, "the system refuses to let a thread go behind");
        begin.send(()).unwrap();
        assert_eq!(rays.unwrap().join().unwrap(), RAYS_NICE);
        assert_eq!(niceness(), before);
    }
}
