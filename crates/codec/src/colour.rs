//! BT.709 limited range to and from full-range RGB (ITU-R BT.709-6, items 3.2 to 3.5), in 16-bit fixed point.
//!
//! The conversion is between the coded values: sRGB's curve goes through as it is, and the stream says that it is sRGB's. A chroma sample stands for its two by two pixels: the mean on the way in, a copy on the way
//! out, so that a colour that fills such a block comes back within the bounds that the test states.

use crate::{PlaneLayout, YuvFrame};

/// Weights of red and blue in luma.
const RED: f64 = 0.2126;
const BLUE: f64 = 0.0722;
const GREEN: f64 = 1.0 - RED - BLUE;

/// Steps of 8-bit luma from black to white, and of a chroma difference from end to end.
const LUMA_STEPS: f64 = 219.0;
const CHROMA_STEPS: f64 = 224.0;
const LUMA_BLACK: i32 = 16;
const CHROMA_GREY: i32 = 128;

const SHIFT: u32 = 16;
const HALF: i32 = 1 << (SHIFT - 1);

const fn fixed(x: f64) -> i32 {
    let scaled = x * (1u32 << SHIFT) as f64;
    (if scaled < 0.0 { scaled - 0.5 } else { scaled + 0.5 }) as i32
}

// RGB from YUV.
const RGB_PER_Y: i32 = fixed(255.0 / LUMA_STEPS);
const RED_PER_V: i32 = fixed(2.0 * (1.0 - RED) * 255.0 / CHROMA_STEPS);
const GREEN_PER_U: i32 = fixed(-2.0 * (1.0 - BLUE) * BLUE / GREEN * 255.0 / CHROMA_STEPS);
const GREEN_PER_V: i32 = fixed(-2.0 * (1.0 - RED) * RED / GREEN * 255.0 / CHROMA_STEPS);
const BLUE_PER_U: i32 = fixed(2.0 * (1.0 - BLUE) * 255.0 / CHROMA_STEPS);

// YUV from RGB. Green takes what the others leave, so that grey gives exactly 128.
const Y_PER_RED: i32 = fixed(RED * LUMA_STEPS / 255.0);
const Y_PER_BLUE: i32 = fixed(BLUE * LUMA_STEPS / 255.0);
const Y_PER_GREEN: i32 = fixed(LUMA_STEPS / 255.0) - Y_PER_RED - Y_PER_BLUE;
const U_PER_BLUE: i32 = fixed(0.5 * CHROMA_STEPS / 255.0);
const U_PER_RED: i32 = fixed(-0.5 * RED / (1.0 - BLUE) * CHROMA_STEPS / 255.0);
const U_PER_GREEN: i32 = -U_PER_BLUE - U_PER_RED;
const V_PER_RED: i32 = fixed(0.5 * CHROMA_STEPS / 255.0);
const V_PER_BLUE: i32 = fixed(-0.5 * BLUE / (1.0 - RED) * CHROMA_STEPS / 255.0);
const V_PER_GREEN: i32 = -V_PER_RED - V_PER_BLUE;

pub(crate) fn rgb8_from_yuv(frame: YuvFrame<'_>) -> Vec<u8> {
    let layout = frame.layout();
    let width = layout.width_px() as usize;
    let mut rgb = vec![0; 3 * width * layout.height_px() as usize];
    for (row, rgb_row) in rgb.chunks_exact_mut(3 * width).enumerate() {
        let y_row = &frame.y()[row * layout.y_stride()..][..width];
        let chroma = row / 2 * layout.uv_stride()..row / 2 * layout.uv_stride() + width / 2;
        let uv = frame.u()[chroma.clone()].iter().zip(&frame.v()[chroma]);
        let pairs = rgb_row.chunks_exact_mut(6).zip(y_row.chunks_exact(2));
        for ((rgb_pair, y_pair), (&u, &v)) in pairs.zip(uv) {
            let (u, v) = (i32::from(u) - CHROMA_GREY, i32::from(v) - CHROMA_GREY);
            let (red, green, blue) = (RED_PER_V * v, GREEN_PER_U * u + GREEN_PER_V * v, BLUE_PER_U * u);
            let pixel = |y: u8| {
                let grey = RGB_PER_Y * (i32::from(y) - LUMA_BLACK) + HALF;
                [grey + red, grey + green, grey + blue].map(|value| (value >> SHIFT).clamp(0, 255) as u8)
            };
            let ([r0, g0, b0], [r1, g1, b1]) = (pixel(y_pair[0]), pixel(y_pair[1]));
            rgb_pair.copy_from_slice(&[r0, g0, b0, r1, g1, b1]);
        }
    }
    rgb
}

/// `rgb` has three bytes for each pixel of the layout.
pub(crate) fn yuv_from_rgb8(layout: PlaneLayout, rgb: &[u8]) -> Vec<u8> {
    let width = layout.width_px() as usize;
    let mut bytes = vec![0; layout.len_bytes()];
    let (y_plane, chroma) = bytes.split_at_mut(layout.y_range().end);
    let (u_plane, v_plane) = chroma.split_at_mut(layout.u_range().len());

    for (y_row, rgb_row) in y_plane.chunks_exact_mut(layout.y_stride()).zip(rgb.chunks_exact(3 * width)) {
        for (y, rgb) in y_row.iter_mut().zip(rgb_row.chunks_exact(3)) {
            let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(i32::from);
            let sum = Y_PER_RED * r + Y_PER_GREEN * g + Y_PER_BLUE * b;
            *y = (LUMA_BLACK + ((sum + HALF) >> SHIFT)) as u8;
        }
    }

    let chroma_rows =
        u_plane.chunks_exact_mut(layout.uv_stride()).zip(v_plane.chunks_exact_mut(layout.uv_stride()));
    for ((u_row, v_row), rgb_rows) in chroma_rows.zip(rgb.chunks_exact(6 * width)) {
        let (upper, lower) = rgb_rows.split_at(3 * width);
        let blocks = upper.chunks_exact(6).zip(lower.chunks_exact(6));
        for ((u, v), (upper, lower)) in u_row.iter_mut().zip(v_row).zip(blocks) {
            let sum_of_four = |c: usize| {
                i32::from(upper[c]) + i32::from(upper[c + 3]) + i32::from(lower[c]) + i32::from(lower[c + 3])
            };
            let [r, g, b] = [0, 1, 2].map(sum_of_four);
            // A mean of four: two more bits to shift away. The largest sum, 4·255·0.44·2^16, fits.
            let mean = |sum: i32| (CHROMA_GREY + ((sum + 4 * HALF) >> (SHIFT + 2))) as u8;
            *u = mean(U_PER_RED * r + U_PER_GREEN * g + U_PER_BLUE * b);
            *v = mean(V_PER_RED * r + V_PER_GREEN * g + V_PER_BLUE * b);
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::YuvPicture;
    use proptest::prelude::*;

    /// A picture of two by two pixels of one colour.
    fn block([r, g, b]: [u8; 3]) -> YuvPicture {
        YuvPicture::from_rgb8(2, 2, &[r, g, b].repeat(4)).unwrap()
    }

    fn yuv([r, g, b]: [u8; 3]) -> [u8; 3] {
        let picture = block([r, g, b]);
        let frame = picture.as_frame();
        [frame.y()[0], frame.u()[0], frame.v()[0]]
    }

    #[test]
    fn known_colours_have_their_bt709_codes() {
        // ITU-R BT.709-6 with the 100 % colour bars of EBU Tech 3325, 8 bit.
        assert_eq!(yuv([0, 0, 0]), [16, 128, 128]);
        assert_eq!(yuv([255, 255, 255]), [235, 128, 128]);
        assert_eq!(yuv([255, 0, 0]), [63, 102, 240]);
        assert_eq!(yuv([0, 255, 0]), [173, 42, 26]);
        assert_eq!(yuv([0, 0, 255]), [32, 240, 118]);
        assert_eq!(yuv([255, 255, 0]), [219, 16, 138]);
    }

    #[test]
    fn every_grey_has_no_chroma_and_comes_back() {
        for grey in 0..=255 {
            let [_, u, v] = yuv([grey; 3]);
            assert_eq!([u, v], [128, 128], "grey {grey}");
            let back = block([grey; 3]).to_rgb8();
            assert!(back.iter().all(|&value| value.abs_diff(grey) <= 1), "grey {grey} came back as {back:?}");
        }
    }

    #[test]
    fn a_colour_comes_back_within_the_quantisation_of_its_three_codes() {
        // Half a step of each code, through the inverse matrix:
        //   red   255·(0.5/219 + 1.5748·0.5/224)          = 1.48, so at most 1 after rounding
        //   green 255·(0.5/219 + (0.1873+0.4681)·0.5/224) = 0.96, so at most 1
        //   blue  255·(0.5/219 + 1.8556·0.5/224)          = 1.64, so at most 2
        let mut worst = [0u8; 3];
        for r in (0..=255).step_by(5) {
            for g in (0..=255).step_by(5) {
                for b in (0..=255u8).step_by(5) {
                    let back = block([r, g, b]).to_rgb8();
                    for (worst, (&found, expected)) in worst.iter_mut().zip(back.iter().zip([r, g, b])) {
                        *worst = (*worst).max(found.abs_diff(expected));
                    }
                }
            }
        }
        assert_eq!(worst, [1, 1, 2]);
    }

    /// Half a step of each of the three codes through the inverse matrix, as above, and half a step of the 8 bits of RGB;
    /// the rest is for the fixed point.
    const QUANTISED: [f64; 3] = [1.48 + 0.5 + 0.02, 0.96 + 0.5 + 0.02, 1.64 + 0.5 + 0.02];

    proptest! {
        #[test]
        fn a_shared_chroma_sample_costs_its_distance_from_the_pixels_own(values in prop::array::uniform12(0u8..)) {
            let differences = |rgb: &[f64]| {
                let luma = RED * rgb[0] + GREEN * rgb[1] + BLUE * rgb[2];
                [(rgb[2] - luma) / (2.0 * (1.0 - BLUE)), (rgb[0] - luma) / (2.0 * (1.0 - RED))]
            };
            let pixels: Vec<Vec<f64>> =
                values.chunks_exact(3).map(|rgb| rgb.iter().map(|&c| f64::from(c)).collect()).collect();
            let mean: Vec<f64> = (0..3).map(|c| pixels.iter().map(|p| p[c]).sum::<f64>() / 4.0).collect();
            let shared = differences(&mean);
            let back = YuvPicture::from_rgb8(2, 2, &values).unwrap().to_rgb8();
            for (pixel, back) in pixels.iter().zip(back.chunks_exact(3)) {
                let own = differences(pixel);
                let [u, v] = [0, 1].map(|i| (shared[i] - own[i]).abs());
                // The inverse matrix, in RGB steps for a step of chroma difference.
                let [red, blue] = [2.0 * (1.0 - RED) * v, 2.0 * (1.0 - BLUE) * u];
                let green = red * RED / GREEN + blue * BLUE / GREEN;
                for (c, subsampled) in [red, green, blue].into_iter().enumerate() {
                    let off = (f64::from(back[c]) - pixel[c]).abs();
                    let bound = subsampled + QUANTISED[c];
                    prop_assert!(off <= bound, "channel {c} of {pixel:?} is off by {off}, bound {bound:.2}");
                }
            }
        }
    }

    #[test]
    fn codes_outside_the_limited_range_are_clipped() {
        let layout = PlaneLayout::packed(2, 2).unwrap();
        let mut bytes = YuvPicture::black(layout).into_bytes();
        bytes[layout.y_range()].fill(255);
        assert_eq!(YuvPicture::new(layout, bytes).unwrap().to_rgb8(), [255; 12]);
        assert_eq!(YuvPicture::new(layout, vec![0; 24]).unwrap().to_rgb8()[..3], [0, 77, 0]);
    }

    proptest! {
        #[test]
        fn luma_keeps_every_pixel_where_chroma_is_shared(values in prop::array::uniform12(0u8..)) {
            let picture = YuvPicture::from_rgb8(2, 2, &values).unwrap();
            let frame = picture.as_frame();
            for (i, rgb) in values.chunks_exact(3).enumerate() {
                let [r, g, b] = [rgb[0], rgb[1], rgb[2]].map(f64::from);
                let luma = 16.0 + LUMA_STEPS * (RED * r + GREEN * g + BLUE * b) / 255.0;
                let found = f64::from(frame.y()[i / 2 * frame.layout().y_stride() + i % 2]);
                prop_assert!((found - luma).abs() < 0.51, "{found} for {luma}");
            }
        }
    }
}
