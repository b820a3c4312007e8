//! The disturbances that lie between any environment and its controller: delays, errors of sensors
//! and faults. They follow from the names and units of the observation and the action.

use crate::fault::{Channel, FaultSite, Side};
use crate::{Axis, AxisKind, Disturbance, Effect, TimeProfile, delays};

/// Numbers of an observation or action that have one name and unit.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopPart {
    /// Name.
    pub name: String,
    /// Unit; empty for dimensionless numbers.
    pub unit: String,
    /// How many numbers it has.
    pub size: usize,
    /// Range of each number, in which faults are measured; `None` if it follows from the unit.
    pub range: Option<[f64; 2]>,
}

/// The loop of an environment and its controller.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlLoop {
    /// Parts of the observation, in order.
    pub observation: Vec<LoopPart>,
    /// Parts of the action, in order.
    pub action: Vec<LoopPart>,
    /// Largest absolute value of an action.
    pub action_limit: f64,
    /// Duration of a control step, s.
    pub control_dt: f64,
    /// Number of control steps of an episode.
    pub episode_steps: usize,
}

impl ControlLoop {
    /// Returns the lengths of an observation and an action.
    pub fn sizes(&self) -> [usize; 2] {
        [&self.observation, &self.action].map(|parts| parts.iter().map(|part| part.size).sum())
    }

    /// Returns all delays, errors of sensors and faults.
    pub fn disturbances(&self) -> Vec<Disturbance> {
        delays().into_iter().chain(self.sensing(|_, _| true)).chain(self.faults()).collect()
    }

    /// Returns a bias of each number of the observation, and white noise of each part. `has` says
    /// whether a part has the bias (`false`) or the noise (`true`).
    pub fn sensing(&self, has: impl Fn(&LoopPart, bool) -> bool) -> Vec<Disturbance> {
        let mut all = Vec::new();
        let mut first = 0;
        for part in &self.observation {
            let [bias, noise] = sensor_errors(&part.unit);
            let entries = first..first + part.size;
            let model = |name: String, bounds, meaning: String| {
                Axis::new(AxisKind::Model, &name, &part.unit, bounds, Some(0.0)).meaning(&meaning)
            };
            if has(part, false) {
                all.extend(entries.clone().map(|entry| {
                    let number =
                        if part.size == 1 { String::new() } else { format!("_{}", entry - first + 1) };
                    let name = format!("{}{number}", part.name);
                    let meaning = format!("constant bias of the observed {name}");
                    let axis = model(format!("bias_{name}"), [-bias, bias], meaning);
                    let profile = TimeProfile::Constant(0..self.episode_steps + 1);
                    Disturbance { axis, effect: Effect::Observation { entry, factor: 1.0, profile } }
                }));
            }
            if has(part, true) {
                let name = &part.name;
                let meaning = format!("standard deviation of white noise on the observed {name}");
                let axis = model(format!("noise_{name}"), [0.0, noise], meaning);
                let entries = entries.map(|entry| (entry, 1.0)).collect();
                all.push(Disturbance { axis, effect: Effect::ObservationNoise { entries } });
            }
            first += part.size;
        }
        all
    }

    /// Returns the faults of the observation and of the action.
    pub fn faults(&self) -> Vec<Disturbance> {
        let ranges = self.observation.iter().flat_map(|part| {
            let largest = largest(&part.unit);
            vec![part.range.unwrap_or([-largest, largest]); part.size]
        });
        let limit = if self.action_limit.is_finite() { self.action_limit } else { 1.0 };
        let actions = self.action.iter().map(|part| part.size).sum();
        let site = |side, name: &str, parts: &[LoopPart], ranges| FaultSite {
            side,
            name: name.to_string(),
            number: 0,
            channels: channels(parts),
            ranges,
            has_numbers: true,
            control_dt: self.control_dt,
            episode_steps: self.episode_steps,
        };
        let sites = [
            site(Side::Sensing, "sensor_fault", &self.observation, ranges.collect()),
            site(Side::Actuation, "actuator_fault", &self.action, vec![[-limit, limit]; actions]),
        ];
        sites.into_iter().flat_map(FaultSite::disturbances).collect()
    }
}

fn channels(parts: &[LoopPart]) -> Vec<Channel> {
    let mut first = 0;
    let channel = |part: &LoopPart| {
        let entries = (first..first + part.size).collect();
        first += part.size;
        Channel { name: part.name.clone(), entries }
    };
    parts.iter().map(channel).collect()
}

/// The spaces of a control loop.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopSpaces {
    /// `delay`, `timing` and `sensing`.
    pub timing_and_sensing: [(String, Vec<Axis>); 3],
    /// Delays and biases, which are constant: part of the space `disturbance`.
    pub steady: Vec<Axis>,
    /// `faults-sensing` and `faults-actuation`.
    pub faults: [(String, Vec<Axis>); 2],
}

impl LoopSpaces {
    /// Sorts the axes of disturbances into spaces, some of which may be empty.
    pub fn new(disturbances: &[Disturbance]) -> LoopSpaces {
        let of = |matches: fn(&Effect) -> bool| {
            distinct(disturbances.iter().filter(|d| matches(&d.effect)).map(|d| &d.axis))
        };
        fn is_fault(effect: &Effect, on: Side) -> bool {
            matches!(effect, Effect::Fault { site, .. } if site.side == on)
        }
        let named = |name: &str, axes| (name.to_string(), axes);
        LoopSpaces {
            timing_and_sensing: [
                named("delay", of(|e| matches!(e, Effect::ActionDelay | Effect::ObservationDelay))),
                named(
                    "timing",
                    of(|e| {
                        matches!(
                            e,
                            Effect::ActionJitter | Effect::ObservationJitter | Effect::ObservationPeriod
                        )
                    }),
                ),
                named(
                    "sensing",
                    of(|e| matches!(e, Effect::Observation { .. } | Effect::ObservationNoise { .. })),
                ),
            ],
            steady: of(|e| {
                matches!(e, Effect::ActionDelay | Effect::ObservationDelay | Effect::Observation { .. })
            }),
            faults: [
                named("faults-sensing", of(|e| is_fault(e, Side::Sensing))),
                named("faults-actuation", of(|e| is_fault(e, Side::Actuation))),
            ],
        }
    }
}

/// Returns the axes with different names: several disturbances may follow one axis.
pub fn distinct<'a>(axes: impl IntoIterator<Item = &'a Axis>) -> Vec<Axis> {
    let mut found: Vec<Axis> = Vec::new();
    for axis in axes {
        if found.iter().all(|known| known.name != axis.name) {
            found.push(axis.clone());
        }
    }
    found
}

/// Largest bias and largest standard deviation of the noise of a sensor, in this unit.
fn sensor_errors(unit: &str) -> [f64; 2] {
    match unit {
        "m" => [0.02, 0.01],
        "rad" => [0.01, 0.005],
        "m/s" | "rad/s" => [0.1, 0.1],
        _ => [0.02, 0.02],
    }
}

/// Largest value of a sensor, in this unit.
fn largest(unit: &str) -> f64 {
    match unit {
        "m" => 10.0,
        "rad" => std::f64::consts::PI,
        "m/s" | "rad/s" => 20.0,
        _ => 1.0,
    }
}
