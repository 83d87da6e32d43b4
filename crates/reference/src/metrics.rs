//! How far one picture is from another.

use crate::ssim::{mean_ssim, mean_ssim_where};
use crate::{Picture, Pixel, RaySetup, Reference, ReferenceError, Uncertainty};

/// A sample of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Pixel from the left.
    pub x: u32,
    /// Pixel from the top.
    pub y: u32,
    /// 0 to 2 red, green, blue (times opacity), 3 opacity.
    pub channel: usize,
}

/// How far one picture is from another. Colours are from 0 to 1; differences that are no number count as infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// The largest difference of a sample, opacity included.
    pub max_abs_error: f64,
    /// Where it is; `None` if there is none.
    pub worst: Option<Place>,
    /// Root of the mean square difference of red, green and blue.
    pub rmse: f64,
    /// `-20·log₁₀(rmse)`, decibels; infinite if the colours are equal.
    pub psnr_db: f64,
    /// Root of the mean square difference of opacity.
    pub opacity_rmse: f64,
    /// The largest difference of opacity.
    pub opacity_max_abs_error: f64,
    /// Structural similarity, the mean over red, green and blue of Wang et al. 2004 with the published window and
    /// constants and a range of 1.
    pub ssim: f64,
    /// How far the depths are off.
    pub depth: DepthErrors,
}

/// How far the depths of two pictures are off.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthErrors {
    /// Pixels at which both have a depth.
    pub both: usize,
    /// Pixels at which only the first has.
    pub only_first: usize,
    /// Pixels at which only the second has.
    pub only_second: usize,
    /// The largest difference where both have one, millimetres.
    pub max_abs_error_mm: f64,
    /// Where it is (x, y); `None` if there is none.
    pub worst: Option<(u32, u32)>,
    /// Root of the mean square difference where both have one, millimetres.
    pub rmse_mm: f64,
    /// From the nearest to the farthest depth of the first, where both have one, millimetres.
    pub range_mm: f64,
    /// `20·log₁₀(range_mm / rmse_mm)`, decibels; `None` without an error, or without a range to hold it against.
    pub psnr_db: Option<f64>,
    /// Structural similarity where both have one, of depths over the range, as colours have it; `None` without a range,
    /// or without such a pixel around which a window fits.
    pub ssim: Option<f64>,
}

/// Compares two pictures of one size. The colours are compared as they are, multiplied by opacity; put both over a
/// background first ([`Picture::over`]) to compare what is seen before it.
///
/// # Errors
/// If the pictures differ in size.
pub fn compare(a: &Picture, b: &Picture) -> Result<Comparison, ReferenceError> {
    same_size(a, b)?;
    let mut max_abs_error = 0.0;
    let mut worst = None;
    let mut opacity_max_abs_error = 0.0f64;
    let mut squares = [0.0; 4];
    for (at, (p, q)) in a.pixels().iter().zip(b.pixels()).enumerate() {
        opacity_max_abs_error = opacity_max_abs_error.max(off(p.rgba[3], q.rgba[3]));
        for (channel, square) in squares.iter_mut().enumerate() {
            let error = off(p.rgba[channel], q.rgba[channel]);
            *square += error * error;
            if error > max_abs_error {
                max_abs_error = error;
                let (x, y) = place(a, at);
                worst = Some(Place { x, y, channel });
            }
        }
    }
    let count = a.pixels().len() as f64;
    let rmse = (squares[..3].iter().sum::<f64>() / (3.0 * count)).sqrt();
    let plane =
        |of: &Picture, channel: usize| of.pixels().iter().map(|p| p.rgba[channel]).collect::<Vec<_>>();
    let (width, height) = (a.width() as usize, a.height() as usize);
    let ssim = |channel| mean_ssim(&plane(a, channel), &plane(b, channel), width, height);
    Ok(Comparison {
        max_abs_error,
        worst,
        rmse,
        psnr_db: if rmse > 0.0 { -20.0 * rmse.log10() } else { f64::INFINITY },
        opacity_rmse: (squares[3] / count).sqrt(),
        opacity_max_abs_error,
        ssim: (0..3).map(ssim).sum::<f64>() / 3.0,
        depth: depth_errors(a, b),
    })
}

fn depth_errors(a: &Picture, b: &Picture) -> DepthErrors {
    let mut errors = DepthErrors::default();
    let mut squares = 0.0;
    let (mut nearest, mut farthest) = (f64::INFINITY, f64::NEG_INFINITY);
    for (at, (p, q)) in a.pixels().iter().zip(b.pixels()).enumerate() {
        match (p.depth_mm, q.depth_mm) {
            (Some(p), Some(q)) => {
                let error = off(p, q);
                (nearest, farthest) = (nearest.min(p), farthest.max(p));
                errors.both += 1;
                squares += error * error;
                if error > errors.max_abs_error_mm {
                    errors.max_abs_error_mm = error;
                    errors.worst = Some(place(a, at));
                }
            }
            (Some(_), None) => errors.only_first += 1,
            (None, Some(_)) => errors.only_second += 1,
            (None, None) => {}
        }
    }
    if errors.both == 0 {
        return errors;
    }
    errors.rmse_mm = (squares / errors.both as f64).sqrt();
    errors.range_mm = farthest - nearest;
    if errors.range_mm > 0.0 {
        errors.psnr_db = (errors.rmse_mm > 0.0).then(|| 20.0 * (errors.range_mm / errors.rmse_mm).log10());
        let counts: Vec<bool> =
            a.pixels().iter().zip(b.pixels()).map(|(p, q)| p.depth_mm.and(q.depth_mm).is_some()).collect();
        let plane = |of: &Picture| -> Vec<f64> {
            let part = |depth_mm: f64| (depth_mm - nearest) / errors.range_mm;
            of.pixels().iter().map(|p| p.depth_mm.map_or(0.0, part)).collect()
        };
        let (width, height) = (a.width() as usize, a.height() as usize);
        errors.ssim = mean_ssim_where(&plane(a), &plane(b), &counts, width, height);
    }
    errors
}

/// Where two pictures differ: `gain` times the absolute difference of each colour or, where it is larger, of the opacity,
/// as an opaque picture before black, held to 1.
///
/// # Errors
/// If the pictures differ in size.
pub fn difference(a: &Picture, b: &Picture, gain: f64) -> Result<Picture, ReferenceError> {
    same_size(a, b)?;
    let pixels = a.pixels().iter().zip(b.pixels()).map(|(p, q)| {
        let opacity = off(p.rgba[3], q.rgba[3]);
        let shown = |i: usize| (gain * off(p.rgba[i], q.rgba[i]).max(opacity)).min(1.0);
        Pixel { rgba: [shown(0), shown(1), shown(2), 1.0], depth_mm: None }
    });
    Picture::new(a.width(), a.height(), pixels.collect())
}

/// What is asked of a measured picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tolerance {
    /// Largest difference of a sample, opacity included.
    pub color: f64,
    /// Largest difference of a depth, millimetres. Infinite: depths are not looked at.
    pub depth_mm: f64,
    /// Depths are looked at where the exact opacity is at least this.
    pub depth_from_opacity: f64,
}

/// What came of looking at each pixel of a measured picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Verdict {
    /// Pixels of the picture.
    pub pixels: usize,
    /// Pixels (x, y) beyond the tolerance of the exact answer and within it of another right one: there the picture
    /// jumps. Their number is to be bounded and reported.
    pub jumps: Vec<(u32, u32)>,
    /// Pixels (x, y) beyond the tolerance of every right answer.
    pub wrong: Vec<(u32, u32)>,
    /// The largest difference of a sample from the nearest right answer.
    pub color_error: f64,
    /// The largest difference of a depth from the nearest right answer, millimetres, where depths were looked at.
    pub depth_error_mm: f64,
}

/// Judges a measured picture by the exact one: each pixel beyond the tolerance is held against all answers that are right
/// within the uncertainty ([`Reference::answers`]). `exact` must be the reference's own picture for `setup`.
///
/// # Errors
/// If the pictures differ in size.
pub fn judge(
    reference: &Reference<'_>,
    setup: &RaySetup,
    exact: &Picture,
    measured: &Picture,
    tolerance: &Tolerance,
    uncertainty: &Uncertainty,
) -> Result<Verdict, ReferenceError> {
    same_size(exact, measured)?;
    let mut verdict = Verdict { pixels: exact.pixels().len(), ..Verdict::default() };
    for (at, (right, found)) in exact.pixels().iter().zip(measured.pixels()).enumerate() {
        let with_depth = tolerance.depth_mm.is_finite() && right.rgba[3] >= tolerance.depth_from_opacity;
        let color = (0..4).map(|i| off(right.rgba[i], found.rgba[i])).fold(0.0, f64::max);
        let depth = match (right.depth_mm, found.depth_mm) {
            _ if !with_depth => 0.0,
            (Some(a), Some(b)) => off(a, b),
            (None, None) => 0.0,
            _ => f64::INFINITY,
        };
        let within = |color: f64, depth: f64| color <= tolerance.color && depth <= tolerance.depth_mm;
        let (mut color_error, mut depth_error_mm) = (color, depth);
        if !within(color, depth) {
            let (x, y) = place(exact, at);
            let answers =
                reference.answers(&setup.pixel_ray(x, y, exact.width(), exact.height()), uncertainty);
            color_error = answers.color_error(found.rgba);
            depth_error_mm = if with_depth { answers.depth_error_mm(found.depth_mm) } else { 0.0 };
            let list =
                if within(color_error, depth_error_mm) { &mut verdict.jumps } else { &mut verdict.wrong };
            list.push((x, y));
        }
        verdict.color_error = verdict.color_error.max(color_error);
        verdict.depth_error_mm = verdict.depth_error_mm.max(depth_error_mm);
    }
    Ok(verdict)
}

fn same_size(a: &Picture, b: &Picture) -> Result<(), ReferenceError> {
    if (a.width(), a.height()) == (b.width(), b.height()) {
        return Ok(());
    }
    Err(ReferenceError::Sizes { first: (a.width(), a.height()), second: (b.width(), b.height()) })
}

/// The absolute difference; infinite if it is no number.
fn off(a: f64, b: f64) -> f64 {
    let difference = (a - b).abs();
    if difference.is_nan() { f64::INFINITY } else { difference }
}

fn place(of: &Picture, at: usize) -> (u32, u32) {
    let at = at as u32;
    (at % of.width(), at / of.width())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(pixels: &[([f64; 4], Option<f64>)], width: u32) -> Picture {
        let pixels: Vec<_> = pixels.iter().map(|&(rgba, depth_mm)| Pixel { rgba, depth_mm }).collect();
        Picture::new(width, pixels.len() as u32 / width, pixels).unwrap()
    }

    #[test]
    fn equal_pictures_have_no_error() {
        let a = picture(&[([0.1, 0.2, 0.3, 0.4], Some(1.0)), ([0.5; 4], None)], 2);
        let c = compare(&a, &a).unwrap();
        assert_eq!((c.max_abs_error, c.worst, c.rmse, c.opacity_rmse), (0.0, None, 0.0, 0.0));
        assert_eq!(c.psnr_db, f64::INFINITY);
        assert!((c.ssim - 1.0).abs() < 1e-12);
        assert_eq!(c.depth, DepthErrors { both: 1, ..DepthErrors::default() });
    }

    #[test]
    fn a_known_square_error_has_its_psnr() {
        let a = picture(&[([0.5; 4], None); 100], 10);
        let b = picture(&[([0.6, 0.6, 0.6, 0.5], None); 100], 10);
        let c = compare(&a, &b).unwrap();
        assert!((c.rmse - 0.1).abs() < 1e-12);
        assert!((c.psnr_db - 20.0).abs() < 1e-9);
        assert_eq!(c.opacity_rmse, 0.0);
        // One sample in 255 off by one step of 8 bits everywhere: 48.13 dB.
        let b = picture(&[([0.5 + 1.0 / 255.0; 4], None); 100], 10);
        assert!((compare(&a, &b).unwrap().psnr_db - 48.130_803_608_679).abs() < 1e-9);
    }

    #[test]
    fn the_worst_sample_is_named() {
        let a = picture(&[([0.0; 4], None); 6], 3);
        let mut pixels = [([0.0; 4], None); 6];
        pixels[4].0[2] = 0.25;
        pixels[1].0[3] = 0.125;
        let c = compare(&a, &picture(&pixels, 3)).unwrap();
        assert_eq!(c.worst, Some(Place { x: 1, y: 1, channel: 2 }));
        assert_eq!((c.max_abs_error, c.opacity_max_abs_error), (0.25, 0.125));
    }

    #[test]
    fn what_is_no_number_is_an_infinite_error() {
        let a = picture(&[([0.0; 4], None)], 1);
        let b = picture(&[([0.0, f64::NAN, 0.0, 0.0], None)], 1);
        assert_eq!(compare(&a, &b).unwrap().max_abs_error, f64::INFINITY);
        assert_eq!(difference(&a, &b, 1.0).unwrap().pixel(0, 0).rgba, [0.0, 1.0, 0.0, 1.0]);
    }

    #[test]
    fn depths_are_compared_where_both_have_one() {
        let a = picture(&[([0.0; 4], Some(1.0)), ([0.0; 4], Some(2.0)), ([0.0; 4], None)], 3);
        let b = picture(&[([0.0; 4], Some(1.5)), ([0.0; 4], None), ([0.0; 4], Some(1.0))], 3);
        let d = compare(&a, &b).unwrap().depth;
        assert_eq!((d.both, d.only_first, d.only_second), (1, 1, 1));
        assert_eq!((d.max_abs_error_mm, d.rmse_mm, d.worst), (0.5, 0.5, Some((0, 0))));
        assert_eq!((d.range_mm, d.psnr_db, d.ssim), (0.0, None, None));
    }

    #[test]
    fn depths_off_by_a_tenth_of_their_range_have_20_db() {
        let of = |by: f64| -> Vec<([f64; 4], Option<f64>)> {
            let depth = |i: u32| (!i.is_multiple_of(5)).then_some(100.0 + f64::from(i % 5) * 10.0 + by);
            (0..400).map(|i| ([0.5; 4], depth(i))).collect()
        };
        let [a, b] = [0.0, 3.0].map(|by| picture(&of(by), 20));
        let d = compare(&a, &b).unwrap().depth;
        assert_eq!((d.both, d.range_mm), (320, 30.0));
        assert!((d.psnr_db.unwrap() - 20.0).abs() < 1e-9, "{d:?}");
        // All are shifted alike: the same shapes, a little brighter.
        assert!(d.ssim.unwrap() > 0.9 && d.ssim.unwrap() < 1.0, "{d:?}");
        let same = compare(&a, &a).unwrap().depth;
        assert!(same.psnr_db.is_none() && (same.ssim.unwrap() - 1.0).abs() < 1e-12, "{same:?}");
    }

    #[test]
    fn pictures_of_two_sizes_are_not_compared() {
        let a = picture(&[([0.0; 4], None); 2], 2);
        let b = picture(&[([0.0; 4], None); 2], 1);
        assert!(matches!(compare(&a, &b), Err(ReferenceError::Sizes { .. })));
    }

    #[test]
    fn the_difference_is_amplified_and_held_to_one() {
        let a = picture(&[([0.5; 4], None)], 1);
        let b = picture(&[([0.51, 0.5, 0.9, 0.5], None)], 1);
        let rgba = difference(&a, &b, 10.0).unwrap().pixel(0, 0).rgba;
        assert!((rgba[0] - 0.1).abs() < 1e-12 && rgba[1] == 0.0 && rgba[2] == 1.0 && rgba[3] == 1.0);
    }
}
