//! A runner that trains and measures in no time.

use std::fs;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use mishandle::controllers::{ControllerFile, Header};
use mishandle::plan::{StartRegion, TrainPlan};
use mishandle::results::{Estimate, Seed, TrialEnd};
use mishandle::train::TrainObserver;
use mishandle::training::{AlgorithmSettings, TimeShares, TrainingControl, TrainingProgress};
use mishandle_studies::zoo::{
    BenchmarkTask, ControllerUnderTest, CornersRecord, EvaluationRecord, FalsificationRecord, PlanRecord,
    Runner, TrialMeasurement, ZooError,
};

/// Settings of PPO; TRPO has the same keys.
pub const SETTINGS: &str = "[run]\ntotal_steps = 2048\n\n[episodes]\nenvironments = 16\n";

pub const CURVE_COLUMNS: &str = "iteration,environment_steps,wall_clock_secs,mean_return,mean_episode_steps,terminated_rate,\
                                 success_rate,strict_success_rate,validation_return,kl,entropy,learning_rate,physics_share,\
                                 inference_share,learning_share";

/// The rows of a curve with an iteration at each of these environment steps, 512 a second. The
/// return is flat from the second on; validations are good from the fourth second on.
pub fn curve_rows(steps: &[u64]) -> String {
    let row = |(index, steps): (usize, &u64)| {
        let secs = *steps as f64 / 512.0;
        let mean_return = if index == 0 { -3.0 } else { -1.0 };
        let rate = if secs >= 4.0 { 1.0 } else { 0.5 };
        format!("{},{steps},{secs:.9},{mean_return},,,{rate},{rate},-2,,,0.001,0.5,0.25,0.25\n", index + 1)
    };
    steps.iter().enumerate().map(row).collect()
}

/// Writes a controller: a shipped one with another header.
pub fn write_controller(path: &Path, change: impl Fn(&mut Header)) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut file = ControllerFile::load(&root.join("controllers/point-reaching/ppo.safetensors")).unwrap();
    change(&mut file.header);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    file.save(path).unwrap();
}

/// Results at the four corners of a box, of which this number succeeds.
pub fn corners(succeeding: u32) -> CornersRecord {
    CornersRecord {
        seeds: 1,
        n: 4,
        succeeding,
        strictly_succeeding: Some(succeeding),
        carefully_succeeding: Some(succeeding),
        center_succeeds: Some(true),
        center_strictly_succeeds: Some(true),
        center_carefully_succeeds: Some(true),
        failing: Vec::new(),
    }
}

pub struct FakeRunner {
    tasks: Vec<BenchmarkTask>,
    calls: Mutex<Vec<String>>,
    stops_training: AtomicBool,
    leaves_out_starts: bool,
    corners: CornersRecord,
}

impl FakeRunner {
    pub fn new() -> FakeRunner {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let file = ControllerFile::load(&root.join("controllers/point-reaching/ppo.safetensors")).unwrap();
        let task = BenchmarkTask {
            name: "point-reaching".to_string(),
            formulas: ["a", "b", "c", "d"].map(String::from),
            careful: "e".to_string(),
            task_hash: "aa".to_string(),
            layout_hash: file.header.layout.hash(),
        };
        FakeRunner {
            tasks: vec![task],
            calls: Mutex::default(),
            stops_training: AtomicBool::new(false),
            leaves_out_starts: false,
            corners: corners(4),
        }
    }

    pub fn task_mut(&mut self) -> &mut BenchmarkTask {
        &mut self.tasks[0]
    }

    /// Every later training run is stopped after its first iteration, or none is.
    pub fn stop_training(&self, stops: bool) {
        self.stops_training.store(stops, Ordering::Relaxed);
    }

    /// Every later evaluation finds these results at the corners.
    pub fn set_corners(&mut self, corners: CornersRecord) {
        self.corners = corners;
    }

    pub fn leave_out_starts(&mut self) {
        self.leaves_out_starts = true;
    }

    /// Actions so far, one line each.
    pub fn calls(&self) -> Vec<String> {
        self.calls.lock().unwrap().clone()
    }

    pub fn count(&self, verb: &str) -> usize {
        self.calls().iter().filter(|call| call.starts_with(verb)).count()
    }

    fn note(&self, call: String) {
        self.calls.lock().unwrap().push(call);
    }

    /// The header of a controller that is trained as planned now.
    pub fn describe(&self, header: &mut Header, algorithm: &str) {
        header.task_hash.clone_from(&self.tasks[0].task_hash);
        header.algorithm = algorithm.to_string();
        let training = &mut header.training;
        training.seed = 0;
        training.settings = AlgorithmSettings::from_toml(algorithm, SETTINGS).unwrap().unwrap().to_toml();
        training.environment_steps = 1024;
        training.wall_clock_secs = 1.5;
        training.command = "mishandle train".to_string();
        training.git_commit = "c0ffee".to_string();
    }

    fn estimate(&self) -> Estimate {
        Estimate { value: Some(0.97), low: Some(0.85), high: Some(0.98), n: 1000 }
    }
}

fn plan_record(task: &str, controller: &str, action_noise: f64) -> PlanRecord {
    PlanRecord {
        task: task.to_string(),
        preset: "paper".to_string(),
        controller: controller.to_string(),
        controller_hash: "hash".to_string(),
        stochastic: false,
        action_noise,
        observation_noise: 0.0,
        seed: Seed(1),
    }
}

/// The progress of a training run that has just started.
fn progress() -> TrainingProgress {
    TrainingProgress {
        iteration: 1,
        environment_steps: 512,
        total_steps: 2048,
        steps_per_second: 512.0,
        wall_clock_secs: 1.0,
        mean_return: None,
        mean_episode_steps: None,
        terminated_rate: None,
        diverged: 0,
        reward_terms: vec![],
        validation: None,
        validation_is_fresh: false,
        scenario_share: None,
        kl: None,
        entropy: None,
        learning_rate: 0.001,
        time_shares: TimeShares::default(),
    }
}

impl Runner for FakeRunner {
    fn tasks(&self) -> &[BenchmarkTask] {
        &self.tasks
    }

    fn commit(&self) -> String {
        "c0ffee".to_string()
    }

    fn train(&self, plan: &TrainPlan, observer: &mut dyn TrainObserver) -> Result<bool, ZooError> {
        self.note(format!("train {}", plan.task));
        if plan.resume {
            self.note("resume".to_string());
        }
        let csv = plan.csv.as_ref().unwrap();
        let stops = self.stops_training.load(Ordering::Relaxed);
        let is_stopped = observer.iteration_finished(&progress()) == TrainingControl::Stop || stops;
        fs::write(plan.checkpoint(), "").unwrap();
        let steps: &[u64] = if is_stopped { &[512] } else { &[512, 1024, 2048] };
        fs::write(csv, format!("{CURVE_COLUMNS}\n{}", curve_rows(steps))).unwrap();
        write_controller(&plan.out, |header| self.describe(header, "ppo"));
        Ok(!is_stopped)
    }

    fn evaluate(
        &self,
        subject: &ControllerUnderTest,
        starts: StartRegion,
        action_noise: f64,
        _: &(dyn Fn() -> bool + Sync),
    ) -> Result<EvaluationRecord, ZooError> {
        self.note(format!("evaluate {} {action_noise}", subject.controller));
        let estimate = self.estimate();
        Ok(EvaluationRecord {
            plan: plan_record(&subject.task, &subject.controller, action_noise),
            starts,
            leaves_out_starts: self.leaves_out_starts,
            simulations: 1000,
            diverged: 0,
            undecided: 0,
            success_rate: estimate,
            strict_success_rate: estimate,
            careful_success_rate: estimate,
            dangerous_behavior_rate: estimate,
            dangerous_episode_rate: estimate,
            task_completion_time: Estimate { value: Some(14.0), ..Estimate::default() },
            corners: self.corners.clone(),
        })
    }

    fn falsify(
        &self,
        subject: &ControllerUnderTest,
        action_noise: f64,
        _: &(dyn Fn() -> bool + Sync),
    ) -> Result<FalsificationRecord, ZooError> {
        self.note(format!("falsify {}", subject.controller));
        let trial = |trial| TrialMeasurement {
            trial,
            falsified: trial == 1,
            simulations: 300,
            minimum_robustness: None,
            initial_configuration: None,
            simulation: None,
            seed: None,
            end: Some(TrialEnd::BudgetSpent),
            diverged: 0,
            undecided: 0,
        };
        Ok(FalsificationRecord {
            // The file moves between a training run and a later measurement.
            plan: plan_record(&subject.task, "ppo", action_noise),
            search: "random".to_string(),
            formula: "a".to_string(),
            budget: 300,
            falsified_trials: 1,
            falsification_rate: self.estimate(),
            mean_simulations: None,
            median_simulations: None,
            restricted_mean_simulations: None,
            trials: [1, 2].map(trial).to_vec(),
        })
    }
}
