//! The questions about a Python target.

use std::ops::ControlFlow;
use std::path::PathBuf;

use mishandle::ResolvedPlan;
use mishandle::results::{Answer, WithoutVerdict};
use mishandle::run::{Engine, Probes, inconclusive_text, without_verdict_text};
use mishandle::store::{RunFile, RunWriter};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::call::Call;
use crate::target::{PyTarget, axes_from, axes_text, keep, space};
use crate::work::{in_run, json, report};
use crate::{gpu, raised};

/// Applies the settings of axes of a call to these axes, and checks the question of the call in
/// their space, before the system is simulated. Returns the axes.
#[pyfunction]
pub fn check_question(call: &str, axes: &str) -> PyResult<String> {
    let Call { plan, .. } = Call::read(call)?;
    let whole = space(axes_from(axes)?)?;
    let known = whole.axes().to_vec();
    let space = mishandle::resolve::with_settings(whole, &plan.axes, &known).map_err(raised)?;
    let check = || {
        if let Some(evaluate) = &plan.evaluate {
            mishandle::resolve::check_evaluate(evaluate)?;
        }
        if let Some(compare) = &plan.compare {
            mishandle::resolve::check_compare(compare)?;
        }
        if let Some(falsify) = &plan.falsify {
            mishandle::resolve::check_falsify(falsify, &space)?;
        }
        if let Some(margin) = &plan.margin {
            mishandle::falsification::check_margin(margin.budget, &space)?;
        }
        if let Some(table) = &plan.metamorphic {
            mishandle::resolve::check_metamorphic(table, space.clone(), &known, plan.seed)?;
        }
        if let Some(risk) = &plan.risk {
            mishandle::resolve::check_risk(risk, &space)?;
        }
        Ok::<_, mishandle::MishandleError>(())
    };
    check().map_err(raised)?;
    axes_text(space.axes())
}

/// The document of an answer and its lines, the exception that ended the question early, and
/// warnings.
type Answered = (String, String, Option<PyErr>, Vec<String>);

/// Asks the question of a target.
#[pyfunction]
#[pyo3(signature = (target, *, out, resume, progress, announce, earlier_probes))]
pub fn ask(
    py: Python<'_>,
    target: &PyTarget,
    out: Option<PathBuf>,
    resume: bool,
    progress: Option<Py<PyAny>>,
    announce: Option<Py<PyAny>>,
    earlier_probes: u64,
) -> PyResult<Answered> {
    let plan = &target.plan;
    let is_auto = target.settings.engine.screening.is_some();
    let device = (plan.screening.is_some() || is_auto).then(gpu::device);
    let work = |resolved: &ResolvedPlan, run: RunWriter, probes: Probes| {
        if let Some(announce) = &announce {
            let cost = mishandle::run::cost(resolved)?;
            let time = mishandle_cli::time_text(&cost, &probes, earlier_probes).into_iter();
            let parts: Vec<String> = [mishandle_cli::cost_text(&cost)].into_iter().chain(time).collect();
            let text = parts.join("; ");
            Python::attach(|py| announce.call1(py, (text,)).map(drop))
                .map_err(|exception| keep(&target.pending, exception))?;
        }
        let is_new = run.file().counts()?.simulations == 0;
        let path = run.file().path().to_path_buf();
        let mut warnings = Vec::new();
        if plan.risk.is_some() {
            warnings.extend(mishandle::run::risk_scenarios(resolved)?.warnings());
        }
        let engine = device.as_ref().map_or(Engine::Direct, |device| Engine::Screening(&*device.worlds));
        let mut answer = mishandle::run::ask(resolved, run, engine, &mut |done| {
            report(target, progress.as_ref(), done.simulations, done.max_simulations)
        })?;
        if is_new {
            warnings.extend(mishandle::run::warnings(&RunFile::open_unchecked(&path)?)?);
        }
        // The progress is that of the question; its repeats can be interrupted, too.
        let watch = |_, _, _| -> ControlFlow<()> { report(target, None, 0, 0) };
        mishandle::inspect::further(resolved, &mut answer, &target.settings.report, watch)?;
        Ok((answer, warnings))
    };
    let ((answer, mut warnings), exception) = in_run(py, target, out, resume, work)?;
    warnings.extend(untested(&answer));
    warnings.extend(answer.asks_nothing().iter().map(|found| format!("not violated: asks nothing: {found}")));
    let text = match mishandle::verdict::verdict(&answer) {
        Some(verdict) => mishandle_cli::verdict_text(&verdict),
        None => mishandle_cli::answer_text(&answer),
    };
    Ok((json(&answer)?, text, exception, warnings))
}

/// Returns the warning of an answer that concludes nothing: an evaluation without any verdict, or
/// another question with too few. A search warns by itself.
fn untested(answer: &Answer) -> Option<String> {
    let found = answer.without_verdict();
    let why = match answer {
        Answer::Falsification(_) => None,
        _ if !answer.is_complete() => None,
        Answer::Evaluation(_) => {
            (!answer.has_verdict()).then(|| "no conclusion: the system was not tested".to_string())
        }
        _ if answer.is_inconclusive() => inconclusive_text(found).or_else(|| match answer {
            Answer::Metamorphic(found) => found.open_relation(),
            _ => None,
        }),
        _ => None,
    }?;
    Some(without_verdict_text(found).map_or(why.clone(), |text| format!("{text}; {why}")))
}

/// Returns the sentence about simulations without a verdict, from that part of an answer as JSON;
/// empty if all have one.
#[pyfunction]
#[pyo3(name = "without_verdict_text")]
pub fn without_verdict_sentence(found: &str) -> PyResult<String> {
    Ok(without_verdict_text(&parsed(found)?).unwrap_or_default())
}

/// Returns why a question has no conclusion, from that part of an answer as JSON; `None` if enough
/// of its simulations have a verdict.
#[pyfunction]
#[pyo3(name = "inconclusive_text")]
pub fn inconclusive_sentence(found: &str) -> PyResult<Option<String>> {
    Ok(inconclusive_text(&parsed(found)?))
}

fn parsed(found: &str) -> PyResult<WithoutVerdict> {
    serde_json::from_str(found).map_err(|error| PyValueError::new_err(error.to_string()))
}
