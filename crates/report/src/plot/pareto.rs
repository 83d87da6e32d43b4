//! The best of two costs.

use super::chart::Point;

/// The points that no other beats in both: none has less or equal `x` and less or equal `y`, with one of them less.
/// Their indices, by rising `x`. Points that are not finite are left out; of equal points the first is kept.
#[must_use]
pub fn pareto_front(points: &[Point]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len())
        .filter(|index| points[*index].x.is_finite() && points[*index].y.is_finite())
        .collect();
    order.sort_by(|a, b| {
        let (a, b) = (&points[*a], &points[*b]);
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y))
    });
    let mut least = f64::INFINITY;
    order.retain(|index| {
        let better = points[*index].y < least;
        least = least.min(points[*index].y);
        better
    });
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points =
            [(3.0, 1.0), (1.0, 5.0), (2.0, 6.0), (2.0, 2.0), (2.0, 2.0), (4.0, 1.0), (f64::NAN, 0.0)];
        let points = points.map(|(x, y)| Point::new(x, y));
        assert_eq!(pareto_front(&points), [1, 3, 0]);
        assert!(pareto_front(&[]).is_empty());
    }
}
