//! Why a file gives no colours.

use std::path::Path;

/// Longest file that is read, in bytes: colours are some numbers, not data.
const LONGEST: u64 = 4 << 20;
/// Most characters of a file's text that a message shows.
const LONGEST_SHOWN: usize = 60;

/// Why a file gives no colours.
#[derive(Debug, thiserror::Error)]
pub enum ColourError {
    /// The system refused.
    #[error("{file}: cannot be read")]
    Unreadable {
        /// The file.
        file: String,
        /// The system's words.
        source: std::io::Error,
    },
    /// Larger than any such file.
    #[error("{file}: {found} bytes, at most {max} are read")]
    TooLarge {
        /// The file.
        file: String,
        /// Its bytes.
        found: u64,
        /// The most.
        max: u64,
    },
    /// Nothing in it is known.
    #[error("{file}: expected {expected}")]
    Unknown {
        /// The file.
        file: String,
        /// What is known.
        expected: &'static str,
    },
    /// Something in it is not what it should be.
    #[error("{file}: {what}: expected {expected}, found {found}")]
    Wrong {
        /// The file.
        file: String,
        /// Where.
        what: String,
        /// What should be there.
        expected: String,
        /// What is.
        found: String,
    },
    /// It holds several, or none of that name.
    #[error("{file}: {}; it holds: {available}", match wanted { Some(name) => format!("no '{name}'"), None => "choose one with FILE#NAME".to_owned() })]
    Choice {
        /// The file.
        file: String,
        /// The name asked for.
        wanted: Option<String>,
        /// The names there are.
        available: String,
    },
    /// It is no XML.
    #[error("{file}: not valid XML")]
    Xml {
        /// The file.
        file: String,
        /// The parser's words.
        source: roxmltree::Error,
    },
    /// It is no JSON of the kind.
    #[error("{file}: not valid JSON")]
    Json {
        /// The file.
        file: String,
        /// The parser's words.
        source: serde_json::Error,
    },
    /// Its numbers make no transfer function.
    #[error("{file}: no transfer function")]
    Function {
        /// The file.
        file: String,
        /// Why.
        source: scene::SceneError,
    },
}

impl ColourError {
    pub(crate) fn wrong(
        file: &str,
        what: impl Into<String>,
        expected: impl Into<String>,
        found: &str,
    ) -> Self {
        let found = format!("'{}'", shown(found));
        Self::Wrong { file: file.to_owned(), what: what.into(), expected: expected.into(), found }
    }
}

/// A piece of a file's text as messages show it: short, and without what could steer a terminal.
pub(crate) fn shown(text: &str) -> String {
    let mut short: String =
        text.chars().take(LONGEST_SHOWN).map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect();
    if text.chars().nth(LONGEST_SHOWN).is_some() {
        short.push('…');
    }
    short
}

/// The text of a file. Bytes that are not UTF-8 may stand in names and comments.
pub(crate) fn read(path: &Path) -> Result<String, ColourError> {
    let file = path.display().to_string();
    let unreadable = |source| ColourError::Unreadable { file: file.clone(), source };
    let found = path.metadata().map_err(unreadable)?;
    if !found.is_file() {
        return Err(unreadable(std::io::Error::other("not a file")));
    }
    if found.len() > LONGEST {
        return Err(ColourError::TooLarge { file, found: found.len(), max: LONGEST });
    }
    Ok(String::from_utf8_lossy(&std::fs::read(path).map_err(unreadable)?).into_owned())
}
