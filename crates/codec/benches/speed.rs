//! How long encoding, decoding and colour conversion take: `cargo bench -p codec`.

#[path = "../tests/common/mod.rs"]
mod common;

use codec::{Complexity, Decoder, Encoder, EncoderSettings};
use common::{encoder, moving_yuv, psnr_db};
use std::io::Write as _;
use std::time::{Duration, Instant};

const FRAMES: u32 = 60;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout().lock();
    for (width_px, height_px, bitrate_bps) in [(640, 180, 3_000_000), (2536, 720, 20_000_000)] {
        let pictures: Vec<_> = (0..FRAMES).map(|frame| moving_yuv(width_px, height_px, frame)).collect();
        for complexity in [Complexity::Low, Complexity::Medium, Complexity::High] {
            let settings = encoder(width_px, height_px, bitrate_bps).settings();
            let mut encoder = Encoder::new(EncoderSettings { complexity, ..settings })?;
            let mut decoder = Decoder::new()?;
            let (mut encode, mut decode, mut convert) = (Vec::new(), Vec::new(), Vec::new());
            let (mut bytes, mut worst_db) = (0, f64::INFINITY);
            for picture in &pictures {
                let begin = Instant::now();
                let access_unit = encoder.encode(picture.as_frame(), false)?;
                encode.push(begin.elapsed());
                let begin = Instant::now();
                let decoded = decoder.decode(&access_unit.bytes)?;
                decode.push(begin.elapsed());
                let begin = Instant::now();
                let rgb = decoded.to_rgb8();
                convert.push(begin.elapsed());
                bytes += access_unit.bytes.len();
                worst_db = worst_db.min(psnr_db(&rgb, &picture.to_rgb8()));
            }
            let mbit = bytes as f64 * 8.0 * f64::from(settings.frames_per_second) / f64::from(FRAMES) / 1e6;
            writeln!(
                out,
                "{width_px}x{height_px} {complexity:?}: median ms encode {:.2}, decode {:.2}, to RGB {:.2}; \
                 {mbit:.2} Mbit/s, worst {worst_db:.1} dB, {}",
                median_ms(encode),
                median_ms(decode),
                median_ms(convert),
                encoder.codec_string().unwrap_or_default()
            )?;
        }
    }
    Ok(())
}

fn median_ms(mut times: Vec<Duration>) -> f64 {
    times.sort_unstable();
    times[times.len() / 2].as_secs_f64() * 1e3
}
