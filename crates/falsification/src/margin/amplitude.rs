//! Disturbances up to an amplitude: the scenarios that they reach, and their norms.

use mishandle_rollout::{Axis, AxisKind, AxisValues, Scenario, Space};

use super::Norms;

/// The bisection of the amplitude ends at an interval of this length.
const RESOLUTION: f64 = 0.01;

/// Amplitudes that differ by less have the same whole steps: 2/3 of 3 steps are 2, whatever the
/// rounding.
const TOLERANCE: f64 = 1e-9;

/// Returns whether the amplitude limits an axis.
pub(super) fn is_disturbed(axis: &Axis) -> bool {
    let is_ordered = !matches!(axis.values, AxisValues::Categorical(_));
    !varies_freely(axis) && axis.nominal.is_some() && !axis.is_fixed() && is_ordered
}

/// Returns whether an axis varies in its whole range at any amplitude: the initial state, times of
/// events, since an event disturbs by its magnitude, and onsets of faults, which disturb by their
/// durations and magnitudes.
pub(super) fn varies_freely(axis: &Axis) -> bool {
    axis.kind == AxisKind::Start || is_time(axis)
}

pub(super) fn is_time(axis: &Axis) -> bool {
    axis.unit == "s" && (axis.kind == AxisKind::Event || axis.is_onset())
}

/// Returns the norms of the disturbance of a scenario: those of the offsets of the axes that
/// [`margin`](super::margin) disturbs.
pub fn norms(space: &Space, scenario: &Scenario) -> Norms {
    offsets(space, scenario).fold(Norms::default(), |norms, offset| Norms {
        amplitude: norms.amplitude.max(offset),
        l2: norms.l2.hypot(offset),
        l1: norms.l1 + offset,
    })
}

/// Returns how far a scenario is from nominal: the sum of the offsets of all its axes, those of the
/// initial state too. Categories are not far from each other.
pub fn distance(space: &Space, scenario: &Scenario) -> f64 {
    let is_ordered = |axis: &Axis| !matches!(axis.values, AxisValues::Categorical(_));
    offsets_of(space, scenario, is_ordered).sum()
}

/// Returns the offsets of the disturbed axes, each from 0 to 1.
pub(super) fn offsets<'a>(space: &'a Space, scenario: &'a Scenario) -> impl Iterator<Item = f64> + 'a {
    offsets_of(space, scenario, is_disturbed)
}

/// Returns the offsets of some axes, each from 0 to 1 within the bounds of its axis.
fn offsets_of<'a>(
    space: &'a Space,
    scenario: &'a Scenario,
    is_asked: impl Fn(&Axis) -> bool + 'a,
) -> impl Iterator<Item = f64> + 'a {
    let pairs = space.axes().iter().zip(scenario.values()).filter(move |(axis, _)| is_asked(axis));
    pairs.filter_map(|(axis, value)| {
        let nominal = axis.unit_coordinate(axis.nominal?);
        let value = axis.unit_coordinate((*value)?);
        let room = if value < nominal { nominal - lowest(axis) } else { 1.0 - lowest(axis) - nominal };
        // An initial state may be where the range ends, or beyond.
        let room = if room > 0.0 { room } else { 1.0 };
        Some(if value == nominal { 0.0 } else { (value - nominal).abs() / room })
    })
}

/// Returns the unit coordinate of the lower bound: half a level for a discrete axis. The upper
/// bound is at 1 minus that.
fn lowest(axis: &Axis) -> f64 {
    axis.unit_coordinate(axis.low)
}

/// Returns the number of whole steps from the nominal value that an amplitude allows, of `room`
/// steps up to the bound.
fn whole_steps(amplitude: f64, room: f64) -> f64 {
    (amplitude * room + TOLERANCE).floor()
}

/// Returns the lowest and the highest value of a discrete disturbed axis at an amplitude.
fn discrete_range(axis: &Axis, nominal: f64, amplitude: f64) -> [f64; 2] {
    let [down, up] = [nominal - axis.low, axis.high - nominal].map(|room| whole_steps(amplitude, room));
    [nominal - down, nominal + up]
}

/// Returns the next amplitude of the bisection between one without a violation and one with a
/// violation; `None` at its end.
///
/// It is their midpoint. If all disturbed axes are discrete, most amplitudes have the same
/// scenarios: then it is the amplitude of the largest offset up to the midpoint, or else of the
/// smallest one above `passes`.
pub(super) fn between(space: &Space, passes: f64, fails: f64) -> Option<f64> {
    if fails - passes <= RESOLUTION {
        return None;
    }
    let middle = f64::midpoint(passes, fails);
    if !steps_only(space) {
        return Some(middle);
    }
    let below = rooms(space).map(|room| whole_steps(middle, room) / room).fold(0.0, f64::max);
    let above =
        rooms(space).map(|room| (whole_steps(passes, room) + 1.0) / room).fold(f64::INFINITY, f64::min);
    let amplitude = if below > passes + TOLERANCE { below } else { above };
    (amplitude < fails - TOLERANCE).then_some(amplitude)
}

/// Returns whether all disturbed axes are discrete.
pub(super) fn steps_only(space: &Space) -> bool {
    space.axes().iter().filter(|axis| is_disturbed(axis)).all(|axis| axis.levels().is_some())
}

/// Returns the amplitude that is the fraction `step` below that of a violation; `None` if there are
/// no smaller disturbances. If all disturbed axes are discrete, it is the amplitude of the largest
/// offset below `fails`.
pub(super) fn below(space: &Space, fails: f64, step: f64) -> Option<f64> {
    let has_free = space.axes().iter().any(|axis| varies_freely(axis) && !axis.is_fixed());
    if fails <= 0.0 {
        return None;
    }
    if !steps_only(space) {
        let amplitude = if fails <= RESOLUTION { 0.0 } else { fails - (step * fails).max(RESOLUTION / 2.0) };
        return (amplitude > 0.0 || has_free).then_some(amplitude);
    }
    let smaller = rooms(space).map(|room| ((fails * room - TOLERANCE).ceil() - 1.0) / room);
    Some(smaller.fold(0.0, f64::max))
}

/// Returns the numbers of steps from the nominal value to a bound, of all discrete disturbed axes.
fn rooms(space: &Space) -> impl Iterator<Item = f64> {
    let disturbed = space.axes().iter().filter(|axis| is_disturbed(axis) && axis.levels().is_some());
    let of = |axis: &Axis| axis.nominal.map_or([0.0; 2], |x| [x - axis.low, axis.high - x]);
    disturbed.flat_map(of).filter(|room| *room > 0.0)
}

/// Returns the point of the unit cube whose scenario at an amplitude is nearest to a scenario: the
/// inverse of [`scenario_at`] if no offset is larger.
pub(super) fn relative(space: &Space, scenario: &Scenario, amplitude: f64) -> Vec<f64> {
    let coordinate = |(axis, value): (&Axis, &Option<f64>)| match (*value, axis.nominal) {
        (Some(value), Some(nominal)) if is_disturbed(axis) => {
            if axis.levels().is_some() {
                let [low, high] = discrete_range(axis, nominal, amplitude);
                return ((value - low + 0.5) / (high - low + 1.0)).clamp(0.0, 1.0);
            }
            let center = axis.unit_coordinate(nominal);
            let u = axis.unit_coordinate(value);
            let room = if u < center { center - lowest(axis) } else { 1.0 - lowest(axis) - center };
            let side = if u == center { 0.0 } else { (u - center) / room / amplitude };
            0.5 + 0.5 * side.clamp(-1.0, 1.0)
        }
        (Some(value), _) => axis.unit_coordinate(value).clamp(0.0, 1.0),
        (None, _) => 0.5,
    };
    space.axes().iter().zip(scenario.values()).map(coordinate).collect()
}

/// Returns the scenario at a point of the unit cube: disturbed axes are scaled to the amplitude.
pub(super) fn scenario_at(space: &Space, u: &[f64], amplitude: f64) -> Scenario {
    let value = |(axis, u): (&Axis, &f64)| match axis.nominal {
        _ if axis.is_fixed() => Some(axis.low),
        None => None,
        Some(nominal) if is_disturbed(axis) => Some(at_amplitude(axis, nominal, *u, amplitude)),
        Some(_) if varies_freely(axis) => Some(axis.at(*u)),
        nominal => nominal,
    };
    space.canonical(Scenario::new(space.axes().iter().zip(u).map(value).collect()))
}

/// Returns the value of a disturbed axis at `u` of \[0, 1\]. At 0 and 1 it is the fraction
/// `amplitude` of the way to the lower and the upper bound. A continuous axis is nominal at 0.5,
/// the values of a discrete one have equal parts of \[0, 1\].
fn at_amplitude(axis: &Axis, nominal: f64, u: f64, amplitude: f64) -> f64 {
    if axis.levels().is_some() {
        let [low, high] = discrete_range(axis, nominal, amplitude);
        return low + (u * (high - low + 1.0)).floor().min(high - low);
    }
    let center = axis.unit_coordinate(nominal);
    let low = lowest(axis);
    let side = amplitude * (2.0 * u - 1.0);
    let room = if side < 0.0 { center - low } else { 1.0 - low - center };
    if side == 0.0 || room == 0.0 { nominal } else { axis.at(center + side * room) }
}

/// Moves the disturbed axes of a scenario toward nominal, so that the largest offset is the
/// amplitude.
pub(super) fn scaled(space: &Space, scenario: &Scenario, amplitude: f64) -> Scenario {
    let factor = (amplitude / norms(space, scenario).amplitude).min(1.0);
    let value = |(axis, value): (&Axis, &Option<f64>)| match (*value, axis.nominal) {
        (Some(value), Some(nominal)) if is_disturbed(axis) && value != nominal => {
            let from = axis.unit_coordinate(nominal);
            let to = axis.unit_coordinate(value);
            let offset: f64 = value - nominal;
            Some(match axis.levels() {
                Some(_) => nominal + whole_steps(factor, offset.abs()).copysign(offset),
                None => axis.at(from + factor * (to - from)),
            })
        }
        (value, _) => value,
    };
    space.canonical(Scenario::new(space.axes().iter().zip(scenario.values()).map(value).collect()))
}

/// Returns all scenarios up to an amplitude, if there are at most `limit`.
pub(super) fn all_scenarios(space: &Space, amplitude: f64, limit: u64) -> Option<Vec<Scenario>> {
    let range = |axis: &Axis| match axis.nominal {
        _ if axis.is_fixed() => Some([axis.low; 2]),
        Some(nominal) if is_disturbed(axis) => {
            axis.levels().map(|_| discrete_range(axis, nominal, amplitude))
        }
        Some(_) if varies_freely(axis) => axis.levels().map(|_| [axis.low, axis.high]),
        nominal => nominal.map(|nominal| [nominal; 2]),
    };
    let is_drawn = |axis: &Axis| axis.nominal.is_none() && !axis.is_fixed();
    let count = |axis: &Axis| match range(axis) {
        _ if is_drawn(axis) => 1.0,
        Some([low, high]) => high - low + 1.0,
        None => f64::INFINITY,
    };
    if space.axes().iter().map(count).product::<f64>() > limit as f64 {
        return None;
    }
    let mut all: Vec<Vec<Option<f64>>> = vec![Vec::new()];
    for axis in space.axes() {
        let values: Vec<Option<f64>> = match range(axis) {
            Some([low, _]) => (0..count(axis) as u64).map(|step| Some(low + step as f64)).collect(),
            None => vec![None],
        };
        let extended = |begin: &Vec<Option<f64>>| {
            values.iter().map(|value| [begin.as_slice(), &[*value]].concat()).collect::<Vec<_>>()
        };
        all = all.iter().flat_map(extended).collect();
    }
    let mut scenarios: Vec<Scenario> = Vec::with_capacity(all.len());
    for scenario in all.into_iter().map(|values| space.canonical(Scenario::new(values))) {
        if !scenarios.iter().any(|known| known.is_same(&scenario)) {
            scenarios.push(scenario);
        }
    }
    Some(scenarios)
}
