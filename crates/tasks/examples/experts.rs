//! Measures the experts: `experts EPISODES SEED [TASK…]` from random initial states in the
//! reachable part of the initial box, `experts corners SEEDS [TASK…]` from its corners, or
//! `experts @X,Y… SEED TASK` from one initial state. Prints the rates of success, strict and
//! careful success, the extremes of the motion, and the first starts from which one of them fails.

#![allow(clippy::print_stdout)]

use std::error::Error;
use std::sync::Arc;

use mishandle_rollout::{Controller, Environment, Sample, Scenario, Seed, StepStatus};
use mishandle_stl::{Clock, Formula, Monitor, Trace, is_satisfied};
use mishandle_tasks::{
    ARM_JOINTS, CONTROL_DT, JOINTS, Preset, Reward, TARGET_STEP, TASKS, Task, TaskEnvironment,
};
use rayon::prelude::*;

const STEPS: usize = 300;

/// The signal that this program adds: the largest speed of an arm joint's target, rad/s.
const TARGET_SPEED: &str = "target_speed";

/// Signals whose extremes are printed, and whether the extreme is the largest value.
const EXTREMES: [(&str, bool); 9] = [
    ("object_force", true),
    ("fixture_force", true),
    ("ground_force", true),
    ("tool_speed", true),
    ("joint_speed_share", true),
    ("joint_acceleration_share", true),
    ("joint_torque_share", true),
    (TARGET_SPEED, true),
    ("joint_limit_distance", false),
];

/// The first control step whose distance to the ends of the joints' ranges careful formulas limit.
const ENDS_FROM: usize = 60;

/// Runs one episode of the expert and returns its trace.
fn episode(
    environment: &TaskEnvironment,
    expert: &dyn Controller,
    start: &Scenario,
    seed: Seed,
) -> Result<Trace, Box<dyn Error + Send + Sync>> {
    let mut worker = environment.worker();
    let mut controller = expert.worker();
    let mut state = vec![0.0; environment.state_size()];
    let mut memory = vec![0.0; expert.state_size()];
    let mut observation = vec![0.0; environment.observation_size()];
    let mut signals = vec![0.0; environment.signals().len() + 1];
    let mut rewards = vec![0.0; environment.reward_terms().len()];
    let mut action = vec![0.0; JOINTS];
    let names = environment.signals().iter().cloned().chain([TARGET_SPEED.to_string()]);
    let names: Vec<String> = names.collect();
    let mut trace = Trace::with_capacity(names.into(), STEPS + 1);
    let own = signals.len() - 1;
    controller.reset(&mut memory, seed);
    let sample =
        Sample { observation: &mut observation, signals: &mut signals[..own], rewards: &mut rewards };
    worker.reset(start, seed, &mut state, sample);
    trace.push(&signals);
    for _ in 0..STEPS {
        controller.act(1, &observation, &mut memory, &mut action);
        let wide: Vec<f64> = action.iter().copied().map(f64::from).collect();
        let sample =
            Sample { observation: &mut observation, signals: &mut signals[..own], rewards: &mut rewards };
        if worker.step(&wide, &mut state, sample) == StepStatus::Diverged {
            return Err(format!("the episode from {start:?} diverged").into());
        }
        let largest = wide[..ARM_JOINTS].iter().fold(0.0, |largest, a| f64::max(largest, a.abs()));
        signals[own] = largest * TARGET_STEP / CONTROL_DT;
        trace.push(&signals);
    }
    Ok(trace)
}

/// Measurement of one episode: whether it met each condition, and its extremes.
struct Outcome {
    met: Vec<bool>,
    extremes: Vec<f64>,
}

/// Returns the formulas of success, strict and careful success, with their names.
fn conditions(task: &dyn Task) -> Vec<(&'static str, String)> {
    let formulas = task.definition().formulas(Preset::Paper);
    let mut all = vec![("success", formulas.success.to_string()), ("strict", formulas.strict.to_string())];
    all.extend(formulas.careful().map(|text| ("careful", text)));
    all
}

fn measure(
    task: &dyn Task,
    environment: &TaskEnvironment,
    expert: &Arc<dyn Controller>,
    starts: &[(Scenario, Seed)],
) -> Result<(), Box<dyn Error + Send + Sync>> {
    let conditions = conditions(task);
    let formulas: Vec<Formula> =
        conditions.iter().map(|(_, text)| Formula::parse(text)).collect::<Result<_, _>>()?;
    let outcome = |(start, seed): &(Scenario, Seed)| {
        let trace = episode(environment, &**expert, start, *seed)?;
        let mut met = Vec::new();
        for formula in &formulas {
            let mut monitor = Monitor::new(formula, trace.names(), Clock::steps(CONTROL_DT))?;
            met.push(monitor.decided_robustness(&trace)?.is_some_and(is_satisfied));
        }
        let extremes = EXTREMES.map(|(name, is_largest)| {
            let values = trace.signal(name).unwrap_or_default().iter().copied();
            if is_largest {
                values.fold(0.0, f64::max)
            } else {
                values.skip(ENDS_FROM).fold(f64::INFINITY, f64::min)
            }
        });
        Ok(Outcome { met, extremes: extremes.to_vec() })
    };
    let outcomes: Vec<Outcome> =
        starts.par_iter().map(outcome).collect::<Result<_, Box<dyn Error + Send + Sync>>>()?;
    print!("{:<15} n {:<5}", task.definition().name, outcomes.len());
    for (index, (name, _)) in conditions.iter().enumerate() {
        // Strict success counts only together with success.
        let count = outcomes.iter().filter(|outcome| outcome.met[0] && outcome.met[index]).count();
        print!(" {name} {:6.2}", 100.0 * count as f64 / outcomes.len() as f64);
    }
    print!("\n   ");
    for (index, (name, is_largest)) in EXTREMES.into_iter().enumerate() {
        let values = outcomes.iter().map(|outcome| outcome.extremes[index]);
        let extreme =
            if is_largest { values.fold(0.0, f64::max) } else { values.fold(f64::INFINITY, f64::min) };
        print!(" {name} {extreme:.3}");
    }
    println!();
    for ((start, _), outcome) in starts.iter().zip(&outcomes).filter(|(_, o)| o.met.contains(&false)).take(4)
    {
        let failed = conditions.iter().zip(&outcome.met).filter(|(_, met)| !**met);
        let failed: Vec<&str> = failed.map(|((name, _), _)| *name).collect();
        println!("    {:?} fails {failed:?}", numbers(start));
    }
    Ok(())
}

/// Returns the values of an initial state.
fn numbers(start: &Scenario) -> Vec<f64> {
    start.values().iter().flatten().copied().collect()
}

fn main() -> Result<(), Box<dyn Error + Send + Sync>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [first, second] = [0, 1].map(|i| words.get(i).map_or("", String::as_str));
    let names = words.get(2..).unwrap_or_default();
    for task in TASKS {
        let definition = task.definition();
        let is_named = names.iter().any(|name| name == definition.name);
        if !is_named && (!names.is_empty() || definition.variant_of.is_some()) {
            continue;
        }
        let expert = task.expert()?;
        let environment = TaskEnvironment::new(*task, Preset::Paper, Reward::Shaped)?
            .with_manner()
            .with_further_parts(expert.further_parts())?;
        if let Some(point) = first.strip_prefix('@') {
            let x0: Vec<f64> = point.split(',').map(str::parse).collect::<Result<_, _>>()?;
            measure(*task, &environment, &expert, &[(x0.as_slice().into(), Seed(second.parse()?))])?;
        } else if first == "corners" {
            let seeds: u64 = second.parse()?;
            let axes = definition.initial_box;
            for corner in 0..1_usize << axes.len() {
                let bound = |(i, axis): (usize, &mishandle_tasks::BoxAxis)| axis.paper[corner >> i & 1];
                let x0: Vec<f64> = axes.iter().enumerate().map(bound).collect();
                print!("{x0:?} reachable {} ", task.reachable(&x0));
                let start = |seed| (Scenario::from(x0.as_slice()), Seed(77).child(seed));
                let starts: Vec<(Scenario, Seed)> = (0..seeds).map(start).collect();
                measure(*task, &environment, &expert, &starts)?;
            }
        } else {
            let count: usize = first.parse()?;
            let seed = Seed(second.parse()?);
            let starts = (0..).map(|i| (environment.space().sample(seed, i), seed.child(i)));
            let reachable = starts.filter(|(start, _)| task.reachable(&numbers(start)));
            measure(*task, &environment, &expert, &reachable.take(count).collect::<Vec<_>>())?;
        }
    }
    Ok(())
}
