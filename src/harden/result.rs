//! The final comparison of a hardening, and its result.

use std::path::Path;

use mishandle_falsification::has_margin;
use mishandle_results as results;
use mishandle_results::{
    EndCounts, Estimate, HardenedArchive, HardenedCorners, HardenedMargin, HardenedMeasure, HardenedMode,
    HardenedSearch, Hardening, HardeningRound, ModeChange, WithoutVerdict,
};
use mishandle_rollout::{Request, Scenario, Seed};
use mishandle_text::path_text;

use super::decision::{Measure, adjusted, is_better, worse};
use super::measure::{measure, path_of};
use super::search::{search, search_files};
use super::{FINAL, Hardener, Watch};
use crate::archive::ModeKey;
use crate::error::MishandleError;
use crate::plan::{MarginPlan, Plan, RiskPlan};
use crate::resolve::ResolvedPlan;
use crate::resolve::guard::guard_facts;

/// A controller in the final comparison.
struct Judged {
    measured: super::measure::Measured,
    /// How the random simulations in the space ended.
    ends: EndCounts,
    failure_probability: Estimate,
    /// Upper bound of it that assumes nothing.
    bound: f64,
    /// `None` in a space without disturbances.
    margin: Option<HardenedMargin>,
    search: HardenedSearch,
    modes: Vec<(ModeKey, u64)>,
}

/// Number of simulations of a batch.
const BATCH: usize = 256;

impl Hardener<'_> {
    /// Simulates the final set and makes the result. Returns `None` if it was interrupted.
    pub(super) fn conclude(
        &self,
        before: &Path,
        after: Option<&Path>,
        out: &Path,
        rounds: Vec<HardeningRound>,
        watch: Watch<'_>,
    ) -> Result<Option<Hardening>, MishandleError> {
        let Some(first) = self.judge("before", before, &mut *watch)? else { return Ok(None) };
        let second = match after {
            Some(after) => match self.judge("after", after, &mut *watch)? {
                Some(judged) => Some(judged),
                None => return Ok(None),
            },
            None => None,
        };
        let (measures, corners) = first.measured.compare(&second.as_ref().unwrap_or(&first).measured)?;
        let archive = after.map(|after| self.archive(after, rounds.len() as u32)).transpose()?;
        let is_judged = second.is_some();
        let worse = worse(&measures, corners);
        let of_both = |value: &dyn Fn(&Judged) -> Estimate| -> Vec<Estimate> {
            std::iter::once(&first).chain(&second).map(value).collect()
        };
        let mut ends = first.ends;
        second.iter().for_each(|second| ends.add_all(second.ends));
        let hardening = Hardening {
            target: self.plan.target.clone(),
            space: self.plan.space.clone(),
            seed: results::Seed(self.plan.seed),
            before: self.plan.controller.clone(),
            guard: self.plan.guard.as_ref().map(guard_facts),
            trainer: self.table.trainer.clone(),
            after: after.map(|_| path_text(out)),
            folder: path_text(&self.folder.given),
            commit: first.measured.commit()?,
            without_verdict: WithoutVerdict::new(ends, self.plan.max_without_verdict),
            verdict: verdict(is_judged, &measures, &worse, &first, &rounds),
            worse: worse.into_iter().map(String::from).collect(),
            measures: hardened_measures(&measures, is_judged),
            corners: corners.map(|corners| HardenedCorners {
                corners: corners.all,
                before: corners.first,
                after: is_judged.then_some(corners.second),
            }),
            failure_probability: of_both(&|judged| judged.failure_probability),
            margin: std::iter::once(&first)
                .chain(&second)
                .filter_map(|judged| judged.margin.clone())
                .collect(),
            searches: std::iter::once(&first).chain(&second).map(|judged| judged.search.clone()).collect(),
            modes: second.as_ref().map_or(Vec::new(), |second| modes(&first.modes, &second.modes)),
            archive,
            environment_steps: rounds.iter().map(|round| round.environment_steps).sum(),
            rounds,
            simulations: self.folder.simulations()?,
        };
        self.folder.finish(&hardening)?;
        Ok(Some(hardening))
    }

    /// Simulates a controller on the final set.
    fn judge(
        &self,
        name: &str,
        controller: &Path,
        watch: Watch<'_>,
    ) -> Result<Option<Judged>, MishandleError> {
        let prefix = self.folder.of_final(name);
        let phase = format!("final, {name}");
        let seed = Seed(self.plan.seed).child(FINAL);
        let Some(measured) =
            measure(self, controller, &prefix, seed, self.table.episodes, &phase, &mut *watch)?
        else {
            return Ok(None);
        };
        let plan = |child: u64| Plan {
            controller: path_text(controller),
            seed: seed.child(child).0,
            harden: None,
            ..self.plan.clone()
        };
        let risk = RiskPlan {
            simulations: self.table.risk,
            method: "monte-carlo".to_string(),
            ..RiskPlan::default()
        };
        let margin = MarginPlan { budget: self.table.margin, ..MarginPlan::default() };
        let mut ask = |plan: Plan, name: &str| {
            self.folder.ask(&plan, &path_of(&prefix, name), &format!("{phase}: {name}"), &mut *watch)
        };
        let Some(risk) = ask(Plan { risk: Some(risk), ..plan(1) }, "risk")? else {
            return Ok(None);
        };
        let risk: results::Risk = risk.answer.try_into()?;
        let mut ends = measured.ends();
        ends.add_all(risk.without_verdict.ends);
        let space = ResolvedPlan::new(&plan(0))?.space;
        let margin = if has_margin(&space) {
            match ask(Plan { margin: Some(margin), ..plan(2) }, "margin")? {
                Some(asked) => Some(hardened_margin(&asked.answer.try_into()?)),
                None => return Ok(None),
            }
        } else {
            // Starts alone have no size.
            None
        };
        let prefix = self.folder.of_final(&format!("{name}-search"));
        let Some(searched) = search(self, controller, &prefix, seed.child(3), &phase, watch)? else {
            return Ok(None);
        };
        let (simulated, modes) = searched.simulated()?;
        Ok(Some(Judged {
            measured,
            ends,
            failure_probability: risk.monte_carlo.failure_rate,
            bound: risk.bounds[1],
            margin,
            search: HardenedSearch {
                simulations: searched.simulations()?,
                failures: simulated.iter().filter(|found| found.robustness.is_sign_negative()).count() as u64,
                modes: modes.len() as u64,
            },
            modes,
        }))
    }

    /// Simulates the failures that the rounds found with the controller after.
    fn archive(&self, after: &Path, rounds: u32) -> Result<HardenedArchive, MishandleError> {
        let resolved =
            ResolvedPlan::new(&Plan { controller: path_text(after), harden: None, ..self.plan.clone() })?;
        let mut system = resolved.system()?;
        let mut requests = Vec::new();
        for round in 1..=rounds {
            let found = self.recorded_failures(round)?;
            requests.extend(found.into_iter().map(|(scenario, seed)| Request::new(scenario, Seed(seed))));
        }
        let mut fixed = 0;
        for batch in requests.chunks(BATCH) {
            let episodes = system.rollout(batch)?;
            fixed += episodes.iter().filter(|episode| episode.is_success()).count() as u64;
        }
        Ok(HardenedArchive { failures: requests.len() as u64, fixed })
    }

    /// Returns the failures that the searches of a round found.
    fn recorded_failures(&self, round: u32) -> Result<Vec<(Scenario, u64)>, MishandleError> {
        let prefix = self.folder.of_round(round, "search");
        let mut found = Vec::new();
        for path in search_files(&prefix, self.table) {
            for simulation in mishandle_store::RunFile::open(&path)?.simulations() {
                let simulation = simulation?;
                if simulation.is_violated() {
                    found.push((Scenario::new(simulation.scenario), simulation.seed));
                }
            }
        }
        Ok(found)
    }
}

fn hardened_margin(margin: &results::Margin) -> HardenedMargin {
    HardenedMargin {
        amplitude: margin.witness.as_ref().map(|witness| witness.norms.amplitude),
        without_failure: margin.no_violation_up_to,
        simulations: margin.simulations,
    }
}

fn hardened_measures(measures: &[Measure], is_judged: bool) -> Vec<HardenedMeasure> {
    let measure = |(Measure { name, rates }, adjusted): (&Measure, f64)| HardenedMeasure {
        name: (*name).to_string(),
        before: rates.first,
        after: is_judged.then_some(rates.second),
        difference: is_judged.then_some(rates.difference),
        broken: rates.first_only,
        fixed: rates.second_only,
        p_value: is_judged.then_some(rates.p_value),
        adjusted_p_value: is_judged.then_some(adjusted),
    };
    measures.iter().zip(adjusted(measures)).map(measure).collect()
}

/// Returns the modes of both controllers with what became of them.
fn modes(before: &[(ModeKey, u64)], after: &[(ModeKey, u64)]) -> Vec<HardenedMode> {
    let count = |modes: &[(ModeKey, u64)], key: &ModeKey| {
        modes.iter().find(|(known, _)| known == key).map_or(0, |(_, count)| *count)
    };
    let mut keys: Vec<&ModeKey> = before.iter().chain(after).map(|(key, _)| key).collect();
    let mut seen = Vec::new();
    keys.retain(|key| {
        let is_new = !seen.contains(key);
        seen.push(*key);
        is_new
    });
    let mode = |key: &ModeKey| {
        let before = count(before, key);
        let after = count(after, key);
        HardenedMode {
            predicate: key.0.clone(),
            axes: key.1.clone(),
            change: ModeChange::new(before, after),
            before,
            after,
        }
    };
    keys.into_iter().map(mode).collect()
}

/// Returns the result in a sentence. What got worse comes first.
fn verdict(
    is_judged: bool,
    measures: &[Measure],
    worse: &[&str],
    before: &Judged,
    rounds: &[HardeningRound],
) -> String {
    if !is_judged {
        let found_nothing = rounds.iter().all(|round| round.failures == 0);
        return if found_nothing && before.failure_probability.value == Some(0.0) {
            let none = match before.ends.total() {
                0 => "Nothing to fix: no simulation in the space fails",
                _ => "No simulation in the space with a verdict fails",
            };
            format!("{none}, so its failure probability is at most {:.2} % (97.5 %).", 100.0 * before.bound)
        } else {
            "No improvement: no round was accepted.".to_string()
        };
    }
    let space = measures.iter().find(|measure| measure.name == "space");
    let rates = space.map_or(String::new(), |Measure { rates, .. }| {
        let failure = |rate: Estimate| rate.value.map_or(f64::NAN, |success| 100.0 * (1.0 - success));
        format!(
            "{:.1} % instead of {:.1} % of the scenarios in the space fail",
            failure(rates.second),
            failure(rates.first)
        )
    });
    let doubt = format!("The final set does not confirm an improvement: {rates}.");
    match (worse.is_empty(), is_better(measures)) {
        (true, true) => format!("Better: {rates}, and no other measure is worse."),
        (true, false) => doubt,
        (false, true) => format!("Worse: {}. Otherwise {rates}.", worse.join(", ")),
        (false, false) => format!("Worse: {}. {doubt}", worse.join(", ")),
    }
}
