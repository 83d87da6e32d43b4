//! Gauss-Legendre rules on 0 to 1, with the integrals up to each node.

use std::sync::LazyLock;

/// The finest rule.
pub(crate) static FINE: LazyLock<Rule<10>> = LazyLock::new(Rule::gauss_legendre);
/// Enough for thin matter.
pub(crate) static MEDIUM: LazyLock<Rule<6>> = LazyLock::new(Rule::gauss_legendre);
/// What the medium rule is compared with.
pub(crate) static COARSE: LazyLock<Rule<4>> = LazyLock::new(Rule::gauss_legendre);

/// Exact for polynomials of degree 2N - 1.
#[derive(Clone, Debug)]
pub(crate) struct Rule<const N: usize> {
    /// Where to take values, rising.
    pub(crate) nodes: [f64; N],
    /// What each counts for; their sum is 1.
    pub(crate) weights: [f64; N],
    /// `integral_to[i][j]`: what value j counts for in the integral from 0 to node i of the polynomial through all.
    pub(crate) integral_to: [[f64; N]; N],
}

impl<const N: usize> Rule<N> {
    /// Nodes are the roots of the Legendre polynomial, by Newton's method from Tricomi's estimate. The polynomial
    /// through the values is their expansion in Legendre polynomials, for whose coefficients the rule itself is exact;
    /// each of those is integrated by `∫ P_k = (P_{k+1} - P_{k-1}) / (2k + 1)`.
    fn gauss_legendre() -> Self {
        let mut nodes = [0.0; N];
        let mut weights = [0.0; N];
        for i in 0..N {
            let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (N as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..20 {
                let p = legendre(x, N + 1);
                slope = N as f64 * (x * p[N] - p[N - 1]) / (x * x - 1.0);
                x -= p[N] / slope;
            }
            nodes[i] = x;
            weights[i] = 2.0 / ((1.0 - x * x) * slope * slope);
        }
        let mut integral_to = [[0.0; N]; N];
        for i in 0..N {
            let end = legendre(nodes[i], N + 1);
            for j in 0..N {
                let at = legendre(nodes[j], N + 1);
                let sum: f64 = (1..N).map(|k| at[k] * (end[k + 1] - end[k - 1])).sum();
                integral_to[i][j] = weights[j] / 4.0 * (nodes[i] + 1.0 + sum);
            }
        }
        Self { nodes: nodes.map(|x| (x + 1.0) / 2.0), weights: weights.map(|w| w / 2.0), integral_to }
    }
}

/// The Legendre polynomials of degrees 0 to `highest` at x from -1 to 1.
fn legendre(x: f64, highest: usize) -> Vec<f64> {
    let mut p = vec![1.0, x];
    for k in 1..highest {
        let n = k as f64;
        p.push(((2.0 * n + 1.0) * x * p[k] - n * p[k - 1]) / (n + 1.0));
    }
    p
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<const N: usize>(rule: &Rule<N>) {
        for degree in 0..2 * N as i32 {
            let sum: f64 = (0..N).map(|i| rule.weights[i] * rule.nodes[i].powi(degree)).sum();
            assert!((sum - 1.0 / f64::from(degree + 1)).abs() < 1e-15, "{degree}");
        }
        for degree in 0..N as i32 {
            for i in 0..N {
                let sum: f64 = (0..N).map(|j| rule.integral_to[i][j] * rule.nodes[j].powi(degree)).sum();
                let expected = rule.nodes[i].powi(degree + 1) / f64::from(degree + 1);
                assert!((sum - expected).abs() < 2e-15, "{degree} {i}: {sum} {expected}");
            }
        }
        assert!(rule.nodes.windows(2).all(|n| n[0] < n[1]));
    }

    #[test]
    fn rules_are_exact_for_polynomials() {
        check(&FINE);
        check(&MEDIUM);
        check(&COARSE);
    }
}
