//! Whether a round of a hardening is accepted.

use mishandle_evaluation::holm;
use mishandle_results::{Estimate, PairedRates};

/// Level below which a measure counts as worse, after Holm's correction.
const SIGNIFICANT: f64 = 0.05;

/// A measure of two controllers on the same scenarios and seeds.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measure {
    pub name: &'static str,
    pub rates: PairedRates,
}

/// Numbers of corners at which two controllers succeed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CornerCounts {
    pub all: u64,
    pub first: u64,
    pub second: u64,
}

/// A decision with its reason.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Decision {
    pub accepted: bool,
    /// Whether the failure rate in the space has a smaller upper bound than before.
    pub improves: bool,
    pub reason: String,
}

/// Returns the adjusted p-values of measures.
pub(super) fn adjusted(measures: &[Measure]) -> Vec<f64> {
    holm(&measures.iter().map(|measure| measure.rates.p_value).collect::<Vec<_>>())
}

/// Returns the names of the measures in which the second controller is worse at 5 % after Holm's
/// correction, and `corners` if it succeeds at fewer of them.
pub(super) fn worse(measures: &[Measure], corners: Option<CornerCounts>) -> Vec<&'static str> {
    let is_worse = |(measure, p_value): (&Measure, f64)| {
        (measure.rates.second_only < measure.rates.first_only && p_value < SIGNIFICANT)
            .then_some(measure.name)
    };
    let mut names: Vec<&'static str> = measures.iter().zip(adjusted(measures)).filter_map(is_worse).collect();
    names.extend(corners.filter(|corners| corners.second < corners.first).map(|_| "corners"));
    names
}

/// Returns whether the second controller succeeds more often in the space, at 5 % after Holm's
/// correction: by the p-value that the table of the measures shows.
pub(super) fn is_better(measures: &[Measure]) -> bool {
    measures.iter().zip(adjusted(measures)).any(|(measure, p_value)| {
        measure.name == "space"
            && measure.rates.second_only > measure.rates.first_only
            && p_value < SIGNIFICANT
    })
}

/// Decides on a round. `bounds` are the upper bounds of the failure rates in the space, before and
/// after it.
pub(super) fn decide(
    measures: &[Measure],
    corners: Option<CornerCounts>,
    [before, after]: [f64; 2],
    allow: &[String],
) -> Decision {
    let improves = after < before;
    let percent = |rate: f64| format!("{:.2} %", 100.0 * rate);
    let bounds = format!("from {} to {}", percent(before), percent(after));
    if !improves {
        let reason =
            format!("the bound of the failure rate in the space went {bounds}, so it did not improve");
        return Decision { accepted: false, improves, reason };
    }
    let worse = worse(measures, corners);
    let (allowed, refused): (Vec<&str>, Vec<&str>) =
        worse.into_iter().partition(|name| allow.iter().any(|allowed| allowed == name));
    let improved = format!("the bound of the failure rate in the space went {bounds}");
    let reason = match (refused.is_empty(), allowed.is_empty()) {
        (true, true) => format!("{improved}, and no other measure got worse"),
        (true, false) => format!("{improved}; worse, as the plan allows: {}", allowed.join(", ")),
        (false, _) => format!("{improved}, but worse, and not allowed: {}", refused.join(", ")),
    };
    Decision { accepted: refused.is_empty(), improves, reason }
}

/// Returns the upper bound of a failure rate from the success rate.
pub(super) fn failure_bound(success: &Estimate) -> f64 {
    success.low.map_or(1.0, |low| 1.0 - low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mishandle_evaluation::{PairedCounts, sign_test};

    fn measure(name: &'static str, first_only: u64, second_only: u64) -> Measure {
        let counts = PairedCounts { both: 400, first_only, second_only, neither: 100 };
        let [first, second] = counts.rates();
        let p_value = sign_test(first_only, second_only);
        let rates =
            PairedRates { first, second, difference: counts.difference(), first_only, second_only, p_value };
        Measure { name, rates }
    }

    fn accepted(measures: &[Measure], corners: Option<[u64; 2]>, bounds: [f64; 2], allow: &[&str]) -> bool {
        let corners = corners.map(|[first, second]| CornerCounts { all: 4, first, second });
        let allow: Vec<String> = allow.iter().map(|name| (*name).to_string()).collect();
        decide(measures, corners, bounds, &allow).accepted
    }

    #[test]
    fn a_round_needs_a_smaller_bound_and_nothing_worse_that_is_not_allowed() {
        let better = [measure("space", 3, 60), measure("strict", 0, 5)];
        assert!(accepted(&better, None, [0.2, 0.1], &[]));
        assert!(!accepted(&better, None, [0.1, 0.1], &[]), "no improvement");
        // 12 against 1: p = 2 (1 + 13) / 2^13 = 0.0034, adjusted 0.0068.
        let worse = [measure("space", 3, 60), measure("strict", 12, 1)];
        assert!(!accepted(&worse, None, [0.2, 0.1], &[]));
        assert!(accepted(&worse, None, [0.2, 0.1], &["strict"]));
        let holds = [measure("space", 3, 60), measure("strict", 5, 0)];
        assert!(accepted(&holds, None, [0.2, 0.1], &[]), "p = 2 / 2^5 = 0.0625");
    }

    #[test]
    fn corners_are_counted_not_tested() {
        let better = [measure("space", 3, 60)];
        assert!(!accepted(&better, Some([4, 3]), [0.2, 0.1], &[]));
        assert!(accepted(&better, Some([4, 3]), [0.2, 0.1], &["corners"]));
        assert!(accepted(&better, Some([3, 4]), [0.2, 0.1], &[]));
    }

    #[test]
    fn several_measures_share_the_error() {
        // p = 2 (1 + 10) / 2^10 = 0.0215 alone, and 0.064 as the smallest of three.
        let one = measure("strict", 9, 1);
        assert!(!accepted(std::slice::from_ref(&one), None, [0.2, 0.1], &[]));
        let three = [one, measure("careful", 1, 1), measure("noise", 1, 1)];
        assert!(accepted(&three, None, [0.2, 0.1], &[]));
        // Better is as hard to show as worse.
        let alone = measure("space", 1, 9);
        assert!(is_better(std::slice::from_ref(&alone)));
        assert!(!is_better(&[alone, measure("careful", 1, 1), measure("noise", 1, 1)]));
        assert!(!is_better(&[measure("strict", 3, 60)]), "another measure");
    }
}
