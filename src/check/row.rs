//! The verdict of a requirement, from the simulations of all runs.

use std::path::PathBuf;

use mishandle_evaluation::{clopper_pearson, count_end};
use mishandle_requirements::WrittenRequirement;
use mishandle_results as results;
use mishandle_results::{
    CheckCell, CheckCounts, CheckVerdict, EndCounts, Estimate, Number, Vacuous, WithoutVerdict,
};
use mishandle_store::{RunFile, Simulation};
use mishandle_text::{decimal, number_text, plural};

use crate::error::MishandleError;
use crate::plan::{EvaluatePlan, Plan};
use crate::run::open_text;
use crate::run::rows::{REQUIREMENT, episode_end};
use crate::run::{OneTrace, asks_nothing};

/// Two one-sided 95 % bounds.
const CONFIDENCE: f64 = 0.9;

/// Numbers of random scenarios that the file of requirements states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct StatedEpisodes {
    /// That of a requirement; `None` if it states none.
    own: Option<u64>,
    /// The largest of the requirements in its space, which share their random scenarios.
    largest: u64,
}

impl StatedEpisodes {
    /// The numbers of a requirement and of all in its space.
    pub fn new<'a>(
        written: &WrittenRequirement,
        same_space: impl Iterator<Item = &'a WrittenRequirement>,
    ) -> StatedEpisodes {
        let largest = same_space.map(stated_episodes).max().unwrap_or_default();
        StatedEpisodes { own: written.check.episodes, largest }
    }
}

/// Returns the number of random scenarios that a requirement asks for.
pub(super) fn stated_episodes(written: &WrittenRequirement) -> u64 {
    written.check.episodes.unwrap_or(EvaluatePlan::default().episodes)
}

/// Numbers and the worst simulation of all runs for a requirement.
#[derive(Debug, Default)]
pub(super) struct Row {
    /// Name of the requirement.
    name: String,
    stated: StatedEpisodes,
    /// Number of random scenarios of the plan.
    episodes: u64,
    random: CheckCounts,
    searched: CheckCounts,
    /// Largest share of the simulations without a verdict that allows a conclusion.
    max_share: f64,
    minimum: Option<Number>,
    /// The first simulation without a verdict, and why it has none.
    unclear: Option<String>,
    /// Its formula.
    formula: String,
    /// The simulations that ask nothing of the controller.
    vacuous: Vacuous,
    /// Whether all simulations have one trace.
    one: OneTrace,
    /// Path, trial and number of the simulation with the minimum robustness.
    pub worst: Option<(PathBuf, u32, u32)>,
}

impl Row {
    pub fn new(name: &str, stated: StatedEpisodes) -> Row {
        Row { name: name.to_string(), stated, ..Row::default() }
    }

    /// Adds a run whose simulations ended so.
    fn add(&mut self, found: &results::Requirement, ends: &EndCounts, run: &RunFile, is_random: bool) {
        let counts = if is_random { &mut self.random } else { &mut self.searched };
        self.formula.clone_from(&found.formula);
        self.vacuous.add_all(found.vacuous);
        counts.simulations += found.simulations;
        counts.violated += found.violated;
        counts.without_verdict += ends.simulations - found.simulations;
        counts.invalid_starts += ends.invalid_starts;
        let place = found.minimum_robustness.zip(found.trial.zip(found.simulation));
        if let Some((robustness, (trial, number))) = place
            && self.minimum.is_none_or(|least| robustness.0.total_cmp(&least.0).is_lt())
        {
            self.minimum = Some(robustness);
            self.worst = Some((run.path().to_path_buf(), trial, number));
        }
    }

    /// Returns the number of simulations that violate it.
    pub fn violated(&self) -> u64 {
        self.random.violated + self.searched.violated
    }

    fn simulations(&self) -> u64 {
        self.random.simulations + self.searched.simulations
    }

    fn without_verdict(&self) -> u64 {
        self.random.without_verdict + self.searched.without_verdict
    }

    /// Returns why the simulations allow no conclusion; `None` if they do. Many of one kind never
    /// make up for the other kind.
    fn obstacle(&self) -> Option<&'static str> {
        let is_searched = self.searched != CheckCounts::default();
        let searched = is_searched.then_some((self.searched, "; no scenario of the searches started"));
        [(self.random, "; no random scenario started")].into_iter().chain(searched).find_map(
            |(CheckCounts { simulations, without_verdict: undecided, .. }, none)| {
                let ends =
                    EndCounts { simulations: simulations + undecided, undecided, ..EndCounts::default() };
                match ends.share() {
                    None => Some(none),
                    Some(_) => WithoutVerdict::new(ends, self.max_share)
                        .is_too_large()
                        .then_some(", too many for a conclusion (max-without-verdict)"),
                }
            },
        )
    }

    /// Returns the failure rate of the random scenarios. Those without a verdict widen the
    /// interval.
    fn failure_rate(&self) -> Estimate {
        let CheckCounts { simulations, violated, without_verdict, .. } = self.random;
        let all = simulations + without_verdict;
        let low = clopper_pearson(violated, all, CONFIDENCE).low;
        let high = clopper_pearson(violated + without_verdict, all, CONFIDENCE).high;
        let value = (simulations > 0).then(|| violated as f64 / all as f64);
        Estimate { value, low, high, n: all }
    }

    /// Returns the cell of a requirement with its largest failure rate, without a counterexample.
    pub fn cell(&self, controller: &str, missing_signals: &[String], limit: Option<f64>) -> CheckCell {
        let is_applicable = missing_signals.is_empty();
        let (verdict, evidence) = if is_applicable {
            self.verdict(limit)
        } else {
            (CheckVerdict::NotApplicable, format!("the target has no signal {}", missing_signals.join(", ")))
        };
        CheckCell {
            requirement: self.name.clone(),
            controller: controller.to_string(),
            verdict,
            evidence,
            missing_signals: missing_signals.to_vec(),
            random: self.random,
            searched: self.searched,
            failure_rate: is_applicable.then(|| self.failure_rate()),
            minimum_robustness: self.minimum,
            counterexample: None,
        }
    }

    /// Returns the verdict and its evidence in a sentence.
    fn verdict(&self, limit: Option<f64>) -> (CheckVerdict, String) {
        let (verdict, mut sentence) = match limit {
            _ if self.simulations() + self.without_verdict() == 0 => {
                (CheckVerdict::NoVerdict, "no simulation started".to_string())
            }
            _ if self.simulations() == 0 => {
                let all = plural(self.without_verdict(), "simulation");
                (CheckVerdict::NoVerdict, format!("none of {all} has a verdict{}", self.why_unclear()))
            }
            Some(limit) => self.verdict_of_rate(limit),
            None if self.violated() > 0 => (CheckVerdict::Violated, self.violations()),
            None => self.verdict_without_violation(),
        };
        if self.simulations() > 0 && self.without_verdict() > 0 {
            let count = plural(self.without_verdict(), "simulation");
            sentence += &format!("; {count} without a verdict{}", self.why_unclear());
        }
        let verdict = match (verdict, self.obstacle()) {
            (CheckVerdict::NotViolated, Some(obstacle)) => {
                sentence += obstacle;
                CheckVerdict::NoVerdict
            }
            (verdict, _) => verdict,
        };
        sentence += &self.why_others();
        let invalid_starts = self.random.invalid_starts + self.searched.invalid_starts;
        if invalid_starts > 0 {
            let left_out = plural(invalid_starts, "scenario");
            sentence += &format!("; left out: {left_out}, from which the target cannot start");
        }
        let reason = asks_nothing(&self.formula, self.vacuous, self.simulations());
        let reason = reason.or_else(|| self.one.reason());
        if let (CheckVerdict::NotViolated, Some(reason)) = (verdict, reason) {
            return (CheckVerdict::AsksNothing, format!("{sentence}; asks nothing: {reason}"));
        }
        (verdict, sentence)
    }

    fn why_unclear(&self) -> String {
        self.unclear.as_ref().map_or(String::new(), |why| format!(" ({why})"))
    }

    /// Says why there are more or fewer random scenarios than the requirement states; empty if
    /// there are as many.
    fn why_others(&self) -> String {
        let Some(own) = self.stated.own.filter(|own| *own != self.episodes && self.episodes > 0) else {
            return String::new();
        };
        let why = if self.episodes == self.stated.largest {
            "requirements in one space share them"
        } else {
            "this number was requested"
        };
        format!("; {} instead of its {own}: {why}", plural(self.episodes, "random scenario"))
    }

    fn verdict_of_rate(&self, limit: f64) -> (CheckVerdict, String) {
        let rate = self.failure_rate();
        let low = rate.low.unwrap_or(0.0);
        let high = rate.high.unwrap_or(1.0);
        let of = self.of_random();
        let between =
            format!("a failure rate from {} to {} (each bound with 95 %)", percent(low), percent(high));
        let limit_text = percent(limit);
        if low > limit {
            (CheckVerdict::Violated, format!("{of}: {between}, above the limit of {limit_text}"))
        } else if high <= limit {
            (CheckVerdict::NotViolated, format!("{of}: {between}, within the limit of {limit_text}"))
        } else {
            (
                CheckVerdict::NoVerdict,
                format!("{of}: {between} does not decide about the limit of {limit_text}"),
            )
        }
    }

    fn violations(&self) -> String {
        match self.random.violated {
            0 => {
                let found = plural(self.searched.violated, "violation");
                format!("searches found {found} in {}", plural(self.searched.simulations, "simulation"))
            }
            _ => {
                let low = self.failure_rate().low.unwrap_or(0.0);
                format!("{}: a failure rate of at least {} (95 %)", self.of_random(), percent(low))
            }
        }
    }

    fn of_random(&self) -> String {
        let CheckCounts { simulations, violated, without_verdict, .. } = self.random;
        format!("{violated} of {} violate it", plural(simulations + without_verdict, "random scenario"))
    }

    /// A simulation without a verdict can hide a violation, so the bound counts it as one.
    fn verdict_without_violation(&self) -> (CheckVerdict, String) {
        let searched = match self.searched.simulations {
            0 => String::new(),
            searched => format!(" and {searched} of searches"),
        };
        let none =
            format!("no violation in {}{searched}", plural(self.random.simulations, "random simulation"));
        let high = percent(self.failure_rate().high.unwrap_or(1.0));
        (
            CheckVerdict::NotViolated,
            format!("{none}: a failure rate of at most {high} in random scenarios (95 %)"),
        )
    }
}

/// Adds what a run found about the requirements in its space. Returns how its simulations ended,
/// which have a verdict if each of these requirements has one.
pub(super) fn add(
    rows: &mut [Row],
    found: &[results::Requirement],
    run: &RunFile,
    is_random: bool,
) -> Result<EndCounts, MishandleError> {
    let header = run.header();
    let column = |row: &Row| {
        let is_own = |verdict: &String| verdict.strip_prefix(REQUIREMENT) == Some(row.name.as_str());
        header.verdicts.iter().position(is_own)
    };
    let columns: Vec<Option<usize>> = rows.iter().map(column).collect();
    let mut ends = EndCounts::default();
    for simulation in run.simulations() {
        let simulation = simulation?;
        let end = episode_end(simulation.end);
        let mut has_all = true;
        for (row, column) in rows.iter_mut().zip(&columns) {
            let is_open = |column: &usize| simulation.verdicts.get(*column).copied().flatten().is_none();
            let Some(column) = column else { continue };
            let is_open = is_open(column);
            row.one.add(&simulation, !is_open);
            has_all &= !is_open;
            if is_open && end.counts_in_rates() {
                row.unclear.get_or_insert_with(|| unclear(&simulation, run));
            }
        }
        count_end(&mut ends, end, has_all, 1);
    }
    let plan = Plan::from_toml(&header.plan)?;
    for row in rows {
        row.max_share = plan.max_without_verdict;
        if let Some(found) = found.iter().find(|found| found.name == row.name) {
            row.episodes = plan.evaluate.as_ref().map_or(row.episodes, |evaluate| evaluate.episodes);
            row.add(found, &ends, run, is_random);
        }
    }
    Ok(ends)
}

/// Names a simulation without a verdict of a requirement, and says why it has none.
fn unclear(simulation: &Simulation, run: &RunFile) -> String {
    let signals: Vec<&str> = run.header().signals.iter().map(|signal| signal.name.as_str()).collect();
    let Simulation { trial, number, end, .. } = *simulation;
    let why = open_text(episode_end(end), &signals);
    let file = run.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
    format!("first in {file}, trial {trial}, simulation {number}: {why}")
}

/// Formats a share. Small ones keep two digits.
fn percent(share: f64) -> String {
    let value = 100.0 * share;
    let decimals = if value == 0.0 || value >= 1.0 { 1 } else { (-value.log10()).ceil() as usize + 1 };
    // More digits would be unreadable.
    if decimals > 9 { number_text(share) } else { format!("{} %", decimal(value, decimals)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(random: [u64; 3], searched: [u64; 3]) -> Row {
        let counts = |[simulations, violated, without_verdict]: [u64; 3]| CheckCounts {
            simulations,
            violated,
            without_verdict,
            invalid_starts: 0,
        };
        let max_share = Plan::MAX_WITHOUT_VERDICT;
        Row { random: counts(random), searched: counts(searched), max_share, ..Row::default() }
    }

    #[test]
    fn without_a_violation_the_rate_has_the_bound_of_the_rule_of_three() {
        let found = row([299, 0, 0], [300, 0, 0]);
        // 299 simulations without a failure are the fewest that show a rate below 1 %.
        assert!(found.failure_rate().high.expect("simulated") < 0.01);
        assert_eq!(found.verdict(None).0, CheckVerdict::NotViolated);
        assert_eq!(found.verdict(Some(0.01)).0, CheckVerdict::NotViolated);
        assert_eq!(row([298, 0, 0], [0; 3]).verdict(Some(0.01)).0, CheckVerdict::NoVerdict);
    }

    #[test]
    fn a_limit_is_violated_only_if_the_rate_is_surely_above_it() {
        // The upper bounds of 1 and 2 of 100 are 4.7 % and 6.2 %: the 95 % quantiles of the beta
        // distributions (2, 99) and (3, 98).
        assert_eq!(row([100, 1, 0], [0; 3]).verdict(Some(0.05)).0, CheckVerdict::NotViolated);
        assert_eq!(row([100, 2, 0], [0; 3]).verdict(Some(0.05)).0, CheckVerdict::NoVerdict);
        assert_eq!(row([100, 50, 0], [0; 3]).verdict(Some(0.05)).0, CheckVerdict::Violated);
        assert_eq!(row([100, 1, 0], [0; 3]).verdict(None).0, CheckVerdict::Violated);
    }

    #[test]
    fn a_share_is_never_shown_as_zero() {
        assert_eq!([0.25, 1e-9, 1e-320].map(percent), ["25.0 %", "0.00000010 %", "1e-320"]);
    }

    #[test]
    fn a_simulation_without_a_verdict_never_helps() {
        let clean = row([1000, 0, 0], [0; 3]);
        let unclear = row([900, 0, 100], [0; 3]);
        assert_eq!(clean.verdict(Some(0.05)).0, CheckVerdict::NotViolated);
        assert_eq!(unclear.verdict(Some(0.05)).0, CheckVerdict::NoVerdict);
        // Without a limit on the rate, too many prevent a conclusion, also of a search, and fewer
        // widen the bound as violations do. A plan can allow none.
        assert_eq!(clean.verdict(None).0, CheckVerdict::NotViolated);
        for found in [
            row([940, 0, 60], [0; 3]),
            row([100, 0, 0], [90, 0, 11]),
            row([1000, 0, 0], [0, 0, 1]),
            row([1, 0, 1], [1000, 0, 0]),
        ] {
            let (verdict, evidence) = found.verdict(None);
            assert_eq!(verdict, CheckVerdict::NoVerdict);
            assert!(evidence.ends_with("too many for a conclusion (max-without-verdict)"), "{evidence}");
        }
        for found in [row([999, 0, 1], [0; 3]), row([1000, 0, 0], [19, 0, 1])] {
            let (verdict, evidence) = found.verdict(None);
            assert_eq!(verdict, CheckVerdict::NotViolated);
            assert!(evidence.ends_with("; 1 simulation without a verdict"), "{evidence}");
            let strict = Row { max_share: 0.0, ..found };
            assert_eq!(strict.verdict(None).0, CheckVerdict::NoVerdict);
        }
        let [few, violated] =
            [[999, 0, 1], [1000, 1, 0]].map(|counts| row(counts, [0; 3]).failure_rate().high);
        assert_eq!(few, violated);
        assert_eq!(row([600, 0, 400], [0; 3]).verdict(Some(0.5)).0, CheckVerdict::NoVerdict);
        // With a limit, it counts as a violation.
        assert_eq!(row([999, 0, 1], [0; 3]).verdict(Some(0.05)).0, CheckVerdict::NotViolated);
        // It takes no violation away.
        assert_eq!(row([900, 1, 100], [0; 3]).verdict(None).0, CheckVerdict::Violated);
        assert_eq!(
            row([0, 0, 10], [0, 0, 5]).verdict(None),
            (CheckVerdict::NoVerdict, "none of 15 simulations has a verdict".into())
        );
    }

    /// Only the random scenarios show a failure rate, and none of them started.
    #[test]
    fn a_scenario_without_a_start_is_in_every_sentence_and_supports_no_conclusion() {
        let left_out = "; left out: 7 scenarios, from which the target cannot start";
        for (searched, expected) in [
            ([0; 3], "no simulation started"),
            ([0, 0, 4], "none of 4 simulations has a verdict"),
            (
                [300, 0, 0],
                "no violation in 0 random simulations and 300 of searches: a failure rate of at most 100.0 % in random \
                 scenarios (95 %); no random scenario started",
            ),
        ] {
            let mut found = row([0; 3], searched);
            found.random.invalid_starts = 7;
            assert_eq!(found.verdict(None), (CheckVerdict::NoVerdict, format!("{expected}{left_out}")));
        }
        let mut violated = row([0; 3], [300, 2, 0]);
        violated.random.invalid_starts = 7;
        assert_eq!(violated.verdict(None).0, CheckVerdict::Violated);
    }
}
