use std::collections::BTreeMap;

use crate::error::MishandleError;

/// Files of a training run that could not be written at the last attempt, with the errors.
///
/// Training continues, because a full disk may have free space later.
#[derive(Debug, Default)]
pub(super) struct WriteFailures {
    failures: BTreeMap<&'static str, MishandleError>,
}

impl WriteFailures {
    /// Records the result of writing `file`; returns the error if the previous attempt succeeded.
    pub(super) fn record(
        &mut self,
        file: &'static str,
        written: Result<(), MishandleError>,
    ) -> Option<&MishandleError> {
        let failed_before = self.failures.remove(file).is_some();
        let failure = self.failures.entry(file).insert_entry(written.err()?).into_mut();
        (!failed_before).then_some(failure)
    }

    /// Returns the errors of all files that are not written.
    pub(super) fn into_errors(self) -> Vec<MishandleError> {
        self.failures.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::RunError;

    #[test]
    fn an_error_is_returned_once_until_the_next_successful_write() {
        let failed = || Err(MishandleError::Run(RunError::NoEpisode));
        let mut failures = WriteFailures::default();
        assert!(failures.record("curve", Ok(())).is_none());
        assert!(failures.record("curve", failed()).is_some());
        assert!(failures.record("curve", failed()).is_none());
        assert!(failures.record("checkpoint", failed()).is_some());
        assert!(failures.record("curve", Ok(())).is_none());
        assert!(failures.record("curve", failed()).is_some());
        assert!(failures.record("checkpoint", Ok(())).is_none());
        assert_eq!(failures.into_errors().len(), 1);
    }
}
