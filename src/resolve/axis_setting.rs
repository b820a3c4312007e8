//! Changes of single axes of a scenario space: a narrower range, or a fixed value.

use std::collections::BTreeMap;
use std::fmt::Display;

use mishandle_results::{Command, Remedy};
use mishandle_rollout::{Axis, AxisKind, AxisValues, Distribution, Interval, RolloutError, Space};
use mishandle_text::number_text;

use crate::error::{MishandleError, invalid, problem};
use crate::plan::AxisSetting;

/// Returns a space with these settings. A set axis that the space lacks is added.
///
/// The nominal value of an axis remains if it is within the new bounds. Otherwise it is the
/// midpoint for the initial state, and the nearest bound for other kinds.
///
/// # Errors
/// If no axis of `known` has a name, or a setting is outside of the bounds of its axis. The initial
/// state may be set outside.
pub fn with_settings(
    space: Space,
    settings: &BTreeMap<String, AxisSetting>,
    known: &[Axis],
) -> Result<Space, MishandleError> {
    if settings.is_empty() {
        return Ok(space);
    }
    let mut axes = space.axes().to_vec();
    for (name, setting) in settings {
        let axis =
            known.iter().find(|axis| axis.name == *name).ok_or_else(|| MishandleError::UnknownName {
                kind: "axis",
                name: name.clone(),
                known: known.iter().map(|axis| axis.name.clone()).collect(),
            })?;
        let axis = restricted(axis, setting)?;
        match axes.iter_mut().find(|other| other.name == *name) {
            Some(other) => *other = axis,
            None => axes.push(axis),
        }
    }
    let space = without_idle(Space::new(space.name(), axes)?, settings)?;
    if space.axes().iter().all(Axis::is_fixed) {
        let what = "the number of axes without a fixed value";
        let expected = "at least 1";
        let at = space.axes().iter().map(|axis| (axis.name.clone(), value_text(axis))).collect();
        let simulate = Remedy::Run(Command::Simulate { at }).when("one scenario is meant");
        return Err(invalid(what, "0", expected).with(simulate));
    }
    Ok(space)
}

/// Returns the value of a fixed axis as the user states it.
fn value_text(axis: &Axis) -> String {
    match &axis.values {
        AxisValues::Categorical(names) => names[axis.low as usize].clone(),
        _ => number_text(axis.low),
    }
}

/// Returns the space without the axes that have no effect, because others are fixed.
fn without_idle(space: Space, settings: &BTreeMap<String, AxisSetting>) -> Result<Space, MishandleError> {
    let idle = space.idle_axes();
    if idle.is_empty() {
        return Ok(space);
    }
    let axes = space.axes();
    if let Some(axis) = idle.iter().map(|index| &axes[*index]).find(|axis| settings.contains_key(&axis.name))
    {
        let needed: Vec<String> = axis.conditions.iter().map(|needed| needed.axis.clone()).collect();
        return Err(problem(format!(
            "the axis {} has no effect: set {} so that it has one",
            axis.name,
            needed.join(" and ")
        )));
    }
    let kept = axes.iter().enumerate().filter(|(index, _)| !idle.contains(index));
    Ok(Space::new(space.name(), kept.map(|(_, axis)| axis.clone()).collect())?)
}

fn restricted(axis: &Axis, setting: &AxisSetting) -> Result<Axis, MishandleError> {
    let [low, high] = match setting {
        AxisSetting::Value(value) => [*value; 2],
        AxisSetting::Range(range) => *range,
        AxisSetting::Text(text) => {
            let AxisValues::Categorical(names) = &axis.values else {
                return restricted(axis, &AxisSetting::Range(interval(axis, text)?));
            };
            let index = names.iter().position(|known| known == text);
            let index = index.ok_or_else(|| MishandleError::UnknownName {
                kind: "category",
                name: text.clone(),
                known: names.to_vec(),
            })?;
            [axis.low + index as f64; 2]
        }
    };
    if low > high || !low.is_finite() || !high.is_finite() {
        return Err(RolloutError::Bounds { axis: axis.name.clone(), low, high }.into());
    }
    let outside = [low, high].into_iter().find(|value| !axis.accepts(*value));
    if let Some(value) = outside {
        return Err(not_of(axis, number_text(value), &values_text(axis)));
    }
    let nominal = axis.nominal.map(|nominal| match axis.kind {
        AxisKind::Start if !(low..=high).contains(&nominal) => f64::midpoint(low, high),
        _ => nominal.clamp(low, high),
    });
    let values = match &axis.values {
        // The first name is that of the lower bound.
        AxisValues::Categorical(names) => {
            let first = (low - axis.low) as usize;
            let last = (high - axis.low) as usize;
            AxisValues::Categorical(names[first..=last].into())
        }
        other => other.clone(),
    };
    // The part of the former bounds that was drawn is another part of these.
    let distribution = match axis.distribution {
        Distribution::Upper(_) => Distribution::Uniform,
        other => other,
    };
    Ok(Axis { low, high, nominal, values, distribution, ..axis.clone() })
}

/// Returns the bounds of an interval with an open end, for an axis of real numbers.
fn interval(axis: &Axis, text: &str) -> Result<[f64; 2], MishandleError> {
    let number = text.replace(',', ".");
    let written = match (text.parse::<Interval>(), number.parse::<f64>()) {
        (Ok(Interval { low, high }), _) if axis.levels().is_none() => return Ok([low, high]),
        (Ok(_), _) => ", which needs no open end".to_string(),
        (_, Ok(found)) if found.is_finite() => format!(", written {number}"),
        _ => String::new(),
    };
    Err(not_of(axis, text, &(values_text(axis) + &written)))
}

fn not_of(axis: &Axis, setting: impl Display, expected: &str) -> MishandleError {
    problem(format!("the axis {} cannot be {setting}: expected {expected}", axis.name))
}

/// Describes the values that an axis may be set to.
fn values_text(axis: &Axis) -> String {
    let [low, high] = [axis.low, axis.high].map(number_text);
    match (&axis.values, axis.kind) {
        (AxisValues::Categorical(names), _) => {
            format!("one of the categories {}", names.join(", "))
        }
        (AxisValues::Integer, _) => format!("a whole number from {low} to {high}"),
        (_, AxisKind::Start) => "a number".to_string(),
        _ => format!("a number from {low} to {high}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known() -> Vec<Axis> {
        let surfaces = ["wood", "ice"].map(String::from).to_vec();
        vec![
            Axis::start("x", "m", 0.0, 1.0),
            Axis::new(AxisKind::Model, "delay", "steps", [0.0, 3.0], Some(0.0))
                .with_values(AxisValues::Integer),
            Axis::new(AxisKind::Model, "surface", "", [0.0, 1.0], Some(0.0))
                .with_values(AxisValues::Categorical(surfaces.into())),
            Axis::new(AxisKind::Noise, "draw", "", [-4.0, 4.0], None),
            Axis::new(AxisKind::Model, "gain", "", [0.0, 0.5], Some(0.0)),
        ]
    }

    fn set(settings: &[(&str, AxisSetting)]) -> Result<Space, MishandleError> {
        let settings = settings.iter().map(|(name, setting)| ((*name).to_string(), setting.clone()));
        with_settings(Space::new("starts", known()[..1].to_vec()).unwrap(), &settings.collect(), &known())
    }

    #[test]
    fn axes_are_narrowed_fixed_and_added() {
        let space = set(&[
            ("x", AxisSetting::Range([0.75, 1.0])),
            ("delay", AxisSetting::Value(2.0)),
            ("draw", AxisSetting::Value(0.5)),
            ("surface", AxisSetting::Text("ice".to_string())),
        ])
        .unwrap();
        let found: Vec<_> =
            space.axes().iter().map(|axis| (axis.name.as_str(), axis.low, axis.high, axis.nominal)).collect();
        let expected = [
            ("x", 0.75, 1.0, Some(0.875)),
            ("delay", 2.0, 2.0, Some(2.0)),
            ("draw", 0.5, 0.5, None),
            ("surface", 1.0, 1.0, Some(1.0)),
        ];
        assert_eq!(found, expected);
        assert_eq!(space.name(), "starts");
        let AxisValues::Categorical(names) = &space.axes()[3].values else { panic!("no category") };
        assert_eq!(names[..], ["ice"], "the first name is that of the lower bound");
        // The start may be outside of its box; the midpoint stays nominal if it is inside.
        let wider = set(&[("x", AxisSetting::Range([-1.0, 2.0]))]).unwrap();
        assert_eq!((wider.axes()[0].low, wider.axes()[0].nominal), (-1.0, Some(0.5)));
    }

    #[test]
    fn an_axis_without_an_effect_is_left_out_and_cannot_be_set() {
        let target = crate::resolve::target(&crate::plan::Plan::new("ball-balancing", "ppo")).unwrap();
        let of = |settings: &[(&str, AxisSetting)]| {
            let settings =
                settings.iter().map(|(name, setting)| ((*name).to_string(), setting.clone())).collect();
            with_settings(target.space("faults-sensing").unwrap(), &settings, &target.axes)
        };
        let category = |name: &str| AxisSetting::Text(name.to_string());
        let space = of(&[("sensor_fault", category("bias"))]).unwrap();
        let names: Vec<&str> = space.axes().iter().map(|axis| axis.name.as_str()).collect();
        let expected = ["", "_channel", "_onset", "_duration", "_recovery", "_offset"];
        assert_eq!(names, expected.map(|suffix| format!("sensor_fault{suffix}")));
        let freeze = [("sensor_fault", category("freeze")), ("sensor_fault_offset", AxisSetting::Value(0.1))];
        let error = of(&freeze).unwrap_err().to_string();
        assert!(error.contains("sensor_fault_offset has no effect: set sensor_fault_duration"), "{error}");
        let error = of(&[("sensor_fault", category("none"))]).unwrap_err().to_string();
        assert!(error.contains("at least 1"), "{error}");
    }

    #[test]
    fn an_open_end_is_no_value_of_the_axis() {
        let text = |text: &str| AxisSetting::Text(text.to_string());
        let space = set(&[("x", text("[0.25, 1)")), ("gain", text("(0, 0.5]"))]).unwrap();
        let bounds: Vec<[f64; 2]> = space.axes().iter().map(|axis| [axis.low, axis.high]).collect();
        assert_eq!(bounds, [[0.25, 1.0_f64.next_down()], [0.0_f64.next_up(), 0.5]]);
        for u in [0.0, 0.5, 1.0] {
            let scenario = space.at(&[u; 2]);
            assert!(scenario.get(0) < Some(1.0) && scenario.get(1) > Some(0.0), "{scenario:?}");
            space.check(&scenario).unwrap();
        }
        let error = set(&[("delay", text("[0, 2)"))]).unwrap_err().to_string();
        assert!(error.contains("a whole number from 0 to 3, which needs no open end"), "{error}");
        let error = set(&[("gain", text("[0, 0.6)"))]).unwrap_err().to_string();
        assert!(error.contains("expected a number from 0 to 0.5"), "{error}");
    }

    #[test]
    fn settings_survive_a_round_trip_through_toml() {
        let category = AxisSetting::Text("ice".to_string());
        let axes =
            [("x", AxisSetting::Range([0.1, 1e-9])), ("delay", AxisSetting::Value(2.0)), ("s", category)];
        let axes = axes.into_iter().map(|(name, setting)| (name.to_string(), setting)).collect();
        let plan = crate::plan::Plan { axes, ..crate::plan::Plan::new("toy/sphere-2d", "") };
        assert_eq!(crate::plan::Plan::from_toml(&plan.to_toml()).unwrap(), plan);
    }

    #[test]
    fn impossible_settings_are_errors() {
        let range = |low, high| AxisSetting::Range([low, high]);
        for (name, setting, part) in [
            ("delai", AxisSetting::Value(1.0), "delai"),
            ("delay", AxisSetting::Value(4.0), "delay cannot be 4: expected a whole number from 0 to 3"),
            ("delay", range(0.5, 2.0), "delay"),
            ("x", range(0.5, 0.2), "from 0.5 to 0.2"),
            ("x", range(0.5, f64::NAN), "from 0.5 to NaN"),
            ("gain", AxisSetting::Value(2.0), "gain cannot be 2: expected a number from 0 to 0.5"),
            ("x", AxisSetting::Text("0,01".to_string()), "x cannot be 0,01: expected a number, written 0.01"),
            ("surface", range(0.0, 3.0), "surface cannot be 3: expected one of the categories wood, ice"),
            ("surface", AxisSetting::Text("sand".to_string()), "sand"),
            ("x", AxisSetting::Value(0.5), "without a fixed value"),
        ] {
            let error = set(&[(name, setting)]).unwrap_err();
            assert!(error.to_string().contains(part), "{name}: {error}");
        }
    }
}
