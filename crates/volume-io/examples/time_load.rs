//! How long loading takes: `time_load PATH TIMES` prints seconds of each load, bytes of voxels and the memory's peak, as
//! JSON. `tools/measure_volumes` calls it.
#![expect(clippy::print_stdout, reason = "an example talks to its caller")]

use std::time::Instant;
use volume_io::{LoadOptions, load};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("expected PATH TIMES")?;
    let times: usize = arguments.next().ok_or("expected PATH TIMES")?.parse()?;
    let (mut secs, mut bytes) = (Vec::new(), 0);
    for _ in 0..times {
        let start = Instant::now();
        let loaded = load(&path, &LoadOptions::default())?;
        secs.push(start.elapsed().as_secs_f64());
        bytes = loaded.volume.sample_bytes();
    }
    // Linux counts the peak; elsewhere there is none.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status
        .lines()
        .find_map(|l| l.strip_prefix("VmHWM:"))
        .map_or("null", |l| l.trim().trim_end_matches(" kB"));
    println!("{{\"secs\": {secs:?}, \"bytes\": {bytes}, \"peak_kib\": {peak}}}");
    Ok(())
}
