//! Standardised uptake values of positron emission tomography.

use super::object::Object;
use super::tags;

/// Seconds of a day.
const DAY_SECS: f64 = 86_400.0;

/// What a stored value in Bq/ml is multiplied with to become g/ml, by body weight: weight over the dose that was left
/// when the scan began. `Err` says what is missing.
///
/// Source: Quantitative Imaging Biomarkers Alliance, vendor-neutral pseudo-code for SUV calculation.
pub(super) fn factor(object: &Object) -> Result<f64, &'static str> {
    let corrected = object.top.text(tags::CORRECTED_IMAGE).unwrap_or_default();
    let has = |what: &str| corrected.split('\\').any(|c| c.trim() == what);
    if !has("ATTN") || !has("DECY") {
        return Err("the image is not corrected for attenuation and decay");
    }
    let positive = |value: Option<f64>| value.filter(|v| *v > 0.0);
    let weight_g = positive(object.top.number(tags::PATIENT_WEIGHT))
        .ok_or("the patient's weight is not in the file")?
        * 1000.0;
    let dose_bq = positive(object.injected.number(tags::RADIONUCLIDE_TOTAL_DOSE))
        .ok_or("the dose is not in the file")?;
    let left = match object.top.text(tags::DECAY_CORRECTION).as_deref() {
        Some("ADMIN") => 1.0,
        Some("START") => {
            let half_life = positive(object.injected.number(tags::RADIONUCLIDE_HALF_LIFE));
            let half_life_secs = half_life.ok_or("the half-life is not in the file")?;
            let waited_secs =
                waited_secs(object).ok_or("the time of injection or of the scan is not in the file")?;
            (-waited_secs / half_life_secs).exp2()
        }
        _ => return Err("decay is not corrected to the start of the scan or to the injection"),
    };
    let factor = weight_g / (dose_bq * left);
    if factor.is_finite() && factor > 0.0 { Ok(factor) } else { Err("dose and times make no number") }
}

/// From the injection to the start of the scan.
fn waited_secs(object: &Object) -> Option<f64> {
    let top = &object.top;
    let series = time_secs(&top.text(tags::SERIES_TIME)?)?;
    let acquired = time_secs(&top.text(tags::ACQUISITION_TIME)?)?;
    let [series_day, acquired_day] = [tags::SERIES_DATE, tags::ACQUISITION_DATE]
        .map(|tag| top.text(tag).and_then(|date| day(&date)).unwrap_or(0.0));
    let (series, acquired) = (series_day * DAY_SECS + series, acquired_day * DAY_SECS + acquired);
    // A series that was processed later has a later time than its first image: it says nothing about the scan.
    if series > acquired {
        return None;
    }
    let injected = match object.injected.text(tags::RADIOPHARMACEUTICAL_START_DATE_TIME) {
        Some(both) if both.len() > 8 && both.is_ascii() => {
            day(&both[..8])? * DAY_SECS + time_secs(&both[8..])?
        }
        _ => {
            let time = time_secs(&object.injected.text(tags::RADIOPHARMACEUTICAL_START_TIME)?)?;
            let same_day = series_day * DAY_SECS + time;
            if same_day > series { same_day - DAY_SECS } else { same_day }
        }
    };
    Some(series - injected).filter(|waited| (0.0..DAY_SECS).contains(waited))
}

/// `HHMMSS.ffffff`, of which the end may be missing; what follows a sign is the time zone.
pub(super) fn time_secs(text: &str) -> Option<f64> {
    let text = text.split(['+', '-']).next()?;
    let part = |range: std::ops::Range<usize>| text.get(range).map_or(Some(0.0), |t| t.parse::<f64>().ok());
    let hours: f64 = text.get(..2)?.parse().ok()?;
    let seconds: f64 = text.get(4..).filter(|t| !t.is_empty()).map_or(Some(0.0), |t| t.parse().ok())?;
    let secs = hours * 3600.0 + part(2..4)? * 60.0 + seconds;
    (0.0..=DAY_SECS).contains(&secs).then_some(secs)
}

/// Days of `YYYYMMDD` since some day, the same for all.
fn day(text: &str) -> Option<f64> {
    let number = |range: std::ops::Range<usize>| text.get(range)?.parse::<u32>().ok();
    let (year, month, day) = (number(0..4)?, number(4..6)?, number(6..8)?);
    if !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Years begin in March, so that the leap day is their last.
    let year = if month < 3 { year.checked_sub(1)? } else { year };
    let month = (month + 9) % 12;
    Some(f64::from(365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_days_are_read() {
        assert_eq!(time_secs("101530.5"), Some(36_930.5));
        assert_eq!(time_secs("10"), Some(36_000.0));
        assert_eq!(time_secs("1015"), Some(36_900.0));
        assert_eq!(time_secs("101530+0200"), Some(36_930.0));
        assert_eq!(time_secs("xx"), None);
        let apart = |a: &str, b: &str| day(b).unwrap() - day(a).unwrap();
        assert_eq!(apart("20240228", "20240301"), 2.0);
        assert_eq!(apart("20230228", "20230301"), 1.0);
        assert_eq!(apart("20231231", "20240101"), 1.0);
        assert_eq!(apart("20000101", "20240101"), 8766.0);
        assert_eq!(day("20241301"), None);
    }
}
