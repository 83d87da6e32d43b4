//! What a frame costs between two ends on loopback: processor time of both ends together, and the time from
//! `send_stream` to the event. Run with the frame's bytes, frames a second and seconds:
//! `cargo run --release -p transport --example cost -- 40000 60 10`
#![expect(clippy::print_stdout, reason = "its output is what it is for")]

use std::time::{Duration, Instant};
use transport::{Event, Identity, ServerEndpoint, TransportSettings, connect};

const PROTOCOL: &[u8] = b"cost/1";

#[tokio::main(worker_threads = 2)]
async fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(|argument| argument.parse::<u32>());
    let mut next = |default| arguments.next().unwrap_or(Ok(default));
    let (bytes, hz, seconds) = (next(40_000)?, next(60)?, next(10)?);
    let identity = Identity::ephemeral()?;
    let settings = TransportSettings::default();
    let endpoint = ServerEndpoint::bind(([127, 0, 0, 1], 0).into(), &identity, &[PROTOCOL], &settings)?;
    let address = endpoint.local_addr()?.to_string();
    let receiving = TransportSettings::receiving(32, 16 << 20);
    let (client, server) =
        tokio::join!(connect(&address, identity.fingerprint(), PROTOCOL, &receiving), endpoint.accept());
    let (mut client, server) = (client?, server.ok_or("the endpoint is closed")?);

    let began = Instant::now();
    let frames = hz * seconds;
    let receiver = tokio::spawn(async move {
        let mut micros = Vec::new();
        while micros.len() < frames as usize {
            match client.next_event().await {
                Event::Stream { bytes } => {
                    let sent_at = bytes.first_chunk().map_or(0, |first| u64::from_le_bytes(*first));
                    micros.push((began.elapsed().as_nanos() as u64).saturating_sub(sent_at) / 1000);
                }
                Event::Closed { reason, .. } => return Err(reason),
                _ => {}
            }
        }
        micros.sort_unstable();
        Ok(micros)
    });
    let cpu_before = cpu_secs();
    let mut ticks = tokio::time::interval(Duration::from_secs_f64(1.0 / f64::from(hz)));
    for frame in 0..frames {
        ticks.tick().await;
        let mut content = vec![frame as u8; bytes.max(8) as usize];
        content[..8].copy_from_slice(&(began.elapsed().as_nanos() as u64).to_le_bytes());
        server.send_stream(frame.into(), content, frame as i32)?;
    }
    let micros = receiver.await??;
    let cpu_ms = 1e3 * (cpu_secs() - cpu_before) / f64::from(frames);
    let at = |part: usize| micros[(micros.len() - 1) * part / 100];
    println!(
        "{frames} frames of {bytes} bytes at {hz} Hz: {cpu_ms:.3} ms of processor time a frame, both ends"
    );
    println!("send to event: p50 {} µs, p95 {} µs, p99 {} µs, max {} µs", at(50), at(95), at(99), at(100));
    println!("{:?}", server.statistics());
    Ok(())
}

/// Processor time of this process in seconds, as Linux tells it; proc(5), fields 14 and 15 of `stat`.
fn cpu_secs() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>()
        / 100.0
}
