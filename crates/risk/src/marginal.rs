//! The distribution of one axis.

use std::fmt;
use std::str::FromStr;

use mishandle_rollout::{Axis, AxisKind, AxisValues, Distribution};

use crate::{RiskError, normal};

/// The distributions, for messages.
const KNOWN: &str = "uniform, log-uniform, normal:MEAN:STD, triangular:MODE, weights:W0:W1:... with a weight for each value, or per-hour:KIND=RATE:... for the kind of a fault";

/// The distribution of the values of an axis, truncated to its bounds.
///
/// On an axis of whole numbers, the value is the nearest whole number of a number with this
/// distribution.
///
/// # Example
/// ```
/// use mishandle_risk::Marginal;
/// let friction: Marginal = "normal:1:0.1".parse().unwrap();
/// assert_eq!(friction, Marginal::Normal { mean: 1.0, std: 0.1 });
/// assert_eq!(friction.to_string(), "normal:1:0.1");
/// assert!("normal:1".parse::<Marginal>().is_err());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Marginal {
    /// Uniform between the bounds.
    Uniform,
    /// Uniform in the logarithm of the value.
    LogUniform,
    /// Normal.
    Normal {
        /// Mean before the truncation, in the unit of the axis.
        mean: f64,
        /// Standard deviation before the truncation, in the unit of the axis.
        std: f64,
    },
    /// A density that rises linearly from the lower bound to the mode and falls linearly to the
    /// upper bound.
    Triangular {
        /// The value with the largest density, in the unit of the axis.
        mode: f64,
    },
    /// One weight for each value of an axis of whole numbers or categories, in order. The
    /// probabilities are proportional to them.
    Weights(Vec<f64>),
    /// Rates of the kinds of a fault. An episode has at most one fault: none with the probability
    /// that a Poisson process with the sum of the rates has no event in the episode, otherwise each
    /// kind in proportion to its rate.
    PerHour {
        /// Name and rate of each kind that occurs, per hour.
        rates: Vec<(String, f64)>,
        /// Duration of an episode, h.
        hours: f64,
    },
}

impl FromStr for Marginal {
    type Err = RiskError;

    fn from_str(text: &str) -> Result<Marginal, RiskError> {
        let error = || RiskError::Syntax { text: text.to_string(), expected: KNOWN };
        if let Some(rates) = text.strip_prefix("per-hour:") {
            let rate = |word: &str| {
                let (kind, rate) = word.split_once('=')?;
                Some((kind.to_string(), rate.parse().ok()?))
            };
            let rates = rates.split(':').map(rate).collect::<Option<Vec<(String, f64)>>>();
            return Ok(Marginal::PerHour { rates: rates.ok_or_else(error)?, hours: 0.0 });
        }
        let mut words = text.split(':');
        let name = words.next().unwrap_or_default();
        let numbers = words.map(str::parse).collect::<Result<Vec<f64>, _>>().map_err(|_| error())?;
        match (name, numbers.as_slice()) {
            ("uniform", []) => Ok(Marginal::Uniform),
            ("log-uniform", []) => Ok(Marginal::LogUniform),
            ("normal", &[mean, std]) => Ok(Marginal::Normal { mean, std }),
            ("triangular", &[mode]) => Ok(Marginal::Triangular { mode }),
            ("weights", [_, ..]) => Ok(Marginal::Weights(numbers)),
            _ => Err(error()),
        }
    }
}

impl fmt::Display for Marginal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Marginal::Uniform => f.write_str("uniform"),
            Marginal::LogUniform => f.write_str("log-uniform"),
            Marginal::Normal { mean, std } => write!(f, "normal:{mean}:{std}"),
            Marginal::Triangular { mode } => write!(f, "triangular:{mode}"),
            Marginal::Weights(weights) => {
                f.write_str("weights")?;
                weights.iter().try_for_each(|weight| write!(f, ":{weight}"))
            }
            Marginal::PerHour { rates, .. } => {
                f.write_str("per-hour")?;
                rates.iter().try_for_each(|(kind, rate)| write!(f, ":{kind}={rate}"))
            }
        }
    }
}

impl Marginal {
    /// Returns the distribution that the axis itself declares. Without a lower part, a continuous
    /// axis is uniform over the whole of its bounds: weak values are part of a risk.
    pub fn of(axis: &Axis) -> Marginal {
        match (axis.distribution, &axis.values, axis.levels()) {
            (Distribution::Normal, _, _) => Marginal::Normal { mean: 0.0, std: 1.0 },
            (Distribution::Upper(from), _, Some(levels)) => {
                let first = (from * levels as f64).floor() as usize;
                Marginal::Weights((0..levels).map(|level| f64::from(u8::from(level >= first))).collect())
            }
            (_, AxisValues::Logarithmic, _) => Marginal::LogUniform,
            (Distribution::Uniform | Distribution::Upper(_), _, _) => Marginal::Uniform,
        }
    }

    /// Returns the distribution for episodes of this duration, h. Only rates depend on it.
    #[must_use]
    pub fn lasting(self, hours: f64) -> Marginal {
        match self {
            Marginal::PerHour { rates, .. } => Marginal::PerHour { rates, hours },
            other => other,
        }
    }

    /// Returns the probability of a fault in an episode; `None` if the distribution has no rates.
    pub fn fault_probability(&self) -> Option<f64> {
        let Marginal::PerHour { rates, hours } = self else { return None };
        let total: f64 = rates.iter().map(|(_, rate)| rate).sum();
        Some(-(-total * hours).exp_m1())
    }

    /// Returns the probability of each value of an axis of the kinds of a fault.
    fn kind_weights(&self, axis: &Axis) -> Vec<f64> {
        let (Marginal::PerHour { rates, .. }, AxisValues::Categorical(names), Some(faulty)) =
            (self, &axis.values, self.fault_probability())
        else {
            return Vec::new();
        };
        let total: f64 = rates.iter().map(|(_, rate)| rate).sum();
        let weight = |(index, name): (usize, &String)| {
            let rate = rates.iter().filter(|(kind, _)| kind == name).map(|(_, rate)| rate).sum::<f64>();
            let is_nominal = axis.nominal == Some(axis.low + index as f64);
            if is_nominal { 1.0 - faulty } else { faulty * rate / total }
        };
        names.iter().enumerate().map(weight).collect()
    }

    /// Checks that the distribution fits an axis.
    ///
    /// # Errors
    /// [`RiskError::Distribution`] with the reason.
    pub(crate) fn check(&self, axis: &Axis) -> Result<(), RiskError> {
        let is_categorical = matches!(axis.values, AxisValues::Categorical(_));
        let [a, b] = support(axis);
        let problem = match self {
            Marginal::Uniform => None,
            Marginal::PerHour { rates, .. } => rates_problem(rates, axis),
            Marginal::LogUniform if axis.low <= 0.0 => Some("its lower bound is not positive".to_string()),
            Marginal::LogUniform if axis.levels().is_some() => Some("its values are discrete".to_string()),
            Marginal::Normal { .. } | Marginal::Triangular { .. } if is_categorical => {
                Some("its values are categories; use weights".to_string())
            }
            Marginal::Normal { mean, std } if !(mean.is_finite() && std.is_finite() && *std > 0.0) => {
                Some("the mean must be finite, the standard deviation positive".to_string())
            }
            // Below that, the quantiles between the bounds lose their digits.
            Marginal::Normal { mean, std } if mass(mean, std, [a, b]) < 1e-12 => {
                Some(format!("it has almost no probability from {} to {}", axis.low, axis.high))
            }
            Marginal::Triangular { mode } if !(axis.low..=axis.high).contains(mode) => {
                Some(format!("the mode must be from {} to {}", axis.low, axis.high))
            }
            Marginal::Weights(weights) => {
                let is_weight = |weight: &f64| weight.is_finite() && *weight >= 0.0;
                match axis.levels() {
                    None => Some("its values are not discrete".to_string()),
                    Some(levels) if levels != weights.len() => Some(format!("it has {levels} values")),
                    _ if !weights.iter().all(is_weight) || weights.iter().sum::<f64>() <= 0.0 => {
                        Some("weights must not be negative, and one must be positive".to_string())
                    }
                    _ => None,
                }
            }
            _ => None,
        };
        let error = |problem| RiskError::Distribution {
            axis: axis.name.clone(),
            distribution: self.to_string(),
            problem,
        };
        problem.map_or(Ok(()), |problem| Err(error(problem)))
    }

    /// Describes what is unlikely to be meant; `None` if nothing.
    pub(crate) fn warning(&self, axis: &Axis) -> Option<String> {
        let Axis { name, low, high, .. } = axis;
        match self {
            Marginal::Normal { mean, .. } if !axis.is_fixed() && !(low..=high).contains(&mean) => {
                Some(format!(
                    "the mean of the distribution {self} of {name} is outside of its bounds, {low} to {high}: only a tail is left"
                ))
            }
            _ => None,
        }
    }

    /// Returns the value whose quantile is that of `z` in the standard normal distribution.
    pub(crate) fn value(&self, axis: &Axis, z: f64) -> f64 {
        if axis.is_fixed() {
            return axis.low;
        }
        let u = normal::cdf(z);
        let [a, b] = support(axis);
        let value = match self {
            Marginal::Uniform => return axis_uniform(axis, u),
            Marginal::LogUniform => axis.low * (axis.high / axis.low).powf(u),
            // Tails have digits on the negative side only, so the upper half is mirrored.
            Marginal::Normal { mean, std } if z > 0.0 => {
                -truncated_normal(-mean, *std, [-b, -a], normal::cdf(-z))
            }
            Marginal::Normal { mean, std } => truncated_normal(*mean, *std, [a, b], u),
            Marginal::Triangular { mode } => triangular(*mode, [a, b], u),
            Marginal::Weights(weights) => return axis.low + level(weights, u) as f64,
            Marginal::PerHour { .. } => {
                return axis.low + level(&self.kind_weights(axis), u) as f64;
            }
        };
        let value = if axis.levels().is_some() { value.round() } else { value };
        value.clamp(axis.low, axis.high)
    }
}

/// Returns why rates do not fit an axis; `None` if they do.
fn rates_problem(rates: &[(String, f64)], axis: &Axis) -> Option<String> {
    let AxisValues::Categorical(names) = &axis.values else {
        return Some("it has no kinds of faults; use it for an axis such as sensor_fault".to_string());
    };
    let nominal = axis.nominal.and_then(|nominal| names.get((nominal - axis.low) as usize));
    let mut kinds: Vec<&str> =
        names.iter().filter(|name| Some(*name) != nominal).map(String::as_str).collect();
    // The other categories of a fault depend on its kind.
    if axis.kind != AxisKind::Fault || !axis.conditions.is_empty() {
        return Some("its categories are not the kinds of a fault; use weights".to_string());
    }
    if let Some((unknown, _)) = rates.iter().find(|(kind, _)| !kinds.contains(&kind.as_str())) {
        return Some(format!("it has no kind `{unknown}`; its kinds: {}", kinds.join(", ")));
    }
    let is_twice = |kind: &&str| rates.iter().filter(|(other, _)| other == kind).count() > 1;
    kinds.retain(is_twice);
    if let Some(kind) = kinds.first() {
        return Some(format!("it has two rates of `{kind}`"));
    }
    let is_rate = |(_, rate): &(String, f64)| rate.is_finite() && *rate >= 0.0;
    if !rates.iter().all(is_rate) || rates.iter().all(|(_, rate)| *rate == 0.0) {
        return Some("rates must not be negative, and one must be positive".to_string());
    }
    None
}

/// Returns the bounds of the continuous number that is rounded to the value of a discrete axis, or
/// those of a continuous axis.
fn support(axis: &Axis) -> [f64; 2] {
    let half = if axis.levels().is_some() { 0.5 } else { 0.0 };
    [axis.low - half, axis.high + half]
}

fn axis_uniform(axis: &Axis, u: f64) -> f64 {
    match axis.values {
        AxisValues::Logarithmic => axis.low * (1.0 - u) + axis.high * u,
        _ => axis.at(u),
    }
}

fn mass(mean: &f64, std: &f64, [a, b]: [f64; 2]) -> f64 {
    let a = (a - mean) / std;
    let b = (b - mean) / std;
    // Differences are exact in the lower tail.
    if a > 0.0 { normal::cdf(-a) - normal::cdf(-b) } else { normal::cdf(b) - normal::cdf(a) }
}

fn truncated_normal(mean: f64, std: f64, [a, b]: [f64; 2], u: f64) -> f64 {
    let [a, b] = [a, b].map(|bound| normal::cdf((bound - mean) / std));
    mean + std * normal::quantile(a + u * (b - a))
}

fn triangular(mode: f64, [a, b]: [f64; 2], u: f64) -> f64 {
    let below = (mode - a) / (b - a);
    if u < below {
        a + (u * (b - a) * (mode - a)).sqrt()
    } else {
        b - ((1.0 - u) * (b - a) * (b - mode)).sqrt()
    }
}

fn level(weights: &[f64], u: f64) -> usize {
    let mut left = u * weights.iter().sum::<f64>();
    for (index, weight) in weights.iter().enumerate() {
        if left < *weight {
            return index;
        }
        left -= weight;
    }
    // Rounding: the last value that has a probability.
    weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_rollout::{Condition, Holds};

    fn axis(bounds: [f64; 2], values: AxisValues) -> Axis {
        Axis::new(AxisKind::Model, "a", "", bounds, Some(bounds[0])).with_values(values)
    }

    /// Quantiles from SciPy 1.17.1: `truncnorm((0 - 1) / 0.5, (1.2 - 1) / 0.5, 1, 0.5)`,
    /// `triang(0.25, 0, 4)` and `loguniform(0.5, 8)`, each `.ppf([0.01, 0.3, 0.9])`.
    #[test]
    fn quantiles_match_scipy() {
        const TRUNCATED: [f64; 3] =
            [0.052_731_228_706_439_09, 0.601_200_498_416_738_7, 1.116_545_438_632_265_3];
        const TRIANGULAR: [f64; 3] = [0.2, 1.101_724_650_762_112_6, 2.904_554_884_989_668];
        const LOGARITHMIC: [f64; 3] = [0.514_056_913_328_033_3, 1.148_698_354_997_035, 6.062_866_266_041_591];
        let zs = [0.01, 0.3, 0.9].map(normal::quantile);
        let of = |text: &str, bounds, values| {
            let marginal: Marginal = text.parse().unwrap();
            let axis = axis(bounds, values);
            marginal.check(&axis).unwrap();
            zs.map(|z| marginal.value(&axis, z))
        };
        for (found, expected) in [
            (of("normal:1:0.5", [0.0, 1.2], AxisValues::Continuous), TRUNCATED),
            (of("triangular:1", [0.0, 4.0], AxisValues::Continuous), TRIANGULAR),
            (of("log-uniform", [0.5, 8.0], AxisValues::Logarithmic), LOGARITHMIC),
        ] {
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 1e-9, "{found}, not {expected}");
            }
        }
    }

    #[test]
    fn the_upper_tail_of_a_normal_distribution_is_as_exact_as_the_lower_one() {
        let axis = axis([-9.0, 9.0], AxisValues::Continuous);
        let marginal = Marginal::Normal { mean: 0.0, std: 1.0 };
        // The truncation removes 1e-19 of the tail, which is 6e-16 beyond 8 and 3e-7 beyond 5.
        for (z, tolerance) in [(0.0, 1e-15), (2.0, 1e-12), (5.0, 1e-11), (8.0, 1e-4)] {
            let upper = marginal.value(&axis, z);
            let lower = marginal.value(&axis, -z);
            assert!((upper - z).abs() < tolerance && lower == -upper, "{z}: {upper}, {lower}");
        }
        // Bounds far on one side of the mean.
        let far = Marginal::Normal { mean: 5.0, std: 1.0 };
        let narrow = Axis { low: -1.0, high: 0.0, ..axis };
        assert!(
            (-1.0..=0.0).contains(&far.value(&narrow, 3.0))
                && far.value(&narrow, 3.0) > far.value(&narrow, -3.0)
        );
    }

    #[test]
    fn discrete_values_have_their_probabilities() {
        let delay = axis([0.0, 3.0], AxisValues::Integer);
        let share = |text: &str, level: f64| {
            let marginal: Marginal = text.parse().unwrap();
            marginal.check(&delay).unwrap();
            let n = 20_000;
            let at = |i: u32| marginal.value(&delay, normal::quantile((f64::from(i) + 0.5) / f64::from(n)));
            (0..n).filter(|i| at(*i) == level).count() as f64 / f64::from(n)
        };
        for (text, level, expected) in [
            ("weights:6:3:0:1", 0.0, 0.6),
            ("weights:6:3:0:1", 2.0, 0.0),
            ("weights:6:3:0:1", 3.0, 0.1),
            ("uniform", 1.0, 0.25),
            // The part of N(1, 1) from 0.5 to 1.5, of that from -0.5 to 3.5: 0.382925 / 0.926983.
            ("normal:1:1", 1.0, 0.413_087),
        ] {
            assert!((share(text, level) - expected).abs() < 2e-4, "{text} {level}: {}", share(text, level));
        }
    }

    /// The kinds none, dropout, freeze and bias.
    fn kinds() -> Axis {
        let names = ["none", "dropout", "freeze", "bias"].map(String::from);
        Axis::new(AxisKind::Fault, "fault", "", [0.0, 3.0], Some(0.0))
            .with_values(AxisValues::Categorical(names.into()))
    }

    #[test]
    fn rates_per_hour_give_at_most_one_fault_per_episode() {
        let marginal: Marginal = "per-hour:dropout=30:bias=10".parse().unwrap();
        assert_eq!(marginal.to_string(), "per-hour:dropout=30:bias=10");
        // 40 faults an hour, episodes of 3 minutes: two are expected, and e^-2 is the probability
        // of none.
        let marginal = marginal.lasting(0.05);
        marginal.check(&kinds()).unwrap();
        let none = (-2.0_f64).exp();
        assert!((marginal.fault_probability().unwrap() - (1.0 - none)).abs() < 1e-15);
        let n = 20_000;
        let at = |i: u32| marginal.value(&kinds(), normal::quantile((f64::from(i) + 0.5) / f64::from(n)));
        let share = |kind: f64| (0..n).filter(|i| at(*i) == kind).count() as f64 / f64::from(n);
        for (kind, expected) in
            [(0.0, none), (1.0, 0.75 * (1.0 - none)), (2.0, 0.0), (3.0, 0.25 * (1.0 - none))]
        {
            assert!((share(kind) - expected).abs() < 2e-4, "{kind}: {}", share(kind));
        }
        // A rare fault has its rate times the duration as probability.
        let rare = "per-hour:freeze=0.001".parse::<Marginal>().unwrap().lasting(0.01);
        assert!((rare.fault_probability().unwrap() / 1e-5 - 1.0).abs() < 1e-4);
    }

    #[test]
    fn rates_that_do_not_fit_a_fault_are_errors() {
        for (text, part) in [
            ("per-hour:none=1", "no kind `none`"),
            ("per-hour:frozen=1", "its kinds: dropout, freeze, bias"),
            ("per-hour:bias=1:bias=2", "two rates"),
            ("per-hour:bias=0", "one must be positive"),
            ("per-hour:bias=-1", "must not be negative"),
        ] {
            let error = text.parse::<Marginal>().unwrap().check(&kinds()).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        let needed = Condition { axis: "kind".into(), nominal: 0.0, holds: Holds::Except(0.0) };
        let channel = kinds().only_if([needed]);
        assert!("per-hour:bias=1".parse::<Marginal>().unwrap().check(&channel).is_err());
        let delay = axis([0.0, 3.0], AxisValues::Integer);
        assert!("per-hour:bias=1".parse::<Marginal>().unwrap().check(&delay).is_err());
        for text in ["per-hour:", "per-hour:bias", "per-hour:bias=x", "per-hour"] {
            assert!(text.parse::<Marginal>().is_err(), "{text}");
        }
    }

    #[test]
    fn distributions_that_do_not_fit_their_axis_are_errors() {
        let categories = AxisValues::Categorical(["a", "b"].map(String::from).to_vec().into());
        for (text, bounds, values, part) in [
            ("normal:0:1", [0.0, 1.0], categories, "use weights"),
            ("weights:1:2:3", [0.0, 3.0], AxisValues::Integer, "it has 4 values"),
            ("weights:0:0", [0.0, 1.0], AxisValues::Integer, "one must be positive"),
            ("triangular:2", [0.0, 1.0], AxisValues::Continuous, "the mode must be from 0 to 1"),
            ("normal:nan:1", [0.0, 1.0], AxisValues::Continuous, "must be finite"),
        ] {
            let error =
                text.parse::<Marginal>().unwrap().check(&axis(bounds, values)).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        }
        for text in ["", "normal", "normal:1:x", "uniform:1", "weights"] {
            assert!(text.parse::<Marginal>().is_err(), "{text}");
        }
    }
}
