//! The header of a run file: what its plan, its target and this build are.

use mishandle_rollout::{Axis, AxisKind, AxisValues, Condition, Holds, Space};
use mishandle_store as store;
use mishandle_store::{AxisRecord, RunHeader, TargetRecord};

use crate::build::build;
use crate::resolve::{ResolvedPlan, is_path};
use crate::run::rows::{REQUIREMENT, verdict_names};

/// Returns the header of a run.
pub(crate) fn header(resolved: &ResolvedPlan) -> RunHeader {
    let ResolvedPlan { plan, target, space, specification, signals, .. } = resolved;
    // Absolute, so that the run can be resumed and replayed from every folder.
    let mut stored = plan.with_absolute_paths();
    if let (true, Ok(path)) = (is_path(&plan.controller), std::path::absolute(&plan.controller)) {
        stored.controller = path.to_string_lossy().into_owned();
    }
    let components = target.components.iter().map(|component| store::ComponentRecord {
        role: component.role.clone(),
        name: component.name.clone(),
        hash: component.hash.clone(),
        file_hash: component.file_hash.clone(),
    });
    let formulas = target
        .formulas
        .iter()
        .filter(|formula| formula.name != "careful" || specification.careful.is_some())
        .map(|formula| store::FormulaRecord { name: formula.name.clone(), text: formula.text.clone() });
    let requirements = specification.others.iter().map(|(name, formula)| store::FormulaRecord {
        name: format!("{REQUIREMENT}{name}"),
        text: formula.to_string(),
    });
    let signals = signals
        .iter()
        .map(|signal| store::SignalRecord { name: signal.name.clone(), unit: signal.unit.clone() });
    RunHeader {
        kind: plan.kind(),
        build: build(),
        versions: target.versions.clone(),
        plan: stored.to_toml(),
        target: TargetRecord {
            kind: target.identity.kind.clone(),
            name: target.identity.name.clone(),
            hash: target.identity.hash.clone(),
            is_deterministic: target.is_deterministic,
        },
        components: components.collect(),
        space: space.name().to_string(),
        formula: specification.requirement.to_string(),
        formulas: formulas.chain(requirements).collect(),
        search: plan.falsify.as_ref().map_or(String::new(), |falsify| falsify.search.clone()),
        seed: plan.seed,
        control_dt: target.control_dt,
        episode_steps: target.episode_steps as u32,
        signals: signals.collect(),
        axes: axis_records(space),
        verdicts: verdict_names(resolved),
        preflight: vec![],
    }
}

/// Returns the axes of a space as a run file describes them.
pub(crate) fn axis_records(space: &Space) -> Vec<AxisRecord> {
    space.axes().iter().map(|each| axis(space, each)).collect()
}

fn axis(space: &Space, axis: &Axis) -> AxisRecord {
    let values = match &axis.values {
        AxisValues::Continuous => "continuous".to_string(),
        AxisValues::Logarithmic => "logarithmic".to_string(),
        AxisValues::Integer => "integer".to_string(),
        AxisValues::Categorical(names) => format!("categorical: {}", names.join(", ")),
    };
    AxisRecord {
        name: axis.name.clone(),
        unit: axis.unit.clone(),
        kind: axis.kind.name().to_string(),
        low: axis.low,
        high: axis.high,
        nominal: axis.nominal,
        values: values + &conditions_text(space, axis),
        meaning: axis.meaning.clone(),
    }
}

/// Text between the values of an axis and its conditions.
const ONLY_IF: &str = "; only if ";

/// Returns the conditions of an axis: the other axes and the numbers of their values.
fn conditions_text(space: &Space, axis: &Axis) -> String {
    let has_axis = |condition: &&Condition| space.axes().iter().any(|axis| axis.name == condition.axis);
    let text = |condition: &Condition| match &condition.holds {
        Holds::OneOf(values) => {
            let values: Vec<String> = values.iter().map(ToString::to_string).collect();
            format!("`{}` in {}", condition.axis, values.join("|"))
        }
        Holds::Except(value) => format!("`{}` not {value}", condition.axis),
    };
    // Others are constant: the space has no axis without an effect.
    let texts: Vec<String> = axis.conditions.iter().filter(has_axis).map(text).collect();
    if texts.is_empty() { String::new() } else { ONLY_IF.to_string() + &texts.join(" and ") }
}

/// Reads what [`conditions_text`] wrote.
fn recorded_conditions(text: &str) -> Vec<Condition> {
    let condition = |text: &str| {
        let (axis, holds) = text.strip_prefix('`')?.split_once("` ")?;
        let (word, values) = holds.split_once(' ')?;
        let values = values.split('|').map(|value| value.parse().ok()).collect::<Option<Vec<f64>>>()?;
        let holds = match (word, values.as_slice()) {
            ("in", values) => Holds::OneOf(values.into()),
            ("not", [value]) => Holds::Except(*value),
            _ => return None,
        };
        // Its axis is in the record, so the nominal value is not needed.
        Some(Condition { axis: axis.to_string(), nominal: 0.0, holds })
    };
    text.split(" and ").filter_map(condition).collect()
}

/// Returns the axis that a run file describes. Its kind matters for sampling and checks only, which
/// a description does not need.
pub fn recorded_axis(record: &AxisRecord) -> Axis {
    let (values, conditions) = record.values.rsplit_once(ONLY_IF).unwrap_or((&record.values, ""));
    let values = match values.split_once(": ") {
        Some(("categorical", names)) => {
            AxisValues::Categorical(names.split(", ").map(str::to_string).collect())
        }
        _ if values == "logarithmic" => AxisValues::Logarithmic,
        _ if values == "integer" => AxisValues::Integer,
        _ => AxisValues::Continuous,
    };
    let bounds = [record.low, record.high];
    let kind = AxisKind::by_name(&record.kind).unwrap_or(AxisKind::Start);
    Axis::new(kind, &record.name, &record.unit, bounds, record.nominal)
        .with_values(values)
        .only_if(recorded_conditions(conditions))
}
