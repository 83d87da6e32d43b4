//! By how many pixels one picture is shifted against another.

use reference::{Picture, Pixel};

/// Rounds of refinement.
const ROUNDS: usize = 20;
/// A shift that changes by less than this, in pixels, is found.
const FOUND_PX: f64 = 1e-4;
/// Farthest that a shift is followed, as a share of the picture's lower side.
const FARTHEST: f64 = 0.25;
/// Pictures in which edges of one direction alone are seen do not tell a shift along them: so little of the weaker
/// direction, of the stronger one.
const LEAST_DETERMINED: f64 = 1e-3;

/// The shift, in pixels to the right and down, by which `found` best matches `exact`: that for which the mean square of
/// their difference in luma is least, found by Gauss and Newton's method (Lucas and Kanade 1981) from coarse to fine.
/// `None` where the pictures do not tell: nothing is seen, nothing has an edge, or they are too far apart.
#[must_use]
pub fn offset_px(found: &Picture, exact: &Picture) -> Option<[f64; 2]> {
    let (width, height) = (exact.width() as usize, exact.height() as usize);
    if (found.width() as usize, found.height() as usize) != (width, height) {
        return None;
    }
    let (found, exact) = (Plane::luma(found), Plane::luma(exact));
    let mut shift = [0.0; 2];
    // Blurred first, so that what is some pixels off still overlaps.
    for radius in [4, 2, 1, 0] {
        shift = refined(&found.blurred(radius), &exact.blurred(radius), shift)?;
        let farthest = FARTHEST * width.min(height) as f64;
        if shift.iter().any(|s| !s.is_finite() || s.abs() > farthest) {
            return None;
        }
    }
    Some(shift)
}

fn refined(found: &Plane, exact: &Plane, mut shift: [f64; 2]) -> Option<[f64; 2]> {
    for _ in 0..ROUNDS {
        // Normal equations of: found(p + shift + step) = exact(p), the gradient taken of `exact`.
        let (mut xx, mut xy, mut yy, mut xd, mut yd) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for y in 1..exact.height - 1 {
            for x in 1..exact.width - 1 {
                let Some(shifted) = found.at(x as f64 + shift[0], y as f64 + shift[1]) else { continue };
                let gx = (exact.value(x + 1, y) - exact.value(x - 1, y)) / 2.0;
                let gy = (exact.value(x, y + 1) - exact.value(x, y - 1)) / 2.0;
                let difference = exact.value(x, y) - shifted;
                (xx, xy, yy) = (xx + gx * gx, xy + gx * gy, yy + gy * gy);
                (xd, yd) = (xd + gx * difference, yd + gy * difference);
            }
        }
        let determinant = xx * yy - xy * xy;
        let trace = xx + yy;
        // The smaller eigenvalue over the larger is at least this share of determinant over trace squared.
        if trace <= 0.0 || trace.is_nan() || determinant < LEAST_DETERMINED * trace * trace {
            return None;
        }
        let step = [(xd * yy - yd * xy) / determinant, (yd * xx - xd * xy) / determinant];
        shift = [shift[0] + step[0], shift[1] + step[1]];
        if step[0].hypot(step[1]) < FOUND_PX {
            break;
        }
    }
    Some(shift)
}

/// One value a pixel.
struct Plane {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Plane {
    fn luma(picture: &Picture) -> Self {
        let luma = |p: &Pixel| 0.2126 * p.rgba[0] + 0.7152 * p.rgba[1] + 0.0722 * p.rgba[2];
        Self {
            width: picture.width() as usize,
            height: picture.height() as usize,
            values: picture.pixels().iter().map(luma).collect(),
        }
    }

    fn value(&self, x: usize, y: usize) -> f64 {
        self.values[y * self.width + x]
    }

    /// Bilinear between pixel centres; `None` outside of them.
    fn at(&self, x: f64, y: f64) -> Option<f64> {
        let inside = |v: f64, n: usize| v >= 0.0 && v < (n - 1) as f64;
        if !inside(x, self.width) || !inside(y, self.height) {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = (x - left as f64, y - top as f64);
        let row = |y: usize| self.value(left, y) * (1.0 - fx) + self.value(left + 1, y) * fx;
        Some(row(top) * (1.0 - fy) + row(top + 1) * fy)
    }

    /// The mean over a square of `2 radius + 1` pixels a side, cut off at the border.
    fn blurred(&self, radius: usize) -> Self {
        let mut blurred = Self { width: self.width, height: self.height, values: Vec::new() };
        for y in 0..self.height {
            for x in 0..self.width {
                let (xs, ys) = (around(x, radius, self.width), around(y, radius, self.height));
                let count = (xs.len() * ys.len()) as f64;
                let sum: f64 =
                    ys.flat_map(|y| xs.clone().map(move |x| (x, y))).map(|(x, y)| self.value(x, y)).sum();
                blurred.values.push(sum / count);
            }
        }
        blurred
    }
}

fn around(at: usize, radius: usize, length: usize) -> std::ops::Range<usize> {
    at.saturating_sub(radius)..(at + radius + 1).min(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two soft blobs, whose middle lies so many pixels from the picture's.
    fn blobs(dx: f64, dy: f64) -> Picture {
        let blob = |x: f64, y: f64, cx: f64, cy: f64, r: f64| {
            (-((x - cx).powi(2) + (y - cy).powi(2)) / (r * r)).exp()
        };
        let pixels = (0..48 * 64).map(|i| {
            let (x, y) = (f64::from(i % 64) - dx, f64::from(i / 64) - dy);
            let grey = 0.7 * blob(x, y, 28.0, 22.0, 8.0) + 0.4 * blob(x, y, 40.0, 28.0, 5.0);
            Pixel { rgba: [grey, grey, grey, 1.0], depth_mm: None }
        });
        Picture::new(64, 48, pixels.collect()).unwrap()
    }

    #[test]
    fn a_shift_is_found_to_a_part_of_a_pixel() {
        for [dx, dy] in [[0.0, 0.0], [0.3, -0.2], [2.5, 1.0], [-4.0, 3.3]] {
            let found = offset_px(&blobs(dx, dy), &blobs(0.0, 0.0)).unwrap();
            let off = (found[0] - dx).hypot(found[1] - dy);
            assert!(off < 0.05, "({dx}, {dy}) was found as {found:?}");
        }
    }

    #[test]
    fn what_does_not_tell_a_shift_has_none() {
        let flat = |grey: f64| {
            let pixel = Pixel { rgba: [grey, grey, grey, 1.0], depth_mm: None };
            Picture::new(64, 48, vec![pixel; 64 * 48]).unwrap()
        };
        assert_eq!(offset_px(&flat(0.0), &flat(0.5)), None);
        let stripes = (0..64 * 48).map(|i| {
            let grey = f64::from(i % 64) / 64.0;
            Pixel { rgba: [grey, grey, grey, 1.0], depth_mm: None }
        });
        let stripes = Picture::new(64, 48, stripes.collect()).unwrap();
        assert_eq!(offset_px(&stripes, &stripes), None, "nothing tells how far up it is");
        assert_eq!(offset_px(&flat(0.0), &Picture::new(1, 1, vec![Pixel::NOTHING]).unwrap()), None);
    }
}
