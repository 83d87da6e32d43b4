//! Colours from the renderer to what a decoder shows, but for the codec between: the shader's planes, turned back by the
//! crate that headsets decode with.
#![expect(clippy::unwrap_used, reason = "a test that cannot set itself up has failed")]

use codec::{PlaneLayout, YuvFrame, YuvPicture};
use end_to_end::{gpu, in_front, subject};
use render::{
    DepthGridSize, FrameRenderer, Placed, Quality, SceneOnDevice, StereoPlan, StereoRequest, StillRenderer,
    VolumeOnDevice,
};
use scene::{SceneFile, VolumeFacts};
use spatial::{Fov, HeadGeometry};
use std::sync::Arc;

const SIZE_PX: [u32; 2] = [96, 64];
/// Luma weights of red, green and blue (ITU-R BT.709-6, item 3.2).
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];
/// What rounding to the three 8-bit codes and to 8-bit RGB may cost, in steps of 8-bit RGB: half a code of luma, 255/219,
/// and of each chroma difference, 255/224, through the inverse matrix, and half a step.
const ROUNDED: [f64; 3] = [
    0.5 * 255.0 * (1.0 / 219.0 + 1.5748 / 224.0) + 0.5,
    0.5 * 255.0 * (1.0 / 219.0 + (0.187_324 + 0.468_124) / 224.0) + 0.5,
    0.5 * 255.0 * (1.0 / 219.0 + 1.8556 / 224.0) + 0.5,
];
/// The device's float32 and the decoder's 16-bit fixed point, in steps of 8-bit RGB.
const ARITHMETIC: f64 = 0.05;

/// Red, green and blue of both eyes side by side, 0 to 255, as the renderer left them before it made planes; and those
/// planes turned back to RGB.
fn there_and_back(scene_json: &str) -> (Vec<[f64; 3]>, Vec<[f64; 3]>) {
    let volume = subject();
    let scene = SceneFile::from_json(scene_json).unwrap().resolve(&VolumeFacts::of(&volume)).unwrap();
    let on_device = Arc::new(VolumeOnDevice::upload(gpu(), &volume, |_| {}).unwrap());
    let shown = SceneOnDevice::new(gpu(), &on_device, &scene).unwrap();
    let geometry = HeadGeometry::parallel(0.064, Fov::symmetric(0.5, 0.36).unwrap());
    let request = StereoRequest {
        eyes: &geometry.view(&in_front()).eyes,
        placed: Placed::in_room(&scene.placement, volume.grid()),
        eye_size_px: SIZE_PX,
        quality: Quality::BALANCED,
        step_mm: None,
        depth_grid: DepthGridSize::default(),
    };
    let plan = StereoPlan::new(&request, volume.grid(), shown.numbers()).unwrap();
    let still = StillRenderer::new(gpu()).render(&shown, &plan).unwrap();
    let frame = FrameRenderer::new(gpu(), 1).unwrap().submit(&shown, &plan).unwrap().finish().unwrap();

    let [width, height] = SIZE_PX.map(|side| side as usize);
    let mut sent = Vec::new();
    for y in 0..height {
        for eye in 0..2 {
            let row = &still.eye(eye)[y * width..][..width];
            sent.extend(row.iter().map(|p| {
                let shown = |c: usize| f64::from(p[c]) + (1.0 - f64::from(p[3])) * scene.background[c];
                [0, 1, 2].map(|c| 255.0 * shown(c).clamp(0.0, 1.0))
            }));
        }
    }
    let [width, height] = frame.size_px();
    let layout = PlaneLayout::with_stride(width, height, frame.luma_stride()).unwrap();
    let planes = YuvFrame::new(layout, frame.planes()).unwrap();
    let rgb = YuvPicture::new(layout, planes.bytes().to_vec()).unwrap().to_rgb8();
    (sent, rgb.chunks_exact(3).map(|c| [0, 1, 2].map(|i| f64::from(c[i]))).collect())
}

/// Blue and red difference, -127.5 to 127.5.
fn differences(rgb: [f64; 3]) -> [f64; 2] {
    let luma: f64 = rgb.iter().zip(LUMA).map(|(c, weight)| c * weight).sum();
    [(rgb[2] - luma) / 1.8556, (rgb[0] - luma) / 1.5748]
}

#[test]
fn a_picture_comes_back_within_its_rounding_and_the_chroma_that_pixels_share() {
    let scene = r#"{"transfer": [[15, 0.1, 0.2, 0.7, 0], [90, 0.1, 0.9, 0.2, 0.02], [175, 0.9, 0.3, 0.2, 0.05],
                    [250, 1, 0.9, 0.2, 0.1]], "shade": true, "background": [0.2, 0.05, 0.3]}"#;
    let (sent, back) = there_and_back(scene);
    let width = 2 * SIZE_PX[0] as usize;
    let (mut worst, mut most_shared, mut flat) = (0.0f64, 0.0f64, 0);
    for (at, (sent_rgb, back_rgb)) in sent.iter().zip(&back).enumerate() {
        let (x, y) = (at % width / 2 * 2, at / width / 2 * 2);
        let block = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| sent[(y + dy) * width + x + dx]);
        let shared = differences([0, 1, 2].map(|c| block.iter().map(|rgb| rgb[c]).sum::<f64>() / 4.0));
        let own = differences(*sent_rgb);
        let [u, v] = [0, 1].map(|i| (shared[i] - own[i]).abs());
        let subsampled = [1.5748 * v, 0.187_324 * u + 0.468_124 * v, 1.8556 * u];
        flat += usize::from(subsampled.iter().all(|s| *s < 0.01));
        for c in 0..3 {
            let off = (sent_rgb[c] - back_rgb[c]).abs();
            let bound = subsampled[c] + ROUNDED[c] + ARITHMETIC;
            assert!(off <= bound, "pixel {at}, channel {c}: {off:.2} off, bound {bound:.2}");
            worst = worst.max(off / bound);
            most_shared = most_shared.max(subsampled[c]);
        }
    }
    println!(
        "worst {:.0} % of its bound; sharing costs up to {most_shared:.1} steps; {flat} pixels are flat",
        100.0 * worst
    );
    assert!(flat > 500, "the background is flat");
    assert!(most_shared > 4.0 && worst > 0.5, "there is something to be seen");
}

#[test]
fn a_flat_colour_comes_back_within_its_rounding() {
    // Nothing is seen of the volume: a background alone.
    for background in
        [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, 0.6, 0.9]]
    {
        let [r, g, b] = background;
        let scene =
            format!(r#"{{"transfer": [[0, 0, 0, 0, 0], [1, 0, 0, 0, 0]], "background": [{r}, {g}, {b}]}}"#);
        let (sent, back) = there_and_back(&scene);
        for (sent, back) in sent.iter().zip(&back) {
            for c in 0..3 {
                let off = (sent[c] - back[c]).abs();
                assert!(off <= ROUNDED[c] + ARITHMETIC, "{background:?}: {sent:?} came back as {back:?}");
            }
        }
    }
}
