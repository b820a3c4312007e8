//! Metamorphic testing: relations between the results of pairs of scenarios.
//!
//! A source case is a random scenario. A relation changes some of its axes, which gives the
//! follow-up case, and says what must hold between the two results. No formula needs to say which
//! of the two is right. The terms are those of T. Y. Chen et al., "Metamorphic Testing: A Review of
//! Challenges and Opportunities", ACM Computing Surveys 51(1), 2018.

mod cases;
mod change;
mod relation;
mod shrink;
#[cfg(test)]
mod tests;

use std::ops::{ControlFlow, RangeInclusive};

use mishandle_results::VerdictCounts;
use mishandle_rollout::{Episode, Request, Scenario, Seed, System};
use mishandle_stl::is_violated;

use crate::FalsificationError;
pub use cases::Cases;
pub use change::AxisChange;
use relation::difference;
pub use relation::{OutputRelation, Relation};
use shrink::{BISECTIONS, Shrunk, shrink};

/// Largest number of broken pairs that are kept for each relation: those with the largest breaks.
const KEPT: usize = 100;

/// Settings of a metamorphic test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetamorphicSettings {
    /// Number of source cases.
    pub pairs: u64,
    /// Number of simulations that are run at once. Results do not depend on it.
    pub batch: usize,
}

impl MetamorphicSettings {
    /// Allowed numbers of source cases.
    pub const PAIRS: RangeInclusive<u64> = 1..=1_000_000;

    /// Trial of the source cases. Relation r, counted from 1, has its follow-up cases in trial
    /// 1 + r.
    pub const SOURCES: u32 = 1;

    /// Default number of source cases.
    pub const DEFAULT_PAIRS: u64 = 100;

    /// Allowed numbers of relations.
    pub const RELATIONS: RangeInclusive<usize> = 1..=100;

    /// Returns the largest number of simulations that these relations take.
    pub fn max_simulations(self, relations: usize) -> u64 {
        let relations = relations as u64;
        self.pairs.saturating_mul(1 + relations).saturating_add(BISECTIONS * relations)
    }

    fn check(self, relations: &[Relation]) -> Result<(), FalsificationError> {
        let invalid =
            |what, value: String, expected| Err(FalsificationError::InvalidValue { what, value, expected });
        if !MetamorphicSettings::PAIRS.contains(&self.pairs) {
            return invalid("the number of pairs", self.pairs.to_string(), "from 1 to 1000000");
        }
        if !MetamorphicSettings::RELATIONS.contains(&relations.len()) {
            let expected = "from 1 to 100; a plan has each in a table [metamorphic.relations.NAME]";
            return invalid("the number of relations", relations.len().to_string(), expected);
        }
        match relations.iter().find(|relation| relation.changes.is_empty()) {
            Some(relation) => invalid(
                "the number of changed axes of a relation",
                format!("0 ({})", relation.name),
                "at least 1, such as change = { ball_x = \"+0.02\" }",
            ),
            None => Ok(()),
        }
    }
}

/// The result of a metamorphic test.
#[derive(Clone, Debug, PartialEq)]
pub struct Metamorphic {
    /// The relations, in their order.
    pub relations: Vec<RelationOutcome>,
    /// Number of all simulations.
    pub simulations: u64,
    /// Whether it was not interrupted.
    pub is_complete: bool,
}

/// The pairs of one relation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RelationOutcome {
    /// Number of pairs that were simulated.
    pub pairs: u64,
    /// Number of source cases whose follow-up case is outside of the bounds.
    pub out_of_bounds: u64,
    /// Number of pairs in which a simulation has no verdict.
    pub without_verdict: u64,
    /// The verdicts of the other pairs.
    pub verdicts: VerdictCounts,
    /// Number of pairs that break the relation.
    pub broken: u64,
    /// The broken pairs with the largest breaks, the largest first.
    pub worst: Vec<Pair>,
    /// The smallest share of the change that breaks the relation from the source case of the worst
    /// pair; `None` without a broken pair, or if an axis is changed to a category.
    pub smallest_change: Option<SmallestChange>,
}

/// A source case and its follow-up case.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// Number of the pair, from 1.
    pub number: u32,
    /// The source case.
    pub source: Case,
    /// The follow-up case.
    pub follow_up: Case,
}

/// A simulation of a pair.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its trial.
    pub trial: u32,
    /// Its number in the trial.
    pub number: u32,
    /// Its scenario.
    pub scenario: Scenario,
    /// Its seed, the same in both cases.
    pub seed: Seed,
    /// Its robustness; `None` without a verdict.
    pub robustness: Option<f64>,
}

/// The smallest change that was found to break a relation.
#[derive(Clone, Debug, PartialEq)]
pub struct SmallestChange {
    /// Number of the pair.
    pub pair: u32,
    /// Share of the change, up to 1.
    pub share: f64,
    /// Largest smaller share at which the relation holds, or a case has no verdict; 0 is the source
    /// case itself.
    pub holds_at: f64,
    /// The follow-up case.
    pub case: Case,
    /// Number of simulations that it took.
    pub simulations: u64,
}

impl From<&Episode> for Case {
    fn from(episode: &Episode) -> Case {
        let Request { trial, number, scenario, seed, .. } = episode.request.clone();
        Case { trial, number, scenario, seed, robustness: episode.robustness() }
    }
}

impl Pair {
    /// Returns the robustness of the follow-up case minus that of the source case; `None` if a case
    /// has no verdict.
    pub fn difference(&self) -> Option<f64> {
        self.source
            .robustness
            .zip(self.follow_up.robustness)
            .map(|(source, follow_up)| difference(source, follow_up))
    }
}

impl Metamorphic {
    /// Returns the numbers of the trials of a complete test.
    pub fn trials(&self) -> impl Iterator<Item = u32> {
        let relations = self.relations.len() as u32;
        let shrunk = (1..).zip(&self.relations).filter_map(move |(index, found)| {
            let has_run = found.smallest_change.as_ref().is_some_and(|found| found.simulations > 0);
            has_run.then_some(MetamorphicSettings::SOURCES + relations + index)
        });
        (MetamorphicSettings::SOURCES..=MetamorphicSettings::SOURCES + relations).chain(shrunk)
    }
}

impl RelationOutcome {
    fn add(&mut self, relation: &Relation, pair: Pair) {
        self.pairs += 1;
        let Some((source, follow_up)) = pair.source.robustness.zip(pair.follow_up.robustness) else {
            self.without_verdict += 1;
            return;
        };
        let VerdictCounts { both_satisfied, both_violated, worse, better } = &mut self.verdicts;
        *match (is_violated(source), is_violated(follow_up)) {
            (false, false) => both_satisfied,
            (true, true) => both_violated,
            (false, true) => worse,
            (true, false) => better,
        } += 1;
        if relation.holds.is_broken(source, follow_up) {
            self.broken += 1;
            self.worst.push(pair);
        }
    }

    /// Keeps the pairs with the largest breaks: a pair near the border of the verdict says less.
    fn keep_worst(&mut self) {
        let size = |pair: &Pair| pair.difference().map_or(0.0, f64::abs);
        self.worst.sort_by(|a, b| size(b).total_cmp(&size(a)).then(a.number.cmp(&b.number)));
        self.worst.truncate(KEPT);
    }
}

/// Simulates random source cases and the follow-up cases of all relations, and bisects the change
/// of the worst broken pair of each.
///
/// Both cases of a pair have the same seed, so their noise is equal. A follow-up case outside of
/// the bounds is counted, not simulated. A pair in which a simulation has no verdict breaks no
/// relation.
///
/// `watch` gets the number of simulations after each batch. It can end the test: the result is then
/// that of the pairs so far.
///
/// # Errors
/// The errors of [`Cases::check`], or if a simulation cannot be run.
pub fn metamorphic(
    system: &mut dyn System,
    cases: &Cases,
    relations: &[Relation],
    settings: MetamorphicSettings,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Metamorphic, FalsificationError> {
    cases.check(relations, settings)?;
    let mut found = Metamorphic {
        relations: vec![RelationOutcome::default(); relations.len()],
        simulations: 0,
        is_complete: true,
    };
    let chunk = (settings.batch / (1 + relations.len())).max(1) as u64;
    let mut next = 1;
    while next <= settings.pairs {
        let last = settings.pairs.min(next + chunk - 1);
        let sources = (next..=last).map(|number| cases.source(number as u32));
        batch(system, cases, relations, sources, &mut found)?;
        next = last + 1;
        if watch(found.simulations).is_break() {
            found.is_complete = false;
            return Ok(found);
        }
    }
    for (index, relation) in (1..).zip(relations) {
        let outcome = &found.relations[index as usize - 1];
        let Some(pair) = outcome.worst.first() else { continue };
        let trial = MetamorphicSettings::SOURCES + relations.len() as u32 + index;
        let done = found.simulations;
        match shrink(system, cases, relation, trial, pair, |simulations| watch(done + simulations))? {
            Shrunk::Found(smallest) => {
                found.simulations += smallest.simulations;
                found.relations[index as usize - 1].smallest_change = Some(smallest);
            }
            Shrunk::Impossible => {}
            Shrunk::Interrupted(simulations) => {
                found.simulations += simulations;
                found.is_complete = false;
                return Ok(found);
            }
        }
    }
    Ok(found)
}

/// Simulates these source cases with their follow-up cases, all at once.
fn batch(
    system: &mut dyn System,
    cases: &Cases,
    relations: &[Relation],
    sources: impl Iterator<Item = Request>,
    found: &mut Metamorphic,
) -> Result<(), FalsificationError> {
    let mut requests: Vec<Request> = Vec::new();
    // Places of source case and follow-up case, with the index of the relation.
    let mut pairs: Vec<(usize, usize, usize)> = Vec::new();
    for source in sources {
        let place = requests.len();
        let mut further = Vec::new();
        for (index, relation) in relations.iter().enumerate() {
            let Some(scenario) = cases.follow_up(relation, &source.scenario, 1.0) else {
                found.relations[index].out_of_bounds += 1;
                continue;
            };
            further.push(Request {
                trial: MetamorphicSettings::SOURCES + 1 + index as u32,
                scenario,
                ..source.clone()
            });
            pairs.push((place, place + further.len(), index));
        }
        if !further.is_empty() {
            requests.push(source);
            requests.append(&mut further);
        }
    }
    let episodes = if requests.is_empty() { Vec::new() } else { system.rollout(&requests)? };
    if episodes.len() != requests.len() {
        return Err(FalsificationError::EpisodeCount { requested: requests.len(), returned: episodes.len() });
    }
    found.simulations += requests.len() as u64;
    for (source, follow_up, index) in pairs {
        let source = Case::from(&episodes[source]);
        let follow_up = Case::from(&episodes[follow_up]);
        found.relations[index].add(&relations[index], Pair { number: source.number, source, follow_up });
    }
    found.relations.iter_mut().for_each(RelationOutcome::keep_worst);
    Ok(())
}
