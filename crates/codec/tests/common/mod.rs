//! A synthetic moving picture and how far two pictures are apart.

use codec::{Complexity, Encoder, EncoderSettings, YuvPicture};

/// A picture such as a ray-caster's: black ground, a shaded ball in colour that moves from frame to frame, once for
/// each eye, over a smooth gradient in its middle.
pub(crate) fn moving_picture(width_px: u32, height_px: u32, frame: u32) -> Vec<u8> {
    let (width, height) = (f64::from(width_px), f64::from(height_px));
    let turn = f64::from(frame) * 0.03;
    let radius = 0.4 * height.min(width / 2.0);
    let mut rgb = Vec::with_capacity((3 * width_px * height_px) as usize);
    for y in 0..height_px {
        for x in 0..width_px {
            let eye_x = f64::from(x) % (width / 2.0) - width / 4.0 - 0.1 * radius * turn.cos();
            let eye_y = f64::from(y) - height / 2.0 - 0.1 * radius * turn.sin();
            let from_middle = (eye_x * eye_x + eye_y * eye_y).sqrt() / radius;
            // A soft edge: the picture of a volume has no other.
            let cover = ((1.0 - from_middle) * radius / 3.0).clamp(0.0, 1.0);
            let light = 0.4 + 0.6 * (1.0 - from_middle * from_middle).max(0.0).sqrt();
            let bands = (8.0 * (eye_x / radius + turn)).sin() * (6.0 * eye_y / radius).cos();
            let colour = [0.85 + 0.1 * bands, 0.7 + 0.15 * bands, 0.5 - 0.2 * bands];
            rgb.extend(colour.map(|c| (255.0 * cover * light * c) as u8));
        }
    }
    rgb
}

pub(crate) fn moving_yuv(width_px: u32, height_px: u32, frame: u32) -> YuvPicture {
    YuvPicture::from_rgb8(width_px, height_px, &moving_picture(width_px, height_px, frame))
        .expect("the sides are even")
}

pub(crate) fn encoder(width_px: u32, height_px: u32, bitrate_bps: u32) -> Encoder {
    let complexity = Complexity::Low;
    Encoder::new(EncoderSettings { width_px, height_px, frames_per_second: 60.0, bitrate_bps, complexity })
        .expect("the settings are in range")
}

/// Peak signal to noise ratio in dB of 8-bit values.
pub(crate) fn psnr_db(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares: f64 = a.iter().zip(b).map(|(&a, &b)| f64::from(a.abs_diff(b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / squares).log10()
}
