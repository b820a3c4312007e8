//! Errors with their causes, and what helps against them.

use std::error::Error;

use mishandle::MishandleError;
use mishandle::results::Remedy;
use mishandle::stl::MonitorError;
use mishandle_evidence::EvidenceError;
use mishandle_logs::LogError;
use mishandle_requirements::RequirementError;

/// Formats the causes of an error, the outermost first. A cause that the text contains already is
/// left out: some errors of libraries end with their cause.
pub fn with_causes<'a>(causes: impl IntoIterator<Item = &'a (dyn Error + 'static)>) -> String {
    causes.into_iter().map(ToString::to_string).fold(String::new(), |text, cause| match text.as_str() {
        "" => cause,
        known if known.ends_with(&cause) => text,
        known => format!("{known}: {cause}"),
    })
}

/// Returns what helps: the remedies of the first cause that has any.
pub fn remedies<'a>(causes: impl IntoIterator<Item = &'a (dyn Error + 'static)>) -> Vec<Remedy> {
    causes.into_iter().map(of).find(|found| !found.is_empty()).unwrap_or_default()
}

fn of(cause: &(dyn Error + 'static)) -> Vec<Remedy> {
    let of_log = cause.downcast_ref().map(LogError::remedies);
    let of_requirement = || cause.downcast_ref().map(RequirementError::remedies);
    let of_library = || cause.downcast_ref().map(MishandleError::remedies);
    let of_evidence = || cause.downcast_ref().map(EvidenceError::remedies);
    let of_formula = || {
        let hint = cause.downcast_ref().and_then(MonitorError::hint)?;
        Some(vec![Remedy::Hint(hint)])
    };
    let found = of_log.or_else(of_requirement).or_else(of_library).or_else(of_evidence);
    found.or_else(of_formula).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_that_an_error_contains_is_printed_once() {
        let error = anyhow::Error::msg("disk I/O error")
            .context("cannot write a.sqlite: disk I/O error")
            .context("run");
        assert_eq!(with_causes(error.chain()), "run: cannot write a.sqlite: disk I/O error");
        assert_eq!(with_causes(anyhow::Error::msg("b").context("a").chain()), "a: b");
    }
}
