//! Structural similarity (Wang, Bovik, Sheikh and Simoncelli 2004).

/// Standard deviation of the Gaussian window, pixels.
const SIGMA: f64 = 1.5;
/// Half the window: 11 pixels a side.
const REACH: usize = 5;
/// (K₁·L)² and (K₂·L)² with K₁ = 0.01, K₂ = 0.03 and a range L of 1.
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// The mean structural similarity of two planes of values from 0 to 1, rows from the top; 1 if they are equal.
///
/// As published: Gaussian window of 11 × 11 with σ = 1.5, only where it fits. Along a side shorter than the window it is
/// cut to the picture and made to sum to 1 again.
pub(crate) fn mean_ssim(a: &[f64], b: &[f64], width: usize, height: usize) -> f64 {
    mean_ssim_where(a, b, &vec![true; a.len()], width, height).unwrap_or(1.0)
}

/// The same over the pixels that count: windows around them alone, in which they alone have weight. `None` if none counts
/// around which a window fits.
pub(crate) fn mean_ssim_where(
    a: &[f64],
    b: &[f64],
    counts: &[bool],
    width: usize,
    height: usize,
) -> Option<f64> {
    let (across, down) = (windows(width), windows(height));
    let is_counted = |i: usize| f64::from(u8::from(counts[i]));
    let weights = blur(&is_counted, width, height, &across, &down);
    let blurred = |of: &dyn Fn(usize) -> f64| {
        let counted = |i: usize| if counts[i] { of(i) } else { 0.0 };
        let mut sums = blur(&counted, width, height, &across, &down);
        sums.iter_mut().zip(&weights).for_each(|(sum, weight)| *sum /= weight);
        sums
    };
    let mean_a = blurred(&|i| a[i]);
    let mean_b = blurred(&|i| b[i]);
    let square_a = blurred(&|i| a[i] * a[i]);
    let square_b = blurred(&|i| b[i] * b[i]);
    let product = blurred(&|i| a[i] * b[i]);
    let similarity = |i: usize| {
        let (ma, mb) = (mean_a[i], mean_b[i]);
        let (va, vb) = (square_a[i] - ma * ma, square_b[i] - mb * mb);
        let covariance = product[i] - ma * mb;
        (2.0 * ma * mb + C1) * (2.0 * covariance + C2) / ((ma * ma + mb * mb + C1) * (va + vb + C2))
    };
    let centre = |i: usize| down[i / across.len()].centre * width + across[i % across.len()].centre;
    let counted: Vec<usize> = (0..weights.len()).filter(|&i| counts[centre(i)]).collect();
    let sum: f64 = counted.iter().map(|&i| similarity(i)).sum();
    (!counted.is_empty()).then(|| sum / counted.len() as f64)
}

/// A window along a side: its middle, its first pixel, and its weights.
struct Window {
    centre: usize,
    first: usize,
    weights: Vec<f64>,
}

fn windows(length: usize) -> Vec<Window> {
    let fits = length > 2 * REACH;
    let centres = if fits { REACH..length - REACH } else { 0..length };
    centres
        .map(|centre| {
            let first = centre.saturating_sub(REACH);
            let last = (centre + REACH).min(length - 1);
            let weight = |i: usize| {
                let off = i as f64 - centre as f64;
                (-off * off / (2.0 * SIGMA * SIGMA)).exp()
            };
            let sum: f64 = (first..=last).map(weight).sum();
            Window { centre, first, weights: (first..=last).map(|i| weight(i) / sum).collect() }
        })
        .collect()
}

fn blur(
    of: &dyn Fn(usize) -> f64,
    width: usize,
    height: usize,
    across: &[Window],
    down: &[Window],
) -> Vec<f64> {
    let mut rows = Vec::with_capacity(across.len() * height);
    for y in 0..height {
        for window in across {
            let at = |i: usize| of(y * width + window.first + i);
            rows.push(window.weights.iter().enumerate().map(|(i, w)| w * at(i)).sum::<f64>());
        }
    }
    let mut blurred = Vec::with_capacity(across.len() * down.len());
    for window in down {
        for x in 0..across.len() {
            let at = |i: usize| rows[(window.first + i) * across.len() + x];
            blurred.push(window.weights.iter().enumerate().map(|(i, w)| w * at(i)).sum());
        }
    }
    blurred
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_planes_are_wholly_similar() {
        let plane: Vec<f64> = (0..20 * 15).map(|i| f64::from(i % 7) / 7.0).collect();
        assert!((mean_ssim(&plane, &plane, 20, 15) - 1.0).abs() < 1e-12);
        assert!((mean_ssim(&plane[..6], &plane[..6], 3, 2) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn flat_planes_differ_by_their_brightness_alone() {
        let (a, b) = (0.4, 0.6);
        let expected = (2.0 * a * b + C1) / (a * a + b * b + C1);
        assert!((mean_ssim(&[a; 400], &[b; 400], 20, 20) - expected).abs() < 1e-12);
    }

    #[test]
    fn agrees_with_scikit_image() {
        // structural_similarity(a, b, data_range=1, gaussian_weights=True, sigma=1.5, use_sample_covariance=False).
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for y in 0..24 {
            for x in 0..32 {
                let (x, y) = (f64::from(x), f64::from(y));
                let value = 0.5 + 0.4 * (0.3 * x).sin() * (0.2 * y).cos();
                a.push(value);
                b.push((value + 0.1 * (1.7 * x + 0.9 * y).sin()).clamp(0.0, 1.0));
            }
        }
        assert!((mean_ssim(&a, &b, 32, 24) - 0.774_918_982_445_313_8).abs() < 1e-12);
    }

    #[test]
    fn what_does_not_count_has_no_part_in_it() {
        let a: Vec<f64> = (0..30 * 30).map(|i| f64::from(i % 7) / 7.0).collect();
        let counts: Vec<bool> = (0..30 * 30).map(|i| i % 30 >= 12).collect();
        let mut b = a.clone();
        b.iter_mut().zip(&counts).filter(|(_, counts)| !**counts).for_each(|(b, _)| *b = f64::NAN);
        assert!((mean_ssim_where(&a, &b, &counts, 30, 30).unwrap() - 1.0).abs() < 1e-12);
        // One that counts does: it lies in the windows around 12..=20.
        b[15 * 30 + 15] += 0.5;
        let found = mean_ssim_where(&a, &b, &counts, 30, 30).unwrap();
        assert!(found < 0.999 && found > 0.0, "{found}");
        assert_eq!(mean_ssim_where(&a, &b, &[false; 900], 30, 30), None);
    }

    #[test]
    fn a_negative_is_dissimilar() {
        let a: Vec<f64> = (0..400).map(|i| f64::from((i % 20 + i / 20) % 2)).collect();
        let b: Vec<f64> = a.iter().map(|x| 1.0 - x).collect();
        assert!(mean_ssim(&a, &b, 20, 20) < -0.9);
    }
}
