use std::fmt;
use std::sync::Arc;

use crate::condition::{Gate, canonical, gates, idle, inactive, needed};
use crate::{Condition, RolloutError, Seed, Stream};

/// Kind of quantity that an [`Axis`] varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum AxisKind {
    /// The initial state.
    Start,
    /// A constant of the system: a factor or an offset of a physical parameter, a sensor bias, a
    /// delay.
    Model,
    /// An event at a point in time: a push, a jump of the target. Several axes describe one event.
    Event,
    /// A fault of a channel of observations or actions, with onset, duration and magnitude. Several
    /// axes describe one fault.
    Fault,
    /// One knot or segment of a disturbance of actions or observations.
    Input,
    /// A random draw made explicit. Its nominal value is `None`, for which its random stream
    /// provides the draw.
    Noise,
}

impl AxisKind {
    /// All kinds with their names in records and output.
    pub const ALL: [(AxisKind, &'static str); 6] = [
        (AxisKind::Start, "start"),
        (AxisKind::Model, "model"),
        (AxisKind::Event, "event"),
        (AxisKind::Fault, "fault"),
        (AxisKind::Input, "input"),
        (AxisKind::Noise, "noise"),
    ];

    /// Returns the kind with a name.
    pub fn by_name(name: &str) -> Option<AxisKind> {
        Self::ALL.iter().find(|(_, known)| *known == name).map(|(kind, _)| *kind)
    }

    /// Returns the name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(kind, _)| *kind == self).map_or("", |(_, name)| name)
    }
}

impl fmt::Display for AxisKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Values of an axis between its bounds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AxisValues {
    /// Real numbers, linear in u.
    Continuous,
    /// Positive real numbers, logarithmic in u.
    Logarithmic,
    /// Whole numbers, including the bounds.
    Integer,
    /// Names, numbered from 0. The bounds are 0 and the number of names minus 1.
    Categorical(Arc<[String]>),
}

/// Distribution from which [`Space::sample`] draws the value of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// Uniform in u.
    Uniform,
    /// Uniform in u from this fraction to 1: the strong values of an axis that is nominal at its
    /// lower bound.
    Upper(f64),
    /// Standard normal, truncated to the bounds by rejection.
    Normal,
}

impl Distribution {
    /// Returns the name.
    pub fn name(self) -> &'static str {
        match self {
            Distribution::Uniform => "uniform",
            Distribution::Upper(_) => "upper",
            Distribution::Normal => "normal",
        }
    }
}

/// Ending of the name of an axis that is the time at which a fault begins.
pub(crate) const ONSET: &str = "_onset";

/// One quantity that a scenario sets.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Name, for instance `ball_x`; unique within its target.
    pub name: String,
    /// Unit, for instance `m`; empty for dimensionless numbers.
    pub unit: String,
    /// Lower bound.
    pub low: f64,
    /// Upper bound.
    pub high: f64,
    /// Value in an undisturbed episode; `None` for a draw that its random stream provides.
    pub nominal: Option<f64>,
    /// Kind of quantity.
    pub kind: AxisKind,
    /// Values between the bounds.
    pub values: AxisValues,
    /// Distribution of random scenarios.
    pub distribution: Distribution,
    /// Description of the quantity.
    pub meaning: String,
    /// The axis has an effect only if all of them hold. In other scenarios it is nominal.
    pub conditions: Vec<Condition>,
    /// The time before which the axis has no effect, as a fraction of the episode. 0 is correct for
    /// every axis.
    pub acts_from: f64,
}

impl Axis {
    /// Makes a continuous axis with a uniform distribution.
    ///
    /// # Example
    /// ```
    /// use mishandle_rollout::{Axis, AxisKind};
    /// let friction = Axis::new(AxisKind::Model, "friction_scale", "", [0.5, 1.5], Some(1.0));
    /// assert_eq!((friction.low, friction.nominal), (0.5, Some(1.0)));
    /// ```
    pub fn new(kind: AxisKind, name: &str, unit: &str, [low, high]: [f64; 2], nominal: Option<f64>) -> Axis {
        Axis {
            name: name.to_string(),
            unit: unit.to_string(),
            low,
            high,
            nominal,
            kind,
            values: AxisValues::Continuous,
            distribution: Distribution::Uniform,
            meaning: String::new(),
            conditions: Vec::new(),
            acts_from: 0.0,
        }
    }

    /// Makes an axis of the initial state. Its nominal value is the midpoint of its bounds.
    pub fn start(name: &str, unit: &str, low: f64, high: f64) -> Axis {
        Axis::new(AxisKind::Start, name, unit, [low, high], Some(low * 0.5 + high * 0.5))
    }

    /// Returns the axis with other values.
    pub fn with_values(self, values: AxisValues) -> Axis {
        Axis { values, ..self }
    }

    /// Returns the axis with a description.
    pub fn meaning(self, meaning: &str) -> Axis {
        Axis { meaning: meaning.to_string(), ..self }
    }

    /// Returns the axis that has no effect before step `step` of `steps` control steps.
    ///
    /// # Example
    /// ```
    /// use mishandle_rollout::{Axis, AxisKind};
    /// let knot = Axis::new(AxisKind::Input, "knot_3", "", [-1.0, 1.0], Some(0.0));
    /// assert_eq!(knot.acting_from(150, 300).acts_from, 0.5);
    /// ```
    pub fn acting_from(self, step: usize, steps: usize) -> Axis {
        Axis { acts_from: (step as f64 / steps.max(1) as f64).min(1.0), ..self }
    }

    /// Returns the axis with conditions.
    pub fn only_if(self, conditions: impl IntoIterator<Item = Condition>) -> Axis {
        Axis { conditions: conditions.into_iter().collect(), ..self }
    }

    /// Returns the number of values of a discrete axis; `None` for a continuous one.
    pub fn levels(&self) -> Option<usize> {
        match self.values {
            AxisValues::Continuous | AxisValues::Logarithmic => None,
            AxisValues::Integer | AxisValues::Categorical(_) => {
                Some(((self.high - self.low) as usize).saturating_add(1))
            }
        }
    }

    /// Returns whether the axis has a single value.
    pub fn is_fixed(&self) -> bool {
        self.low == self.high
    }

    /// Returns whether the axis is the time at which a fault begins.
    pub fn is_onset(&self) -> bool {
        self.kind == AxisKind::Fault && self.name.ends_with(ONSET)
    }

    /// Returns the value at `u` in \[0, 1\]. The bounds are exact at 0 and 1.
    pub fn at(&self, u: f64) -> f64 {
        match (&self.values, self.levels()) {
            _ if self.is_fixed() => self.low,
            (_, Some(levels)) => self.low + (u * levels as f64).floor().min((levels - 1) as f64),
            (AxisValues::Logarithmic, _) if u > 0.0 && u < 1.0 => self.low * (self.high / self.low).powf(u),
            _ => self.low * (1.0 - u) + self.high * u,
        }
    }

    /// Returns the u of a value, the inverse of [`at`](Self::at) up to rounding. For a discrete
    /// value it is the midpoint of the interval that maps to the value.
    pub fn unit_coordinate(&self, value: f64) -> f64 {
        match (&self.values, self.levels()) {
            _ if self.is_fixed() => 0.5,
            (_, Some(levels)) => (value - self.low + 0.5) / levels as f64,
            (AxisValues::Logarithmic, _) => (value / self.low).ln() / (self.high / self.low).ln(),
            _ => (value - self.low) / (self.high - self.low),
        }
    }

    /// Returns whether `value` is allowed. An initial state may be outside its bounds, because a
    /// user may ask for one.
    pub fn accepts(&self, value: f64) -> bool {
        let within = (self.low..=self.high).contains(&value);
        match self.levels() {
            Some(_) => within && value.fract() == 0.0,
            None => value.is_finite() && (within || self.kind == AxisKind::Start),
        }
    }

    fn check(&self) -> Result<(), RolloutError> {
        let error = |what| RolloutError::Axis { axis: self.name.clone(), what };
        if !(self.low <= self.high && self.low.is_finite() && self.high.is_finite()) {
            return Err(RolloutError::Bounds { axis: self.name.clone(), low: self.low, high: self.high });
        }
        if self.values == AxisValues::Logarithmic && self.low <= 0.0 {
            return Err(error("the lower bound of a logarithmic axis must be positive"));
        }
        if self.levels().is_some() && (self.low.fract() != 0.0 || self.high.fract() != 0.0) {
            return Err(error("the bounds of a discrete axis must be whole numbers"));
        }
        let largest = if self.levels().is_some() { LARGEST_WHOLE } else { LARGEST };
        if self.low.abs().max(self.high.abs()) > largest {
            return Err(error(match self.levels() {
                Some(_) => {
                    "the bounds of a discrete axis must be at most 2^53, the largest exact whole number"
                }
                None => "the bounds must be at most 1e150",
            }));
        }
        if self.values == AxisValues::Logarithmic && self.low < 1.0 / LARGEST {
            return Err(error("the lower bound of a logarithmic axis must be at least 1e-150"));
        }
        if matches!(self.distribution, Distribution::Upper(from) if !(0.0..1.0).contains(&from)) {
            return Err(error("the fraction from which values are drawn must be at least 0 and less than 1"));
        }
        if !(0.0..=1.0).contains(&self.acts_from) {
            return Err(error("the time from which an axis acts must be from 0 to 1, in episodes"));
        }
        match self.nominal {
            None if self.kind != AxisKind::Noise => Err(error("only a noise axis may have no nominal value")),
            Some(nominal) if !nominal.is_finite() => Err(error("the nominal value must be finite")),
            _ => Ok(()),
        }
    }
}

/// Largest bound: widths of ranges, ratios of bounds and squares stay finite.
const LARGEST: f64 = 1e150;

/// Largest bound of a discrete axis: 2^53, up to which each whole number is exact.
const LARGEST_WHOLE: f64 = 9_007_199_254_740_992.0;

/// One value per axis of a [`Space`], in the order of the axes and in SI units.
///
/// A value of `None` is a draw that its random stream provides. Only noise axes may have one.
///
/// # Example
/// ```
/// use mishandle_rollout::Scenario;
/// let scenario = Scenario::from([0.2, -0.1]);
/// assert_eq!(scenario.values(), [Some(0.2), Some(-0.1)]);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scenario(Vec<Option<f64>>);

impl Scenario {
    /// Makes a scenario from its values.
    pub fn new(values: Vec<Option<f64>>) -> Scenario {
        Scenario(values)
    }

    /// Returns the values, one per axis.
    pub fn values(&self) -> &[Option<f64>] {
        &self.0
    }

    /// Returns the value of axis `index`; `None` if its random stream provides it.
    ///
    /// # Panics
    /// If `index` is not the index of an axis.
    pub fn get(&self, index: usize) -> Option<f64> {
        self.0[index]
    }

    /// Returns whether both scenarios have the same bits.
    pub fn is_same(&self, other: &Scenario) -> bool {
        let bits = |scenario: &Scenario| scenario.0.iter().map(|x| x.map(f64::to_bits)).collect::<Vec<_>>();
        bits(self) == bits(other)
    }
}

impl From<Vec<f64>> for Scenario {
    fn from(values: Vec<f64>) -> Scenario {
        Scenario(values.into_iter().map(Some).collect())
    }
}

impl From<&[f64]> for Scenario {
    fn from(values: &[f64]) -> Scenario {
        Scenario(values.iter().copied().map(Some).collect())
    }
}

impl<const N: usize> From<[f64; N]> for Scenario {
    fn from(values: [f64; N]) -> Scenario {
        Scenario::from(values.as_slice())
    }
}

/// A search space: a named list of axes. Axes of the target that it does not contain keep their
/// nominal values.
///
/// [`at`](Self::at) maps a point u of \[0,1\]^d to a [`Scenario`] in SI units. No other code does
/// this conversion.
///
/// # Example
/// ```
/// use mishandle_rollout::{Axis, Space};
/// let axes = vec![Axis::start("ball_x", "m", 0.2, 0.5), Axis::start("ball_y", "m", -0.15, 0.15)];
/// let space = Space::new("starts", axes).unwrap();
/// assert_eq!(space.at(&[0.0, 1.0]), [0.2, 0.15].into());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    name: String,
    axes: Arc<[Axis]>,
    gates: Arc<[Gate]>,
}

impl Space {
    /// Makes a space of these axes.
    ///
    /// # Errors
    /// If the bounds of an axis are not finite or not in order, its nominal value is missing, or
    /// two axes have the same name.
    pub fn new(name: &str, axes: Vec<Axis>) -> Result<Space, RolloutError> {
        for (index, axis) in axes.iter().enumerate() {
            axis.check()?;
            if axes[..index].iter().any(|other| other.name == axis.name) {
                return Err(RolloutError::Axis { axis: axis.name.clone(), what: "two axes have this name" });
            }
        }
        Ok(Space { name: name.to_string(), gates: gates(&axes), axes: axes.into() })
    }

    /// Returns the name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the axes, in the order of the values of a scenario.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Returns the number of axes.
    pub fn dimension(&self) -> usize {
        self.axes.len()
    }

    /// Returns the scenario at the point `u` of \[0,1\]^d. The bounds are exact at 0 and 1.
    pub fn at(&self, u: &[f64]) -> Scenario {
        self.canonical(Scenario(self.axes.iter().zip(u).map(|(axis, u)| Some(axis.at(*u))).collect()))
    }

    /// Returns the scenario with the nominal value on each axis that has no effect in it, so that
    /// scenarios with equal episodes are equal: see [`Axis::conditions`].
    pub fn canonical(&self, scenario: Scenario) -> Scenario {
        canonical(&self.gates, &self.axes, scenario)
    }

    /// Returns the axes whose values have no effect in a scenario and are not nominal.
    pub fn ineffective(&self, scenario: &Scenario) -> Vec<&Axis> {
        let is_off = |axis: &usize| scenario.get(*axis) != self.axes[*axis].nominal;
        self.inactive(scenario).filter(is_off).map(|axis| &self.axes[axis]).collect()
    }

    /// Returns the indices of the axes that have no effect in a scenario, whatever their values.
    pub fn inactive(&self, scenario: &Scenario) -> impl Iterator<Item = usize> {
        inactive(&self.gates, scenario)
    }

    /// Returns these axes without those that need another one of them, which does not need them.
    pub fn without_dependent(&self, axes: &[usize]) -> Vec<usize> {
        let needs = |axis: usize, other: usize| self.with_needed(axis).contains(&other);
        let depends = |axis: usize| axes.iter().any(|other| needs(axis, *other) && !needs(*other, axis));
        axes.iter().copied().filter(|axis| !depends(*axis)).collect()
    }

    /// Returns the index of an axis and those of the axes that its conditions name.
    pub fn with_needed(&self, index: usize) -> Vec<usize> {
        needed(&self.gates, index)
    }

    /// Returns the indices of the axes that have an effect in no scenario of this space.
    pub fn idle_axes(&self) -> Vec<usize> {
        idle(&self.gates, &self.axes)
    }

    /// Returns the point of a scenario, the inverse of [`at`](Self::at) up to rounding; `None` if a
    /// value is `None`.
    pub fn unit_point(&self, scenario: &Scenario) -> Option<Vec<f64>> {
        self.axes
            .iter()
            .zip(scenario.values())
            .map(|(axis, value)| value.map(|value| axis.unit_coordinate(value)))
            .collect()
    }

    /// Returns the scenario of an undisturbed episode.
    pub fn nominal(&self) -> Scenario {
        Scenario(self.axes.iter().map(|axis| axis.nominal).collect())
    }

    /// Returns random scenario number `index` of `seed`. Each axis has its own distribution.
    pub fn sample(&self, seed: Seed, index: u64) -> Scenario {
        self.canonical(self.draw(seed, index))
    }

    /// Returns the values of [`sample`](Self::sample) before those without an effect become nominal:
    /// they are independent of each other.
    pub fn draw(&self, seed: Seed, index: u64) -> Scenario {
        let uniform = |number: u32| seed.uniform(Stream::InitialConfiguration, index, number);
        let draw = |(number, axis): (u32, &Axis)| match axis.distribution {
            _ if axis.is_fixed() => axis.low,
            Distribution::Uniform => axis.at(uniform(number)),
            Distribution::Upper(from) => axis.at(from + (1.0 - from) * uniform(number)),
            Distribution::Normal => normal_within(axis, seed.child(index).child(u64::from(number))),
        };
        Scenario((0..).zip(self.axes.iter()).map(draw).map(Some).collect())
    }

    /// Returns random corner number `index` of `seed`: each axis is at its lower or upper bound,
    /// with equal probability.
    pub(crate) fn random_corner(&self, seed: Seed, index: u64) -> Scenario {
        let bound = |axis: u32| f64::from(u8::from(seed.uniform(Stream::Scenario, index + 1, axis) >= 0.5));
        self.at(&(0..).take(self.dimension()).map(bound).collect::<Vec<f64>>())
    }

    /// Checks that `scenario` has an allowed value for every axis.
    ///
    /// # Errors
    /// If the number of values is wrong, or a value is missing, not finite, outside the bounds of
    /// its axis (except for initial states) or a fraction on a discrete axis.
    pub fn check(&self, scenario: &Scenario) -> Result<(), RolloutError> {
        let found = scenario.values().len();
        if found != self.dimension() {
            let axes = self.axes.iter().map(|axis| axis.name.as_str()).collect::<Vec<_>>().join(", ");
            return Err(RolloutError::Dimension { expected: self.dimension(), found, axes });
        }
        for (axis, value) in self.axes.iter().zip(scenario.values()) {
            match *value {
                None if axis.nominal.is_some() => {
                    return Err(RolloutError::MissingValue { axis: axis.name.clone() });
                }
                Some(value) if !value.is_finite() => {
                    return Err(RolloutError::NotFinite { axis: axis.name.clone(), value });
                }
                Some(value) if !axis.accepts(value) => {
                    let Axis { name, low, high, .. } = axis;
                    return Err(RolloutError::OutOfRange {
                        axis: name.clone(),
                        value,
                        low: *low,
                        high: *high,
                        is_discrete: axis.levels().is_some(),
                    });
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// Draws a standard normal number within the bounds of `axis` by rejection; returns their midpoint
/// after 10,000 rejections.
fn normal_within(axis: &Axis, seed: Seed) -> f64 {
    const DRAWS: u64 = 10_000;
    let draw = |step| {
        let mut number = [0.0];
        seed.normals(Stream::InitialConfiguration, step, &mut number);
        number[0]
    };
    (0..DRAWS).map(draw).find(|z| (axis.low..=axis.high).contains(z)).unwrap_or_else(|| axis.at(0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(values: AxisValues, low: f64, high: f64) -> Axis {
        Axis::new(AxisKind::Model, "a", "", [low, high], Some(low)).with_values(values)
    }

    #[test]
    fn every_discrete_value_has_an_equal_part_of_the_unit_interval_and_an_inverse() {
        let delay = axis(AxisValues::Integer, 0.0, 3.0);
        let count = |level: f64| (0..4000).filter(|i| delay.at(f64::from(*i) / 4000.0) == level).count();
        assert_eq!([0.0, 1.0, 2.0, 3.0].map(count), [1000; 4]);
        assert_eq!((delay.at(0.0), delay.at(1.0)), (0.0, 3.0));
        assert_eq!(
            [0.0, 1.0, 2.0, 3.0].map(|level| delay.at(delay.unit_coordinate(level))),
            [0.0, 1.0, 2.0, 3.0]
        );
    }

    #[test]
    fn a_logarithmic_axis_has_the_geometric_mean_at_its_midpoint_and_exact_bounds() {
        let gain = axis(AxisValues::Logarithmic, 0.25, 4.0);
        assert!((gain.at(0.5) - 1.0).abs() < 1e-15);
        assert_eq!((gain.at(0.0), gain.at(1.0)), (0.25, 4.0));
        assert!((gain.unit_coordinate(2.0) - 0.75).abs() < 1e-15);
    }

    #[test]
    fn bounds_whose_widths_or_ratios_are_not_finite_or_not_exact_are_refused() {
        let is_possible = |values, low, high| Space::new("s", vec![axis(values, low, high)]).is_ok();
        assert!(is_possible(AxisValues::Continuous, -1e150, 1e150));
        assert!(!is_possible(AxisValues::Continuous, -1e308, 1e308));
        assert!(is_possible(AxisValues::Logarithmic, 1e-150, 1e150));
        assert!(!is_possible(AxisValues::Logarithmic, 1e-320, 1.0));
        assert!(is_possible(AxisValues::Integer, 0.0, 9_007_199_254_740_992.0));
        assert!(!is_possible(AxisValues::Integer, 0.0, 1e30));
    }

    #[test]
    fn an_axis_with_equal_bounds_has_exactly_this_value() {
        let mut draw = Axis::new(AxisKind::Noise, "z", "", [0.1; 2], None);
        draw.distribution = Distribution::Normal;
        let fixed = [AxisValues::Continuous, AxisValues::Logarithmic, AxisValues::Integer].map(|values| {
            let value = if values == AxisValues::Integer { 2.0 } else { 0.1 };
            Axis { name: format!("{values:?}"), ..axis(values, value, value) }
        });
        let space = Space::new("s", fixed.into_iter().chain([draw]).collect()).unwrap();
        assert!(space.axes().iter().all(Axis::is_fixed));
        let expected = Scenario::from([0.1, 0.1, 2.0, 0.1]);
        for u in [0.0, 0.3, 0.7, 1.0] {
            assert_eq!(space.at(&[u; 4]), expected);
        }
        assert_eq!(space.sample(Seed(1), 2), expected);
        assert_eq!(space.unit_point(&expected), Some(vec![0.5; 4]));
    }

    #[test]
    fn invalid_axes_are_errors() {
        let none = Axis::new(AxisKind::Model, "a", "", [0.0, 1.0], None);
        for (axis, expected) in [
            (axis(AxisValues::Continuous, 1.0, 0.5), "from 1 to 0.5"),
            (axis(AxisValues::Continuous, 0.0, f64::NAN), "from 0 to NaN"),
            (axis(AxisValues::Logarithmic, 0.0, 1.0), "logarithmic"),
            (axis(AxisValues::Integer, 0.0, 1.5), "whole"),
            (none, "nominal"),
        ] {
            let error = Space::new("s", vec![axis]).unwrap_err().to_string();
            assert!(error.contains(expected), "{error}");
        }
        let twice = vec![axis(AxisValues::Continuous, 0.0, 1.0), axis(AxisValues::Continuous, 0.0, 1.0)];
        assert!(Space::new("s", twice).unwrap_err().to_string().contains("two axes"));
    }

    #[test]
    fn only_an_initial_state_may_be_outside_its_bounds_and_only_noise_may_be_omitted() {
        let noise = Axis::new(AxisKind::Noise, "z", "", [-3.0, 3.0], None);
        let axes = vec![Axis::start("x", "m", 0.0, 1.0), axis(AxisValues::Integer, 0.0, 3.0), noise];
        let space = Space::new("s", axes).unwrap();
        let check = |values: [Option<f64>; 3]| space.check(&Scenario::new(values.to_vec())).is_ok();
        assert!(check([Some(7.0), Some(2.0), None]));
        assert!(!check([Some(0.5), Some(2.5), None]));
        assert!(!check([Some(0.5), Some(4.0), None]));
        assert!(!check([None, Some(2.0), None]));
        assert!(!check([Some(f64::NAN), Some(2.0), Some(0.0)]));
        assert!(!check([Some(0.5), Some(2.0), Some(9.0)]));
        assert!(space.check(&[0.5].into()).unwrap_err().to_string().contains("x, a, z"));
        assert_eq!(space.nominal(), Scenario::new(vec![Some(0.5), Some(0.0), None]));
    }

    #[test]
    fn upper_draws_leave_out_the_lower_part_and_weaker_choices() {
        let upper = |name: &str, values, high, from| Axis {
            name: name.to_string(),
            distribution: Distribution::Upper(from),
            ..axis(values, 0.0, high)
        };
        let strength = upper("strength", AxisValues::Continuous, 3.0, 2.0 / 3.0);
        let count = upper("count", AxisValues::Integer, 3.0, 0.25);
        let space = Space::new("s", vec![strength, count]).unwrap();
        let mut counts = [0; 4];
        let mut lowest = f64::INFINITY;
        for index in 0..3000 {
            let drawn = space.sample(Seed(2), index);
            lowest = lowest.min(drawn.get(0).unwrap());
            counts[drawn.get(1).unwrap() as usize] += 1;
        }
        assert!((2.0..2.01).contains(&lowest), "{lowest}");
        assert!(counts[0] == 0 && counts[1..].iter().all(|count| (900..1100).contains(count)), "{counts:?}");
        // A search may ask for weaker ones.
        assert_eq!(space.at(&[0.0, 0.0]), space.nominal());
        let error = Space::new("s", vec![upper("a", AxisValues::Continuous, 1.0, 1.0)]).unwrap_err();
        assert!(error.to_string().contains("fraction"), "{error}");
    }

    #[test]
    fn normal_draws_have_mean_0_and_variance_1_and_stay_within_the_bounds() {
        let mut draw = Axis::new(AxisKind::Noise, "z", "", [-4.0, 4.0], None);
        draw.distribution = Distribution::Normal;
        let space = Space::new("s", vec![draw]).unwrap();
        let n = 20_000;
        let values: Vec<f64> = (0..n).filter_map(|i| space.sample(Seed(3), i).get(0)).collect();
        let mean = values.iter().sum::<f64>() / n as f64;
        let variance = values.iter().map(|z| z * z).sum::<f64>() / n as f64;
        // Five standard errors; the tails beyond 4 change the variance by 1e-3.
        assert!(mean.abs() < 5.0 / (n as f64).sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / n as f64).sqrt() + 1e-3, "{variance}");
        assert!(values.iter().all(|z| z.abs() <= 4.0));
    }
}
