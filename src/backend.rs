//! Physics engines besides MuJoCo C. They propose scenarios; MuJoCo C gives every verdict.

use std::ops::ControlFlow;
use std::sync::{Arc, OnceLock};

use mishandle_evaluation::{
    CornerReport, EvaluationError, FormulaRoles, ScreenedEvaluation, ScreenedProgress, evaluate_corners,
    evaluate_screened,
};
use mishandle_network::NetworkDevice;
use mishandle_risk::{Scenarios, ScreenedReport, ScreenedSettings, screened_risk};
use mishandle_rollout::{RolloutError, ScenarioBatch, Screening, Seed};
use mishandle_tasks::TaskBatch;
use mishandle_world::Backend;

use crate::evaluate::{corner_report, with_requests};
use crate::{MishandleError, Plan, ResolvedPlan, task_target};

static GPU: OnceLock<Gpu> = OnceLock::new();

/// What the backend `gpu` consists of.
struct Gpu {
    worlds: Arc<dyn Backend>,
    networks: Option<Arc<dyn NetworkDevice>>,
}

/// Makes a backend available as `gpu`: worlds, and networks for the learner of `train`, which otherwise computes them on the CPU. The
/// first call of a process counts; the Python package calls it.
pub fn install_gpu_backend(worlds: Arc<dyn Backend>, networks: Option<Arc<dyn NetworkDevice>>) {
    let _ = GPU.set(Gpu { worlds, networks });
}

/// Returns the backend `gpu`.
///
/// # Errors
/// If no backend is installed, because this program is not the one of the Python package.
pub fn gpu_backend() -> Result<Arc<dyn Backend>, MishandleError> {
    GPU.get().map(|gpu| gpu.worlds.clone()).ok_or(MishandleError::NoGpuBackend)
}

/// Returns the networks of the backend `gpu`, if it has some.
pub(crate) fn gpu_networks() -> Option<&'static dyn NetworkDevice> {
    GPU.get()?.networks.as_deref()
}

/// Makes the screening of a plan's simulations on a backend, in two batches of half of `rows` worlds each: while the engine steps
/// one of them, the CPU computes the samples and actions of the other.
///
/// # Errors
/// If the target is no task, or the backend cannot simulate it.
pub fn screening(
    resolved: &ResolvedPlan,
    backend: &dyn Backend,
    rows: usize,
) -> Result<Screening, MishandleError> {
    if resolved.target.identity.kind != "task" {
        let target = resolved.plan.target.clone();
        return Err(MishandleError::UnsupportedOption { target, option: "--screening" });
    }
    let target = task_target(&resolved.plan)?;
    let environment = target.environment(&resolved.space)?;
    let Plan { risk, evaluate, falsify, .. } = &resolved.plan;
    let simulations = [
        risk.as_ref().map(|table| table.simulations as usize),
        evaluate.as_ref().map(|table| table.episodes as usize),
        falsify.as_ref().map(|table| table.trials as usize * table.budget as usize),
    ];
    // More worlds than simulations would be idle.
    let rows = rows.min(simulations.into_iter().flatten().max().unwrap_or(rows)).max(1);
    let halves = [rows.div_ceil(2), rows / 2];
    let batches = halves
        .into_iter()
        .filter(|rows| *rows > 0)
        .map(|rows| Ok(Box::new(TaskBatch::new(&environment, backend, rows)?) as Box<dyn ScenarioBatch>))
        .collect::<Result<Vec<_>, RolloutError>>()?;
    let rollout = target.system_in(Arc::new(environment), &resolved.space, &resolved.specification)?;
    Ok(Screening::new(rollout, batches))
}

/// Estimates the failure probability of a plan by screening on a backend: see [`screened_risk`](mishandle_risk::screened_risk()).
///
/// # Errors
/// If the plan has no table `[risk]`, or a simulation cannot be run.
pub fn risk_on_backend(
    resolved: &ResolvedPlan,
    scenarios: &Scenarios,
    screening: &mut Screening,
    sample_rate: f64,
    watch: &mut (dyn FnMut(ScreenedProgress) -> ControlFlow<()> + Send),
) -> Result<ScreenedReport, MishandleError> {
    let table = resolved.plan.risk.as_ref().ok_or(MishandleError::MissingPlanTable { table: "risk" })?;
    let settings = ScreenedSettings {
        simulations: table.simulations,
        sample_rate,
        seed: Seed(resolved.plan.seed),
        batch: table.batch as usize,
    };
    Ok(screened_risk(screening, &mut *resolved.system()?, scenarios, &settings, watch)?)
}

/// Results of an evaluation on a backend.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedEvaluationOutcome {
    /// Results of the random simulations.
    pub report: ScreenedEvaluation,
    /// Results at the corners and the center of the initial box, all from the target's system; `None` if the space has no numeric axis
    /// of kind `start`, or the evaluation was interrupted.
    pub corners: Option<CornerReport>,
}

/// Evaluates a plan by screening on a backend: see [`evaluate_screened`](mishandle_evaluation::evaluate_screened()).
///
/// # Errors
/// If the plan has no table `[evaluate]`, or a simulation cannot be run.
pub fn evaluate_on_backend(
    resolved: &ResolvedPlan,
    screening: &mut Screening,
    sample_rate: f64,
    watch: &mut (dyn FnMut(ScreenedProgress) -> ControlFlow<()> + Send),
) -> Result<ScreenedEvaluationOutcome, MishandleError> {
    with_requests(resolved, |requests| {
        let (mut system, roles) = (resolved.system()?, FormulaRoles::of(&resolved.specification));
        let report = evaluate_screened(screening, &mut *system, &requests.random, roles, sample_rate, watch)?;
        let mut outcome = ScreenedEvaluationOutcome { report, corners: None };
        if let (Some(corners), true) = (&requests.corners, outcome.report.is_complete) {
            let progress = ScreenedProgress {
                screened: outcome.report.failures.trials,
                confirmed: outcome.report.confirmed(),
            };
            let mut report = corner_report(resolved, corners);
            let mut is_stopped = false;
            evaluate_corners(&mut *system, corners, requests.random.batch, &mut report, |_| {
                let flow = watch(progress);
                is_stopped |= flow.is_break();
                Ok::<_, EvaluationError>(flow)
            })?;
            outcome.report.is_complete = !is_stopped;
            outcome.corners = (!is_stopped).then_some(report);
        }
        Ok(outcome)
    })
}
