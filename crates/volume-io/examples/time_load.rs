//! How long loading takes: `time_load load|read PATH TIMES` prints seconds of each turn, bytes of voxels, and the memory of
//! the process before the first turn and at its peak, as JSON. `read` does not load: it reads the files of a folder on all cores into memory that was never touched,
//! which no loader can be faster than. `tools/measure_volumes` calls it.
#![expect(clippy::print_stdout, reason = "an example talks to its caller")]

use rayon::prelude::*;
use std::fs::File;
use std::io::Read as _;
use std::path::PathBuf;
use std::time::Instant;
use volume_io::{LoadOptions, load};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [what, path, times] = arguments.as_slice() else {
        return Err("expected load|read PATH TIMES".into());
    };
    let before = memory("VmRSS:");
    let (mut secs, mut bytes) = (Vec::new(), 0);
    for _ in 0..times.parse()? {
        let start = Instant::now();
        bytes = match what.as_str() {
            "load" => load(path, &LoadOptions::default())?.volume.sample_bytes(),
            "read" => read(path)?,
            _ => return Err("expected load or read".into()),
        };
        secs.push(start.elapsed().as_secs_f64());
    }
    let peak = memory("VmHWM:");
    println!("{{\"secs\": {secs:?}, \"bytes\": {bytes}, \"before_kib\": {before}, \"peak_kib\": {peak}}}");
    Ok(())
}

/// A figure of this process's memory in KiB. Linux counts it; elsewhere there is none.
fn memory(figure: &str) -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix(figure));
    line.map_or("null", |l| l.trim().trim_end_matches(" kB")).to_owned()
}

/// Reads the files of a folder behind each other into fresh memory; gives back how many bytes they have.
fn read(folder: &str) -> std::io::Result<usize> {
    let files = std::fs::read_dir(folder)?
        .map(|entry| Ok(entry?.path()))
        .collect::<std::io::Result<Vec<PathBuf>>>()?;
    let lengths =
        files.iter().map(|f| Ok(f.metadata()?.len() as usize)).collect::<std::io::Result<Vec<_>>>()?;
    let total = lengths.iter().sum();
    let mut memory = vec![0u8; total];
    let (mut work, mut rest) = (Vec::new(), memory.as_mut_slice());
    for (file, length) in files.iter().zip(lengths) {
        let (here, after) = rest.split_at_mut(length);
        work.push((file, here));
        rest = after;
    }
    work.into_par_iter().try_for_each(|(file, here)| File::open(file)?.read_exact(here))?;
    Ok(total)
}
