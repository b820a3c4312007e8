//! Compares the adversary with searches on an oscillator in closed form: see
//! studies/notebook/2026-11-27-adversary.md.
//!
//! ```sh
//! cargo run -p mishandle-studies --example adversary_toy -- known 1.55 300 40 201
//! ```
//!
//! Arguments: `known` or `drawn` frequency, the limit of the position, the budget, the number of
//! trials, and the seed.
#![allow(clippy::print_stdout, reason = "an experiment prints its results")]

use std::ops::ControlFlow;
use std::sync::Arc;

use mishandle::plan::{FalsifyPlan, Plan};
use mishandle::resolve::ResolvedPlan;
use mishandle::rollout::{
    Axis, AxisKind, Controller, ControllerWorker, Disturbance, Effect, Environment, EnvironmentWorker,
    Identity, NamedFormula, Noise, Rollout, RolloutError, Sample, Scenario, Seed, Signal, Space,
    Specification, StepStatus, Stream, System, Target, TimeProfile,
};
use mishandle::run::{Answer, Engine};

/// Control steps of an episode, of a disturbance, and their duration, s.
const STEPS: usize = 200;
const SEGMENT: usize = 10;
const DT: f64 = 0.1;

/// A mass on a spring with angular frequency 1/s, or one that the seed draws from 0.6 to 1.4. It
/// starts at rest in the middle.
struct Oscillator {
    is_drawn: bool,
    space: Space,
    signals: Arc<[String]>,
}

impl Environment for Oscillator {
    fn name(&self) -> &str {
        "oscillator"
    }
    fn space(&self) -> &Space {
        &self.space
    }
    fn signals(&self) -> &Arc<[String]> {
        &self.signals
    }
    fn reward_terms(&self) -> &[String] {
        &[]
    }
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn action_limit(&self) -> f64 {
        1.0
    }
    fn state_size(&self) -> usize {
        3
    }
    fn control_dt(&self) -> f64 {
        DT
    }
    fn episode_steps(&self) -> usize {
        STEPS
    }
    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        Box::new(OscillatorWorker { is_drawn: self.is_drawn })
    }
}

struct OscillatorWorker {
    is_drawn: bool,
}

impl OscillatorWorker {
    fn show(state: &[f64], sample: &mut Sample<'_>) -> StepStatus {
        sample.observation.copy_from_slice(&[state[0] as f32, state[1] as f32]);
        sample.signals[0] = state[0].abs();
        StepStatus::Running
    }
}

impl EnvironmentWorker for OscillatorWorker {
    fn reset(&mut self, _: &Scenario, seed: Seed, state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        let frequency = if self.is_drawn { 0.6 + 0.8 * seed.uniform(Stream::Reset, 0, 0) } else { 1.0 };
        state.copy_from_slice(&[0.0, 0.0, frequency]);
        OscillatorWorker::show(state, &mut sample)
    }

    fn step(&mut self, action: &[f64], state: &mut [f64], mut sample: Sample<'_>) -> StepStatus {
        state[1] += DT * (action[0] - state[2] * state[2] * state[0]);
        state[0] += DT * state[1];
        OscillatorWorker::show(state, &mut sample)
    }
}

/// Damps the velocity.
struct Damper;

impl Controller for Damper {
    fn observation_size(&self) -> usize {
        2
    }
    fn action_size(&self) -> usize {
        1
    }
    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Damper)
    }
}

impl ControllerWorker for Damper {
    fn act(&mut self, rows: usize, observations: &[f32], _: &mut [f64], actions: &mut [f32]) {
        (0..rows).for_each(|row| actions[row] = -0.2 * observations[2 * row + 1]);
    }
}

/// A force of up to 0.3 in each second.
fn disturbances() -> Vec<Disturbance> {
    let disturbance = |segment: usize| Disturbance {
        axis: Axis::new(AxisKind::Input, &format!("force_{}", segment + 1), "", [-0.3, 0.3], Some(0.0)),
        effect: Effect::Action {
            entry: 0,
            profile: TimeProfile::Constant(segment * SEGMENT..(segment + 1) * SEGMENT),
        },
    };
    (0..STEPS / SEGMENT).map(disturbance).collect()
}

fn system(
    is_drawn: bool,
    space: &Space,
    specification: &Specification,
) -> Result<Box<dyn System>, RolloutError> {
    let signals = Arc::from(["distance".to_string()]);
    let oscillator = Oscillator { is_drawn, space: Space::new("none", Vec::new())?, signals };
    let rollout =
        Rollout::new(Arc::new(oscillator), Arc::new(Damper), specification.clone(), Noise::default())?;
    Ok(Box::new(rollout.with_disturbances(space.clone(), &disturbances())?))
}

fn target(is_drawn: bool, limit: &str) -> Result<Target, RolloutError> {
    let axes: Vec<Axis> = disturbances().into_iter().map(|disturbance| disturbance.axis).collect();
    Ok(Target {
        identity: Identity::new("example", "oscillator", limit),
        components: Vec::new(),
        spaces: vec![Space::new("disturbance", axes.clone())?],
        axes,
        signals: vec![Signal { name: "distance".to_string(), unit: String::new() }],
        signals_on_request: Vec::new(),
        controller_signals: Vec::new(),
        formulas: vec![NamedFormula {
            name: "success".to_string(),
            text: format!("always(distance <= {limit})"),
        }],
        control_dt: DT,
        episode_steps: STEPS,
        is_deterministic: true,
        can_fail: false,
        depends_on_seed: is_drawn,
        random_axes: Vec::new(),
        versions: Vec::new(),
        reachable: None,
        factory: Arc::new(move |space, specification| system(is_drawn, space, specification)),
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [frequency, limit, budget, trials, seed] = arguments.as_slice() else {
        return Err("expected: known|drawn LIMIT BUDGET TRIALS SEED".into());
    };
    let target = target(frequency == "drawn", limit)?;
    let folder = std::env::temp_dir().join(format!("adversary-toy-{}", std::process::id()));
    for search in [FalsifyPlan::ADVERSARY, "portfolio", "cma-es", "random"] {
        let falsify = FalsifyPlan {
            search: search.to_string(),
            trials: trials.parse()?,
            budget: budget.parse()?,
            ..FalsifyPlan::default()
        };
        let plan = Plan { falsify: Some(falsify), seed: seed.parse()?, ..Plan::new("oscillator", "") };
        let resolved = ResolvedPlan::with_target(&plan, target.clone())?;
        let run = mishandle::run::create_run(&resolved, Some(&folder.join(format!("{search}.sqlite"))))?;
        let answer = mishandle::run::ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(()))?;
        let Answer::Falsification(found, _) = answer else { return Err("another answer".into()) };
        let counts: Vec<String> = found.trials.iter().map(|trial| trial.simulations.to_string()).collect();
        println!(
            "{search}: {} of {trials}, restricted mean {:.1}, {} control steps; {}",
            found.falsified_trials,
            found.restricted_mean_simulations.unwrap_or(f64::NAN),
            found.control_steps,
            counts.join(" ")
        );
    }
    std::fs::remove_dir_all(folder)?;
    Ok(())
}
