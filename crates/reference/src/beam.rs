//! The emission-absorption integral, adaptively, for any matter along a way.

use crate::quadrature::{COARSE, FINE, MEDIUM, Rule};

/// Colours and opacity of a pixel are integrated to this absolute error.
pub(crate) const PICTURE_ERROR: f64 = 1.0e-10;
/// Optical depth behind which at most 1e-14 of the light is left: nothing there counts.
pub(crate) const SPENT_DEPTH: f64 = 32.24;
/// A rule is not trusted over a larger optical depth: its nodes could all lie behind the part that is seen.
const DEEPEST_PIECE: f64 = 2.0;
/// Relative rounding error of a sum over a rule; less cannot be asked for.
const ROUNDING: f64 = 4.0e-16;
/// Halvings after which a piece counts for less than its rounding error.
const MOST_HALVINGS: u32 = 48;

/// What matter does to light at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matter {
    /// Its colour as lit, RGB.
    pub color: [f64; 3],
    /// Its extinction a millimetre.
    pub extinction_per_mm: f64,
}

/// What has been seen along a ray so far.
///
/// `color = ∫ c σ exp(-τ) dt` and `τ = ∫ σ dt`, by Gauss-Legendre quadrature on pieces that are halved until the rule
/// of 6 nodes agrees with that of 4, or that of 10 with that of 6. Within a piece, τ at the nodes is the integral of the polynomial through the
/// values of σ there. The estimate of the finer rule's error from the difference is QUADPACK's (Piessens et al. 1983).
#[derive(Clone, Debug)]
pub struct Beam {
    color: [f64; 3],
    optical_depth: f64,
    /// The optical depth whose place is looked for.
    sought_depth: f64,
}

impl Default for Beam {
    fn default() -> Self {
        Self::seeking(0.5)
    }
}

impl Beam {
    /// A beam through nothing yet, which looks for where its transmittance falls to `transmittance`.
    #[must_use]
    pub fn seeking(transmittance: f64) -> Self {
        Self { color: [0.0; 3], optical_depth: 0.0, sought_depth: -transmittance.ln() }
    }

    /// Colour times opacity, RGB.
    #[must_use]
    pub fn color(&self) -> [f64; 3] {
        self.color
    }

    /// ∫ σ dt.
    #[must_use]
    pub fn optical_depth(&self) -> f64 {
        self.optical_depth
    }

    /// Opacity, 1 - exp(-∫ σ dt), with all its digits where it is small.
    #[must_use]
    pub fn alpha(&self) -> f64 {
        -(-self.optical_depth).exp_m1()
    }

    /// Whether what lies behind can add no more than 1e-14.
    #[must_use]
    pub fn is_spent(&self) -> bool {
        self.optical_depth > SPENT_DEPTH
    }

    /// Goes on through matter that is given by a parameter from `from` to `to`, in which it is smooth; each unit of the
    /// parameter is `mm` millimetres. Colour and opacity change by at most `error` from their exact values. Tells at
    /// which parameter the transmittance fell to what the beam looks for, if it did here.
    pub fn pass(
        &mut self,
        from: f64,
        to: f64,
        mm: f64,
        error: f64,
        matter: &impl Fn(f64) -> Matter,
    ) -> Option<f64> {
        self.halve(from, to, mm, error, MOST_HALVINGS, matter)
    }

    fn halve(
        &mut self,
        from: f64,
        to: f64,
        mm: f64,
        error: f64,
        halvings: u32,
        matter: &impl Fn(f64) -> Matter,
    ) -> Option<f64> {
        if self.is_spent() {
            return None;
        }
        let light = (-self.optical_depth).exp();
        let middle = from + (to - from) / 2.0;
        let enough = |piece: &Piece, coarser: &Piece| {
            piece.optical_depth <= DEEPEST_PIECE && light * piece.error(coarser) <= error
        };
        let medium = Piece::of(&MEDIUM, from, to, mm, matter);
        if enough(&medium, &Piece::of(&COARSE, from, to, mm, matter)) {
            return self.take(&medium, light, from, to, mm, matter);
        }
        let fine = Piece::of(&FINE, from, to, mm, matter);
        let indivisible = halvings == 0 || middle <= from || middle >= to;
        if indivisible || enough(&fine, &medium) {
            return self.take(&fine, light, from, to, mm, matter);
        }
        let first = self.halve(from, middle, mm, error / 2.0, halvings - 1, matter);
        let second = self.halve(middle, to, mm, error / 2.0, halvings - 1, matter);
        first.or(second)
    }

    fn take(
        &mut self,
        piece: &Piece,
        light: f64,
        from: f64,
        to: f64,
        mm: f64,
        matter: &impl Fn(f64) -> Matter,
    ) -> Option<f64> {
        let missing = self.sought_depth - self.optical_depth;
        for (sum, c) in self.color.iter_mut().zip(piece.color) {
            *sum += light * c;
        }
        self.optical_depth += piece.optical_depth;
        let falls_here = missing > 0.0 && missing <= piece.optical_depth;
        falls_here.then(|| depth_reached(missing, from, to, mm, matter))
    }
}

/// One rule over one piece, seen with the light of the piece's begin.
struct Piece {
    color: [f64; 3],
    optical_depth: f64,
    /// The same integral for a colour of 1, which has a closed form: `1 - exp(-τ)`. How far off it is, is an error too.
    opacity: f64,
}

impl Piece {
    fn of<const N: usize>(
        rule: &Rule<N>,
        from: f64,
        to: f64,
        mm: f64,
        matter: &impl Fn(f64) -> Matter,
    ) -> Self {
        let width = to - from;
        let at = rule.nodes.map(|node| matter(from + width * node));
        let extinction = at.map(|m| m.extinction_per_mm * width * mm);
        let mut piece = Self { color: [0.0; 3], optical_depth: 0.0, opacity: 0.0 };
        for i in 0..N {
            let depth: f64 = (0..N).map(|j| rule.integral_to[i][j] * extinction[j]).sum();
            let seen = rule.weights[i] * extinction[i] * (-depth).exp();
            for (sum, c) in piece.color.iter_mut().zip(at[i].color) {
                *sum += seen * c;
            }
            piece.opacity += seen;
            piece.optical_depth += rule.weights[i] * extinction[i];
        }
        piece
    }

    /// What this rule may be off by, given a coarser one.
    fn error(&self, coarse: &Self) -> f64 {
        let left = (-self.optical_depth).exp();
        let closed = 1.0 - left;
        let mut difference = (left - (-coarse.optical_depth).exp()).abs();
        for (fine, coarse) in self.color.iter().zip(coarse.color) {
            difference = difference.max((fine - coarse).abs());
        }
        let size = self.color.iter().copied().fold(closed, f64::max);
        // (200·difference/size)^1.5, times the size.
        let apart = if size > 0.0 { 200.0 * difference / size } else { 0.0 };
        let estimated = size * (apart * apart.sqrt()).min(1.0);
        let known = (self.opacity - closed).abs();
        let error = estimated.max(known);
        if error <= ROUNDING * size.max(left) { 0.0 } else { error }
    }
}

/// The parameter at which the optical depth from `from` on is `sought`; it lies before `to`, in a piece over which the
/// rule is exact. Newton's method, whose derivative is the extinction, within a bracket.
fn depth_reached(sought: f64, from: f64, to: f64, mm: f64, matter: &impl Fn(f64) -> Matter) -> f64 {
    let depth_to = |u: f64| {
        let at = |node: f64| matter(from + (u - from) * node).extinction_per_mm;
        let sum: f64 = FINE.nodes.iter().zip(FINE.weights).map(|(&node, w)| w * at(node)).sum();
        sum * (u - from) * mm
    };
    let (mut low, mut high) = (from, to);
    let mut u = low + (high - low) / 2.0;
    for step in 0..200 {
        let off = depth_to(u) - sought;
        if off < 0.0 {
            low = u;
        } else {
            high = u;
        }
        let newton = u - off / (matter(u).extinction_per_mm * mm);
        let next =
            if newton > low && newton < high && step % 3 != 2 { newton } else { low + (high - low) / 2.0 };
        if (next - u).abs() <= f64::EPSILON * to.abs().max(from.abs()) {
            return next;
        }
        u = next;
    }
    u
}

#[cfg(test)]
mod tests {
    use super::*;

    fn through(length: f64, matter: impl Fn(f64) -> Matter) -> (Beam, Option<f64>) {
        let mut beam = Beam::default();
        let half = beam.pass(0.0, length, 1.0, PICTURE_ERROR, &matter);
        (beam, half)
    }

    #[test]
    fn a_homogeneous_slab_is_exponential_whatever_its_opacity() {
        for sigma in [1e-9, 1e-6, 0.1, 1.0, 13.86, 1e3, 1e6] {
            for length in [1e-6, 1.0, 40.0, 1e4] {
                let (beam, half) =
                    through(length, |_| Matter { color: [1.0, 0.5, 0.0], extinction_per_mm: sigma });
                let alpha = -(-sigma * length).exp_m1();
                assert!((beam.alpha() - alpha).abs() <= 1e-12 * alpha + 1e-13, "{sigma} {length}");
                assert!((beam.color()[0] - alpha).abs() < 1e-10, "{sigma} {length}: {:?}", beam.color());
                assert!((beam.color()[1] - alpha / 2.0).abs() < 1e-10);
                assert_eq!(half.is_some(), sigma * length >= std::f64::consts::LN_2);
                if let Some(half) = half {
                    let expected = std::f64::consts::LN_2 / sigma;
                    assert!((half / expected - 1.0).abs() < 1e-9, "{sigma} {length}: {half}");
                }
            }
        }
    }

    #[test]
    fn linear_extinction_and_colour_follow_the_closed_form() {
        // ∫₀ᴸ (c₀ + c₁t)(a + bt) e^(-τ) dt = c₀ - (c₀ + c₁L) e^(-τ(L)) + c₁ ∫ e^(-τ), τ = at + bt²/2. The last integral by
        // Simpson's rule on 20 000 pieces: its error is below 1e-14 here, and the form has no b to divide by.
        for (a, b, c0, c1, length) in [
            (0.3, 0.2, 0.2, 0.1, 5.0),
            (0.0, 1.0, 1.0, -0.1, 8.0),
            (2.0, -0.3, 0.0, 0.2, 5.0),
            (0.5, 1e-14, 0.1, 0.3, 3.0),
            (1e-6, 1e-7, 0.1, 0.3, 3.0),
        ] {
            let tau = |t: f64| a * t + b * t * t / 2.0;
            let pieces = 20_000;
            let h = length / f64::from(2 * pieces);
            let integral: f64 = (0..=2 * pieces)
                .map(|i| {
                    let weight = if i == 0 || i == 2 * pieces { 1.0 } else { f64::from(2 + 2 * (i % 2)) };
                    weight * (-tau(f64::from(i) * h)).exp()
                })
                .sum::<f64>()
                * h
                / 3.0;
            let expected = c0 - (c0 + c1 * length) * (-tau(length)).exp() + c1 * integral;
            let (beam, _) =
                through(length, |t| Matter { color: [c0 + c1 * t; 3], extinction_per_mm: a + b * t });
            assert!((beam.color()[0] - expected).abs() < 1e-10, "{a} {b}: {} {expected}", beam.color()[0]);
            assert!((beam.optical_depth() - tau(length)).abs() < 1e-12);
        }
    }

    #[test]
    fn the_closed_form_in_error_functions_agrees() {
        // √(π/2b)·e^(a²/2b)·[erf((a+bL)/√(2b)) - erf(a/√(2b))] with a = 0, b = 2, L = 1: √π/2·erf(1).
        let erf_1 = 0.842_700_792_949_714_9;
        let integral = std::f64::consts::PI.sqrt() / 2.0 * erf_1;
        let (c0, c1) = (0.3, 0.5);
        let expected = c0 - (c0 + c1) * (-1.0f64).exp() + c1 * integral;
        let (beam, _) = through(1.0, |t| Matter { color: [c0 + c1 * t; 3], extinction_per_mm: 2.0 * t });
        assert!((beam.color()[0] - expected).abs() < 1e-11);
    }

    #[test]
    fn the_place_where_half_the_light_is_left_is_exact() {
        let (_, half) = through(3.0, |t| Matter { color: [0.0; 3], extinction_per_mm: t });
        assert!((half.unwrap() - (2.0 * std::f64::consts::LN_2).sqrt()).abs() < 1e-14);
    }

    #[test]
    fn a_highlight_narrower_than_the_nodes_are_apart_is_found() {
        // Colour 1/(1 + (t/w)²) around 0.37: the integral without absorption is w·[atan].
        let w = 1e-3;
        let (beam, _) = through(1.0, |t| Matter {
            color: [1.0 / (1.0 + ((t - 0.37) / w).powi(2)); 3],
            extinction_per_mm: 1e-6,
        });
        let expected = 1e-6 * w * ((0.63 / w).atan() + (0.37 / w).atan());
        assert!((beam.color()[0] - expected).abs() < 1e-10);
        let (beam, _) = through(1.0, |t| Matter {
            color: [1.0 / (1.0 + ((t - 0.37) / w).powi(2)); 3],
            extinction_per_mm: 1.0,
        });
        let fine: f64 = (0..2_000_000)
            .map(|i| {
                let t = (f64::from(i) + 0.5) * 5e-7;
                5e-7 * (-t).exp() / (1.0 + ((t - 0.37) / w).powi(2))
            })
            .sum();
        assert!((beam.color()[0] - fine).abs() < 1e-9, "{} {fine}", beam.color()[0]);
    }

    #[test]
    fn early_termination_leaves_no_more_than_it_states() {
        let (beam, _) =
            through(1e3, |t| Matter { color: [if t > 40.0 { 1.0 } else { 0.0 }; 3], extinction_per_mm: 1.0 });
        assert!(beam.is_spent());
        assert!(beam.color()[0] < 1e-14);
        assert!(1.0 - beam.alpha() < 1e-14);
    }
}
