//! Importance sampling whose proposal depends on the state at each step.

use mishandle_random::{Seed, Sequence};
use mishandle_rollout::Steerable;
use mishandle_stl::is_violated;

use crate::experiment::{Experiment, Stop};
use crate::features::{Choice, Chooser, Layout, Pilot};
use crate::importance::{Importance, clip, regions};
use crate::sequence_proposal::{Sample, SequenceProposal};
use crate::{Draw, RiskError, Scenarios};

/// Number of rounds that fit the proposal, and largest number of their simulations, whose sums are
/// kept in memory.
const ROUNDS: u64 = 10;
const MOST_FITTING: u64 = 20_000;

/// Fraction of the simulations of the fit that choose the columns, and their largest number.
const PILOT: (f64, u64) = (0.1, 500);

/// Fraction of a round below the level of the next fit.
const ELITE: f64 = 0.1;

/// Largest number of simulations that a proposal is fitted to.
const MOST_ELITE: usize = 2000;

/// Number of simulations that are made at once.
const CHUNK: u64 = 1024;

/// Checks that a steering has something to choose in the scenarios.
///
/// # Errors
/// [`RiskError::NotSteerable`] if not.
pub fn check_steerable(steerable: Option<&Steerable>, scenarios: &Scenarios) -> Result<(), RiskError> {
    if steerable.is_some_and(|steerable| Layout::new(steerable, scenarios).has_slots()) {
        Ok(())
    } else {
        Err(RiskError::NotSteerable)
    }
}

/// Fits a proposal that chooses disturbances of actions while a simulation runs, with `fitting`
/// simulations, and then estimates the probability of failures with the rest of the budget, as
/// [`importance`](crate::importance::importance) does. Returns `None` if the fit reaches no
/// failure.
///
/// The fit is a cross-entropy method with levels: a policy is fitted to the simulations below a
/// level of the robustness, which falls to that of a failure. All rounds count in each fit, with
/// weights of the mixture of all proposals so far.
///
/// # Reference
/// Rubinstein, "The cross-entropy method for combinatorial and continuous optimization",
/// Methodology and Computing in Applied Probability 1, 1999. Cornuet, Marin, Mira and Robert,
/// "Adaptive multiple importance sampling", Scandinavian Journal of Statistics 39, 2012. Delecki,
/// Katz and Kochenderfer, "Failure probability estimation for black-box autonomous systems using
/// state-dependent importance sampling proposals", arXiv 2412.02154, 2024.
pub(crate) fn sequence(
    experiment: &mut Experiment<'_>,
    seed: Seed,
    fitting: u64,
    failed: &[Draw],
) -> Result<Option<Importance>, Stop> {
    let Some(steerable) = experiment.steerable() else { return Ok(None) };
    let before = experiment.done();
    let layout = Layout::new(&steerable, experiment.scenarios);
    // The failures of Monte Carlo are simulated again for their weights.
    let fitting = fitting.saturating_sub(failed.len() as u64).min(MOST_FITTING);
    let pilot = ((PILOT.0 * fitting as f64) as u64).min(PILOT.1);
    let mut random = Sequence::new(seed.0, 0);
    let mut draws: Vec<Draw> = (0..pilot).map(|_| experiment.scenarios.draw(&mut random)).collect();
    let pilot_outcomes = experiment.steered(&mut draws, &Pilot::new(&layout), |_, _| ())?;
    let layout = layout.with_columns(&pilot_outcomes);
    let Some((proposal, largest)) = fit(experiment, seed, &layout, fitting - pilot)? else {
        return Ok(None);
    };
    let monte_carlo = given(experiment, &layout, failed)?;
    let monte_carlo: Vec<f64> =
        monte_carlo.iter().map(|sample| 1.0 / proposal.ratio(&layout, sample)).collect();
    let fitting = experiment.done() - before;
    let n = experiment.left();
    let mut random = Sequence::new(seed.0, ROUNDS + 1);
    let weight = |sample: &Sample| {
        if is_violated(sample.robustness) { 1.0 / proposal.ratio(&layout, sample) } else { 0.0 }
    };
    let mut all = Vec::with_capacity(n as usize);
    while experiment.left() > 0 {
        let count = CHUNK.min(experiment.left());
        all.extend(simulate(experiment, &layout, &proposal, false, &mut random, count)?.iter().map(weight));
    }
    let found = regions(&all, largest, &monte_carlo);
    Ok(Some(Importance { fitting, components: proposal.components(), ..found }))
}

/// Fits the proposal. Returns it with the largest weight of a failure in the last round; `None`
/// without one.
fn fit(
    experiment: &mut Experiment<'_>,
    seed: Seed,
    layout: &Layout,
    fitting: u64,
) -> Result<Option<(SequenceProposal, f64)>, Stop> {
    let mut proposals = vec![SequenceProposal::default()];
    // Each sample with the sum over the rounds of its density, in simulations.
    let mut samples: Vec<(Sample, f64)> = Vec::new();
    let n = fitting / ROUNDS;
    let mut last = 0;
    for round in 0..ROUNDS {
        let Some(proposal) = proposals.last() else { break };
        let mut random = Sequence::new(seed.0, 1 + round);
        let drawn = simulate(experiment, layout, proposal, true, &mut random, n)?;
        // The latest proposal has drawn nothing before.
        for (sample, density) in &mut samples {
            *density += n as f64 * proposal.ratio(layout, sample);
        }
        last = samples.len();
        samples.extend(drawn.into_iter().map(|sample| {
            let density: f64 = proposals.iter().map(|proposal| proposal.ratio(layout, &sample)).sum();
            (sample, n as f64 * density)
        }));
        let Some(proposal) = proposals.last() else { break };
        let components: Vec<usize> =
            samples.iter().map(|(sample, _)| proposal.likeliest(layout, sample)).collect();
        let levels: Vec<f64> = (0..proposal.components().max(1))
            .map(|component| {
                let own = samples.iter().zip(&components).skip(last);
                let own = own.filter(|(_, of)| **of == component);
                level(own.map(|((sample, _), _)| sample.robustness).collect())
            })
            .collect();
        let total = samples.len() as f64;
        let is_reached = levels.iter().all(|level| is_violated(*level));
        let mut elite: Vec<(&Sample, f64)> = Vec::new();
        for (number, level) in levels.iter().enumerate() {
            let own = samples.iter().zip(&components).filter(|(_, component)| **component == number);
            let mut own: Vec<(&Sample, f64)> = own
                .filter(|((sample, _), _)| is_below(sample.robustness, *level))
                .map(|((sample, density), _)| (sample, total / density))
                .collect();
            clip(&mut own);
            // On the way, all modes count the same. Otherwise the weights would forget the one that
            // is ahead, because its samples are less probable.
            let sum: f64 = own.iter().map(|(_, weight)| weight).sum();
            let scale = if is_reached { 1.0 } else { 1.0 / sum };
            elite.extend(own.into_iter().map(|(sample, weight)| (sample, weight * scale)));
        }
        let step = elite.len().div_ceil(MOST_ELITE).max(1);
        let elite: Vec<(&Sample, f64)> = elite.into_iter().rev().step_by(step).collect();
        if let Some(fitted) = SequenceProposal::fit(layout, &elite) {
            proposals.push(fitted);
        } else if let Some(same) = proposals.last().cloned() {
            proposals.push(same);
        }
    }
    let Some(proposal) = proposals.pop() else { return Ok(None) };
    let weights = samples[last..]
        .iter()
        .filter(|(sample, _)| is_violated(sample.robustness))
        .map(|(sample, _)| 1.0 / proposal.ratio(layout, sample));
    let largest = weights.fold(0.0, f64::max);
    Ok((largest > 0.0).then_some((proposal, largest)))
}

/// Returns the level of a component from the robustness of its simulations in the last round.
fn level(mut reached: Vec<f64>) -> f64 {
    reached.sort_by(f64::total_cmp);
    let index = (ELITE * reached.len() as f64) as usize;
    reached.get(index).copied().unwrap_or(f64::NEG_INFINITY)
}

/// Returns whether a robustness is below a level. No level is below a failure.
fn is_below(robustness: f64, level: f64) -> bool {
    is_violated(robustness) || (!is_violated(level) && robustness <= level)
}

/// Simulates `n` draws of the proposal.
fn simulate(
    experiment: &mut Experiment<'_>,
    layout: &Layout,
    proposal: &SequenceProposal,
    is_fit: bool,
    random: &mut Sequence,
    n: u64,
) -> Result<Vec<Sample>, Stop> {
    let scenarios = experiment.scenarios;
    let mut draws: Vec<Draw> = (0..n).map(|_| proposal.draw(layout, scenarios, random)).collect();
    steered(experiment, layout, Choice::Proposal(proposal), is_fit, &mut draws)
}

/// Simulates draws again, for what a proposal would have seen.
fn given(experiment: &mut Experiment<'_>, layout: &Layout, draws: &[Draw]) -> Result<Vec<Sample>, Stop> {
    steered(experiment, layout, Choice::Given(draws), false, &mut draws.to_vec())
}

fn steered(
    experiment: &mut Experiment<'_>,
    layout: &Layout,
    choice: Choice<'_>,
    is_fit: bool,
    draws: &mut [Draw],
) -> Result<Vec<Sample>, Stop> {
    let chooser = Chooser { layout, scenarios: experiment.scenarios, choice, is_fit };
    let outcomes = experiment.steered(draws, &chooser, |draw, memory| layout.complete(draw, memory))?;
    let sample = |(draw, (robustness, mut memory)): (&Draw, (f64, Vec<f64>))| {
        let decided = if is_fit { layout.decided(&memory, robustness).to_vec() } else { Vec::new() };
        memory.truncate(layout.sums());
        let others = layout.others.iter().map(|index| draw.latent[*index]).collect();
        Sample { others, sums: memory, decided, robustness }
    };
    Ok(draws.iter().zip(outcomes).map(sample).collect())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use std::ops::ControlFlow;

    use mishandle_rollout::{
        Axis, AxisKind, Distribution, Episode, EpisodeEnd, Request, RolloutError, Seen, Space, SteeredAxis,
        SteeredEpisode, Steering, System, Verdict,
    };
    use mishandle_stl::Trace;

    use super::*;

    const STEPS: usize = 20;

    /// A walk whose noise is the scenario, with two unsteered axes that move its start.
    struct Walk(Space);

    impl Walk {
        fn new() -> Walk {
            let axis = |name: String| {
                let mut axis = Axis::new(AxisKind::Noise, &name, "", [-9.0, 9.0], None);
                axis.distribution = Distribution::Normal;
                axis
            };
            Walk(Space::new("noise", (0..STEPS + 2).map(|i| axis(format!("z{i}"))).collect()).unwrap())
        }
    }

    impl System for Walk {
        fn space(&self) -> &Space {
            &self.0
        }

        fn rollout(&mut self, requests: &[Request]) -> Result<Vec<Episode>, RolloutError> {
            let pilot = Pilot::new(&Layout::new(&self.steerable().unwrap(), &scenarios(self)));
            let steered = self.rollout_steered(requests, &pilot)?;
            Ok(steered.into_iter().map(|steered| steered.episode).collect())
        }

        fn steerable(&self) -> Option<Steerable> {
            let axes =
                (0..STEPS).map(|step| SteeredAxis { axis: step + 2, step, channel: step % 2 }).collect();
            Some(Steerable { axes, observation_size: 1, signals: 1, episode_steps: STEPS })
        }

        fn rollout_steered(
            &mut self,
            requests: &[Request],
            steering: &dyn Steering,
        ) -> Result<Vec<SteeredEpisode>, RolloutError> {
            let steerable = self.steerable().unwrap();
            let episode = |request: &Request| {
                let mut values: Vec<f64> = request.scenario.values().iter().map(|x| x.unwrap()).collect();
                let mut memory = vec![0.0; steering.memory_size()];
                let mut x = values[0] + values[1];
                for step in 0..STEPS {
                    let axes = steerable.beginning(step);
                    let seen = Seen {
                        seed: request.seed,
                        step,
                        observation: &[x as f32],
                        signals: &[x * x],
                        bound: f64::INFINITY,
                    };
                    steering.steer(seen, axes, &mut memory, &mut values[step + 2..=step + 2]);
                    x += values[step + 2];
                }
                let verdict = Verdict { robustness: Some(6.0 - x), ..Verdict::default() };
                let episode = Episode {
                    request: Request { scenario: values.into(), ..request.clone() },
                    end: EpisodeEnd::Completed,
                    reason: String::new(),
                    steps: STEPS,
                    verdict,
                    total_reward: 0.0,
                    trace: Trace::new([].into()),
                    trace_digest: None,
                };
                SteeredEpisode { episode, memory }
            };
            Ok(requests.iter().map(episode).collect())
        }
    }

    fn scenarios(system: &Walk) -> Scenarios {
        Scenarios::new(system.space(), [], true).unwrap()
    }

    /// The density of the distribution divided by that of the proposal has the mean 1 under the
    /// proposal, and its inverse under the distribution: both, for a proposal that was fitted, and
    /// for steered and unsteered axes.
    #[test]
    fn likelihood_ratios_have_the_mean_one() {
        let mut system = Walk::new();
        let scenarios = scenarios(&system);
        let layout = Layout::new(&system.steerable().unwrap(), &scenarios);
        let mut watch = |_| ControlFlow::Continue(());
        let mut experiment = Experiment::new(&mut system, &scenarios, 100_000, 64, &mut watch);
        let mut random = Sequence::new(1, 0);
        let mut draws: Vec<Draw> = (0..200).map(|_| scenarios.draw(&mut random)).collect();
        let Ok(pilot) = experiment.steered(&mut draws, &Pilot::new(&layout), |_, _| ()) else { panic!() };
        let layout = layout.with_columns(&pilot);
        let Ok(Some((proposal, _))) = fit(&mut experiment, Seed(2), &layout, 4000) else { panic!() };
        let n = 8000;
        let Ok(drawn) = simulate(&mut experiment, &layout, &proposal, false, &mut random, n) else {
            panic!()
        };
        let weights: Vec<f64> = drawn.iter().map(|sample| 1.0 / proposal.ratio(&layout, sample)).collect();
        let moments = |values: &[f64]| {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let square = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / values.len() as f64;
            (mean, (square / values.len() as f64).sqrt())
        };
        let (mean, error) = moments(&weights);
        assert!((mean - 1.0).abs() < 4.0 * error && error < 0.1, "{mean} ± {error}");
        // The proposal is another distribution.
        assert!(drawn.iter().filter(|sample| is_violated(sample.robustness)).count() > 1000);
        // P(x > 6) for the variance 22: 0.1003.
        let failed: Vec<f64> = drawn
            .iter()
            .zip(&weights)
            .map(|(sample, weight)| if is_violated(sample.robustness) { *weight } else { 0.0 })
            .collect();
        let (mean, error) = moments(&failed);
        assert!((mean - 0.1003).abs() < 4.0 * error && error < 0.003, "{mean} ± {error}");
    }

    /// The sums of given draws are those of the proposal that drew them.
    #[test]
    fn given_draws_have_the_sums_of_their_simulation() {
        let mut system = Walk::new();
        let scenarios = scenarios(&system);
        let layout = Layout::new(&system.steerable().unwrap(), &scenarios);
        let mut watch = |_| ControlFlow::Continue(());
        let mut experiment = Experiment::new(&mut system, &scenarios, 1000, 64, &mut watch);
        let proposal = SequenceProposal::default();
        let mut random = Sequence::new(5, 0);
        let mut draws: Vec<Draw> = (0..10).map(|_| proposal.draw(&layout, &scenarios, &mut random)).collect();
        let choice = Choice::Proposal(&proposal);
        let Ok(drawn) = steered(&mut experiment, &layout, choice, false, &mut draws) else { panic!() };
        let Ok(again) = given(&mut experiment, &layout, &draws) else { panic!() };
        for (a, b) in drawn.iter().zip(&again) {
            assert_eq!((&a.sums, a.robustness.to_bits()), (&b.sums, b.robustness.to_bits()));
        }
    }
}
