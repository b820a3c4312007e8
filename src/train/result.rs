use mishandle_controllers::ControllerFile;
use mishandle_results::{
    ActionInterface, Controller, Number, ScenarioRates, Seed, Training, TrainingPlan, TrainingTime,
    Validation,
};
use mishandle_text::path_text;
use mishandle_training::{Rates, RunSettings};

use crate::plan::TrainPlan;
use crate::train::{CurveRow, NoTrainingTime, TrainReport, TrainingFacts};

impl TrainReport {
    /// Returns the report of a finished training run as a result.
    pub fn result(&self, plan: &TrainPlan) -> Training {
        let TrainReport { result, settings, training_time, .. } = self;
        let environments = settings.episodes().environments;
        let validation = result.best_validation;
        let time = training_time.as_ref().map_err(|reason| *reason);
        let (training_time, no_training_time) = self::training_time(time, environments);
        Training {
            task: plan.task.clone(),
            algorithm: plan.algorithm.clone(),
            device: plan.device.clone(),
            seed: Seed(plan.seed),
            environments: environments as u64,
            environment_steps: result.environment_steps,
            best_environment_steps: result.best_environment_steps,
            wall_clock_secs: result.wall_clock_secs.into(),
            stopped_early: self.stopped_early(),
            stop_condition: self.stopped_early().then(|| stop_condition(settings.run())),
            training_time,
            no_training_time,
            success_rate: validation.and_then(|validation| decided(validation.success_rate)),
            strict_success_rate: validation.and_then(|validation| decided(validation.strict_success_rate)),
            space: validation.and_then(|validation| validation.space).and_then(rates),
            corners: validation.and_then(|validation| validation.corners).and_then(rates),
            controller_hash: result.best.hash(),
            best: path_text(&plan.out),
            last: path_text(&plan.last()),
            csv: plan.csv.as_deref().map(path_text),
            tensorboard: plan.tensorboard.as_deref().map(path_text),
        }
    }
}

/// Returns a rate; `None` without a verdict.
fn decided(rate: f64) -> Option<Number> {
    (!rate.is_nan()).then(|| rate.into())
}

fn rates(rates: Rates) -> Option<ScenarioRates> {
    rates.has_verdicts().then(|| ScenarioRates {
        success_rate: rates.success_rate.into(),
        strict_success_rate: rates.strict_success_rate.into(),
        mean_return: rates.mean_return.into(),
    })
}

/// Describes the condition of early stopping.
fn stop_condition(run: &RunSettings) -> String {
    let target =
        |name: &str, rate: Option<f64>| rate.map(|rate| format!("{name} at least {} %", 100.0 * rate));
    let rates = [target("success", run.stop_success), target("strict success", run.stop_strict)];
    let rates: Vec<String> = rates.into_iter().flatten().collect();
    format!("{} in {} consecutive validations", rates.join(" and "), run.stop_validations)
}

impl TrainingFacts {
    /// Returns the facts of a plan as a result.
    pub fn result(&self, plan: &TrainPlan) -> TrainingPlan {
        TrainingPlan {
            task: plan.task.clone(),
            algorithm: plan.algorithm.clone(),
            reward: plan.reward.clone(),
            device: plan.device.clone(),
            seed: Seed(plan.seed),
            environment_steps: self.settings.run().total_steps,
            command: plan.command(),
            settings: self.settings.to_toml(),
            task_hash: self.task_hash.clone(),
            layout_hash: self.layout_hash.clone(),
            formats: self.formats.iter().copied().collect(),
        }
    }
}

/// Returns the training time, or why it is missing.
fn training_time(
    time: Result<&CurveRow, NoTrainingTime>,
    environments: usize,
) -> (Option<TrainingTime>, Option<String>) {
    match time {
        Err(reason) => (None, Some(reason.to_string())),
        Ok(row) => {
            let control_steps = row.control_steps(environments);
            let time = TrainingTime {
                environment_steps: row.environment_steps,
                control_steps,
                secs: row.wall_clock_secs.into(),
            };
            (Some(time), None)
        }
    }
}

/// Returns an action interface as a result.
fn action_interface(interface: &mishandle_controllers::ActionInterface) -> ActionInterface {
    let numbers = |numbers: &[f64]| numbers.iter().copied().map(Number).collect();
    ActionInterface {
        velocity: numbers(&interface.velocity),
        acceleration: numbers(&interface.acceleration),
        target_velocity: numbers(&interface.target_velocity),
        margin: Number(interface.margin),
        lead: Number(interface.lead),
    }
}

/// Describes a controller file. `weaknesses` are those that are known of it.
pub fn controller_result(file: &ControllerFile, weaknesses: &[&str]) -> Controller {
    let header = &file.header;
    let training = &file.header.training;
    Controller {
        task: header.task.clone(),
        algorithm: header.algorithm.clone(),
        preset: header.preset.clone(),
        reward: header.reward.clone(),
        seed: Seed(training.seed),
        environment_steps: training.environment_steps,
        wall_clock_secs: training.wall_clock_secs.into(),
        git_commit: training.git_commit.clone(),
        command: training.command.clone(),
        validation: training.validation.map(|found| Validation {
            episodes: found.episodes as u64,
            success_rate: found.success_rate.into(),
            strict_success_rate: found.strict_success_rate.into(),
        }),
        policy: file.policy.kind().to_string(),
        sizes: file.policy.network().sizes().iter().map(|size| *size as u64).collect(),
        action_interface: header.action_interface.as_ref().map(action_interface),
        controller_hash: file.hash(),
        task_hash: header.task_hash.clone(),
        layout_hash: header.layout.hash(),
        settings: training.settings.clone(),
        weaknesses: weaknesses.iter().map(ToString::to_string).collect(),
    }
}
