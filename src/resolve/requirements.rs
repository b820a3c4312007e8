//! Several requirements by name: each has a robustness of its own, and a search tries to violate
//! any of them.

use mishandle_random::Seed;
use mishandle_rollout::{Request, RolloutError, Space, Specification, Target};
use mishandle_stl::Formula;

use crate::error::{MishandleError, invalid};
use crate::plan::Plan;
use crate::resolve::{check_decidable, requirement};

/// Returns the requirements that a plan names.
pub(super) fn named_requirements(
    plan: &Plan,
    target: &Target,
) -> Result<Vec<(String, Formula)>, MishandleError> {
    let is_name = |name: &str| {
        let mut letters = name.chars();
        letters.next().is_some_and(char::is_alphabetic)
            && letters.all(|c| c.is_alphanumeric() || "_-.".contains(c))
    };
    let mut found = Vec::new();
    for (name, text) in &plan.requirements {
        if !is_name(name) {
            let expected = "a letter, then letters, digits, `_`, `-` and `.`";
            return Err(invalid("the name of a requirement", name, expected));
        }
        let formula = requirement(text, target)?;
        check_decidable(&formula, target)?;
        found.push((name.clone(), formula));
    }
    Ok(found)
}

/// Returns the signals of a formula, or of the name of one, that a target lacks.
///
/// # Errors
/// If the text is not a formula.
pub(crate) fn missing_signals(text: &str, target: &Target) -> Result<Vec<String>, MishandleError> {
    if target.formulas.iter().any(|formula| formula.name == text) {
        return Ok(Vec::new());
    }
    let formula = Formula::parse(text).map_err(|source| {
        MishandleError::Rollout(RolloutError::Parse { formula: text.to_string(), source })
    })?;
    let is_missing = |name: &&str| target.all_signals().all(|signal| signal.name != *name);
    Ok(formula.signals().into_iter().filter(is_missing).map(String::from).collect())
}

/// Returns the formula of the question of a plan; `None` for an evaluation, which has none.
pub(super) fn table_formula(plan: &mut Plan) -> Option<&mut Option<String>> {
    let Plan { falsify, margin, metamorphic, risk, .. } = plan;
    let of_falsify = falsify.as_mut().map(|table| &mut table.formula);
    let of_margin = margin.as_mut().map(|table| &mut table.formula);
    let of_metamorphic = metamorphic.as_mut().map(|table| &mut table.formula);
    of_falsify.or(of_margin).or(of_metamorphic).or(risk.as_mut().map(|table| &mut table.formula))
}

/// Returns the formula that holds if all requirements hold. Each is divided by its robustness in
/// the nominal scenario, so that none is masked because its unit has large numbers.
///
/// # Errors
/// If the target cannot be simulated.
pub(super) fn joined(
    others: &[(String, Formula)],
    target: &Target,
    space: &Space,
) -> Result<String, MishandleError> {
    let Some((_, first)) = others.first() else { return Ok(String::new()) };
    let specification = Specification { others: others.to_vec(), ..Specification::new(first.clone()) };
    let mut system = target.system(space, &specification)?;
    // A seed of its own, as for every probe.
    let nominal = Request::new(space.nominal(), Seed(u64::MAX));
    let episodes = system.rollout(&[nominal])?;
    let scale = |index: usize| {
        let robustness =
            episodes.first().and_then(|episode| episode.verdict.others.get(index).copied().flatten());
        robustness.map(f64::abs).filter(|scale| *scale > 0.0 && scale.is_finite()).unwrap_or(1.0)
    };
    let parts: Vec<String> = others
        .iter()
        .enumerate()
        .map(|(index, (_, formula))| format!("(({formula}) / {})", scale(index)))
        .collect();
    Ok(parts.join(" and "))
}
