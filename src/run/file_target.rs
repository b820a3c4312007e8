//! The plan of a run whose target only the run file describes: no file is opened, no program is
//! started, and nothing can be simulated.

use std::sync::Arc;

use mishandle_falsification::search_space;
use mishandle_rollout::{
    Component, Identity, NamedFormula, RolloutError, Signal, Space, Specification, Target,
};
use mishandle_stl::Formula;
use mishandle_store::{ComponentRecord, FormulaRecord, RunHeader, SignalRecord};

use crate::error::MishandleError;
use crate::plan::Plan;
use crate::resolve::{ResolvedPlan, reachable_starts};
use crate::run::facts::Facts;
use crate::run::rows::REQUIREMENT;

/// Start of the names of the verdicts that are parts of the robustness.
const PART: &str = "part_";

/// Largest number of axes that are tried, because a hostile file can have many.
const MOST: usize = 30;

/// Returns the possible plans of a run. A header does not say what depends on a seed, and which of
/// the axes that a metamorphic relation changes are nominal in source cases. The recorded
/// simulations fit one possibility; if they fit several, the first one claims the least.
pub(crate) fn possible_plans(
    header: &RunHeader,
) -> impl Iterator<Item = Result<ResolvedPlan, MishandleError>> + '_ {
    let names = || header.axes.iter().map(|axis| &axis.name);
    let plan = Plan::from_toml(&header.plan).ok();
    let tables = plan.iter().flat_map(|plan| &plan.metamorphic);
    let relations = tables.flat_map(|table| table.relations.values());
    let changed: Vec<&String> = relations.flat_map(|relation| relation.change.keys()).collect();
    let further = names().rev().take(MOST).take_while(|name| changed.contains(name)).count();
    let sources = (header.axes.len() - further..=header.axes.len()).rev();
    let each = names().take(MOST).map(|name| (false, vec![name.clone()]));
    let random: Vec<_> = [(false, Vec::new()), (true, Vec::new())].into_iter().chain(each).collect();
    sources.flat_map(move |sources| {
        random.clone().into_iter().map(move |(depends_on_seed, random_axes)| {
            let mut found = file_plan(header)?;
            for space in &mut found.target.spaces {
                *space = Space::new(space.name(), space.axes()[..sources].to_vec())?;
            }
            found.target.depends_on_seed = depends_on_seed;
            found.target.random_axes = random_axes;
            Ok(found)
        })
    })
}

/// Returns the plan of a run with a target that has the axes of its space, none of whose
/// simulations depends on its seed.
///
/// # Errors
/// If the header is invalid.
pub(crate) fn file_plan(header: &RunHeader) -> Result<ResolvedPlan, MishandleError> {
    let Facts { plan, space, .. } = Facts::recorded(header)?;
    let part = |name: &str| Space::new(name, space.axes().to_vec());
    let spaces = plan.space.split('+').map(part).collect::<Result<_, _>>()?;
    let is_own = |formula: &&FormulaRecord| !formula.name.starts_with(REQUIREMENT);
    let named =
        |formula: &FormulaRecord| NamedFormula { name: formula.name.clone(), text: formula.text.clone() };
    let formulas: Vec<NamedFormula> = header.formulas.iter().filter(is_own).map(named).collect();
    let parsed = |text: &str| {
        Formula::parse(text).map_err(|source| RolloutError::Parse { formula: text.to_string(), source })
    };
    let mut specification = Specification::from_formulas(&formulas, parsed(&header.formula)?)?;
    specification.success.get_or_insert_with(|| specification.requirement.clone());
    for FormulaRecord { name, text } in &header.formulas {
        if let Some(name) = name.strip_prefix(REQUIREMENT) {
            specification.others.push((name.to_string(), parsed(text)?));
        }
    }
    let signal = |signal: &SignalRecord| Signal { name: signal.name.clone(), unit: signal.unit.clone() };
    let signals: Vec<Signal> = header.signals.iter().map(signal).collect();
    let component = |component: &ComponentRecord| Component {
        role: component.role.clone(),
        name: component.name.clone(),
        hash: component.hash.clone(),
        file_hash: component.file_hash.clone(),
    };
    let steps = header.episode_steps as usize;
    let target = Target {
        identity: Identity {
            kind: header.target.kind.clone(),
            name: header.target.name.clone(),
            hash: header.target.hash.clone(),
        },
        components: header.components.iter().map(component).collect(),
        axes: space.axes().to_vec(),
        spaces,
        signals: signals.clone(),
        signals_on_request: Vec::new(),
        controller_signals: Vec::new(),
        formulas,
        control_dt: header.control_dt,
        episode_steps: steps,
        is_deterministic: header.target.is_deterministic,
        can_fail: true,
        depends_on_seed: false,
        random_axes: Vec::new(),
        versions: header.versions.clone(),
        reachable: reachable_starts(&plan),
        factory: Arc::new(|_: &Space, _: &Specification| Err(RolloutError::Ended)),
        solver_variants: Vec::new(),
    };
    let parts = specification.decomposition(target.control_dt, steps + 1)?;
    let search_space = search_space(&space, &parts, steps);
    let stored_parts = header.verdicts.iter().filter(|name| name.starts_with(PART)).count();
    Ok(ResolvedPlan { plan, target, space, specification, signals, stored_parts, search_space })
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use mishandle_results::Answer;
    use mishandle_store::RunFile;

    use super::*;
    use crate::run::{Engine, ask, create_run, recorded_answer};

    /// Leaves out what only the target knows.
    fn known(answer: Answer) -> Answer {
        match answer {
            Answer::Margin(mut found) => {
                found.at_nominal.clear();
                found.subject.offered = None;
                Answer::Margin(found)
            }
            Answer::Risk(mut found) => {
                found.seed_is_random = false;
                found.subject.offered = None;
                Answer::Risk(found)
            }
            Answer::Metamorphic(mut found) => {
                found.is_random = false;
                found.subject.offered = None;
                Answer::Metamorphic(found)
            }
            other => other,
        }
    }

    #[test]
    fn the_file_alone_gives_the_answer_of_the_target() {
        let folder = tempfile::tempdir().unwrap();
        let relation = "[metamorphic]\npairs = 20\n[metamorphic.relations.r]\n";
        let questions = [
            "[margin]\nbudget = 60".to_string(),
            "[risk]\nsimulations = 400".to_string(),
            "[risk]\nsimulations = 3000\nmethod = 'splitting'".to_string(),
            format!("{relation}change = {{ x = '+0.05' }}"),
        ];
        let mut answers = 0;
        for target in ["toy/sphere-2d", "toy/noisy"] {
            for (number, question) in questions.iter().enumerate() {
                let path = folder.path().join(format!("{}-{number}.sqlite", target.replace('/', "-")));
                let plan = Plan::from_toml(&format!("target = '{target}'\nseed = 3\n{question}")).unwrap();
                let Ok(resolved) = ResolvedPlan::new(&plan) else { continue };
                let Ok(run) = create_run(&resolved, Some(&path)) else { continue };
                ask(&resolved, run, Engine::Direct, &mut |_| ControlFlow::Continue(())).unwrap();
                let run = RunFile::open(&path).unwrap();
                let expected = recorded_answer(&run, Some(&resolved)).unwrap();
                let found = recorded_answer(&run, None).unwrap();
                assert_eq!(known(found), known(expected), "{target}: {question}");
                answers += 1;
            }
        }
        assert!(answers >= 6, "{answers}");
    }
}
