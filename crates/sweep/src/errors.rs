//! How far a measured picture is from the exact one.

use crate::exact::Exact;
use crate::sweep::SweepError;
use reference::{Answers, Picture, Pixel, compare};
use std::collections::HashSet;

/// A pixel is in doubt only if another right answer is nearer by more than this: half a step of 8 bits, and in depth by
/// more than a tenth of a millimetre. Roundings are no doubt.
const COLOR_JUMP: f64 = 0.5 / 255.0;
const DEPTH_JUMP_MM: f64 = 0.1;
/// Pixels that are asked for their other right answers at a time.
const ASKED_AT_A_TIME: usize = 32;

/// How far a picture is from the exact one; colours from 0 to 1.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Errors {
    /// The largest difference of a sample (red, green, blue, opacity), all pixels.
    pub max_abs_error: f64,
    /// Its pixel (x, y).
    pub worst: Option<[u32; 2]>,
    /// Of red, green and blue, all pixels.
    pub rmse: f64,
    /// `-20·log₁₀(rmse)`, decibels; none if the colours are equal.
    pub psnr_db: Option<f64>,
    /// Structural similarity of red, green and blue.
    pub ssim: f64,
    /// The largest difference of opacity.
    pub opacity_max_abs_error: f64,
    /// The same with pixels in doubt counted apart.
    pub beside_doubt: BesideDoubt,
    /// How far depths are off.
    pub depth: Depths,
}

/// Errors where pixels that have several right answers in float32 are held against the nearest of them.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct BesideDoubt {
    /// Pixels further from the exact picture than `max_abs_error`, each proven to have another right answer within it.
    pub pixels_in_doubt: usize,
    /// The largest difference of any pixel, in doubt or not, from its nearest right answer.
    pub max_abs_error: f64,
    /// Over the pixels that are not in doubt.
    pub rmse: f64,
    /// Of that.
    pub psnr_db: Option<f64>,
}

/// How far depths are off, millimetres of the volume.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Depths {
    /// Pixels with a depth in both pictures.
    pub in_both: usize,
    /// Pixels whose depth the measured picture lacks.
    pub missing: usize,
    /// Pixels that have a depth in the measured picture alone.
    pub extra: usize,
    /// Root of the mean square difference.
    pub rmse_mm: f64,
    /// The largest difference.
    pub max_abs_error_mm: f64,
    /// Pixels with both depths further off than `max_beside_doubt_mm`, each proven to have another right one within it.
    pub pixels_in_doubt: usize,
    /// The largest difference from the nearest right depth.
    pub max_beside_doubt_mm: f64,
}

impl Errors {
    pub(crate) fn of(exact: &mut Exact<'_>, measured: &Picture) -> Result<Self, SweepError> {
        let is_number = |p: &Pixel| p.rgba.iter().all(|x| x.is_finite());
        if let Some(at) = measured.pixels().iter().position(|p| !is_number(p)) {
            let (x, y) = (at as u32 % measured.width(), at as u32 / measured.width());
            return Err(SweepError::NotFinite { x, y, rgba: measured.pixels()[at].rgba });
        }
        let c = compare(&exact.picture, measured)?;
        let pairs = || exact.picture.pixels().iter().zip(measured.pixels());
        let square = |i: usize, (a, b): (&Pixel, &Pixel)| {
            let off = a.rgba[i] - b.rgba[i];
            off * off
        };
        let squares: Vec<f64> = pairs().map(|pair| (0..3).map(|i| square(i, pair)).sum()).collect();
        let colors: Vec<f64> =
            pairs().map(|(a, b)| (0..4).map(|i| off(a.rgba[i], b.rgba[i])).fold(0.0, f64::max)).collect();
        let depths: Vec<f64> =
            pairs().map(|(a, b)| a.depth_mm.zip(b.depth_mm).map_or(0.0, |(a, b)| off(a, b))).collect();

        let found = |pixel: usize| measured.pixels()[pixel];
        let color = |pixel, answers: &Answers| answers.color_error(found(pixel).rgba);
        let (max_abs_error, in_doubt) = beside_doubt(&colors, COLOR_JUMP, color, exact);
        let depth = |pixel, answers: &Answers| answers.depth_error_mm(found(pixel).depth_mm);
        let (max_beside_doubt_mm, depths_in_doubt) = beside_doubt(&depths, DEPTH_JUMP_MM, depth, exact);
        let doubtful: HashSet<usize> = in_doubt.iter().copied().collect();
        let sure = || (0..squares.len()).filter(|pixel| !doubtful.contains(pixel));
        let rmse = match sure().count() {
            0 => 0.0,
            count => (sure().map(|pixel| squares[pixel]).sum::<f64>() / (3 * count) as f64).sqrt(),
        };
        Ok(Self {
            max_abs_error: c.max_abs_error,
            worst: c.worst.map(|w| [w.x, w.y]),
            rmse: c.rmse,
            psnr_db: psnr_db(c.rmse),
            ssim: c.ssim,
            opacity_max_abs_error: c.opacity_max_abs_error,
            beside_doubt: BesideDoubt {
                pixels_in_doubt: in_doubt.len(),
                max_abs_error,
                rmse,
                psnr_db: psnr_db(rmse),
            },
            depth: Depths {
                in_both: c.depth.both,
                missing: c.depth.only_first,
                extra: c.depth.only_second,
                rmse_mm: c.depth.rmse_mm,
                max_abs_error_mm: c.depth.max_abs_error_mm,
                pixels_in_doubt: depths_in_doubt.len(),
                max_beside_doubt_mm,
            },
        })
    }
}

/// The largest distance of a pixel from its nearest right answer, and the pixels in doubt that are further than that
/// from the exact one. Other answers can only be nearer, so pixels are asked from the worst on until what is left is no
/// further off than what was found: a few, where the picture has no jumps, and none that matters is passed over.
fn beside_doubt(
    errors: &[f64],
    jump: f64,
    to_nearest: impl Fn(usize, &Answers) -> f64,
    exact: &mut Exact<'_>,
) -> (f64, Vec<usize>) {
    let mut order: Vec<usize> = (0..errors.len()).filter(|&pixel| errors[pixel] > jump).collect();
    order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
    let small = errors.iter().copied().filter(|error| *error <= jump).fold(0.0, f64::max);
    let mut largest = small;
    let mut asked = 0;
    while order.get(asked).is_some_and(|&pixel| errors[pixel] > largest) {
        let next = &order[asked..(asked + ASKED_AT_A_TIME).min(order.len())];
        for (&pixel, answers) in next.iter().zip(exact.answers(next)) {
            let nearest = to_nearest(pixel, answers);
            let jumps = errors[pixel] - nearest > jump;
            largest = largest.max(if jumps { nearest } else { errors[pixel] });
        }
        asked += next.len();
    }
    (largest, order.into_iter().take_while(|&pixel| errors[pixel] > largest).collect())
}

fn psnr_db(rmse: f64) -> Option<f64> {
    (rmse > 0.0).then(|| -20.0 * rmse.log10())
}

fn off(a: f64, b: f64) -> f64 {
    (a - b).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Subject;
    use render::Placed;
    use scene::{SceneFile, VolumeFacts};
    use spatial::{DVec3, EyeView, Fov, Pose};
    use volume::{Channel, ChannelKind, Grid, Volume, Voxels};

    /// A block of matter whose face at x = -0.5 holds all rays of the middle column: whether they meet it is a matter of
    /// the last digit.
    fn check(change: impl Fn(&mut Vec<Pixel>), expected: impl Fn(&Errors)) {
        let voxels = Voxels::U8(vec![200; 8 * 8 * 8].into());
        let channel =
            Channel { name: "ct".into(), kind: ChannelKind::Intensity, voxels, slope: 1.0, intercept: 0.0 };
        let grid = Grid::axis_aligned([8; 3], DVec3::ONE).unwrap();
        let volume = Volume::new(grid, vec![channel]).unwrap();
        let file = SceneFile::from_json(r#"{"mode": "threshold", "threshold": 100}"#).unwrap();
        let scene = file.resolve(&VolumeFacts::of(&volume)).unwrap();
        let eye_at = DVec3::new(-0.5, 3.5, -20.0);
        let eye = EyeView {
            world_from_eye: Pose::looking_at(eye_at, DVec3::new(-0.5, 3.5, 0.0), DVec3::Y).unwrap(),
            fov: Fov::symmetric(0.2, 0.2).unwrap(),
        };
        let subject = Subject {
            name: "block",
            volume: &volume,
            scene: &scene,
            placed: Placed::own_axes(volume.grid()),
            eye,
            size_px: [9, 9],
        };
        let folder = tempfile::tempdir().unwrap();
        let mut exact = Exact::of(&subject, folder.path(), &|_| {}).unwrap();
        let mut pixels = exact.picture.pixels().to_vec();
        change(&mut pixels);
        let measured = Picture::new(9, 9, pixels).unwrap();
        expected(&Errors::of(&mut exact, &measured).unwrap());
    }

    /// What the other side of the face shows: nothing, or the matter.
    fn other(pixels: &[Pixel]) -> Pixel {
        if pixels[40].rgba[3] > 0.0 {
            Pixel::NOTHING
        } else {
            *pixels.iter().find(|p| p.rgba[3] > 0.0).unwrap()
        }
    }

    #[test]
    fn a_pixel_with_two_right_answers_is_counted_apart() {
        check(
            |pixels| pixels[40] = Pixel { depth_mm: pixels[40].depth_mm, ..other(pixels) },
            |errors| {
                assert!(errors.max_abs_error > 0.5, "{errors:?}");
                assert_eq!(errors.worst, Some([4, 4]), "{errors:?}");
                assert_eq!(errors.beside_doubt.pixels_in_doubt, 1, "{errors:?}");
                assert!(errors.beside_doubt.max_abs_error < 1e-9, "{errors:?}");
                assert!(errors.rmse > 0.01 && errors.beside_doubt.rmse == 0.0, "{errors:?}");
                assert!(errors.psnr_db.is_some() && errors.beside_doubt.psnr_db.is_none(), "{errors:?}");
            },
        );
    }

    #[test]
    fn a_wrong_pixel_is_an_error_whatever_stands_beside_it() {
        check(
            |pixels| {
                pixels[40] = Pixel { depth_mm: pixels[40].depth_mm, ..other(pixels) };
                let seen = pixels.iter().position(|p| p.rgba[3] > 0.0).unwrap();
                let at = if seen % 9 == 4 { seen + 1 } else { seen };
                pixels[at].rgba[1] += 0.1;
            },
            |errors| {
                assert_eq!(errors.beside_doubt.pixels_in_doubt, 1, "{errors:?}");
                assert!((errors.beside_doubt.max_abs_error - 0.1).abs() < 1e-9, "{errors:?}");
                assert!(errors.beside_doubt.rmse > 0.0, "{errors:?}");
            },
        );
    }

    #[test]
    fn neither_of_two_right_answers_is_wrong() {
        check(
            |pixels| pixels[40].rgba = other(pixels).rgba.map(|x| (x + 0.3) / 2.0),
            |errors| {
                assert!(errors.beside_doubt.max_abs_error > 0.1, "{errors:?}");
            },
        );
    }

    #[test]
    fn depths_are_looked_at_where_both_have_one() {
        check(
            |pixels| {
                let seen: Vec<usize> =
                    (0..81).filter(|&i| pixels[i].depth_mm.is_some() && i % 9 != 4).collect();
                *pixels[seen[0]].depth_mm.as_mut().unwrap() += 2.0;
                pixels[seen[1]].depth_mm = None;
                let unseen =
                    (0..81).find(|&i| pixels[i].depth_mm.is_none() && i % 9 != 4 && i != seen[1]).unwrap();
                pixels[unseen].depth_mm = Some(1.0);
            },
            |errors| {
                assert_eq!((errors.depth.missing, errors.depth.extra), (1, 1), "{errors:?}");
                assert_eq!(errors.depth.max_abs_error_mm, 2.0, "{errors:?}");
                assert_eq!(errors.depth.max_beside_doubt_mm, 2.0, "{errors:?}");
                assert_eq!(errors.depth.pixels_in_doubt, 0, "{errors:?}");
                assert_eq!(errors.max_abs_error, 0.0, "{errors:?}");
            },
        );
    }
}
