//! Ranks the axes of a space by their effect on a result, to choose those that the maps show.

use mishandle::evaluation::{holm, kruskal_wallis};
use mishandle::rollout::Axis;
use mishandle_text::plural;

use crate::html::{number, short, text};

/// Smallest number of values with which axes are ranked. With fewer, chance decides.
const MIN_VALUES: usize = 50;

/// Number of groups of a continuous axis, each with the same number of values.
const GROUPS: usize = 5;

/// Largest number of levels of a discrete axis that are a group each.
const MAX_LEVELS: usize = 8;

/// Level of the tests, after Holm's correction.
const SIGNIFICANT: f64 = 0.01;

/// The axes of a space in the order of their effect.
pub struct Ranking {
    /// The most important axis first, or in the order of the space if there are too few values.
    axes: Vec<RankedAxis>,
    values: usize,
    /// Whether the rows are random scenarios. Others rank nothing.
    is_random: bool,
}

struct RankedAxis {
    axis: usize,
    /// Share of the variance of the ranks of the result that the axis explains.
    share: f64,
    has_effect: bool,
}

impl Ranking {
    /// Ranks the axes with the given indices. `value` returns the value of an axis, `result` the
    /// result of a row. Only `is_random` rows tell an effect: points that a search chose gather
    /// where the result is low, and then every axis seems to explain it.
    pub fn new<T>(
        space: &[Axis],
        axes: &[usize],
        rows: &[T],
        is_random: bool,
        value: impl Fn(&T, usize) -> Option<f64>,
        result: impl Fn(&T) -> Option<f64>,
    ) -> Ranking {
        let values = rows.iter().filter(|row| result(row).is_some()).count();
        let tested: Vec<_> = axes
            .iter()
            .map(|axis| {
                let pairs = rows.iter().filter_map(|row| Some((value(row, *axis)?, result(row)?)));
                kruskal_wallis(&grouped(pairs.collect(), space[*axis].levels()))
            })
            .collect();
        let p_values: Vec<f64> =
            tested.iter().map(|found| found.as_ref().map_or(1.0, |found| found.p_value)).collect();
        let ranked =
            axes.iter().zip(&tested).zip(holm(&p_values)).map(|((axis, found), p_value)| RankedAxis {
                axis: *axis,
                share: found.as_ref().map_or(0.0, |found| found.share),
                has_effect: is_random && values >= MIN_VALUES && p_value < SIGNIFICANT,
            });
        let mut axes: Vec<RankedAxis> = ranked.collect();
        if is_random && values >= MIN_VALUES {
            axes.sort_by(|a, b| b.has_effect.cmp(&a.has_effect).then(b.share.total_cmp(&a.share)));
        }
        Ranking { axes, values, is_random }
    }

    /// Returns the number of ranked axes.
    pub fn len(&self) -> usize {
        self.axes.len()
    }

    /// Returns the indices of the first `n` axes.
    pub fn first(&self, n: usize) -> Vec<usize> {
        self.axes.iter().take(n).map(|ranked| ranked.axis).collect()
    }

    /// Returns the axes for maps of pairs: at most `n`, those with an effect, and at least two.
    pub fn shown(&self, n: usize) -> Vec<usize> {
        let with_effect = self.axes.iter().filter(|ranked| ranked.has_effect).count();
        self.first(if with_effect == 0 { n } else { with_effect.clamp(2, n) })
    }

    /// Returns a sentence on the choice of the `shown` axes, as HTML. `result` names the result,
    /// such as "robustness".
    pub fn sentence(&self, space: &[Axis], shown: usize, result: &str) -> String {
        let all = format!("{} axes", self.axes.len());
        if !self.is_random {
            return format!(
                "The space has {all}. The simulations were not all drawn at random, so they cannot tell which axes have an effect \
                 on {result}; the maps show the first {shown}. Random samples can tell: those of an \
                 evaluation or of the search <code>random</code>."
            );
        }
        if self.values < MIN_VALUES {
            return format!(
                "The space has {all}. {} are too few to rank them ({MIN_VALUES} are needed), so the maps show the first {shown}.",
                plural(self.values as u64, "simulation")
            );
        }
        let with_effect: Vec<&RankedAxis> = self.axes.iter().filter(|ranked| ranked.has_effect).collect();
        if with_effect.is_empty() {
            return format!(
                "The space has {all}. None has an effect on {result} that these simulations show ({TEST}), so the maps show \
                 {shown} of them without a reason to prefer these."
            );
        }
        let one = |ranked: &&RankedAxis| {
            let name = text(&short(&space[ranked.axis].name, 40));
            format!("<code>{name}</code> {} %", number((ranked.share * 100.0).round()))
        };
        let listed: Vec<String> = with_effect.iter().take(shown).map(one).collect();
        let more = match with_effect.len().saturating_sub(shown) {
            0 => String::new(),
            n => format!(" and {n} more"),
        };
        format!(
            "The space has {all}. The axes with an effect on {result} ({TEST}), and the share of the variance of its ranks that each \
             explains alone: {}{more}. An effect of two axes together can be missed.",
            listed.join(", ")
        )
    }
}

const TEST: &str = "Kruskal-Wallis test, Holm's correction, 1 %";

/// Groups results by the values of an axis: by level, or by intervals with the same number of
/// values. Equal values are in one group.
fn grouped(mut pairs: Vec<(f64, f64)>, levels: Option<usize>) -> Vec<Vec<f64>> {
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = pairs.len();
    let is_small = levels.is_some_and(|levels| levels <= MAX_LEVELS);
    let mut groups: Vec<Vec<f64>> = Vec::new();
    let mut done = 0;
    let mut last = None;
    for equal in pairs.chunk_by(|a, b| a.0 == b.0) {
        let interval = (2 * done + equal.len()) * GROUPS / (2 * n);
        if is_small || last != Some(interval) {
            groups.push(Vec::new());
        }
        last = Some(interval);
        if let Some(group) = groups.last_mut() {
            group.extend(equal.iter().map(|(_, result)| *result));
        }
        done += equal.len();
    }
    groups
}

#[cfg(test)]
mod tests {
    use mishandle::rollout::{AxisKind, AxisValues};

    use super::*;

    const N: usize = 200;

    fn axis(name: &str, values: AxisValues) -> Axis {
        let high = match values {
            AxisValues::Integer => 3.0,
            _ => 1.0,
        };
        Axis { values, ..Axis::new(AxisKind::Start, name, "", [0.0, high], None) }
    }

    /// Fractional parts of multiples of irrational numbers: evenly spread and unrelated.
    fn spread(i: usize, root: f64) -> f64 {
        (i as f64 * root.sqrt()).fract()
    }

    /// Ranks four axes: one without effect, one with an effect that is not monotone, one that is
    /// monotone, one with levels.
    fn ranked(n: usize, result: impl Fn(&[f64]) -> f64) -> (Vec<Axis>, Ranking) {
        let space = vec![
            axis("dead", AxisValues::Continuous),
            axis("valley", AxisValues::Continuous),
            axis("slope", AxisValues::Continuous),
            axis("level", AxisValues::Integer),
        ];
        let row =
            |i: usize| vec![spread(i, 2.0), spread(i, 3.0), spread(i, 5.0), (4.0 * spread(i, 7.0)).floor()];
        let rows: Vec<Vec<f64>> = (1..=n).map(row).collect();
        let ranking = Ranking::new(
            &space,
            &[0, 1, 2, 3],
            &rows,
            true,
            |row, axis| Some(row[axis]),
            |row| Some(result(row)),
        );
        (space, ranking)
    }

    #[test]
    fn an_effect_that_is_not_monotone_is_seen_and_an_axis_without_effect_is_not_shown() {
        let (space, ranking) = ranked(N, |row| (row[1] - 0.5).abs());
        assert_eq!(ranking.shown(4), [1, ranking.first(2)[1]]);
        assert!(ranking.axes[0].share > 0.7, "{}", ranking.axes[0].share);
        let sentence = ranking.sentence(&space, 2, "robustness");
        assert!(sentence.contains("<code>valley</code>") && !sentence.contains("dead"), "{sentence}");
        let (_, ranking) = ranked(N, |row| row[2] + if row[3] == 2.0 { 1.0 } else { 0.0 });
        let mut shown = ranking.shown(4);
        shown.sort_unstable();
        assert_eq!(shown, [2, 3]);
    }

    #[test]
    fn few_simulations_and_no_effect_are_said() {
        let (space, ranking) = ranked(49, |row| row[2]);
        assert_eq!(ranking.shown(3), [0, 1, 2]);
        let sentence = ranking.sentence(&space, 3, "robustness");
        assert!(
            sentence.contains("49 simulations are too few") && sentence.contains("first 3"),
            "{sentence}"
        );
        let (space, ranking) = ranked(N, |_| 1.0);
        let sentence = ranking.sentence(&space, 4, "robustness");
        assert!(sentence.contains("None has an effect on robustness"), "{sentence}");
    }

    #[test]
    fn groups_have_equal_sizes_and_do_not_split_equal_values() {
        let sizes = |pairs: Vec<(f64, f64)>, levels| -> Vec<usize> {
            grouped(pairs, levels).iter().map(Vec::len).collect()
        };
        assert_eq!(sizes((0..20).map(|i| (f64::from(i), 0.0)).collect(), None), [4; 5]);
        assert_eq!(sizes((0..20).map(|i| (f64::from(i / 10), 0.0)).collect(), None), [10, 10]);
        assert_eq!(sizes((0..20).map(|i| (f64::from(i % 4), 0.0)).collect(), Some(4)), [5; 4]);
        assert!(sizes(Vec::new(), None).is_empty());
    }
}
