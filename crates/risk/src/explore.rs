//! Searches for failures, and samples the neighborhoods of those that it finds.

use mishandle_random::{Seed, Sequence};
use mishandle_search::{Observation, SearchOptions, by_name};
use mishandle_stl::is_violated;

use crate::Draw;
use crate::experiment::{Experiment, Stop};
use crate::moves::Walk;
use crate::proposal::centers;
use crate::scenarios::latent;

/// Fraction of the simulations that search for failures. The others sample around them.
const SEARCH: f64 = 0.6;

/// Searches that run one after the other, with their fractions of the simulations that search.
const SEARCHES: [(&str, f64); 3] = [("corners", 0.2), ("line", 0.2), ("sobol", 0.2)];

/// The search that has the other simulations. It starts again after each failure.
const RESTARTED: &str = "cma-es";

/// Random streams besides those of [`SEARCHES`], which are their indices.
const RESTARTS: u64 = 0x100;
const RELAXATION: u64 = 0x101;

/// Simulations of a search per coordinate before it starts again.
const PER_COORDINATE: u64 = 60;

/// Number of simulations per batch of a search.
const BATCH: usize = 64;

/// Largest number of failures whose neighborhoods are sampled, and fewest moves for each.
const MOST_STARTS: usize = 16;
const FEWEST_MOVES: u64 = 60;

/// Bisections of the way from the center to a failure.
const BISECTIONS: u32 = 6;

/// Returns failing draws: those that the searches found, followed by draws of the distribution
/// within the failure modes that contain them. The simulations are at most `budget`.
pub(crate) fn explore(experiment: &mut Experiment<'_>, seed: Seed, budget: u64) -> Result<Vec<Draw>, Stop> {
    let end = experiment.done() + budget;
    let found = search(experiment, seed, (SEARCH * budget as f64) as u64)?;
    let left = end.saturating_sub(experiment.done());
    let most = (left / FEWEST_MOVES).clamp(1, MOST_STARTS as u64) as usize;
    let latents: Vec<&[f64]> = found.iter().map(|draw| draw.latent.as_slice()).collect();
    let chosen = centers(&latents, most.min(found.len()));
    let starts = chosen.into_iter().map(|index| found[index].clone()).collect();
    let starts = approach(experiment, starts, left)?;
    let left = end.saturating_sub(experiment.done());
    relax(experiment, &mut Sequence::new(seed.child(RELAXATION).0, 0), &starts, left)
}

/// Moves each failure toward the center of the distribution while it still fails: searches find
/// failures far out, but most of the probability is at the near end of a failure mode.
fn approach(experiment: &mut Experiment<'_>, mut draws: Vec<Draw>, budget: u64) -> Result<Vec<Draw>, Stop> {
    if u64::from(BISECTIONS) * draws.len() as u64 > budget {
        return Ok(draws);
    }
    // The last factor of each draw at which it passed, as a fraction of the draw.
    let mut passed = vec![0.0; draws.len()];
    for _ in 0..BISECTIONS {
        let factor = |passed: &f64| f64::midpoint(*passed, 1.0);
        let scaled = |(draw, passed): (&Draw, &f64)| Draw {
            latent: draw.latent.iter().map(|z| factor(passed) * z).collect(),
            seed: draw.seed,
        };
        let nearer: Vec<Draw> = draws.iter().zip(&passed).map(scaled).collect();
        let robustness = experiment.robustness(&nearer)?;
        for (((draw, passed), nearer), rho) in draws.iter_mut().zip(&mut passed).zip(nearer).zip(robustness) {
            let tried = factor(passed);
            if is_violated(rho) {
                *draw = nearer;
                *passed /= tried;
            } else {
                *passed = tried;
            }
        }
    }
    Ok(draws)
}

/// Runs searches one after the other and returns their failures.
fn search(experiment: &mut Experiment<'_>, seed: Seed, budget: u64) -> Result<Vec<Draw>, Stop> {
    let end = experiment.done() + budget;
    let mut found = Vec::new();
    for (stream, (name, share)) in (0..).zip(SEARCHES) {
        let n = (share * budget as f64) as u64;
        found.extend(search_once(experiment, name, seed.child(stream), n, Until::Budget)?);
    }
    let most = PER_COORDINATE * (experiment.scenarios.dimension() as u64 + 1);
    for trial in 0.. {
        let before = experiment.done();
        let own = seed.child(RESTARTS).child(trial);
        let n = most.min(end.saturating_sub(before));
        found.extend(search_once(experiment, RESTARTED, own, n, Until::Failure)?);
        if experiment.done() == before {
            break;
        }
    }
    Ok(found)
}

/// When a search ends.
#[derive(Clone, Copy, PartialEq)]
enum Until {
    Budget,
    /// At the first batch with a failure, or when the budget is spent.
    Failure,
}

/// Runs a search and returns its failures.
fn search_once(
    experiment: &mut Experiment<'_>,
    name: &str,
    seed: Seed,
    budget: u64,
    until: Until,
) -> Result<Vec<Draw>, Stop> {
    let mut random = Sequence::new(seed.0, 0);
    let coordinates = experiment.scenarios.coordinates();
    let mut search = by_name(name, &coordinates, seed.child(0).0, &SearchOptions::default())?;
    let end = experiment.done() + budget;
    let mut found = Vec::new();
    while experiment.done() < end && (found.is_empty() || until == Until::Budget) {
        let points = search.ask_batch(BATCH.min((end - experiment.done()) as usize));
        if points.is_empty() {
            break;
        }
        let draws: Vec<Draw> =
            points.iter().map(|u| Draw { latent: latent(u), seed: Seed(random.bits()) }).collect();
        let robustness = experiment.robustness(&draws)?;
        for ((u, draw), rho) in points.iter().zip(draws).zip(robustness) {
            search.tell(u, &Observation::from(rho))?;
            if is_violated(rho) {
                found.push(draw);
            }
        }
    }
    Ok(found)
}

/// Samples the distribution within failure modes: a Markov chain from each start whose moves are
/// accepted if they still fail. Returns the states of the second halves of the chains.
fn relax(
    experiment: &mut Experiment<'_>,
    random: &mut Sequence,
    starts: &[Draw],
    budget: u64,
) -> Result<Vec<Draw>, Stop> {
    let steps = budget.checked_div(starts.len() as u64).unwrap_or(0);
    let mut walk = Walk::new(experiment.scenarios.depends_on_seed());
    let mut states = starts.to_vec();
    let mut kept = if steps < 2 { starts.to_vec() } else { Vec::new() };
    for step in 0..steps {
        let proposals: Vec<Draw> = states.iter().map(|draw| walk.proposal(draw, random)).collect();
        let robustness = experiment.robustness(&proposals)?;
        walk.adapt(robustness.iter().filter(|rho| is_violated(**rho)).count() as f64 / states.len() as f64);
        for ((state, proposal), rho) in states.iter_mut().zip(proposals).zip(robustness) {
            if is_violated(rho) {
                *state = proposal;
            }
        }
        if step >= steps / 2 {
            kept.extend_from_slice(&states);
        }
    }
    Ok(kept)
}
