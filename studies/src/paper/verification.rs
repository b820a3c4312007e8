//! Which units are run again, and what must be the same before a digest can be compared.

use mishandle::ResolvedPlan;
use mishandle::build::build;
use mishandle::rollout::Seed;

use crate::paper::results::{CampaignResults, Results, RunResults};
use crate::paper::unit::Unit;

/// A unit to run again.
#[derive(Clone, Copy, Debug)]
pub struct SampledUnit<'a> {
    /// The campaign of the run.
    pub campaign: &'a CampaignResults,
    /// The run of the unit.
    pub run: &'a RunResults,
    /// The unit.
    pub unit: &'a Unit,
}

impl Results {
    /// Returns a random share of the units of each campaign, at least one, in the order of the
    /// results. Units that only another engine or question can run are left out.
    pub fn sample(&self, share: f64, seed: Seed) -> Vec<SampledUnit<'_>> {
        let campaigns = (0..).zip(&self.campaigns);
        campaigns.flat_map(|(index, campaign)| campaign.sample(share, seed.child(index))).collect()
    }
}

impl CampaignResults {
    fn sample(&self, share: f64, seed: Seed) -> Vec<SampledUnit<'_>> {
        let can_run = |run: &&RunResults| {
            (run.plan.evaluate.is_some() || run.plan.falsify.is_some()) && run.plan.screening.is_none()
        };
        let units = self
            .runs
            .iter()
            .filter(can_run)
            .flat_map(|run| run.units.iter().map(move |unit| SampledUnit { campaign: self, run, unit }));
        let units: Vec<SampledUnit<'_>> = units.filter(|sampled| sampled.unit.simulations > 0).collect();
        let size = ((share * units.len() as f64).round() as usize).max(1);
        // The units with the smallest random numbers are a sample without replacement.
        let mut numbered: Vec<(u64, usize)> = (0..units.len()).map(|i| (seed.child(i as u64).0, i)).collect();
        numbered.sort_unstable();
        let mut chosen: Vec<usize> = numbered.into_iter().take(size).map(|(_, i)| i).collect();
        chosen.sort_unstable();
        chosen.into_iter().map(|i| units[i]).collect()
    }
}

impl RunResults {
    /// Lists the facts on which the simulations depend and that differ from those of this program.
    pub fn differences(&self, resolved: &ResolvedPlan) -> Vec<String> {
        let facts = &self.facts;
        let target = &resolved.target;
        let now = build();
        let versions = |versions: &[(String, String)]| {
            versions.iter().map(|(name, version)| format!("{name} {version}")).collect::<Vec<_>>().join(", ")
        };
        let controller = target.components.first().map_or(String::new(), |part| part.hash.clone());
        let pairs = [
            ("hash of the target", facts.target_hash.clone(), target.identity.hash.clone()),
            ("hash of the controller", facts.controller_hash.clone(), controller),
            ("formula", facts.formula.clone(), resolved.specification.requirement.to_string()),
            ("versions", versions(&facts.versions), versions(&target.versions)),
            ("build", facts.build.clone(), [now.target, now.architecture].join(", ")),
        ];
        pairs
            .into_iter()
            .filter(|(_, recorded, now)| recorded != now)
            .map(|(what, recorded, now)| format!("{what}: recorded {recorded}, now {now}"))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paper::results::RunFacts;
    use mishandle::Plan;
    use mishandle::plan::FalsifyPlan;
    use mishandle::store::TrialStatus;

    fn run(trials: u32) -> RunResults {
        let falsify = FalsifyPlan { trials, ..FalsifyPlan::default() };
        let plan = Plan { falsify: Some(falsify), ..Plan::new("toy/sphere-2d", "") };
        let unit = |trial| Unit {
            trial,
            first: 1,
            simulations: 1,
            seed: 0,
            status: TrialStatus::BudgetSpent,
            violations: 0,
            stopped: 0,
            lowest: None,
            highest: None,
            evaluated: None,
            sha256: String::new(),
        };
        let facts = RunFacts { plan: plan.to_toml(), ..RunFacts::default() };
        RunResults { facts, plan, units: (1..=trials).map(unit).collect(), evaluation: None }
    }

    fn results() -> Results {
        let campaign = |name: &str, trials: u32| CampaignResults {
            name: name.to_string(),
            command: String::new(),
            runs: vec![run(trials), run(trials)],
        };
        Results { campaigns: vec![campaign("large", 200), campaign("small", 3)], ..Results::default() }
    }

    fn chosen(share: f64, seed: u64) -> Vec<(String, usize, u32)> {
        let results = results();
        let position = |sampled: &SampledUnit<'_>| {
            sampled.campaign.runs.iter().position(|run| std::ptr::eq(run, sampled.run)).unwrap()
        };
        let sampled = results.sample(share, Seed(seed));
        sampled.iter().map(|one| (one.campaign.name.clone(), position(one), one.unit.trial)).collect()
    }

    #[test]
    fn a_sample_is_a_share_of_each_campaign_and_at_least_one_unit() {
        let found = chosen(0.1, 0);
        assert_eq!(found.iter().filter(|(name, ..)| name == "large").count(), 40);
        assert_eq!(found.iter().filter(|(name, ..)| name == "small").count(), 1);
        let mut distinct = found.clone();
        distinct.dedup();
        assert_eq!(distinct, found);
        assert_eq!(chosen(1.0, 7).len(), 406);
        assert_eq!(chosen(1e-9, 7).len(), 2);
    }

    #[test]
    fn a_seed_chooses_the_same_units_and_seeds_choose_all_units() {
        assert_eq!(chosen(0.1, 3), chosen(0.1, 3));
        assert_ne!(chosen(0.1, 3), chosen(0.1, 4));
        let all: std::collections::HashSet<_> = (0..100).flat_map(|seed| chosen(0.1, seed)).collect();
        assert_eq!(all.len(), 406);
    }

    #[test]
    fn other_facts_than_the_recorded_ones_are_named() {
        let resolved = ResolvedPlan::new(&run(1).plan).unwrap();
        let found = run(1).differences(&resolved).join("; ");
        let hash = format!("hash of the target: recorded , now {}", resolved.target.identity.hash);
        assert!(found.contains(&hash) && found.contains("formula: recorded , now always"), "{found}");
    }
}
