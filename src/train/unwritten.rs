use std::collections::BTreeMap;

use crate::MishandleError;

/// Files of a training that could not be written when that was last tried, and why.
///
/// A training goes on without them: a disk that is full may have room later.
#[derive(Debug, Default)]
pub(super) struct Unwritten {
    failures: BTreeMap<&'static str, MishandleError>,
}

impl Unwritten {
    /// Takes down how writing `file` went; gives the failure if it follows no other of that file.
    pub(super) fn note(
        &mut self,
        file: &'static str,
        written: Result<(), MishandleError>,
    ) -> Option<&MishandleError> {
        let failed_before = self.failures.remove(file).is_some();
        let failure = self.failures.entry(file).insert_entry(written.err()?).into_mut();
        (!failed_before).then_some(failure)
    }

    /// Why each file that is not written is not.
    pub(super) fn into_failures(self) -> Vec<MishandleError> {
        self.failures.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_told_once_until_the_file_was_written_again() {
        let full = || Err(MishandleError::NoEpisode);
        let mut unwritten = Unwritten::default();
        assert!(unwritten.note("curve", Ok(())).is_none());
        assert!(unwritten.note("curve", full()).is_some());
        assert!(unwritten.note("curve", full()).is_none());
        assert!(unwritten.note("checkpoint", full()).is_some());
        assert!(unwritten.note("curve", Ok(())).is_none());
        assert!(unwritten.note("curve", full()).is_some());
        assert!(unwritten.note("checkpoint", Ok(())).is_none());
        assert_eq!(unwritten.into_failures().len(), 1);
    }
}
