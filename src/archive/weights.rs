//! Failures as scenarios to train on, each with its weight.

use std::fmt::Write as _;

use mishandle_rollout::{Axis, AxisKind, AxisValues};

/// A scenario that a search simulated.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Simulated {
    /// One value per axis; `None` if it was drawn at random.
    pub scenario: Vec<Option<f64>>,
    /// Random seed of the simulation.
    pub seed: u64,
    /// Robustness of the requirement; negative or −0 for a failure.
    pub robustness: f64,
    /// Failure mode, if it is known.
    pub mode: Option<usize>,
}

/// Share of the weight that scenarios get which passed, but least of all: without them, training
/// could forget what it can already do there.
const PASSED: f64 = 1.0 / 3.0;

/// Largest number of scenarios. Those left out have the smallest weights.
const SCENARIOS: usize = 20_000;

/// Returns the weights of scenarios to train on, and the scenarios: all failures, and as many of
/// those that passed with the least robustness. Of more than 20,000, the heaviest.
///
/// All failure modes weigh the same, however many failures a search found of each. Within a mode,
/// the weight of a failure is inversely proportional to its rank by violation, as in prioritized
/// level replay.
///
/// # Reference
/// Jiang, Grefenstette and Rocktäschel, "Prioritized Level Replay", ICML 2021.
pub(crate) fn weighted(simulated: &[Simulated]) -> Vec<(f64, &Simulated)> {
    let mut ordered: Vec<&Simulated> = simulated.iter().collect();
    ordered.sort_by(|a, b| a.robustness.total_cmp(&b.robustness));
    let (failures, passed): (Vec<&Simulated>, Vec<&Simulated>) =
        ordered.into_iter().partition(|found| found.robustness.is_sign_negative());
    let mut modes: Vec<Option<usize>> = failures.iter().map(|found| found.mode).collect();
    modes.sort_unstable();
    modes.dedup();
    let mut weights = Vec::new();
    for mode in &modes {
        let of_mode = failures.iter().filter(|found| found.mode == *mode);
        weights.extend(by_rank(of_mode.copied(), (1.0 - PASSED) / modes.len() as f64));
    }
    weights.extend(by_rank(passed.into_iter().take(failures.len()), PASSED));
    if weights.len() > SCENARIOS {
        weights.sort_by(|(a, _), (b, _)| b.total_cmp(a));
        weights.truncate(SCENARIOS);
    }
    weights
}

/// Shares a weight by rank.
fn by_rank<'a>(
    ordered: impl Iterator<Item = &'a Simulated>,
    weight: f64,
) -> impl Iterator<Item = (f64, &'a Simulated)> {
    let ordered: Vec<&Simulated> = ordered.collect();
    let whole: f64 = (1..=ordered.len()).map(|rank| 1.0 / rank as f64).sum();
    (1..).zip(ordered).map(move |(rank, found)| (weight / (f64::from(rank) * whole), found))
}

/// Returns weighted scenarios as the text of a file of scenarios for training. A random value is an
/// empty cell.
pub(crate) fn csv(axes: &[Axis], weighted: &[(f64, &Simulated)]) -> String {
    let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
    let mut text = format!("weight,{}\n", names.join(","));
    for (weight, found) in weighted {
        let cells: Vec<String> =
            axes.iter().zip(&found.scenario).map(|(axis, value)| cell(axis, *value)).collect();
        // Writing to a text cannot fail.
        let _ = writeln!(text, "{weight},{}", cells.join(","));
    }
    text
}

/// Returns whether a fault of a scenario shows NaN to the policy. No policy can learn from it.
pub(crate) fn shows_nan(axes: &[Axis], scenario: &[Option<f64>]) -> bool {
    let is_nan =
        |(axis, value): (&Axis, &Option<f64>)| axis.kind == AxisKind::Fault && cell(axis, *value) == "nan";
    axes.iter().zip(scenario).any(is_nan)
}

fn cell(axis: &Axis, value: Option<f64>) -> String {
    match (value, &axis.values) {
        (None, _) => String::new(),
        (Some(value), AxisValues::Categorical(names)) => {
            names.get((value - axis.low) as usize).cloned().unwrap_or_default()
        }
        (Some(value), _) => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulated(robustness: f64, mode: Option<usize>) -> Simulated {
        Simulated { scenario: vec![Some(robustness), None], seed: 1, robustness, mode }
    }

    #[test]
    fn modes_weigh_the_same_and_ranks_share_the_weight_of_a_mode() {
        // Mode 0 has two failures, mode 1 one. Of those that passed, the three nearest count.
        let all = [
            simulated(-0.1, Some(0)),
            simulated(5.0, None),
            simulated(-0.4, Some(0)),
            simulated(-0.2, Some(1)),
            simulated(1.0, None),
            simulated(2.0, None),
            simulated(3.0, None),
        ];
        let found: Vec<(f64, f64)> =
            weighted(&all).into_iter().map(|(weight, found)| (found.robustness, weight)).collect();
        let third = 1.0 / 3.0;
        // 1 + 1/2, and 1 + 1/2 + 1/3 = 11/6.
        let expected = [
            (-0.4, third / 1.5),
            (-0.1, third / 3.0),
            (-0.2, third),
            (1.0, third * 6.0 / 11.0),
            (2.0, third * 3.0 / 11.0),
            (3.0, third * 2.0 / 11.0),
        ];
        assert_eq!(found.len(), expected.len());
        for ((rho, weight), (expected_rho, expected)) in found.iter().zip(expected) {
            assert_eq!(*rho, expected_rho);
            assert!((weight - expected).abs() < 1e-12, "{rho}: {weight}");
        }
        assert!(weighted(&[]).is_empty());
        assert!(weighted(&[simulated(1.0, None)]).is_empty(), "nothing failed");
        assert_eq!(weighted(&[simulated(-0.0, None)]).len(), 1, "−0 is a failure");
    }

    #[test]
    fn the_largest_archive_is_a_file_that_training_reads() {
        let axes: Vec<Axis> = (0..100)
            .map(|number| Axis::start(&format!("a_long_name_of_an_axis_{number}"), "m", 0.0, 1.0))
            .collect();
        let one = |number: usize| Simulated {
            scenario: vec![Some(1.0 / 3.0 + number as f64); axes.len()],
            ..simulated(-1.0 - number as f64, Some(number % 3))
        };
        let all: Vec<Simulated> = (0..SCENARIOS + 500).map(one).collect();
        let weighted = weighted(&all);
        assert_eq!(weighted.len(), SCENARIOS);
        let lightest = weighted.iter().map(|(weight, _)| *weight).fold(f64::INFINITY, f64::min);
        assert!(lightest < 1e-3 * weighted[0].0, "the lightest are left out");
        assert!(csv(&axes, &weighted).len() < mishandle_files::limits::SCENARIOS as usize);
    }

    #[test]
    fn a_file_names_axes_and_categories_and_leaves_random_values_open() {
        let names = ["none", "bias"].map(String::from);
        let kind = Axis::new(AxisKind::Fault, "kind", "", [0.0, 1.0], Some(0.0));
        let axes = [Axis::start("x", "m", 0.0, 1.0), kind.with_values(AxisValues::Categorical(names.into()))];
        let found = [
            Simulated { scenario: vec![Some(0.1), Some(1.0)], ..simulated(-1.0, None) },
            Simulated { scenario: vec![None, Some(0.0)], ..simulated(-1.0, None) },
        ];
        let weighted = [(0.5, &found[0]), (0.25, &found[1])];
        assert_eq!(csv(&axes, &weighted), "weight,x,kind\n0.5,0.1,bias\n0.25,,none\n");
    }
}
