//! From a plan to tables, with a runner that trains in no time.

#![allow(
    clippy::redundant_closure_for_method_calls,
    reason = "a path has no lifetime that is general enough"
)]

use std::fs;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::runner::{CURVE_COLUMNS, FakeRunner, SETTINGS, corners, curve_rows, write_controller};
use mishandle::controllers::Header;
use mishandle::files::FileLock;
use mishandle_studies::zoo::{CornersRecord, NOISE_LEVELS, Selection, Zoo, ZooError, ZooFolder, ZooObserver};

/// A repository with one task and one settings file.
struct Repository {
    folder: tempfile::TempDir,
    runner: FakeRunner,
    stop: AtomicBool,
}

/// Keeps the reports of a call.
#[derive(Default)]
struct Reports(Mutex<Vec<String>>);

impl ZooObserver for Reports {
    fn note(&self, name: &str, words: &str) {
        self.0.lock().unwrap().push(format!("{name}: {words}"));
    }

    fn ended(&self, name: &str, result: &Result<(), ZooError>) {
        let words = result.as_ref().map_or_else(ToString::to_string, |()| "done".to_string());
        self.0.lock().unwrap().push(format!("{name}: {words}"));
    }
}

const PPO_SETTINGS: &str = "controllers/training/point-reaching/ppo.toml";
const SHIPPED: &str = "controllers/point-reaching/ppo.safetensors";
const KEPT_CURVE: &str = "controllers/curves/point-reaching/ppo.csv";

/// The selection of the task's PPO.
fn ppo() -> Selection {
    Selection { only: Some("point-reaching/ppo".to_string()) }
}

impl Repository {
    fn new() -> Repository {
        let folder = tempfile::tempdir().unwrap();
        let repository = Repository { folder, runner: FakeRunner::new(), stop: AtomicBool::new(false) };
        repository.write(PPO_SETTINGS, SETTINGS);
        let page = |names: &[&str]| -> String {
            names.iter().map(|name| format!("<!-- figures: {name} -->\n<!-- end of figures -->\n")).collect()
        };
        repository.write("docs/reference/tasks.md", &page(&["pictures", "tasks"]));
        let tables = ["summary", "controllers", "noise", "training", "curves"];
        repository.write("controllers/README.md", &page(&tables));
        repository
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap_or_default()
    }

    fn write_controller(&self, name: &str, change: impl Fn(&mut Header)) {
        write_controller(&self.path(name), |header| {
            self.runner.describe(header, "ppo");
            change(header);
        });
    }

    /// Calls `act` on the zoo, and returns its result with the reports.
    fn call(
        &self,
        selection: Selection,
        act: impl FnOnce(&Zoo<'_>) -> Result<(), ZooError>,
    ) -> (Result<(), ZooError>, Vec<String>) {
        self.call_adopting(selection, false, act)
    }

    fn call_adopting(
        &self,
        selection: Selection,
        adopts: bool,
        act: impl FnOnce(&Zoo<'_>) -> Result<(), ZooError>,
    ) -> (Result<(), ZooError>, Vec<String>) {
        let reports = Reports::default();
        let stop = || self.stop.load(Ordering::Relaxed);
        let zoo = Zoo::new(ZooFolder::new(self.folder.path()), &self.runner, &reports, &stop);
        let zoo = zoo.with_selection(selection).with_adoption(adopts);
        let result = act(&zoo);
        (result, reports.0.into_inner().unwrap())
    }

    #[track_caller]
    fn train(&self) {
        let (result, reports) = self.call(ppo(), |zoo| zoo.train());
        result.unwrap_or_else(|error| panic!("{error}: {reports:?}"));
    }

    /// Returns the state of the task's PPO.
    fn state(&self) -> String {
        let mut states = Vec::new();
        let (result, _) = self.call(ppo(), |zoo| {
            states = zoo.entries()?.iter().map(|entry| entry.state.to_string()).collect();
            Ok(())
        });
        result.unwrap();
        states.concat()
    }

    fn page(&self) -> String {
        self.read("controllers/README.md")
    }
}

fn lines_of(page: &str, start: &str) -> Vec<String> {
    page.lines().filter(|line| line.starts_with(start)).map(String::from).collect()
}

#[test]
fn a_missing_controller_is_trained_measured_and_shown_once() {
    let repository = Repository::new();
    assert_eq!(repository.state(), "needs training: no controller");
    repository.train();
    assert_eq!(repository.state(), "done");
    assert!(repository.path(SHIPPED).is_file());
    assert!(repository.path(KEPT_CURVE).is_file());
    assert!(repository.read("controllers/curves/point-reaching.svg").contains("</svg>"));
    assert_eq!(fs::read_dir(repository.path("target/controllers")).unwrap().count(), 0);
    let page = repository.page();
    let rows = lines_of(&page, "| `point-reaching` | `ppo` |");
    // The paper's PPO: SR 93, DBR 0.26, TCT 29.3; TT 10500.
    let figures = "97.0 [85.0, 98.0] | 97.0 [85.0, 98.0] | 97.0 [85.0, 98.0] | 4/4; strict 4/4; careful 4/4 | 97.00 [85.00, 98.00] | 97.0 [85.0, 98.0] | 14.0";
    assert_eq!(rows[0], format!("| `point-reaching` | `ppo` | {figures} | 93 | 0.26 | 29.3 |  | c0ffee |"));
    assert!(rows[1].contains("| 87 | 0.27 | 29.8 | 1 of 2 |"), "{}", rows[1]);
    // 16 environments: the return of the fake curve is flat after 1024 environment steps.
    assert_eq!(
        rows[2],
        "| `point-reaching` | `ppo` | 2048 | 1024 | 2 | 64 | 2 | 10500 | 4 | `mishandle train` | c0ffee |"
    );
    assert!(page.contains("| `point-reaching` | `ddpg` | not measured |"));
    let tasks = repository.read("docs/reference/tasks.md");
    assert!(tasks.contains("<img src=\"../../crates/tasks/src/point_reaching/picture.png\""), "{tasks}");
    assert!(tasks.contains("| `point-reaching` | `a` |\n"), "{tasks}");
    // A second call finds nothing to do.
    let calls = repository.runner.calls();
    repository.train();
    assert_eq!(repository.runner.calls(), calls);
    assert_eq!(repository.page(), page);
}

#[test]
fn a_change_of_settings_or_task_is_named_and_the_controller_is_trained_again() {
    let mut repository = Repository::new();
    repository.train();
    repository.write(PPO_SETTINGS, &SETTINGS.replace("2048", "4096"));
    assert_eq!(repository.state(), "needs training: settings changed: run.total_steps");
    // The page has no figures of another controller than the planned one.
    repository.call(Selection::default(), |zoo| zoo.write_pages()).0.unwrap();
    assert!(repository.page().contains("| `point-reaching` | `ppo` | not measured |"));
    repository.write(PPO_SETTINGS, SETTINGS);
    assert_eq!(repository.state(), "done");
    repository.runner.task_mut().task_hash = "cc".to_string();
    assert_eq!(repository.state(), "needs training: task changed");
    repository.train();
    assert_eq!(repository.state(), "done");
    // Another formula needs another measurement, but no training.
    repository.runner.task_mut().formulas[0] = "c".to_string();
    assert_eq!(repository.state(), "needs measurement: formulas changed: success");
    repository.runner.task_mut().formulas[3] = "e".to_string();
    let reason = "needs measurement: formulas changed: success, completion";
    assert_eq!(repository.state(), reason);
    let trained = repository.runner.count("train");
    repository.train();
    assert_eq!(repository.state(), "done");
    assert_eq!(repository.runner.count("train"), trained);
}

#[test]
fn a_controller_that_fails_at_a_corner_misses_a_threshold_beside_its_success_rate() {
    let mut repository = Repository::new();
    repository.runner.set_corners(corners(3));
    repository.train();
    let page = repository.page();
    assert!(page.contains("| `point-reaching` | `ppo` (corners); `trpo` (not measured);"), "{page}");
    let row = lines_of(&page, "| `point-reaching` | `ppo` |").remove(0);
    assert!(
        row.contains("| **3/4**; strict **3/4**; careful **3/4** |") && row.contains("| corners | c0ffee |"),
        "{row}"
    );
    // A failing center counts too.
    repository.runner.set_corners(CornersRecord { center_succeeds: Some(false), ..corners(4) });
    repository.call(ppo(), |zoo| zoo.measure(true)).0.unwrap();
    let row = lines_of(&repository.page(), "| `point-reaching` | `ppo` |").remove(0);
    assert!(
        row.contains("| **4/4, center fails**; strict 4/4; careful 4/4 |") && row.contains("| corners |"),
        "{row}"
    );
}

#[test]
fn only_a_missing_falsification_is_run() {
    let repository = Repository::new();
    repository.train();
    let record = repository.path("controllers/figures/point-reaching/ppo.json");
    let text = fs::read_to_string(&record).unwrap();
    let start = text.find("\"falsification\":").unwrap();
    let end = text.find("\"training\":").unwrap();
    fs::write(&record, format!("{}\"falsification\": null,\n  {}", &text[..start], &text[end..])).unwrap();
    assert_eq!(repository.state(), "needs falsification");
    repository.call(Selection::default(), |zoo| zoo.write_pages()).0.unwrap();
    let rows = lines_of(&repository.page(), "| `point-reaching` | `ppo` |");
    assert!(rows[1].contains("| not measured | c0ffee |"), "{}", rows[1]);
    let evaluated = repository.runner.count("evaluate");
    repository.call(ppo(), |zoo| zoo.measure(false)).0.unwrap();
    assert_eq!(repository.state(), "done");
    assert_eq!(repository.runner.count("evaluate"), evaluated);
    assert_eq!(repository.runner.count("falsify"), 2);
    assert_eq!(fs::read_to_string(&record).unwrap(), text);
}

#[test]
fn measurements_are_repeated_only_on_request() {
    let repository = Repository::new();
    repository.train();
    let evaluated = repository.runner.count("evaluate");
    repository.call(ppo(), |zoo| zoo.measure(false)).0.unwrap();
    assert_eq!(repository.runner.count("evaluate"), evaluated);
    repository.call(ppo(), |zoo| zoo.measure(true)).0.unwrap();
    assert_eq!(repository.runner.count("evaluate"), evaluated + NOISE_LEVELS.len());
    assert_eq!(repository.runner.count("train"), 1);
}

#[test]
fn a_controller_of_another_task_is_adopted_on_request_and_marked() {
    let mut repository = Repository::new();
    repository.write_controller(SHIPPED, |header| header.task_hash = "dd".to_string());
    assert_eq!(repository.state(), "needs training: task changed");
    repository.call_adopting(ppo(), true, |zoo| zoo.train()).0.unwrap();
    assert_eq!(repository.runner.count("train"), 0);
    assert!(repository.page().contains("c0ffee, adopted |"));
    // It belongs to that task from then on.
    repository.runner.task_mut().task_hash = "cc".to_string();
    assert_eq!(repository.state(), "needs training: task changed");
    repository.call_adopting(ppo(), true, |zoo| zoo.measure(false)).0.unwrap();
    assert_eq!(repository.state(), "done");
    // A controller that is put in place by hand has no curve.
    repository.write(
        KEPT_CURVE,
        "environment_steps,wall_clock_secs,mean_return,success_rate,strict_success_rate,validation_return\n",
    );
    repository.write_controller(SHIPPED, |header| header.training.environment_steps = 512);
    repository.train();
    assert_eq!(repository.state(), "done");
    assert!(!repository.path(KEPT_CURVE).exists());
}

#[test]
fn a_stopped_training_run_continues_from_its_checkpoint() {
    let repository = Repository::new();
    repository.runner.stop_training(true);
    let (stopped, reports) = repository.call(ppo(), |zoo| zoo.train());
    let stopped = stopped.unwrap_err().to_string();
    assert!(stopped.contains("interrupted after 0 of 1 job;"), "{stopped}");
    assert_eq!(reports, Vec::<String>::new());
    let interrupted = "needs training: no controller; checkpoint exists, curve up to 512 environment steps";
    assert_eq!(repository.state(), interrupted);
    // A checkpoint of other settings is of no use.
    repository.write(PPO_SETTINGS, &SETTINGS.replace("2048", "4096"));
    assert_eq!(repository.state(), "needs training: no controller");
    repository.write(PPO_SETTINGS, SETTINGS);
    repository.runner.stop_training(false);
    // While another process trains it, its files are left alone.
    let lock = repository.path("target/controllers/point-reaching-ppo.safetensors.lock");
    let other = FileLock::try_acquire(&lock).unwrap().unwrap();
    let (refused, reports) = repository.call(ppo(), |zoo| zoo.train());
    assert!(matches!(refused, Err(ZooError::Failed { failed: 1, total: 1 })), "{refused:?}");
    assert!(reports[0].contains("another training run is writing"), "{reports:?}");
    drop(other);
    assert_eq!(repository.state(), interrupted);
    repository.train();
    assert_eq!(repository.runner.count("resume"), 1);
    assert_eq!(repository.state(), "done");
}

#[test]
fn a_stop_before_the_first_job_starts_nothing() {
    let repository = Repository::new();
    repository.stop.store(true, Ordering::Relaxed);
    let (stopped, _) = repository.call(ppo(), |zoo| zoo.train());
    assert!(matches!(stopped, Err(ZooError::InterruptedWith { done: 0, total: 1 })), "{stopped:?}");
    assert_eq!(repository.runner.calls(), Vec::<String>::new());
}

#[test]
fn a_second_process_is_kept_out() {
    let repository = Repository::new();
    let lock = repository.path("target/controllers/lock");
    fs::create_dir_all(lock.parent().unwrap()).unwrap();
    let _other = FileLock::try_acquire(&lock).unwrap().unwrap();
    let (refused, _) = repository.call(ppo(), |zoo| zoo.train());
    assert!(matches!(refused, Err(ZooError::Busy)), "{refused:?}");
    // Listing needs no lock.
    assert_eq!(repository.state(), "needs training: no controller");
}

#[test]
fn imported_training_runs_are_checked_against_the_plan() {
    let repository = Repository::new();
    let source = repository.path("elsewhere");
    let rows = |last: u64| format!("{CURVE_COLUMNS}\n{}", curve_rows(&[512, 1024, last]));
    type Change = fn(&mut Header);
    let changes: [(Change, u64, &str); 4] = [
        (|header| header.training.seed = 3, 2048, "seed is 3, expected 0"),
        (|header| header.task_hash = "cc".to_string(), 2048, "task changed"),
        (
            |header| header.training.settings = SETTINGS.replace("16", "32"),
            2048,
            "settings changed: episodes.environments",
        ),
        (|_| {}, 1536, "the training run has not ended: 1536 of 2048 environment steps"),
    ];
    for (change, last, expected) in changes {
        repository.write_controller("elsewhere/point-reaching-ppo.safetensors", change);
        repository.write("elsewhere/point-reaching-ppo.csv", &rows(last));
        let (result, reports) = repository.call(ppo(), |zoo| zoo.import(&source));
        assert!(matches!(result, Err(ZooError::Refused { refused: 1, .. })), "{result:?}");
        assert!(reports[0].contains(expected), "{reports:?}");
        assert_eq!(repository.state(), "needs training: no controller", "{expected}");
        assert!(!repository.path("controllers/point-reaching").exists(), "{expected}");
    }
    repository.write_controller("elsewhere/point-reaching-ppo.safetensors", |_| {});
    repository.write_controller("elsewhere/another.safetensors", |_| {});
    repository.write("elsewhere/point-reaching-ppo.csv", &rows(2048));
    let (result, reports) = repository.call(ppo(), |zoo| zoo.import(&source));
    result.unwrap();
    assert_eq!(reports, ["another: not in the plan, or not selected", "point-reaching-ppo: imported"]);
    assert_eq!(repository.state(), "done");
    assert_eq!(repository.runner.count("train"), 0);
    // A controller in the repository is imported again only if its curve is missing.
    let evaluated = repository.runner.count("evaluate");
    repository.call(ppo(), |zoo| zoo.import(&source)).0.unwrap();
    assert_eq!(repository.runner.count("evaluate"), evaluated);
    fs::remove_file(repository.path(KEPT_CURVE)).unwrap();
    repository.call(ppo(), |zoo| zoo.import(&source)).0.unwrap();
    assert!(repository.path(KEPT_CURVE).is_file());
    assert!(source.join("point-reaching-ppo.safetensors").is_file(), "an import moves no file");
}

#[test]
fn the_whole_box_is_measured_where_starts_are_left_out() {
    let mut repository = Repository::new();
    repository.runner.leave_out_starts();
    repository.train();
    let page = repository.page();
    assert_eq!(lines_of(&page, "| `point-reaching` | `ppo`, whole box | 97.0 [85.0, 98.0] |").len(), 2);
    assert_eq!(repository.runner.count("evaluate"), 2 * NOISE_LEVELS.len());
}

#[test]
fn a_failed_training_run_is_named_and_ends_no_other() {
    let repository = Repository::new();
    repository.write("controllers/training/point-reaching/trpo.toml", SETTINGS);
    // The runner trains by PPO, whatever the plan says.
    let selection = Selection::default();
    let (result, reports) = repository.call(selection, |zoo| zoo.train());
    assert!(matches!(result, Err(ZooError::Failed { failed: 1, total: 3 })), "{result:?}");
    assert!(reports.iter().any(|line| line.contains("algorithm is ppo, expected trpo")), "{reports:?}");
    assert_eq!(repository.state(), "done");
}

#[test]
fn an_expert_is_measured_once_and_never_trained() {
    let repository = Repository::new();
    let expert = || Selection { only: Some("point-reaching/expert".to_string()) };
    repository.call(expert(), |zoo| zoo.train()).0.unwrap();
    repository.call(expert(), |zoo| zoo.train()).0.unwrap();
    assert_eq!(repository.runner.calls().len(), NOISE_LEVELS.len());
    let rows = lines_of(&repository.page(), "| `point-reaching` | `expert` | 97.0");
    assert_eq!(rows.len(), NOISE_LEVELS.len());
    let unknown = Selection { only: Some("point-reaching/expret".to_string()) };
    let (refused, _) = repository.call(unknown, |zoo| zoo.train());
    assert!(matches!(refused, Err(ZooError::UnknownSelection { .. })), "{refused:?}");
}
