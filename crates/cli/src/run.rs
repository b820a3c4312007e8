//! What evaluate and falsify share: from flags to a plan, and where its run is stored.

use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use indicatif::ProgressBar;
use mishandle::store::{RunFile, RunWriter};
use mishandle::{Plan, Subject};

use crate::{args, interrupt, output};

/// More threads than any machine has cores for.
const MAX_THREADS: usize = 1024;

/// Makes a rayon pool of the wanted size the one that everything runs in.
pub fn set_threads(threads: Option<usize>) -> Result<()> {
    if let Some(threads) = threads {
        ensure!(
            (1..=MAX_THREADS).contains(&threads),
            "--threads is {threads}; it has to be from 1 to {MAX_THREADS}"
        );
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    }
    Ok(())
}

/// The plan that the flags describe: one from a file or a run, or a new one, edited.
pub fn plan(subject: &args::Subject, run: &args::Run) -> Result<Plan> {
    let mut plan = match (&subject.plan, &subject.task, &subject.controller) {
        (Some(path), _, _) => {
            let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
            Plan::from_toml(&text).with_context(|| path.display().to_string())?
        }
        (None, Some(task), Some(controller)) => Plan::new(task, controller),
        _ => bail!("a task and a --controller are needed, or a --plan"),
    };
    let edit = |field: &mut String, flag: &Option<String>| {
        if let Some(value) = flag {
            field.clone_from(value);
        }
    };
    edit(&mut plan.task, &subject.task);
    edit(&mut plan.controller, &subject.controller);
    edit(&mut plan.preset, &subject.preset);
    plan.action_noise = subject.action_noise.unwrap_or(plan.action_noise);
    plan.observation_noise = subject.observation_noise.unwrap_or(plan.observation_noise);
    plan.stochastic |= subject.stochastic;
    plan.seed = run.seed.unwrap_or(plan.seed);
    for (key, value) in [("task", &plan.task), ("controller", &plan.controller)] {
        ensure!(!value.is_empty(), "the plan names no `{key}`, and no argument does");
    }
    Ok(plan)
}

/// Plan, subject and open run file: of a stopped run, whose controller may have moved, or of a new one that the flags
/// describe.
pub fn open(
    resume: Option<&Path>,
    controller: Option<&str>,
    out: Option<&Path>,
    new_plan: impl FnOnce() -> Result<Plan>,
) -> Result<(Plan, Subject, RunWriter)> {
    let Some(path) = resume else {
        let plan = new_plan()?;
        let subject = Subject::new(&plan)?;
        let run = mishandle::create_run(&plan, &subject, out)?;
        return Ok((plan, subject, run));
    };
    let run = RunWriter::resume(path)?;
    let (plan, subject) = mishandle::recorded_subject(run.file().header(), controller)?;
    for difference in mishandle::other_build(run.file().header()) {
        output::say(&format!("warning: the run was begun by another build: {difference}"));
    }
    Ok((plan, subject, run))
}

/// Where a run is, as a person would type it.
pub fn name(run: &RunFile) -> String {
    mishandle::shell_word(&run.path().to_string_lossy())
}

/// Says how far an interrupted run came, and how it goes on.
pub fn say_interrupted(command: &str, simulations: u64, name: &str) {
    output::say(&format!("interrupted after {simulations} simulations; every one is in {name}"));
    output::say(&format!("Carry on: mishandle {command} --resume {name}"));
}

/// Has signals end the run after a batch, and says so below the bar as soon as one comes.
pub fn end_on_signals(bar: &ProgressBar) -> Result<()> {
    let bar = bar.clone();
    interrupt::listen(move || {
        bar.suspend(|| {
            output::say("finishing the simulations that have begun; Ctrl-C again ends at once");
        });
    })
}

/// Whether to go on after a batch.
pub fn flow() -> ControlFlow<()> {
    if interrupt::asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
