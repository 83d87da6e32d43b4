//! Why a scene file cannot be shown.

/// Why a scene file cannot be shown; each says what was expected and what was found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SceneError {
    /// Not JSON, or not of the schema; the text of the parser names line, column and field.
    #[error("the scene is not valid: {0}")]
    Json(String),
    /// A number is NaN, infinite or out of its range.
    #[error("scene field '{field}' is {found}, expected {expected}")]
    Range {
        /// The field's path.
        field: String,
        /// What was found.
        found: String,
        /// What is allowed.
        expected: &'static str,
    },
    /// The values of a transfer function go down.
    #[error(
        "transfer function: point {index} has value {value}, below {previous} before it; \
         points must be in the order of their values"
    )]
    TransferOrder {
        /// Which point, counted from 0.
        index: usize,
        /// Its value.
        value: f64,
        /// The value before it.
        previous: f64,
    },
    /// More points than any transfer function needs.
    #[error("transfer function has {found} points, at most {max} are allowed")]
    TransferLength {
        /// Points found.
        found: usize,
        /// Points allowed.
        max: usize,
    },
    /// The volume has no such channel.
    #[error("the scene shows channel '{wanted}', the volume has: {available}")]
    NoSuchChannel {
        /// Name or number asked for.
        wanted: String,
        /// What there is.
        available: String,
    },
}

/// Checks that a number lies in a range, for [`SceneError::Range`].
pub(crate) fn within(
    field: &str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    expected: &'static str,
) -> Result<f64, SceneError> {
    if range.contains(&value) {
        Ok(value)
    } else {
        Err(SceneError::Range { field: field.to_owned(), found: value.to_string(), expected })
    }
}
