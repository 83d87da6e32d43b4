//! The value along a ray inside one cell: a cubic.

use spatial::DVec3;

/// Steps of a root search after which the bracket is a rounding error wide, whatever Newton did: every third step
/// halves it.
const MOST_STEPS: usize = 200;
/// A root is found when it moves by no more than this; the parameter runs from 0 to 1.
const ROOT_STEP: f64 = f64::EPSILON;

/// `c₀ + c₁u + c₂u² + c₃u³` over the parameter u from 0 to 1.
///
/// A trilinear function is a product of three linear ones, so that along a straight line it is exactly such a cubic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// Coefficients, the constant one first.
    pub coefficients: [f64; 4],
}

impl Cubic {
    /// The trilinear interpolant of eight corners along the line from `from` (u = 0) to `to` (u = 1), both in the cell's
    /// own coordinates from 0 to 1. Corners: x in bit 0 of the position, y in bit 1, z in bit 2.
    #[must_use]
    pub fn across(corners: &[f64; 8], from: DVec3, to: DVec3) -> Self {
        let step = to - from;
        // Along x: a linear polynomial for each of the four edges.
        let edge = |i: usize| {
            let rise = corners[i + 1] - corners[i];
            [corners[i] + rise * from.x, rise * step.x]
        };
        // Along y: p + (q - p)·(y₀ + Δy·u), a quadratic for each of two faces.
        let face = |p: [f64; 2], q: [f64; 2]| {
            let rise = [q[0] - p[0], q[1] - p[1]];
            [p[0] + rise[0] * from.y, p[1] + rise[1] * from.y + rise[0] * step.y, rise[1] * step.y]
        };
        let (p, q) = (face(edge(0), edge(2)), face(edge(4), edge(6)));
        let rise = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
        Self {
            coefficients: [
                p[0] + rise[0] * from.z,
                p[1] + rise[1] * from.z + rise[0] * step.z,
                p[2] + rise[2] * from.z + rise[1] * step.z,
                rise[2] * step.z,
            ],
        }
    }

    /// The value at `u`.
    #[must_use]
    pub fn at(&self, u: f64) -> f64 {
        let [c0, c1, c2, c3] = self.coefficients;
        c0 + u * (c1 + u * (c2 + u * c3))
    }

    /// The derivative by u at `u`.
    #[must_use]
    pub fn slope_at(&self, u: f64) -> f64 {
        let [_, c1, c2, c3] = self.coefficients;
        c1 + u * (2.0 * c2 + u * 3.0 * c3)
    }

    /// The mean over 0 to 1: the integral of the polynomial, exactly.
    #[must_use]
    pub fn mean(&self) -> f64 {
        let [c0, c1, c2, c3] = self.coefficients;
        c0 + c1 / 2.0 + c2 / 3.0 + c3 / 4.0
    }

    /// 0, where the derivative changes sign strictly between 0 and 1, and 1, in rising order: between neighbours the
    /// value only rises or only falls. The count says how many of the four places are used.
    ///
    /// The quadratic is solved by `q = -(b + sign(b)·√(b² - ac))`, roots `q/a` and `c/q`, which loses no digits and
    /// needs no case for a vanishing leading coefficient (that root is then beyond every bound).
    #[must_use]
    pub fn turns(&self) -> ([f64; 4], usize) {
        let [_, c1, c2, c3] = self.coefficients;
        let (a, half_b, c) = (3.0 * c3, c2, c1);
        let discriminant = half_b * half_b - a * c;
        let mut turns = [0.0; 4];
        let mut count = 1;
        if discriminant > 0.0 {
            let q = -(half_b + discriminant.sqrt().copysign(half_b));
            let (mut first, mut second) = (q / a, c / q);
            if first > second {
                (first, second) = (second, first);
            }
            for root in [first, second] {
                if root > 0.0 && root < 1.0 {
                    turns[count] = root;
                    count += 1;
                }
            }
        }
        turns[count] = 1.0;
        (turns, count + 1)
    }

    /// Where the value is `level` between `from` and `to`, if it only rises or only falls between them and `level` lies
    /// between the values there. Newton's method within a bracket that is halved every third step, to the last bit.
    #[must_use]
    pub fn crossing(&self, level: f64, from: f64, to: f64) -> f64 {
        let (at_from, at_to) = (self.at(from) - level, self.at(to) - level);
        let rising = at_to > at_from;
        let (mut low, mut high) = (from, to);
        let mut u = from + (to - from) * (at_from / (at_from - at_to)).clamp(0.0, 1.0);
        for step in 0..MOST_STEPS {
            let off = self.at(u) - level;
            if off == 0.0 {
                return u;
            }
            if (off < 0.0) == rising {
                low = u;
            } else {
                high = u;
            }
            let newton = u - off / self.slope_at(u);
            // Also false where the slope is 0 and Newton's step is no number.
            let inside = newton > low && newton < high;
            let next = if inside && step % 3 != 2 { newton } else { low + (high - low) / 2.0 };
            if (next - u).abs() <= ROOT_STEP {
                return next;
            }
            u = next;
        }
        u
    }

    /// The first `u` at which the value is at or above `level`.
    #[must_use]
    pub fn first_at_or_above(&self, level: f64) -> Option<f64> {
        if self.at(0.0) >= level {
            return Some(0.0);
        }
        let (turns, count) = self.turns();
        turns[..count]
            .windows(2)
            .find(|span| self.at(span[1]) >= level)
            .map(|span| self.crossing(level, span[0], span[1]))
    }

    /// Adds to `found` each `u` at which the value passes through `level`; a touch without passing is left out.
    pub fn crossings(&self, level: f64, found: &mut Vec<f64>) {
        let (turns, count) = self.turns();
        for span in turns[..count].windows(2) {
            let (before, after) = (self.at(span[0]) - level, self.at(span[1]) - level);
            if before < 0.0 && after > 0.0 || before > 0.0 && after < 0.0 {
                found.push(self.crossing(level, span[0], span[1]));
            } else if after == 0.0 && span[1] < 1.0 {
                found.push(span[1]);
            }
        }
    }

    /// The highest value and the first `u` at which it is reached.
    #[must_use]
    pub fn highest(&self) -> (f64, f64) {
        let (turns, count) = self.turns();
        let mut best = (0.0, self.at(0.0));
        for &u in &turns[1..count] {
            let value = self.at(u);
            if value > best.1 {
                best = (u, value);
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn from_roots(scale: f64, r: [f64; 3]) -> Cubic {
        let [a, b, c] = r;
        Cubic { coefficients: [-a * b * c, a * b + b * c + a * c, -(a + b + c), 1.0].map(|x| x * scale) }
    }

    fn roots(cubic: &Cubic) -> Vec<f64> {
        let mut found = Vec::new();
        cubic.crossings(0.0, &mut found);
        found
    }

    fn check_roots(cubic: &Cubic, expected: &[f64]) {
        let found = roots(cubic);
        assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < 1e-14, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn finds_three_roots() {
        check_roots(&from_roots(3.0, [0.25, 0.5, 0.75]), &[0.25, 0.5, 0.75]);
    }

    #[test]
    fn a_double_root_is_touched_not_passed() {
        let cubic = from_roots(1.0, [0.25, 0.25, 3.0]);
        assert!(roots(&cubic).len() <= 2);
        // Touched from below: the first point at or above the level is the touch itself.
        let negative = Cubic { coefficients: [-0.0625, 0.5, -1.0, 0.0] };
        assert_eq!(negative.first_at_or_above(0.0), Some(0.25));
    }

    #[test]
    fn degenerate_cubics_are_solved() {
        check_roots(&Cubic { coefficients: [-0.25, 0.0, 1.0, 0.0] }, &[0.5]);
        check_roots(&Cubic { coefficients: [-0.25, 1.0, 0.0, 0.0] }, &[0.25]);
        check_roots(&Cubic { coefficients: [-0.25, 1.0, 0.0, 1e-300] }, &[0.25]);
        check_roots(&Cubic { coefficients: [-0.25, 1.0, 1e-300, 0.0] }, &[0.25]);
        check_roots(&Cubic { coefficients: [1.0, 0.0, 0.0, 0.0] }, &[]);
        check_roots(&Cubic { coefficients: [0.0; 4] }, &[]);
        check_roots(&Cubic { coefficients: [-0.125, 0.0, 0.0, 1.0] }, &[0.5]);
    }

    #[test]
    fn a_triple_root_is_passed_once() {
        let found = roots(&from_roots(1.0, [0.5, 0.5, 0.5]));
        assert_eq!(found.len(), 1);
        // Its condition is the cube root of the rounding error.
        assert!((found[0] - 0.5).abs() < 1e-5);
    }

    #[test]
    fn the_highest_value_is_at_an_end_or_where_the_slope_is_zero() {
        let (u, value) = Cubic { coefficients: [0.0, 1.0, -1.0, 0.0] }.highest();
        assert!((u - 0.5).abs() < 1e-15 && (value - 0.25).abs() < 1e-15);
        assert_eq!(Cubic { coefficients: [2.0, 0.0, 0.0, 0.0] }.highest(), (0.0, 2.0));
        assert_eq!(Cubic { coefficients: [0.0, 0.0, 0.0, 2.0] }.highest(), (1.0, 2.0));
    }

    proptest! {
        #[test]
        fn the_cubic_is_the_trilinear_value_along_the_line(
            corners in prop::array::uniform8(-100.0..100.0f64),
            from in prop::array::uniform3(0.0..1.0f64),
            to in prop::array::uniform3(0.0..1.0f64),
            u in 0.0..1.0f64,
        ) {
            let (from, to) = (DVec3::from_array(from), DVec3::from_array(to));
            let p = from.lerp(to, u);
            let weight = |i: usize| {
                (0..3).map(|axis| if i >> axis & 1 == 1 { p[axis] } else { 1.0 - p[axis] }).product::<f64>()
            };
            let expected: f64 = (0..8).map(|i| weight(i) * corners[i]).sum();
            prop_assert!((Cubic::across(&corners, from, to).at(u) - expected).abs() < 1e-12);
        }

        #[test]
        fn what_is_found_is_a_root_and_nothing_is_missed(c in prop::array::uniform4(-1.0..1.0f64)) {
            let cubic = Cubic { coefficients: c };
            let found = roots(&cubic);
            for u in &found {
                prop_assert!(cubic.at(*u).abs() < 1e-14);
            }
            // Signs between roots are those of a dense sampling.
            let changes = (0..10_000)
                .filter(|i| (cubic.at(f64::from(*i) * 1e-4) < 0.0) != (cubic.at(f64::from(i + 1) * 1e-4) < 0.0))
                .count();
            prop_assert!(changes <= found.len(), "{changes} {found:?}");
        }

        #[test]
        fn nothing_before_the_first_point_reaches_the_level(
            c in prop::array::uniform4(-1.0..1.0f64), level in -1.0..1.0f64
        ) {
            let cubic = Cubic { coefficients: c };
            let first = cubic.first_at_or_above(level);
            for i in 0..=1000 {
                let u = f64::from(i) * 1e-3;
                if cubic.at(u) > level + 1e-13 {
                    prop_assert!(first.is_some_and(|f| f <= u), "{first:?} {u}");
                }
            }
        }
    }
}
