use serde::Serialize;

use crate::Estimate;

/// Success rates over the values of each axis, and over those of the pairs of axes that interact
/// most.
///
/// They count random simulations only: points that a search chose lie where earlier results were
/// low, so their rates say nothing about an axis. A simulation counts for an axis only if the axis
/// has an effect in its scenario.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxisRates {
    /// Success rate over all simulations that count, with its Wilson interval.
    pub success_rate: Estimate,
    /// The axes that vary, those with the smallest p-value first.
    pub axes: Vec<AxisRate>,
    /// The pairs of axes with the largest interaction, largest first; at most 6.
    pub pairs: Vec<PairRate>,
    /// Number of pairs of axes that were tested.
    pub pairs_tested: u64,
}

/// Success rates over the values of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct AxisRate {
    /// Name of the axis.
    pub axis: String,
    /// Unit of its values; empty without one.
    pub unit: String,
    /// Success rate over the simulations in which the axis has an effect.
    pub success_rate: Estimate,
    /// Parts of the range, in ascending order: each category, each of at most 12 whole numbers, or
    /// 5 parts of equal width, 10 from 500 simulations on. A logarithmic axis is divided on its
    /// scale.
    pub bins: Vec<RateBin>,
}

/// Success rate over a part of the range of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RateBin {
    /// The part of the range.
    #[serde(flatten)]
    pub values: ValueRange,
    /// Success rate, with its Wilson interval.
    pub success_rate: Estimate,
    /// P-value of Fisher's exact test that the simulations in the bin succeed as often as all
    /// others of the axis, after Holm's correction for all bins of all axes; `null` if one of both
    /// is empty.
    pub p_value: Option<f64>,
    /// Whether the rate differs from that of the others: a p-value below 0.05.
    pub differs: bool,
}

/// A part of the range of an axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ValueRange {
    /// Lowest value.
    pub low: f64,
    /// Highest value; for a whole number or a category the same as `low`.
    pub high: f64,
    /// Name of the category; missing for a number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
}

/// Success rates over the values of two axes.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct PairRate {
    /// Names of both axes.
    pub axes: [String; 2],
    /// Parts of the range of each axis.
    pub bins: [Vec<ValueRange>; 2],
    /// Fraction of the variance of success that both axes explain together beyond the sum of their
    /// separate effects (second-order Sobol index over the cells), without what chance explains.
    pub interaction: f64,
    /// P-value of a chi-squared test that the effects of both axes add up, after Holm's correction
    /// for all pairs.
    pub p_value: f64,
    /// Success rate in each cell: a row for each bin of the first axis.
    pub cells: Vec<Vec<Estimate>>,
}

impl AxisRates {
    /// Returns the bins whose rates differ, each with its axis.
    pub fn differing(&self) -> impl Iterator<Item = (&AxisRate, &RateBin)> {
        self.axes
            .iter()
            .flat_map(|axis| axis.bins.iter().filter(|bin| bin.differs).map(move |bin| (axis, bin)))
    }
}

impl PairRate {
    /// Returns whether the effects of both axes do not add up: a p-value below 0.05.
    pub fn interacts(&self) -> bool {
        self.p_value < 0.05
    }
}
