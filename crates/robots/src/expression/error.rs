use std::ops::Range;

/// An error in the text of an expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct ExpressionError {
    /// Problem, and a way out where there is one.
    pub message: String,
    /// Bytes of the text that it is about.
    pub span: Range<usize>,
    /// Whether the mistake is in a definition that the text uses.
    is_in_definition: bool,
}

impl ExpressionError {
    /// Makes an error about these bytes of the text.
    pub fn new(span: Range<usize>, message: impl Into<String>) -> ExpressionError {
        ExpressionError { message: message.into(), span, is_in_definition: false }
    }

    /// Returns the error of a definition where it is used. The innermost one has the mistake.
    pub(super) fn in_definition(self, name: &str, span: Range<usize>) -> ExpressionError {
        let message = if self.is_in_definition {
            self.message
        } else {
            format!("in the definition of `{name}`: {}", self.message)
        };
        ExpressionError { message, span, is_in_definition: true }
    }

    /// Returns the message with the text and a line that marks the bytes.
    ///
    /// # Example
    /// ```
    /// let text = "1 + )";
    /// let error = mishandle_robots::expression::parse(text).unwrap_err();
    /// assert_eq!(error.marked(text), "expected a number, a name or `(`, found `)`\n  1 + )\n      ^");
    /// ```
    pub fn marked(&self, text: &str) -> String {
        let line = text.replace(['\n', '\r', '\t'], " ");
        let before = text.get(..self.span.start).map_or(0, |before| before.chars().count());
        let marked = text.get(self.span.clone()).map_or(1, |marked| marked.chars().count().max(1));
        format!("{}\n  {line}\n  {}{}", self.message, " ".repeat(before), "^".repeat(marked))
    }
}
