//! Physics engines besides MuJoCo C. They propose scenarios; MuJoCo C gives every verdict.

use std::ops::ControlFlow;
use std::sync::Arc;

use mishandle_evaluation::{
    CornerReport, EvaluationError, FormulaRoles, ScreenedEvaluation, ScreenedProgress, evaluate_corners,
    evaluate_screened,
};
use mishandle_network::NetworkDevice;
use mishandle_rollout::{Screen, Screening, System};
use mishandle_world::WorldDevice;

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, scene_target};
use crate::run::evaluate::{corner_report, with_requests};

/// A device besides the CPU, which a front end that has one passes to the questions.
#[derive(Clone)]
pub struct Device {
    /// Worlds that propose simulations, and in which policies train.
    pub worlds: Arc<dyn WorldDevice>,
    /// Networks for the learner of [`train`](crate::train::train()). Without them, the CPU computes
    /// the networks.
    pub networks: Option<Arc<dyn NetworkDevice>>,
}

/// Makes the screening of a plan's simulations on a device, in two batches of half of `rows` worlds
/// each: while the engine steps one of them, the CPU computes the samples and actions of the other.
///
/// # Errors
/// If the target has no scene, or the device cannot simulate it.
pub fn screening(
    resolved: &ResolvedPlan,
    device: &dyn WorldDevice,
    rows: usize,
) -> Result<Screening, MishandleError> {
    let target = scene_target(resolved)?;
    let Plan { risk, evaluate, falsify, .. } = &resolved.plan;
    let simulations = [
        risk.as_ref().map(|table| table.simulations as usize),
        evaluate.as_ref().map(|table| table.episodes as usize),
        falsify.as_ref().map(|table| table.trials as usize * table.budget as usize),
    ];
    // More worlds than simulations would be idle.
    let rows = rows.min(simulations.into_iter().flatten().max().unwrap_or(rows)).max(1);
    let halves = [rows.div_ceil(2), rows / 2];
    let space = &resolved.space;
    let specification = &resolved.specification;
    let batches =
        target.batches((space, specification), device, halves.into_iter().filter(|rows| *rows > 0))?;
    let environment = target.environment(space, specification, false)?;
    let rollout = target.system_in(environment, space, specification)?;
    Ok(Screening::new(rollout, batches))
}

/// Results of an evaluation on a device.
#[derive(Clone, Debug, PartialEq)]
pub struct ScreenedEvaluationOutcome {
    /// Results of the random simulations.
    pub report: ScreenedEvaluation,
    /// Results at the corners and the center of the initial box, all from the target's system;
    /// `None` if the space has no numeric axis of kind `start`, or the evaluation was interrupted.
    pub corners: Option<CornerReport>,
}

/// Evaluates a plan by screening: see
/// [`evaluate_screened`](mishandle_evaluation::evaluate_screened()).
pub(crate) fn evaluate(
    resolved: &ResolvedPlan,
    (screening, system): (&mut dyn Screen, &mut dyn System),
    sample_rate: f64,
    watch: &mut (dyn FnMut(ScreenedProgress) -> ControlFlow<()> + Send),
) -> Result<ScreenedEvaluationOutcome, MishandleError> {
    with_requests(resolved, |requests| {
        let roles = FormulaRoles::of(&resolved.specification);
        let report = evaluate_screened(screening, system, &requests.random, roles, sample_rate, watch)?;
        let mut outcome = ScreenedEvaluationOutcome { report, corners: None };
        if let (Some(corners), true) = (&requests.corners, outcome.report.is_complete) {
            let progress = ScreenedProgress {
                screened: outcome.report.failures.trials,
                confirmed: outcome.report.confirmed(),
            };
            let mut report = corner_report(resolved, corners);
            let mut is_stopped = false;
            evaluate_corners(system, corners, requests.random.batch, &mut report, |_| {
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
