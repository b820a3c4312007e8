//! The costs of a question as text, which stand before its first simulation.

use mishandle::check::CheckCost;
use mishandle::run::{Cost, Probes};
use mishandle_text::plural;

/// Says how many simulations a question takes.
pub fn text(cost: &Cost) -> String {
    let further = match cost.of_counterexample {
        0 => String::new(),
        n => format!(", about {n} more for each failure"),
    };
    format!("at most {}{further}", plural(cost.simulations, "simulation"))
}

/// Says how many simulations a check takes.
pub fn check_text(cost: &CheckCost) -> String {
    let searched = match cost.searched {
        0 => String::new(),
        n => format!(" and {n} of searches"),
    };
    format!(
        "{}: {}{searched}; besides, probes before each run, and about {} for each violation",
        text(&Cost { simulations: cost.simulations(), of_counterexample: 0 }),
        plural(cost.random, "random scenario"),
        cost.of_violation
    )
}

/// Says about how long they take; `None` without a probe. `earlier` is the number of probes before
/// those that were timed.
pub fn time_text(cost: &Cost, probes: &Probes, earlier: u64) -> Option<String> {
    let seconds = probes.estimate(cost.simulations)?;
    Some(format!("after {}: about {}", plural(earlier + probes.simulations, "probe"), about(seconds)))
}

/// Names a duration in its largest unit.
fn about(seconds: f64) -> String {
    match seconds {
        ..1.0 => "a second or less".to_string(),
        ..90.0 => plural(seconds.round() as u64, "second"),
        ..5400.0 => plural((seconds / 60.0).round() as u64, "minute"),
        _ => plural((seconds / 3600.0).round() as u64, "hour"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_says_its_largest_number_of_simulations_and_about_its_time() {
        let cost = Cost { simulations: 900, of_counterexample: 30 };
        assert_eq!(text(&cost), "at most 900 simulations, about 30 more for each failure");
        assert_eq!(time_text(&cost, &Probes::default(), 2), None);
        let cost = Cost { simulations: 1, of_counterexample: 0 };
        assert_eq!(text(&cost), "at most 1 simulation");
        for (seconds, expected) in
            [(0.1, "a second or less"), (20.0, "20 seconds"), (600.0, "10 minutes"), (8000.0, "2 hours")]
        {
            let probes = Probes { simulations: 2, seconds };
            assert_eq!(time_text(&cost, &probes, 2), Some(format!("after 4 probes: about {expected}")));
        }
    }
}
