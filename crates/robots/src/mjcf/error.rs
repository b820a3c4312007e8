use std::fmt;

/// The error of reading or editing a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MjcfError {
    /// The file, empty if the error is of an edit.
    pub file: String,
    /// The line in that file or, without a file, in a fragment of XML.
    pub line: Option<usize>,
    /// The reason.
    pub message: String,
}

impl MjcfError {
    pub(crate) fn new(file: &str, line: Option<usize>, message: impl Into<String>) -> MjcfError {
        MjcfError { file: file.to_string(), line, message: message.into() }
    }

    /// The error of an edit.
    pub(crate) fn edit(message: impl Into<String>) -> MjcfError {
        MjcfError::new("", None, message)
    }
}

impl fmt::Display for MjcfError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.file.as_str(), self.line) {
            ("", None) => f.write_str(&self.message),
            ("", Some(line)) => write!(f, "line {line}: {}", self.message),
            (file, None) => write!(f, "{file}: {}", self.message),
            (file, Some(line)) => write!(f, "{file}:{line}: {}", self.message),
        }
    }
}

impl std::error::Error for MjcfError {}
