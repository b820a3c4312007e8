//! Errors in the words of Python.

use std::error::Error;
use std::iter::successors;

use mishandle_cli::words::{Python, described, hint, remedies, with_causes};

/// Returns the text of an error with its causes, the outermost first, and what helps.
pub fn worded(error: &(dyn Error + 'static)) -> String {
    let causes = || successors(Some(error), |error| (*error).source());
    let remedies = remedies(causes());
    let text = described(&with_causes(causes()), &remedies, &Python);
    hint(&remedies).map_or(text.clone(), |hint| format!("{text}; {hint}"))
}
