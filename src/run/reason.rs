//! Reasons of the ends of simulations, for readers.

/// Returns a reason, if there is one.
pub(crate) fn given(reason: &str) -> Option<String> {
    (!reason.is_empty()).then(|| reason.to_string())
}
