//! The part that `evaluate`, `falsify`, `margin` and `risk` share: they ask a question.

use std::time::Instant;

use anyhow::{Context, Result};
use mishandle::plan::{EngineChoice, ScreeningPlan, Settings};
use mishandle::results::{Answer, Screening};
use mishandle::run::{Device, Engine, with_faster_engine};
use mishandle::store::RunKind;
use mishandle::{MishandleError, Plan, ResolvedPlan, RunError};
use mishandle_text::plural;

use super::{ExitStatus, control_flow, name, open, report_interruption, stop_on_signals};
use crate::flags::{self, Assignment};
use crate::show::output;
use crate::show::progress::Bar;

/// A question that was asked.
pub struct Asked {
    pub resolved: ResolvedPlan,
    pub answer: Answer,
    pub settings: Settings,
    /// Path of the run file, quoted for a shell.
    pub name: String,
    pub kind: RunKind,
    simulations: u64,
    seconds: f64,
}

/// Opens or creates the run file of a question, and asks it.
pub fn ask(
    kind: RunKind,
    keys: &[Assignment],
    file: &flags::OpenRun,
    gpu: Option<&Device>,
    plan: impl FnOnce() -> Result<(Plan, Settings)>,
) -> Result<Asked> {
    let bar = Bar::new(0, "simulations");
    stop_on_signals(&bar)?;
    // Before there is a run file.
    let (planned, settings) = match (&file.resume, plan) {
        (Some(_), _) => {
            (None, flags::settings(keys, if kind == RunKind::Metamorphic { "run" } else { kind.name() })?)
        }
        (None, plan) => {
            let (plan, settings) = plan()?;
            (Some(plan), settings)
        }
    };
    if let (Some(Plan { screening: Some(ScreeningPlan { device, .. }), .. }), None) = (&planned, gpu) {
        return Err(MishandleError::NoDevice { device: device.clone() }.into());
    }
    let planned = match (planned, settings.engine.screening) {
        (Some(planned), Some(EngineChoice::Auto)) => Some(faster(&planned, gpu)?),
        (planned, _) => planned,
    };
    let (resolved, file) = open(file, kind, &settings.engine, planned)?;
    output::warn_about(&resolved.specification.requirement);
    let is_new = file.file().counts()?.simulations == 0;
    for warning in file.file().header().preflight.iter().filter(|_| is_new) {
        output::message(&format!("warning: {}", crate::show::escape::name(warning)));
    }
    let name = name(file.file());
    let start = Instant::now();
    let mut simulations = 0;
    let engine = gpu.map_or(Engine::Direct, |gpu| Engine::Screening(&*gpu.worlds));
    let answer = mishandle::run::ask(&resolved, file, engine, &mut |progress| {
        simulations = progress.simulations;
        bar.set_length(progress.max_simulations);
        bar.set_position(progress.simulations);
        if kind == RunKind::Falsify {
            let ended = plural(progress.ended, "trial");
            bar.set_note(format!("{ended} finished, {} falsified", progress.falsified));
        }
        control_flow()
    });
    bar.clear();
    if let Err(MishandleError::Run(RunError::NothingRuns { .. })) = &answer {
        output::message(&format!("Run file: {name}"));
    }
    let answer = answer?;
    let seconds = start.elapsed().as_secs_f64();
    Ok(Asked { resolved, answer, settings, name, kind, simulations, seconds })
}

/// Returns a plan with the engine that is faster, and says which.
fn faster(plan: &Plan, gpu: Option<&Device>) -> Result<Plan> {
    let rows = plan.screening.clone().unwrap_or_default();
    let Some(gpu) = gpu else { return Err(MishandleError::NoDevice { device: rows.device }.into()) };
    output::message(
        "measuring both engines on the first simulations of the question, which belong to no run",
    );
    let bar = Bar::new(rows.rows.into(), "simulations of the device");
    let watch = |done: usize| {
        bar.set_position(done as u64);
        control_flow()
    };
    let found = with_faster_engine(&ResolvedPlan::new, plan, &*gpu.worlds, &watch)?;
    bar.clear();
    let (plan, speeds) = found.context("interrupted before there is a run file")?;
    output::message(&speeds.text());
    Ok(plan)
}

impl Asked {
    /// Reports how long a screening took.
    pub fn report_screening(&self, counts: &Screening) {
        output::message(&format!(
            "{} screened in {:.1} s; only the {} that MuJoCo C confirmed are evidence",
            plural(counts.simulations, "simulation"),
            self.seconds,
            counts.flagged + counts.audit_sample
        ));
    }

    /// Reports the run file, and how to resume an interrupted question. Returns `Interrupted` then.
    pub fn report_file(&self) -> Option<ExitStatus> {
        if self.answer.is_complete() {
            output::message(&format!("Run file: {}", self.name));
            return None;
        }
        report_interruption(self.kind, self.simulations, &self.name);
        Some(ExitStatus::Interrupted)
    }
}
