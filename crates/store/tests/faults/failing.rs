//! A run in which one step fails.

use std::path::{Path, PathBuf};

use mishandle_store::StoreError;
use tempfile::TempDir;

use super::life::{Content, Session, Step};
use super::vfs;

/// Reaction to an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaction {
    /// The same writer performs the step again.
    Retry,
    /// The writer is dropped while the fault lasts, and the run is resumed.
    Resume,
}

/// The steps of a run and the content of the file after each number of steps.
pub struct FailingRun {
    pub steps: Vec<Step>,
    contents: Vec<Content>,
    /// The file to begin with, if the first step does not create one.
    file: Option<PathBuf>,
}

impl FailingRun {
    pub fn new(steps: Vec<Step>, file: Option<&Path>) -> FailingRun {
        let mut run = FailingRun { steps, contents: vec![], file: file.map(PathBuf::from) };
        let (_folder, path) = run.start();
        let initial = if file.is_some() { Content::read(&path).unwrap() } else { Content::default() };
        run.contents = initial.after_each(&run.steps);
        run
    }

    fn start(&self) -> (TempDir, PathBuf) {
        vfs::install();
        // Moves the log into the file often.
        vfs::set_checkpoint_pages(12);
        let folder = super::folder();
        let path = folder.path().join("run.sqlite");
        if let Some(file) = &self.file {
            std::fs::copy(file, &path).unwrap();
        }
        (folder, path)
    }

    /// Performs all steps without errors. Calls `before` with the number of each step, and at last
    /// with the number of steps.
    pub fn perform(&self, mut before: impl FnMut(usize)) {
        let (_folder, path) = self.start();
        let mut session = Session::new(&path, false);
        for (number, step) in self.steps.iter().enumerate() {
            before(number);
            session.perform(*step).unwrap();
        }
        before(self.steps.len());
    }

    /// Performs the steps, with a fault from step `first` on until a step fails. Then ends the
    /// fault, reacts and continues. Returns the error.
    ///
    /// Some errors do not reach the caller: SQLite repeats a failed transfer of the log later.
    pub fn fail(
        &self,
        first: usize,
        begin_fault: impl Fn(),
        end_fault: impl Fn(),
        reaction: Reaction,
    ) -> Option<StoreError> {
        let (_folder, path) = self.start();
        let mut session = Session::new(&path, false);
        let mut failed = None;
        for (number, step) in self.steps.iter().enumerate() {
            if number == first {
                begin_fault();
            }
            if let Err(error) = session.perform(*step) {
                failed = Some((number, error));
                break;
            }
        }
        if reaction == Reaction::Resume {
            session.writer = None;
        }
        end_fault();
        if let Some((number, error)) = &failed {
            let done = self.check(*number, error, reaction, &path);
            for step in &self.steps[done..] {
                session.perform(*step).unwrap_or_else(|later| panic!("{error}; then {step:?}: {later}"));
            }
        }
        drop(session);
        assert!(Content::read(&path).unwrap() == self.contents[self.steps.len()], "the records differ");
        failed.map(|(_, error)| error)
    }

    /// Checks error and file after a failed step, and returns the number of complete steps.
    fn check(&self, number: usize, error: &StoreError, reaction: Reaction, path: &Path) -> usize {
        let step = self.steps[number];
        assert!(!accuses_the_file(error), "{step:?}: {error}");
        if step == Step::Create {
            assert!(!path.exists(), "an incomplete run is left after: {error}");
            // There is no run to resume.
            assert!(!matches!(error, StoreError::DiskFull { .. }), "{error}");
            return number;
        }
        // The error of a commit can come after its last write. Then the step is complete.
        let found = Content::read(path).unwrap_or_else(|later| panic!("{step:?}: {error}; then {later}"));
        let before = &self.contents[number];
        let after = &self.contents[number + 1];
        assert!(found == *before || found == *after, "{step:?} left other records: {error}");
        // A writer that is still open has rolled back, unless SQLite had no memory after the
        // commit.
        assert!(
            reaction == Reaction::Resume || found == *before || is_out_of_memory(error),
            "{step:?}: {error}"
        );
        number + usize::from(found != *before)
    }
}

pub fn is_out_of_memory(error: &StoreError) -> bool {
    error.to_string().contains("out of memory")
}

/// Returns whether an error says that the file or the records are wrong, which no failure of a disk
/// may cause.
fn accuses_the_file(error: &StoreError) -> bool {
    use StoreError::{AlreadyRecorded, Damaged, Locked, NewerVersion, NotARun, OlderVersion, UnknownTrial};
    matches!(
        error,
        Damaged { .. }
            | NotARun { .. }
            | NewerVersion { .. }
            | OlderVersion { .. }
            | AlreadyRecorded { .. }
            | UnknownTrial { .. }
            | Locked { .. }
    )
}
