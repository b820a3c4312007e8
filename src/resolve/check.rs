//! Checks the tables of a plan against target and space.

use std::ops::RangeInclusive;

use mishandle_results::{Choice, Key, Remedy};
use mishandle_risk::Scenarios;
use mishandle_rollout::{Axis, AxisKind, Seed, Space, Target};

use crate::error::{MishandleError, invalid, unsupported};
use crate::plan::{
    ComparePlan, EvaluatePlan, FalsifyPlan, Measure, MetamorphicPlan, Plan, RiskPlan, StartRegion, Until,
};
use crate::resolve::search::{coordinates, new_search};
use crate::resolve::{MetamorphicCases, search_entry};

/// Checks the evaluation settings of a plan against its target and space.
pub(super) fn check_evaluate_in(
    evaluate: &EvaluatePlan,
    target: &Target,
    space: &Space,
) -> Result<(), MishandleError> {
    check_evaluate(evaluate)?;
    if evaluate.starts == StartRegion::Reachable {
        let option = "`evaluate.box = \"reachable\"`";
        target.reachable.as_ref().ok_or_else(|| unsupported(&target.identity.name, option))?;
        if space.axes().iter().all(|axis| axis.kind != AxisKind::Start) {
            let expected =
                "a space that contains `starts`, because the box `reachable` restricts the initial state";
            return Err(invalid("the space", space.name(), expected));
        }
    }
    Ok(())
}

/// Checks the numbers of the evaluation settings of a plan.
///
/// # Errors
/// If the number of episodes or the batch size is out of its range.
pub fn check_evaluate(evaluate: &EvaluatePlan) -> Result<(), MishandleError> {
    check_batch(evaluate.batch)?;
    check_rate(evaluate)?;
    if Plan::EPISODES.contains(&evaluate.episodes) {
        return Ok(());
    }
    let what = "the number of episodes";
    let expected = "from 1 to 1000000000";
    Err(invalid(what, evaluate.episodes, expected))
}

/// Checks the rule that ends an evaluation.
fn check_rate(evaluate: &EvaluatePlan) -> Result<(), MishandleError> {
    let expected = match (evaluate.until, evaluate.rate) {
        (Some(Until::Decided), None) => {
            let expected = "a number above 0 and below 1, because `decided` decides on which side of it the success rate is";
            return Err(
                invalid("the rate", "missing", expected).with(Remedy::set(Key::RATE, Choice::Shape("0.95")))
            );
        }
        (Some(Until::Decided), Some(rate)) if rate <= 0.0 || rate >= 1.0 || rate.is_nan() => {
            "a number above 0 and below 1"
        }
        (Some(Until::Width(_)) | None, Some(_)) => {
            "left out, because only `until = \"decided\"` decides about it"
        }
        (Some(Until::Width(width)), None) if width >= 1.0 => {
            let expected = "below 1, because a rate is from 0 to 1";
            return Err(invalid("the width", width, expected));
        }
        _ => return Ok(()),
    };
    let value = evaluate.rate.map_or("missing".to_string(), |rate| rate.to_string());
    Err(invalid("the rate", value, expected))
}

/// Checks the settings of a comparison that stops by itself.
///
/// # Errors
/// If the margin or the bounds of the robustness are missing, superfluous or not possible.
pub fn check_compare(compare: &ComparePlan) -> Result<(), MishandleError> {
    let refused = |what, value, expected: &'static str| Err(invalid(what, value, expected));
    if let Some([low, high]) = compare.robustness_bounds {
        let value = format!("{low}:{high}");
        if compare.measure == Measure::Success {
            let expected =
                "left out, because the rule watches the success rates (`compare.measure = \"robustness\"`)";
            return refused("the setting robustness-bounds", value, expected);
        }
        if !low.is_finite() || !high.is_finite() || low >= high {
            return refused(
                "the setting robustness-bounds",
                value,
                "two finite numbers, the smaller one first",
            );
        }
        if !(2.0 * (high - low)).is_finite() {
            return refused("the setting robustness-bounds", value, "a range whose double is finite");
        }
        if let Until::Width(width) = compare.until
            && width >= 2.0 * (high - low)
        {
            let expected = "below twice the range of the robustness bounds, which is the widest interval";
            return refused("the width", width.to_string(), expected);
        }
    } else if compare.measure == Measure::Robustness {
        let expected = "given (`compare.robustness-bounds = [LOW, HIGH]`; values beyond count as the bound), because without bounds \
                        no interval of a mean holds at any time: a rare value can move the mean anywhere";
        return refused("the setting robustness-bounds", "missing".to_string(), expected);
    }
    match (compare.margin, compare.until) {
        (None, Until::Width(width)) if compare.measure == Measure::Success && width >= 2.0 => {
            refused("the width", width.to_string(), "below 2, because a difference of rates is from -1 to 1")
        }
        (Some(margin), Until::Width(_)) => {
            let expected = "left out, because only `decided` needs it";
            refused("the margin", margin.to_string(), expected)
        }
        (Some(margin), _) if !(margin > 0.0 && margin.is_finite()) => {
            refused("the margin", margin.to_string(), "a number above 0")
        }
        (Some(margin), _) if compare.measure == Measure::Success && margin >= 1.0 => {
            refused("the margin", margin.to_string(), "below 1, because it is a difference of rates")
        }
        _ => Ok(()),
    }
}

/// Checks a batch size.
fn check_batch(batch: u32) -> Result<(), MishandleError> {
    if Plan::BATCH.contains(&batch.into()) {
        return Ok(());
    }
    let what = "the batch size";
    let expected = "from 1 to 65536";
    Err(invalid(what, batch, expected))
}

/// Checks the falsification settings of a plan against its space.
///
/// # Errors
/// If a number is out of its range, or the search or one of its options is unknown or invalid.
pub fn check_falsify(falsify: &FalsifyPlan, space: &Space) -> Result<(), MishandleError> {
    check_batch(falsify.batch)?;
    let numbers = [
        ("the number of trials", falsify.trials, Plan::TRIALS),
        ("the budget", falsify.budget, Plan::BUDGET),
    ];
    let is_outside = |(_, value, range): &(_, u32, RangeInclusive<u64>)| !range.contains(&(*value).into());
    if let Some((what, value, _)) = numbers.into_iter().find(is_outside) {
        let expected = "from 1 to 1000000";
        return Err(invalid(what, value, expected));
    }
    if !(0.0..1.0).contains(&falsify.new_mode_rate) {
        let what = "the rate of new failure modes";
        let expected = "from 0 to less than 1";
        return Err(invalid(what, falsify.new_mode_rate, expected));
    }
    search_entry(&falsify.search)?;
    new_search(falsify, &coordinates(space))(0)?;
    Ok(())
}

/// Checks the relations of a plan. `sources` is the space of the source cases and `known` the axes
/// of the target.
///
/// # Errors
/// If a number is out of its range, the name of an axis is unknown, or a relation cannot be tested.
pub fn check_metamorphic(
    table: &MetamorphicPlan,
    sources: Space,
    known: &[Axis],
    seed: u64,
) -> Result<(), MishandleError> {
    check_batch(table.batch)?;
    MetamorphicCases::new(table, sources, known, Seed(seed))?.check()
}

/// Checks the settings of an estimation against its space.
///
/// # Errors
/// If a number is out of its range, or the method, an axis or a distribution is unknown.
pub fn check_risk(risk: &RiskPlan, space: &Space) -> Result<(), MishandleError> {
    check_batch(risk.batch)?;
    risk.method()?;
    if !RiskPlan::SIMULATIONS.contains(&risk.simulations) {
        let what = "the number of simulations";
        let expected = "from 100 to 1000000000";
        return Err(invalid(what, risk.simulations, expected));
    }
    Scenarios::new(space, &risk.marginals(1.0)?, true)?;
    Ok(())
}
