//! After a power cut at any moment, the file holds a consistent prefix of the records, and the run
//! continues.
//!
//! A virtual file system records every write of a run. From the record, the tests compute the files
//! that a power cut can leave after each write, and open them. `MISHANDLE_FAULTS=all` tries more of
//! them.

use crate::faults;
use crate::own_process::own_process;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

use crate::faults::disk::{self, Disk, Image, Kept, State};
use crate::faults::life::{Content, Session, Step, campaign};
use crate::faults::vfs;
use crate::sample::header;
use mishandle_store::{IfExists, RunFile, RunWriter, StoreError};
use tempfile::TempDir;

/// A run to cut.
struct Life {
    steps: Vec<Step>,
    /// Content after each number of steps.
    contents: Vec<Content>,
    /// Whether the writer syncs each commit.
    is_durable: bool,
    /// Number of steps that an earlier power cut may have taken away in part. Their last pages can
    /// still be in the log and become valid when the resumed run writes the missing pages with the
    /// same bytes before them. That is the content that the run will have anyway.
    earlier: usize,
}

impl Life {
    fn new(steps: Vec<Step>, is_durable: bool) -> Life {
        Life { contents: Content::default().after_each(&steps), steps, is_durable, earlier: 0 }
    }

    /// Performs all steps and returns what they wrote.
    fn record(&self, path: &Path) -> Disk {
        vfs::start_recording();
        self.perform(0, path);
        vfs::stop_recording()
    }

    fn perform(&self, first: usize, path: &Path) {
        let mut session = Session::new(path, self.is_durable);
        for step in &self.steps[first..] {
            session.perform(*step).unwrap();
            vfs::mark();
        }
    }

    fn is_new(&self) -> bool {
        self.steps.first() == Some(&Step::Create)
    }

    /// Writes the files of a power cut after `returned` steps, of which `durable` are durable, and
    /// returns the number of steps in them. Creates the run again if it was not yet created.
    fn recover(&self, path: &Path, image: &Image, durable: usize, returned: usize) -> Result<usize, String> {
        disk::write(image, path.parent().unwrap());
        match Content::read(path) {
            Ok(content) => {
                let possible = durable..=self.earlier.max(returned + 1).min(self.steps.len());
                let kept = possible.clone().find(|&steps| self.contents[steps] == content);
                kept.map(|steps| if self.is_new() { steps.max(1) } else { steps }).ok_or_else(|| {
                    let trials = content.trials.len();
                    let simulations = content.simulations.len();
                    format!(
                        "{trials} trials and {simulations} simulations are not those of steps {possible:?}"
                    )
                })
            }
            Err(StoreError::Missing { .. } | StoreError::Unfinished { .. } | StoreError::NotARun { .. })
                if self.is_new() && durable == 0 =>
            {
                RunWriter::create(path, &header(), IfExists::Replace).map_err(|error| error.to_string())?;
                Ok(1)
            }
            Err(error) => Err(error.to_string()),
        }
    }

    /// Checks the files of a power cut: they are recovered and the run continues to the same end.
    fn check(&self, path: &Path, image: &Image, durable: usize, returned: usize) -> Result<(), String> {
        let kept = self.recover(path, image, durable, returned)?;
        self.perform(kept, path);
        match Content::read(path) {
            Ok(end) if end == self.contents[self.steps.len()] => Ok(()),
            Ok(_) => Err("the resumed run has other records".into()),
            Err(error) => Err(format!("after resuming: {error}")),
        }
    }

    /// Visits each image that a power cut can leave, once, and returns their number.
    fn each_cut(&self, disk: &Disk, random: u64, mut visit: impl FnMut(&State, &Image, Kept)) -> usize {
        let mut seen = HashSet::new();
        let mut event = 0;
        disk.replay(|state| {
            event += 1;
            let random = (0..random).map(|number| Kept::Random(event << 16 | number));
            for kept in [Kept::Nothing, Kept::Everything].into_iter().chain(random) {
                let image = state.cut(kept);
                if seen.insert((image.clone(), state.marks, self.durable(state))) {
                    visit(state, &image, kept);
                }
            }
        });
        seen.len()
    }

    /// Returns the number of steps that a power cut must keep.
    fn durable(&self, state: &State) -> usize {
        if self.is_durable { state.marks } else { state.durable_marks }
    }

    #[track_caller]
    fn check_each_cut(&self, disk: &Disk, path: &Path, random: u64) -> usize {
        self.each_cut(disk, random, |state, image, kept| {
            let durable = self.durable(state);
            if let Err(what) = self.check(path, image, durable, state.marks) {
                let events = state.events;
let steps = state.marks;
                panic!("power cut after {events} calls and {steps} steps, {durable} durable, {kept:?} kept: {what}");
            }
        })
    }
}

/// Moves the log into the file every 12 pages, which happens several times in the runs of this
/// file.
fn new_path() -> (TempDir, PathBuf) {
    vfs::install();
    vfs::set_checkpoint_pages(12);
    let folder = faults::folder();
    let path = folder.path().join("run.sqlite");
    (folder, path)
}

/// Returns the number of random subsets of the unsynced writes for each power cut.
fn random_subsets() -> u64 {
    if faults::all() { 40 } else { 1 }
}

#[test]
fn a_power_cut_leaves_a_prefix_and_loses_at_most_the_steps_since_the_last_sync() {
    own_process(
        "power_cut::a_power_cut_leaves_a_prefix_and_loses_at_most_the_steps_since_the_last_sync",
        || {
            let (_folder, path) = new_path();
            let life = Life::new(campaign(), false);
            let disk = life.record(&path);
            let images = life.check_each_cut(&disk, &path, random_subsets());
            assert!(images > 150, "{images}");
        },
    );
}

#[test]
fn a_power_cut_loses_nothing_of_a_durable_run() {
    own_process("power_cut::a_power_cut_loses_nothing_of_a_durable_run", || {
        let (_folder, path) = new_path();
        let life = Life::new(campaign(), true);
        let disk = life.record(&path);
        let images = life.check_each_cut(&disk, &path, random_subsets());
        assert!(images > 150, "{images}");
    });
}

/// A process that is killed while it closes a run leaves a rollback journal.
#[test]
fn a_run_with_a_rollback_journal_can_be_read() {
    own_process("power_cut::a_run_with_a_rollback_journal_can_be_read", || {
        let (_folder, path) = new_path();
        let life = Life::new(campaign(), false);
        let disk = life.record(&path);
        let mut journals = 0;
        life.each_cut(&disk, 0, |state, image, kept| {
            let has_journal = image.keys().any(|name| name.ends_with("-journal"));
            if kept == Kept::Everything && state.marks > 0 && has_journal {
                journals += 1;
                disk::write(image, path.parent().unwrap());
                RunFile::open(&path).unwrap();
            }
        });
        assert!(journals > 0);
    });
}

/// A second power cut, while the run continues after the first.
#[test]
fn a_second_power_cut_leaves_a_prefix() {
    own_process("power_cut::a_second_power_cut_leaves_a_prefix", || {
        let (_folder, path) = new_path();
        let life = Life::new(campaign(), false);
        let disk = life.record(&path);
        let mut images = 0;
        let mut second_images = 0;
        life.each_cut(&disk, 1, |state, image, _| {
            images += 1;
            if !faults::all() && images % 60 != 0 {
                return;
            }
            let kept = life.recover(&path, image, life.durable(state), state.marks).unwrap();
            if kept <= 1 || kept + 1 >= life.steps.len() {
                return; // perhaps not yet created, or complete
            }
            // Reading can have changed the files.
            disk::write(image, path.parent().unwrap());
            let rest = Life {
                steps: life.steps[kept..].to_vec(),
                contents: life.contents[kept..].to_vec(),
                is_durable: false,
                earlier: state.marks + 1 - kept,
            };
            let disk = rest.record(&path);
            second_images += rest.check_each_cut(&disk, &path, 0);
        });
        assert!(second_images > 50, "{second_images}");
    });
}

/// Without syncs, the same checks find losses: the model does cut.
#[test]
fn the_model_finds_the_losses_of_a_run_that_is_not_durable() {
    own_process("power_cut::the_model_finds_the_losses_of_a_run_that_is_not_durable", || {
        let (_folder, path) = new_path();
        let life = Life::new(campaign(), false);
        let disk = life.record(&path);
        let mut lost = HashSet::new();
        life.each_cut(&disk, 0, |state, image, _| {
            // All steps that returned are expected, which only a durable run promises.
            if state.marks > 0 && life.recover(&path, image, state.marks, state.marks).is_err() {
                lost.insert(state.marks);
            }
        });
        // Creating, closing and resuming sync; other steps lose their records, except one that
        // fills the log.
        assert!(lost.len() >= 6, "{lost:?}");
        for step in [1, 8, 9, 12] {
            assert!(!lost.contains(&step), "{lost:?}");
        }
    });
}
