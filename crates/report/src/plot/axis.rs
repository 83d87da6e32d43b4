//! Where a value stands along an axis, and which values are written beside it.

/// How values are laid along an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equal lengths.
    #[default]
    Linear,
    /// Equal ratios are equal lengths. What is 0 or less stands at the axis's lower end, hollow.
    Log,
}

/// Values from `low` to `high` laid from `start` to `end`, in pixels. `low < high`, both above 0 if logarithmic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ruler {
    pub(super) scale: Scale,
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) start: f64,
    pub(super) end: f64,
}

impl Ruler {
    /// A ruler without a place yet that holds all finite `values`, with round ends. A linear one begins at 0 if that
    /// is not far away.
    pub(super) fn around(scale: Scale, values: impl IntoIterator<Item = f64>) -> Self {
        let values = values.into_iter().filter(|value| value.is_finite());
        let shown = values.filter(|value| scale == Scale::Linear || *value > 0.0);
        let (mut low, mut high) = shown
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            (low, high) = (1.0, 10.0);
        }
        match scale {
            Scale::Linear => {
                if low > 0.0 && low < high * 0.7 {
                    low = 0.0;
                }
                if low == high {
                    high += if low == 0.0 { 1.0 } else { low.abs() * 0.1 };
                }
                let step = step(high - low, 6);
                // A little air above the highest value.
                (low, high) =
                    ((low / step).floor() * step, ((high + 0.02 * (high - low)) / step).ceil() * step);
            }
            Scale::Log => {
                // To the next of 1, 2, 5, with a little air.
                (low, high) = (round_down(low / 1.15), round_up(high * 1.15));
            }
        }
        Self { scale, low, high, start: 0.0, end: 1.0 }
    }

    pub(super) fn linear(low: f64, high: f64) -> Self {
        Self { scale: Scale::Linear, low, high, start: 0.0, end: 1.0 }
    }

    pub(super) fn laid(self, start: f64, end: f64) -> Self {
        Self { start, end, ..self }
    }

    /// Where a value stands, in pixels; at an end if it lies beyond.
    pub(super) fn place(&self, value: f64) -> f64 {
        let share = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log if value <= self.low => 0.0,
            Scale::Log => (value / self.low).ln() / (self.high / self.low).ln(),
        };
        self.start + share.clamp(0.0, 1.0) * (self.end - self.start)
    }

    /// Whether a value stands at its own place.
    pub(super) fn holds(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// Round values along the axis with their text; about `most`, and not many more.
    pub(super) fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Linear => {
                let step = step(self.high - self.low, most);
                let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
                let first = (self.low / step - 1e-9).ceil() as i64;
                let last = (self.high / step + 1e-9).floor() as i64;
                let values = (first..=last).map(|index| index as f64 * step);
                values.map(|value| (value, format!("{value:.decimals$}").replace('-', "−"))).collect()
            }
            Scale::Log => {
                let exponents = self.low.log10().floor() as i32..=self.high.log10().ceil() as i32;
                let within = |digits: &'static [f64]| {
                    let values =
                        exponents.clone().flat_map(move |e| digits.iter().map(move |d| d * 10f64.powi(e)));
                    values
                        .filter(|value| (self.low * 0.999..=self.high * 1.001).contains(value))
                        .collect::<Vec<_>>()
                };
                let fine = within(&[1.0, 2.0, 5.0]);
                let mut values = if fine.len() <= most { fine } else { within(&[1.0]) };
                let every = values.len().div_ceil(most.max(1));
                values = values.into_iter().step_by(every).collect();
                values.into_iter().map(|value| (value, plain(value))).collect()
            }
        }
    }
}

/// A step of 1, 2 or 5 times a power of ten that divides `span` into `most` parts or fewer.
pub(super) fn step(span: f64, most: usize) -> f64 {
    round_up(span / most.max(1) as f64 * (1.0 - 1e-9))
}

fn round_up(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let digits = [1.0, 2.0, 5.0, 10.0];
    digits
        .into_iter()
        .map(|digit| digit * power)
        .find(|round| *round >= value * (1.0 - 1e-9))
        .unwrap_or(10.0 * power)
}

fn round_down(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let digits = [5.0, 2.0, 1.0];
    digits
        .into_iter()
        .map(|digit| digit * power)
        .find(|round| *round <= value * (1.0 + 1e-9))
        .unwrap_or(power)
}

/// A number without needless digits: 0.002, 50, 1e-7.
pub(super) fn plain(value: f64) -> String {
    if value == 0.0 || (1e-4..1e6).contains(&value.abs()) {
        // Six significant digits are more than a label needs and hide the last bits of a product.
        let decimals = if value == 0.0 { 0 } else { (5.0 - value.abs().log10().floor()).max(0.0) as usize };
        let text = format!("{value:.decimals$}");
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        text.replace('-', "−")
    } else {
        format!("{value:.0e}").replace('-', "−")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(ruler: Ruler, most: usize, expected: &[&str]) {
        let found: Vec<String> = ruler.ticks(most).into_iter().map(|(_, text)| text).collect();
        assert_eq!(found, expected, "{ruler:?}");
    }

    #[test]
    fn linear_ticks_are_round() {
        check(Ruler::linear(0.0, 10.0), 10, &["0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "10"]);
        check(Ruler::linear(0.0, 600.0), 6, &["0", "100", "200", "300", "400", "500", "600"]);
        check(Ruler::linear(-0.3, 0.3), 4, &["−0.2", "0.0", "0.2"]);
    }

    #[test]
    fn logarithmic_ticks_are_ones_twos_and_fives_or_powers() {
        check(Ruler::around(Scale::Log, [1.2, 40.0]), 8, &["1", "2", "5", "10", "20", "50"]);
        check(Ruler::around(Scale::Log, [2e-8, 0.9]), 5, &["1e−8", "1e−6", "0.0001", "0.01", "1"]);
    }

    #[test]
    fn an_axis_holds_its_values_whatever_they_are() {
        for scale in [Scale::Linear, Scale::Log] {
            for values in [&[][..], &[3.0], &[0.0], &[-4.0, -4.0], &[1e-9, 1e9], &[f64::NAN, 2.0]] {
                let ruler = Ruler::around(scale, values.iter().copied()).laid(0.0, 100.0);
                assert!(ruler.low < ruler.high, "{scale:?} {values:?}: {ruler:?}");
                assert!(!ruler.ticks(6).is_empty(), "{scale:?} {values:?}: {ruler:?}");
                for value in values
                    .iter()
                    .filter(|value| value.is_finite() && (scale == Scale::Linear || **value > 0.0))
                {
                    assert!(ruler.holds(*value), "{scale:?} {values:?}: {ruler:?}");
                }
            }
        }
    }
}
