use anyhow::Result;
use mishandle::falsification::{Outcome as Found, TrialEnd};
use mishandle::rollout::Environment;
use mishandle::store::{End, RunFile};
use mishandle::{FalsifyPlan, Plan, Subject};
use serde_json::{Value, json};

use crate::commands::evaluate::noise;
use crate::output::{self, number};
use crate::{Outcome, args, progress, run};

pub fn run(command: &args::Falsify) -> Result<Outcome> {
    run::set_threads(command.run.threads)?;
    let bar = progress::bar(0, "simulations at most");
    run::end_on_signals(&bar)?;
    let moved = command.subject.controller.as_deref();
    let (plan, subject, file) =
        run::open(command.resume.as_deref(), moved, command.out.as_deref(), || plan(command))?;
    output::warn_of_chains(&subject.specification.requirement);
    let name = run::name(file.file());
    let path = file.file().path().to_path_buf();
    let found = mishandle::falsify(&plan, &subject, file, |progress| {
        bar.set_length(progress.most);
        bar.set_position(progress.simulations);
        bar.set_message(format!("({} trials ended, {} falsified)", progress.ended, progress.falsified));
        run::flow()
    })?;
    bar.finish_and_clear();
    say_undefined(&RunFile::open(&path)?, &subject)?;
    let trials = plan.falsify.as_ref().map_or(0, |falsify| falsify.trials);
    let ended = found.trials.iter().filter(|trial| trial.end.is_some()).count();
    if ended < trials as usize {
        run::say_interrupted("falsify", found.simulations, &name);
        return Ok(Outcome::Interrupted);
    }
    if command.run.json {
        output::json(&document(&plan, &subject, &found))?;
    } else {
        output::line(&text(&plan, &subject, &found))?;
    }
    output::say(&format!("Every simulation is in {name}"));
    if found.falsified_trials == 0 {
        return Ok(Outcome::Done);
    }
    output::say(&format!("See the first counterexample again: mishandle replay {name}"));
    Ok(Outcome::Violated)
}

fn plan(command: &args::Falsify) -> Result<Plan> {
    let mut plan = run::plan(&command.subject, &command.run)?;
    let mut falsify: FalsifyPlan = plan.falsify.take().unwrap_or_default();
    falsify.search = command.search.clone().unwrap_or(falsify.search);
    falsify.formula = command.formula.clone().unwrap_or(falsify.formula);
    falsify.trials = command.trials.unwrap_or(falsify.trials);
    falsify.budget = command.budget.unwrap_or(falsify.budget);
    plan.evaluate = None;
    plan.falsify = Some(falsify);
    Ok(plan)
}

fn document(plan: &Plan, subject: &Subject, found: &Found) -> Value {
    let falsify = plan.falsify.clone().unwrap_or_default();
    let trials: Vec<Value> = found
        .trials
        .iter()
        .map(|trial| {
            let minimum = trial.minimum.as_ref();
            json!({
                "trial": trial.trial + 1,
                "falsified": trial.falsified(),
                "simulations": trial.simulations,
                "minimum_robustness": minimum.map_or(Value::Null, |minimum| number(minimum.robustness)),
                "initial_configuration": minimum.map(|minimum| &minimum.initial_configuration),
                "simulation": minimum.map(|minimum| minimum.number),
                "seed": minimum.map(|minimum| minimum.seed.0.to_string()),
                "end": trial.end.map(end),
                "diverged": trial.diverged,
                "undecided": trial.undecided,
            })
        })
        .collect();
    json!({
        "task": plan.task,
        "preset": plan.preset,
        "controller": mishandle::controller_name(&plan.controller),
        "controller_hash": subject.controller_hash,
        "stochastic": plan.stochastic,
        "action_noise": plan.action_noise,
        "observation_noise": plan.observation_noise,
        "seed": plan.seed.to_string(),
        "search": falsify.search,
        "formula": subject.specification.requirement.to_string(),
        "budget": falsify.budget,
        "falsified_trials": found.falsified_trials,
        "falsification_rate": {
            "value": found.falsification_rate.value,
            "low": found.falsification_rate.low,
            "high": found.falsification_rate.high,
            "n": found.falsification_rate.n,
        },
        "mean_simulations": found.mean_simulations,
        "median_simulations": found.median_simulations,
        "restricted_mean_simulations": found.restricted_mean_simulations,
        "trials": trials,
    })
}

/// Says from where the formula had no finite value, the first few times.
fn say_undefined(run: &RunFile, subject: &Subject) -> Result<()> {
    const SHOWN: usize = 3;
    let mut count = 0;
    for simulation in run.simulations() {
        let simulation = simulation?;
        let End::Undefined { step } = simulation.end else { continue };
        count += 1;
        if count <= SHOWN {
            output::say(&format!(
                "warning: simulation {} of trial {}, from {}, seed {}: the formula has no finite value at step {step}; \
                 it counts as undecided",
                simulation.number,
                simulation.trial,
                start(subject, &simulation.initial_configuration),
                simulation.seed
            ));
        }
    }
    if count > SHOWN {
        output::say(&format!("warning: so have {} more simulations", count - SHOWN));
    }
    Ok(())
}

/// An initial configuration for people.
fn start(subject: &Subject, x0: &[f64]) -> String {
    let axes = subject.environment.initial_box().axes();
    let values = axes.iter().zip(x0).map(|(axis, value)| format!("{} = {value:.4} {}", axis.name, axis.unit));
    values.collect::<Vec<_>>().join(", ")
}

/// How a trial ended, in a word.
fn end(end: TrialEnd) -> &'static str {
    match end {
        TrialEnd::Falsified => "falsified",
        TrialEnd::BudgetSpent => "budget spent",
        TrialEnd::SearchEnded(_) => "search ended",
    }
}

fn text(plan: &Plan, subject: &Subject, found: &Found) -> String {
    let falsify = plan.falsify.clone().unwrap_or_default();
    let start = |x0: &[f64]| start(subject, x0);
    let mut rows = vec![["trial", "", "simulations", "least robustness", "at"].map(String::from).to_vec()];
    for trial in &found.trials {
        let minimum = trial.minimum.as_ref();
        rows.push(vec![
            (trial.trial + 1).to_string(),
            trial.end.map_or("cut short", end).to_string(),
            trial.simulations.to_string(),
            minimum.map_or("-".to_string(), |minimum| format!("{:.4}", minimum.robustness)),
            minimum.map_or(String::new(), |minimum| start(&minimum.initial_configuration)),
        ]);
    }
    let ended = found.falsification_rate.n;
    let mut text = format!(
        "{}, controller {}, task preset {}{}\nsearch {}, at most {} simulations a trial, seed {}\nformula {}\n\n{}\n\n\
         falsified {} of {ended} trials",
        plan.task,
        plan.controller,
        plan.preset,
        noise(plan),
        falsify.search,
        falsify.budget,
        plan.seed,
        subject.specification.requirement,
        output::table(&rows),
        found.falsified_trials,
    );
    if let Some(mean) = found.mean_simulations {
        text.push_str(&format!(", after {mean:.1} simulations on average"));
    }
    let first =
        found.trials.iter().filter(|trial| trial.falsified()).find_map(|trial| trial.minimum.as_ref());
    if let Some(first) = first {
        text.push_str(&format!(
            "\ncounterexample: {}, seed {}: robustness {:.4}",
            start(&first.initial_configuration),
            first.seed.0,
            first.robustness
        ));
    }
    if found.diverged + found.undecided > 0 {
        text.push_str(&format!(
            "\n{} simulations diverged, {} were undecided; neither counts as a counterexample",
            found.diverged, found.undecided
        ));
    }
    text
}
