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
    /// The volume has no such label, and no table names it.
    #[error("the scene names label {wanted}, the volume has: {available}")]
    NoSuchLabel {
        /// Name or number asked for.
        wanted: String,
        /// What there is.
        available: String,
    },
    /// Labels are told apart, not measured: no other mode has a meaning for them.
    #[error(
        "channel '{channel}' holds labels, which mode {mode} cannot show: use emission-absorption, or load its numbers \
         as measured values (--kind intensity)"
    )]
    LabelMode {
        /// The channel's name.
        channel: String,
        /// The mode asked for.
        mode: &'static str,
    },
    /// The scene says how labels look, but the channel holds none.
    #[error(
        "the scene has 'labels', but channel '{channel}' holds measured values: if they are labels, load them as such \
         (--kind label)"
    )]
    NotLabels {
        /// The channel's name.
        channel: String,
    },
    /// There is no such preset.
    #[error("no preset '{wanted}'; there are: {available}")]
    NoSuchPreset {
        /// What was asked for.
        wanted: String,
        /// The names there are.
        available: String,
    },
    /// A preset is made for other volumes.
    #[error(
        "preset '{preset}' is for {wants}, but {found}: choose one that fits ({fits}), or say what the volume is \
         (--modality CT, --kind label)"
    )]
    PresetFit {
        /// The preset.
        preset: String,
        /// What it is for.
        wants: String,
        /// What the volume is.
        found: String,
        /// Presets that fit.
        fits: String,
    },
    /// A file is named where only the one who started the program may name files.
    #[error(
        "the scene names the file '{file}' in {field}, which only a scene file on the server's machine may"
    )]
    File {
        /// The field.
        field: &'static str,
        /// The file.
        file: String,
    },
    /// A further volume is not among those that are there.
    #[error("the scene shows the volume '{wanted}'; there are: {available}")]
    NoSuchVolume {
        /// As the scene names it.
        wanted: String,
        /// What there is beside the first.
        available: String,
    },
    /// What is to be played has no steps.
    #[error(
        "play: expected a volume that is a series in time, found one of a single step; leave the field out"
    )]
    NoSeries,
    /// The series has no such step.
    #[error("play.from: expected a step of 0 to {}, found {wanted}", steps.saturating_sub(1))]
    NoSuchStep {
        /// Step asked for, counted from 0.
        wanted: u32,
        /// How many there are.
        steps: u32,
    },
    /// More volumes than a scene may have.
    #[error(
        "the scene {what} {found} volumes, at most {max} are allowed; hide some with \"shown\": false or leave them out"
    )]
    VolumeCount {
        /// What it does with them.
        what: &'static str,
        /// Volumes found, the first counted.
        found: usize,
        /// Volumes allowed.
        max: usize,
    },
    /// A mode that shows the first volume only is to show others, or the first is hidden.
    #[error(
        "mode {mode} shows the first volume and no other, the scene shows {found} volumes{}; \
         mode emission-absorption shows several", if *first_is_shown { "" } else { ", the first is hidden" }
    )]
    SeveralInMode {
        /// The mode's name.
        mode: &'static str,
        /// Volumes that are to be shown.
        found: usize,
        /// Whether the first is among them.
        first_is_shown: bool,
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
