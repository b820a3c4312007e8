//! Success rates over the values of axes.

use mishandle_results::{AxisRate, AxisRates, Estimate, PairRate, RateBin, ValueRange};
use mishandle_rollout::{Axis, AxisValues, Episode, Scenario, Space};

use crate::interaction::{Cells, Interaction, interaction};
use crate::{anytime_rate, decides_success, fisher_test, holm, wilson};

/// Fewest simulations with rates over an axis, and over a pair of axes.
const FEWEST: u64 = 50;
const FEWEST_OF_PAIRS: u64 = 200;

/// Number of simulations from which on ranges are divided into more parts.
const MANY: u64 = 500;

/// Parts of a range of numbers with fewer and with [`MANY`] simulations; those of a pair of axes.
const BINS: [usize; 2] = [5, 10];
const BINS_OF_PAIRS: [usize; 2] = [3, 5];

/// Most whole numbers that have a bin each.
const WHOLE_NUMBERS: usize = 12;

/// Most categories of an axis, and of an axis in a pair. Other axes have no rates.
const CATEGORIES: usize = 100;
const CATEGORIES_OF_PAIRS: usize = 10;

/// Most axes of which pairs are counted, the first ones: their number grows with the square.
const PAIRED_AXES: usize = 200;

/// Number of pairs in the result.
const PAIRS: usize = 6;

/// Level below which a p-value counts as a difference.
const SIGNIFICANT: f64 = 0.05;

/// Counts successes over the values of each axis and of each pair of axes.
///
/// A simulation counts for an axis only if the axis has an effect in its scenario, because it is
/// nominal in all others.
///
/// # Example
/// ```
/// use mishandle_evaluation::AxisRateCounter;
/// use mishandle_rollout::{Axis, Scenario, Space};
/// # fn main() -> Result<(), mishandle_rollout::RolloutError> {
/// let space = Space::new("starts", vec![Axis::start("x", "m", 0.0, 1.0)])?;
/// let mut counter = AxisRateCounter::new(&space, 100);
/// for i in 0..100 {
///     let x = f64::from(i) / 100.0;
///     counter.add_verdict(&Scenario::from([x]), Some(x < 0.8));
/// }
/// let found = counter.report().expect("the simulations have verdicts");
/// let last = &found.axes[0].bins[4];
/// assert_eq!((last.values.low, last.success_rate.value, last.differs), (0.8, Some(0.0), true));
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct AxisRateCounter {
    space: Space,
    /// Indices of the axes with rates, and their bins.
    axes: Vec<(usize, Vec<ValueRange>)>,
    counts: Vec<Vec<Count>>,
    /// Indices of axes, their bins, and counts row by row.
    pairs: Vec<Pair>,
    /// Bins of the axes in pairs; `None` for an axis that is in none.
    pair_bins: Vec<Option<Vec<ValueRange>>>,
    all: Count,
    verdicts: u64,
    is_any_time: bool,
}

/// Number of simulations, and of those that succeed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Count {
    pub n: u64,
    pub successes: u64,
}

impl Count {
    fn add(&mut self, is_success: bool) {
        self.n += 1;
        self.successes += u64::from(is_success);
    }

    pub(crate) fn sum<'a>(counts: impl IntoIterator<Item = &'a Count>) -> Count {
        counts.into_iter().fold(Count::default(), |sum, count| Count {
            n: sum.n + count.n,
            successes: sum.successes + count.successes,
        })
    }
}

#[derive(Clone, Debug)]
struct Pair {
    axes: [usize; 2],
    counts: Vec<Count>,
}

impl AxisRateCounter {
    /// Makes a counter for about `simulations` simulations from random scenarios of a space.
    pub fn new(space: &Space, simulations: u64) -> AxisRateCounter {
        let size = usize::from(simulations >= MANY);
        let bins =
            |axis: &Axis, numbers: (usize, usize), categories: usize| match (axis.levels(), &axis.values) {
                _ if axis.is_fixed() => None,
                (_, AxisValues::Categorical(names)) => {
                    (names.len() <= categories).then(|| category_bins(axis, names))
                }
                (Some(levels), _) => {
                    let (parts, single) = numbers;
                    Some(whole_number_bins(axis, levels, if levels <= single { levels } else { parts }))
                }
                _ => Some(range_bins(axis, numbers.0)),
            };
        let all = space.axes().iter().enumerate();
        let axes: Vec<(usize, Vec<ValueRange>)> = all
            .filter_map(|(index, axis)| Some((index, bins(axis, (BINS[size], WHOLE_NUMBERS), CATEGORIES)?)))
            .collect();
        let pair_bins: Vec<Option<Vec<ValueRange>>> = if simulations < FEWEST_OF_PAIRS {
            vec![None; space.dimension()]
        } else {
            let parts = BINS_OF_PAIRS[size];
            space.axes().iter().map(|axis| bins(axis, (parts, parts), CATEGORIES_OF_PAIRS)).collect()
        };
        let paired: Vec<(usize, usize)> = (0..)
            .zip(&pair_bins)
            .filter_map(|(index, bins)| Some((index, bins.as_ref()?.len())))
            .take(PAIRED_AXES)
            .collect();
        let pairs = paired.iter().enumerate().flat_map(|(place, (a, rows))| {
            let later = &paired[place + 1..];
            later.iter().map(move |(b, columns)| Pair {
                axes: [*a, *b],
                counts: vec![Count::default(); rows * columns],
            })
        });
        AxisRateCounter {
            space: space.clone(),
            counts: axes.iter().map(|(_, bins)| vec![Count::default(); bins.len()]).collect(),
            pairs: pairs.collect(),
            axes,
            pair_bins,
            all: Count::default(),
            verdicts: 0,
            is_any_time: false,
        }
    }

    /// Chooses intervals that hold at any time if `is_any_time` is `true`, because the results
    /// decide how many simulations there are. A rule that reads the verdicts only does not affect
    /// the tests: given the verdicts, the values of an axis without effect are still random.
    pub fn with_intervals_at_any_time(self, is_any_time: bool) -> AxisRateCounter {
        AxisRateCounter { is_any_time, ..self }
    }

    fn rate(&self, count: &Count) -> Estimate {
        let interval = if self.is_any_time { anytime_rate } else { wilson };
        interval(count.successes, count.n)
    }

    /// Counts the simulation of a random scenario. As in the success rate, one without a verdict is
    /// no success, and an invalid start does not count.
    pub fn add(&mut self, episode: &Episode) {
        if episode.end.counts_in_rates() {
            let verdict = decides_success(episode).then(|| episode.is_success());
            self.add_verdict(&episode.request.scenario, verdict);
        }
    }

    /// Counts a simulation by its verdict; `None` counts as no success.
    pub fn add_verdict(&mut self, scenario: &Scenario, verdict: Option<bool>) {
        let is_success = verdict == Some(true);
        self.all.add(is_success);
        self.verdicts += u64::from(verdict.is_some());
        let mut has_effect = vec![true; self.space.dimension()];
        self.space.inactive(scenario).for_each(|axis| has_effect[axis] = false);
        let value = |axis: usize| scenario.get(axis).filter(|_| has_effect[axis]);
        for ((axis, bins), counts) in self.axes.iter().zip(&mut self.counts) {
            let bin = value(*axis).and_then(|value| bin(&self.space.axes()[*axis], bins, value));
            if let Some(bin) = bin {
                counts[bin].add(is_success);
            }
        }
        let places: Vec<Option<(usize, usize)>> = (0..)
            .zip(&self.pair_bins)
            .map(|(axis, bins)| {
                let bins = bins.as_ref()?;
                Some((bin(&self.space.axes()[axis], bins, value(axis)?)?, bins.len()))
            })
            .collect();
        for Pair { axes: [a, b], counts } in &mut self.pairs {
            if let (Some((row, _)), Some((column, columns))) = (places[*a], places[*b]) {
                counts[row * columns + column].add(is_success);
            }
        }
    }

    /// Returns the rates; `None` for too few simulations, or if none has a verdict or no axis
    /// varies.
    pub fn report(&self) -> Option<AxisRates> {
        if self.all.n < FEWEST || self.verdicts == 0 || self.axes.is_empty() {
            return None;
        }
        let totals: Vec<Count> = self.counts.iter().map(Count::sum).collect();
        let p_value = |count: Count, total: Count| {
            let others = Count { n: total.n - count.n, successes: total.successes - count.successes };
            let row = |count: Count| [count.successes, count.n - count.successes];
            (count.n > 0 && others.n > 0).then(|| fisher_test([row(count), row(others)]))
        };
        let raw: Vec<Option<f64>> = self
            .counts
            .iter()
            .zip(&totals)
            .flat_map(|(counts, total)| counts.iter().map(|count| p_value(*count, *total)))
            .collect();
        let mut adjusted = holm(&raw.iter().flatten().copied().collect::<Vec<_>>()).into_iter();
        let mut p_values = raw.into_iter().map(|p| p.and_then(|_| adjusted.next()));
        let mut axes = Vec::new();
        for (((index, bins), counts), total) in self.axes.iter().zip(&self.counts).zip(&totals) {
            let bins = bins.iter().zip(counts).map(|(values, count)| {
                let p_value = p_values.next().flatten();
                let differs = p_value.is_some_and(|p| p < SIGNIFICANT);
                RateBin { values: values.clone(), success_rate: self.rate(count), p_value, differs }
            });
            let bins = bins.collect();
            let axis = &self.space.axes()[*index];
            let name = axis.name.clone();
            let unit = axis.unit.clone();
            axes.push(AxisRate { axis: name, unit, success_rate: self.rate(total), bins });
        }
        axes.sort_by(|a, b| least(a).total_cmp(&least(b)));
        let (pairs, pairs_tested) = self.pair_rates();
        Some(AxisRates { success_rate: self.rate(&self.all), axes, pairs, pairs_tested })
    }

    /// Returns the pairs with the largest interaction, and the number of pairs that were tested.
    fn pair_rates(&self) -> (Vec<PairRate>, u64) {
        let columns = |pair: &Pair| self.pair_bins[pair.axes[1]].as_ref().map_or(1, Vec::len);
        let mut tested: Vec<(&Pair, Interaction)> = Vec::new();
        for pair in &self.pairs {
            let cells = Cells { counts: &pair.counts, columns: columns(pair) };
            tested.extend(interaction(&cells).map(|found| (pair, found)));
        }
        let adjusted = holm(&tested.iter().map(|(_, found)| found.p_value).collect::<Vec<_>>());
        let count = tested.len() as u64;
        let mut ranked: Vec<_> = tested.into_iter().zip(adjusted).collect();
        ranked.retain(|((_, found), _)| found.share > 0.0);
        ranked.sort_by(|((_, a), _), ((_, b), _)| b.share.total_cmp(&a.share));
        let pair = |((pair, found), p_value): ((&Pair, Interaction), f64)| PairRate {
            axes: pair.axes.map(|axis| self.space.axes()[axis].name.clone()),
            bins: pair.axes.map(|axis| self.pair_bins[axis].clone().unwrap_or_default()),
            interaction: found.share,
            p_value,
            cells: pair
                .counts
                .chunks(columns(pair))
                .map(|row| row.iter().map(|count| self.rate(count)).collect())
                .collect(),
        };
        (ranked.into_iter().take(PAIRS).map(pair).collect(), count)
    }
}

/// Returns the smallest p-value of the bins of an axis.
fn least(axis: &AxisRate) -> f64 {
    axis.bins.iter().filter_map(|bin| bin.p_value).fold(1.0, f64::min)
}

fn category_bins(axis: &Axis, names: &[String]) -> Vec<ValueRange> {
    let bin = |(index, name): (usize, &String)| {
        let value = axis.low + index as f64;
        ValueRange { low: value, high: value, name: Some(name.clone()) }
    };
    names.iter().enumerate().map(bin).collect()
}

/// Returns parts of a range of whole numbers, each with the numbers whose coordinates it contains.
fn whole_number_bins(axis: &Axis, levels: usize, parts: usize) -> Vec<ValueRange> {
    let first = |part: usize| axis.low + (part as f64 / parts as f64 * levels as f64 - 0.5).ceil().max(0.0);
    (0..parts).map(|part| ValueRange { low: first(part), high: first(part + 1) - 1.0, name: None }).collect()
}

fn range_bins(axis: &Axis, parts: usize) -> Vec<ValueRange> {
    let at = |part: usize| axis.at(part as f64 / parts as f64);
    (0..parts).map(|part| ValueRange { low: at(part), high: at(part + 1), name: None }).collect()
}

/// Returns the bin of a value; `None` outside the range.
fn bin(axis: &Axis, bins: &[ValueRange], value: f64) -> Option<usize> {
    let within = (axis.low..=axis.high).contains(&value);
    // A value on a border belongs to the upper bin.
    let above = bins.partition_point(|bin| bin.low <= value);
    above.checked_sub(1).filter(|_| within)
}

#[cfg(test)]
mod tests {
    use mishandle_random::{Seed, Sequence};
    use mishandle_rollout::AxisKind;

    use super::*;

    fn space(axes: Vec<Axis>) -> Space {
        Space::new("starts", axes).expect("the axes are valid")
    }

    /// Counts `n` random scenarios, of which each succeeds with a probability of `rate`.
    fn counted(space: &Space, seed: u64, n: u64, rate: impl Fn(&[f64]) -> f64) -> AxisRates {
        let mut counter = AxisRateCounter::new(space, n);
        let mut noise = Sequence::new(Seed(seed).child(1).0, 0);
        for index in 0..n {
            let scenario = space.sample(Seed(seed), index);
            let values: Vec<f64> = scenario.values().iter().flatten().copied().collect();
            counter.add_verdict(&scenario, Some(noise.uniform() < rate(&values)));
        }
        counter.report().expect("the simulations have verdicts")
    }

    fn unit_axes(names: &[&str]) -> Vec<Axis> {
        names.iter().map(|name| Axis::start(name, "", 0.0, 1.0)).collect()
    }

    #[test]
    fn whole_numbers_and_categories_have_a_bin_each() {
        let names = AxisValues::Categorical(["ice".to_string(), "mud".to_string()].into());
        let axes = vec![
            Axis::start("delay", "steps", 0.0, 3.0).with_values(AxisValues::Integer),
            Axis::start("ground", "", 0.0, 1.0).with_values(names),
            Axis::start("many", "", -3.0, 20.0).with_values(AxisValues::Integer),
            Axis::new(AxisKind::Model, "mass", "kg", [1e-2, 1e3], Some(1.0))
                .with_values(AxisValues::Logarithmic),
            Axis::start("fixed", "", 2.0, 2.0),
        ];
        let found = counted(&space(axes), 1, 400, |values| if values[1] == 1.0 { 0.2 } else { 0.9 });
        let bins = |name: &str| {
            let axis = found.axes.iter().find(|axis| axis.axis == name).expect("the axis varies");
            assert_eq!(axis.bins.iter().map(|bin| bin.success_rate.n).sum::<u64>(), 400, "{name}");
            axis.bins.iter().map(|bin| [bin.values.low, bin.values.high]).collect::<Vec<_>>()
        };
        assert_eq!(bins("delay"), [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]]);
        assert_eq!(bins("ground"), [[0.0, 0.0], [1.0, 1.0]]);
        // 24 numbers in 5 parts: none twice, none left out.
        let many = bins("many");
        assert_eq!((many[0][0], many[4][1]), (-3.0, 20.0));
        assert!(many.windows(2).all(|pair| pair[1][0] == pair[0][1] + 1.0), "{many:?}");
        for (bin, exponent) in bins("mass").iter().zip(-2..) {
            assert!((bin[0].log10() - f64::from(exponent)).abs() < 1e-9, "{bin:?}");
        }
        assert!(found.axes.iter().all(|axis| axis.axis != "fixed"));
        // The axis that decides is the first.
        assert_eq!((found.axes[0].axis.as_str(), found.differing().count()), ("ground", 2));
        assert_eq!(found.axes[0].bins[1].values.name.as_deref(), Some("mud"));
    }

    /// In 200 samples without an effect, at most 5 % may mark a bin. Three standard errors are 4.6
    /// %.
    #[test]
    fn axes_without_an_effect_are_seldom_marked() {
        let space = space(unit_axes(&["a", "b", "c", "d"]));
        let marked =
            (0..200).filter(|seed| counted(&space, *seed, 300, |_| 0.8).differing().count() > 0).count();
        assert!(marked <= 19, "{marked} of 200");
    }

    #[test]
    fn values_of_an_axis_without_an_effect_do_not_count_for_it() {
        use mishandle_rollout::{Condition, Holds};
        let names = ["dry", "wet"].map(String::from);
        let road = Axis::new(AxisKind::Model, "road", "", [0.0, 1.0], Some(0.0));
        let road = road.with_values(AxisValues::Categorical(names.into()));
        let wet = Condition { axis: "road".to_string(), nominal: 0.0, holds: Holds::OneOf([1.0].into()) };
        let depth = Axis::new(AxisKind::Model, "depth", "m", [0.0, 1.0], Some(0.0)).only_if([wet]);
        let found =
            counted(&space(vec![road, depth]), 3, 1000, |values| if values[0] == 1.0 { 0.5 } else { 1.0 });
        let of = |name: &str| found.axes.iter().find(|axis| axis.axis == name).expect("the axis varies");
        let wet = of("road").bins[1].success_rate;
        assert_eq!(of("depth").success_rate, wet);
        assert!(of("road").bins.iter().all(|bin| bin.differs), "{found:?}");
        // The depth does not matter. Its nominal value 0, of the dry road, would mark its first
        // bin.
        assert!(of("depth").bins.iter().all(|bin| !bin.differs), "{found:?}");
    }

    #[test]
    fn few_simulations_and_those_without_a_verdict_have_no_rates() {
        let space = space(unit_axes(&["x"]));
        let mut counter = AxisRateCounter::new(&space, 60);
        for index in 0..60 {
            counter.add_verdict(&space.sample(Seed(0), index), None);
        }
        assert_eq!(counter.report(), None);
        let mut counter = AxisRateCounter::new(&space, 49);
        for index in 0..49 {
            counter.add_verdict(&space.sample(Seed(0), index), Some(true));
        }
        assert_eq!(counter.report(), None);
    }

    /// Success is missing where x and y are both in the upper half: P = 1 - XY with independent X
    /// and Y of mean 1/2. The variance is 3/16, that of E[P | x] and of E[P | y] is 1/16 each, so
    /// the interaction is a third.
    #[test]
    fn the_interaction_of_two_axes_is_the_second_order_sobol_index() {
        let mut axes = unit_axes(&["a", "b", "c"]);
        for axis in axes.iter_mut().take(2) {
            *axis = axis
                .clone()
                .with_values(AxisValues::Categorical(["no".to_string(), "yes".to_string()].into()));
        }
        let rate = |values: &[f64]| 1.0 - values[0] * values[1];
        let found = counted(&space(axes), 5, 20_000, rate);
        let first = &found.pairs[0];
        assert_eq!((first.axes.as_slice(), found.pairs_tested), (["a", "b"].map(String::from).as_slice(), 3));
        assert!((first.interaction - 1.0 / 3.0).abs() < 0.01 && first.interacts(), "{first:?}");
        assert_eq!(first.cells[1][1].value, Some(0.0));
        assert!(found.pairs[1..].iter().all(|pair| pair.interaction < 0.005), "{found:?}");
    }

    /// The effects of both axes add up: at most 5 % of the samples may say that they do not. Three
    /// standard errors of 5 % in 300 samples are 3.8 %.
    #[test]
    fn effects_that_add_up_seldom_look_like_an_interaction() {
        let space = space(unit_axes(&["x", "y"]));
        let rates: [fn(&[f64]) -> f64; 5] = [
            |_| 0.5,
            |_| 0.98,
            |values| 0.3 + 0.3 * values[0] + 0.3 * values[1],
            |values| 1.0 - 0.1 * values[0] * values[0],
            |values| f64::from(u8::from(values[0] > 0.3)),
        ];
        for n in [200, 400, 600, 2000] {
            for (index, rate) in rates.iter().enumerate() {
                let wrong = (0..300)
                    .filter(|seed| counted(&space, *seed, n, rate).pairs.iter().any(PairRate::interacts))
                    .count();
                assert!(wrong <= 26, "n {n}, rate {index}: {wrong} of 300");
            }
        }
    }
}
