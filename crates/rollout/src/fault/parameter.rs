//! The parameters of a fault: one axis each.

use std::sync::Arc;

use super::kind::{Description, Fill, Side};
use super::site::FaultSite;
use crate::space::ONSET;
use crate::{Axis, AxisKind, AxisValues, Condition, Disturbance, Effect, Holds};

/// Largest lateness of a command, control steps.
const MAX_LATENESS: f64 = 6.0;

/// Largest length of a burst, control steps.
const MAX_BURST: f64 = 30.0;

/// Largest offset and step of a quantization, in units of half the range of the channel.
const MAX_OFFSET: f64 = 0.5;
const MAX_QUANTUM: f64 = 0.5;

/// Longest fault and recovery, and latest onset, as fractions of the episode.
const LONGEST: f64 = 0.4;
const LONGEST_RECOVERY: f64 = 0.1;
const LATEST: f64 = 0.8;

/// Parameter of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// The kind, by its number: see [`Side::kinds`].
    Kind,
    /// Number of the channel: 0 for all, if there is more than one.
    Channel,
    /// Number of the channel with which it is exchanged, from 1; 0 for the next one.
    Partner,
    /// Time at which the fault begins, s.
    Onset,
    /// Duration, s.
    Duration,
    /// Time in which the fault decreases to nothing after its duration, s.
    Recovery,
    /// Number of the [`Fill`].
    Filling,
    /// Added offset, in units of half the range of the channel.
    Offset,
    /// Constant value, from -1 (lower end of the range) to 1 (upper end).
    Level,
    /// Step of a quantization, in units of half the range of the channel.
    Quantum,
    /// Probability that a burst of losses begins in a control step.
    Probability,
    /// Length of a burst, control steps.
    Burst,
    /// Share of the action that has no effect.
    Loss,
    /// Share of the range that is left.
    Limit,
    /// Largest lateness of a command, control steps.
    Lateness,
}

use Parameter as P;

/// All parameters, in the order of their axes.
const ALL: [Parameter; 15] = [
    P::Kind,
    P::Channel,
    P::Partner,
    P::Onset,
    P::Duration,
    P::Recovery,
    P::Filling,
    P::Offset,
    P::Level,
    P::Quantum,
    P::Probability,
    P::Burst,
    P::Loss,
    P::Limit,
    P::Lateness,
];

impl Parameter {
    /// Number of parameters.
    pub(crate) const COUNT: usize = ALL.len();

    /// Returns the nominal values of all parameters.
    pub(crate) fn nominal_values() -> [f64; Parameter::COUNT] {
        ALL.map(Parameter::nominal)
    }

    /// Returns whether another value than the nominal one makes an episode depend on its seed.
    pub fn is_random(self) -> bool {
        matches!(self, P::Probability | P::Lateness)
    }

    /// Returns whether this is the size of the effect of a kind of fault. A kind has at most one.
    pub(crate) fn is_magnitude(self) -> bool {
        matches!(self, P::Offset | P::Level | P::Quantum | P::Probability | P::Loss | P::Limit | P::Lateness)
    }

    /// Returns whether a fault of this magnitude has no effect. A constant value always has one.
    pub(crate) fn is_nominal(self, magnitude: f64) -> bool {
        self != P::Level && magnitude == self.nominal()
    }

    fn nominal(self) -> f64 {
        match self {
            P::Burst | P::Limit => 1.0,
            _ => 0.0,
        }
    }

    /// Returns the ending of the name of the axis. The kind has the name of the site.
    pub fn suffix(self) -> &'static str {
        match self {
            P::Kind => "",
            P::Channel => "_channel",
            P::Partner => "_partner",
            P::Onset => ONSET,
            P::Duration => "_duration",
            P::Recovery => "_recovery",
            P::Filling => "_fill",
            P::Offset => "_offset",
            P::Level => "_level",
            P::Quantum => "_quantum",
            P::Probability => "_probability",
            P::Burst => "_burst",
            P::Loss => "_loss",
            P::Limit => "_limit",
            P::Lateness => "_lateness",
        }
    }

    fn unit(self) -> &'static str {
        match self {
            P::Onset | P::Duration | P::Recovery => "s",
            P::Burst | P::Lateness => "control steps",
            _ => "",
        }
    }

    fn bounds(self, site: &FaultSite) -> [f64; 2] {
        let end = site.episode_steps as f64 * site.control_dt;
        let last = |count: usize| count.saturating_sub(1) as f64;
        match self {
            P::Kind => [0.0, last(site.kinds().count())],
            P::Channel => [0.0, last(site.choices().len())],
            P::Partner => [0.0, last(site.partners().len())],
            P::Onset => [0.0, LATEST * end],
            P::Duration => [0.0, LONGEST * end],
            P::Recovery => [0.0, LONGEST_RECOVERY * end],
            P::Filling => [0.0, last(site.fills().len())],
            P::Offset => [-MAX_OFFSET, MAX_OFFSET],
            P::Level => [-1.0, 1.0],
            P::Quantum => [0.0, MAX_QUANTUM],
            P::Burst => [1.0, MAX_BURST],
            P::Lateness => [0.0, MAX_LATENESS],
            P::Probability | P::Loss | P::Limit => [0.0, 1.0],
        }
    }

    fn values(self, site: &FaultSite) -> AxisValues {
        let names = |names: Vec<&str>| {
            AxisValues::Categorical(names.into_iter().map(str::to_string).collect::<Vec<_>>().into())
        };
        match self {
            P::Kind => names(site.kinds().map(|kind| kind.name).collect()),
            P::Channel => names(site.choices()),
            P::Partner => names(site.partners()),
            P::Filling => names(site.fills().iter().map(|(_, name)| *name).collect()),
            P::Burst | P::Lateness => AxisValues::Integer,
            _ => AxisValues::Continuous,
        }
    }

    fn meaning(self, site: &FaultSite) -> String {
        let quantity = match site.side {
            Side::Sensing => "observation",
            Side::Actuation => "action",
        };
        let order = match site.number {
            0 => String::new(),
            number => format!(", applied after that of number {number}"),
        };
        match self {
            P::Kind => format!("kind of a fault of the {quantity}{order}"),
            P::Channel => format!("channel of the {quantity} that has the fault"),
            P::Partner => {
                "channel with which it is exchanged; all channels are shifted by one entry".to_string()
            }
            P::Onset => "time at which the fault begins".to_string(),
            P::Duration => "duration of the fault".to_string(),
            P::Recovery => "time in which the fault decreases to nothing after its duration".to_string(),
            P::Filling => "value that the controller sees of a lost sample".to_string(),
            P::Offset => "offset, in units of half the range of the channel".to_string(),
            P::Level => "constant value: -1 and 1 are the ends of the range of the channel".to_string(),
            P::Quantum => "step of the quantization, in units of half the range of the channel".to_string(),
            P::Probability => "probability that a burst of losses begins in a control step".to_string(),
            P::Burst => "length of a burst of losses".to_string(),
            P::Loss => "share of all actions that is lost".to_string(),
            P::Limit => "share of the range of the channel that is left".to_string(),
            P::Lateness => "largest delay of a command, drawn in each control step".to_string(),
        }
    }

    fn is_used_by(self, kind: &Description) -> bool {
        match self {
            P::Kind => true,
            P::Onset | P::Duration => kind.name != "none",
            _ => kind.parameters.contains(&self),
        }
    }

    /// Returns whether the parameter has a choice at a site.
    fn exists_at(self, site: &FaultSite) -> bool {
        let [low, high] = self.bounds(site);
        low < high && site.kinds().any(|kind| self.is_used_by(kind))
    }

    /// Returns the conditions of the axis. Without a duration there is no fault, and of a fault
    /// only the parameters of its kind have a meaning.
    fn conditions(self, site: &FaultSite) -> Vec<Condition> {
        let duration = || Condition {
            axis: site.axis_name(P::Duration),
            nominal: P::Duration.nominal(),
            holds: Holds::Except(0.0),
        };
        let kinds = || Condition {
            axis: site.axis_name(P::Kind),
            nominal: P::Kind.nominal(),
            holds: Holds::OneOf(
                (0..)
                    .zip(site.kinds())
                    .filter(|(_, kind)| self.is_used_by(kind))
                    .map(|(i, _)| f64::from(i))
                    .collect(),
            ),
        };
        match self {
            P::Kind => vec![duration()],
            P::Duration => vec![kinds()],
            P::Partner => {
                let one = Condition {
                    axis: site.axis_name(P::Channel),
                    nominal: P::Channel.nominal(),
                    holds: Holds::Except(0.0),
                };
                vec![duration(), kinds(), one]
            }
            _ => vec![duration(), kinds()],
        }
    }
}

impl FaultSite {
    /// Returns the name of the axis of a parameter.
    pub(crate) fn axis_name(&self, parameter: Parameter) -> String {
        format!("{}{}", self.name, parameter.suffix())
    }

    /// Returns the axes of a fault at this site. Their kind is [`AxisKind::Fault`], and an axis
    /// that has no meaning for the chosen kind of fault has [conditions](Axis::conditions).
    pub fn disturbances(self) -> Vec<Disturbance> {
        let site = Arc::new(self);
        let axis = |parameter: Parameter| {
            let name = site.axis_name(parameter);
            let unit = parameter.unit();
            let bounds = parameter.bounds(&site);
            Axis::new(AxisKind::Fault, &name, unit, bounds, Some(parameter.nominal()))
                .with_values(parameter.values(&site))
                .meaning(&parameter.meaning(&site))
                .only_if(parameter.conditions(&site))
        };
        let exists = |parameter: &Parameter| parameter.exists_at(&site);
        let disturbance = |parameter| Disturbance {
            axis: axis(parameter),
            effect: Effect::Fault { site: Arc::clone(&site), parameter },
        };
        ALL.into_iter().filter(exists).map(disturbance).collect()
    }

    /// Returns the values that a lost sample can have. Whole numbers have no NaN.
    pub(crate) fn fills(&self) -> &'static [(Fill, &'static str)] {
        if self.has_numbers { &Fill::ALL } else { &Fill::ALL[..1] }
    }
}
