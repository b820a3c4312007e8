//! Models of the parts of the robustness: each sees only the coordinates that can act before its
//! end.

use std::mem;

use super::distance;
use super::steps::SuccessRate;
use crate::gp::candidates::{CandidateGenerator, Candidates};
use crate::gp::elementary::log_normal_tail;
use crate::gp::history::History;
use crate::gp::space::TypedSpace;
use crate::gp::surrogate::{Limits, Surrogate};
use crate::gp::transform::Transform;
use crate::{Composition, Parts, SearchSpace};

/// Evaluations that a model uses. There are several models, so each is smaller than the one of the
/// robustness.
const LIMITS: Limits = Limits { active: 64, fitted: 40 };
/// The most models.
const MODELS: usize = 8;
/// Candidates of each kind.
const CANDIDATES: usize = 32;
/// Rounds of the local search from the best candidate, its points per round, and its first step,
/// which is halved in each round.
const CLIMB: (i32, usize, f64) = (4, 24, 0.3);
/// Two points of a round keep this distance, as a fraction of the diagonal.
const APART: f64 = 0.03;
/// The least and the largest share of points.
const SHARE: (f64, f64) = (0.1, 0.8);

/// The source of points that the models of the parts propose, and the share that it earns.
#[derive(Debug, Clone)]
pub(super) struct Trace {
    models: Vec<PartModel>,
    parts: Parts,
    /// The parts of the round.
    received: Vec<Vec<f64>>,
    /// Whether the models lack evaluations.
    is_stale: bool,
    /// Scored candidates of the whole box.
    candidates: Vec<(f64, Vec<f64>)>,
    generator: CandidateGenerator,
    /// The rates of success of the other sources and of this one.
    rates: [SuccessRate; 2],
}

/// The model of one part.
#[derive(Debug, Clone)]
struct PartModel {
    /// The coordinates that can change the part.
    inputs: Vec<usize>,
    history: History,
    surrogate: Surrogate,
}

impl PartModel {
    fn new(space: &SearchSpace, end: f64) -> PartModel {
        let acts = |k: &usize| space.begins[*k] < end || space.begins[*k] == 0.0;
        let inputs: Vec<usize> = (0..space.coordinates.len()).filter(acts).collect();
        let coordinates: Vec<_> = inputs.iter().map(|&k| space.coordinates[k]).collect();
        let surrogate = Surrogate::new(TypedSpace::new(&coordinates), Transform::Asinh).with_limits(LIMITS);
        PartModel { inputs, history: History::default(), surrogate }
    }

    fn projected(&self, point: &[f64]) -> Vec<f64> {
        self.inputs.iter().map(|&k| point[k]).collect()
    }

    /// Returns for each point the logarithm of the probability that the part is negative.
    fn violations(&self, points: &Candidates) -> Option<Vec<f64>> {
        let projected: Vec<Vec<f64>> = points.points().map(|point| self.projected(point)).collect();
        let margins = self.surrogate.margins(projected.iter().map(Vec::as_slice))?;
        let log = |(margin, deviation): (f64, f64)| log_normal_tail(margin / deviation.max(f64::EPSILON));
        Some(margins.into_iter().map(log).collect())
    }
}

impl Trace {
    /// Returns the source; `None` if the parts are windows of one signal, which say little more
    /// than the robustness, if there are more parts than there can be models, or if nothing changes
    /// a part.
    pub(super) fn new(space: &SearchSpace, seed: u64) -> Option<Trace> {
        let parts = space.parts.as_ref()?;
        let models: Vec<PartModel> = parts.ends.iter().map(|end| PartModel::new(space, *end)).collect();
        let has_several = parts.signals.iter().any(|signal| *signal != parts.signals[0]);
        let can_model = models.len() <= MODELS && models.iter().all(|model| !model.inputs.is_empty());
        let is_useful = has_several && can_model;
        is_useful.then(|| Trace {
            models,
            parts: parts.clone(),
            received: Vec::new(),
            is_stale: false,
            candidates: Vec::new(),
            generator: CandidateGenerator::new(TypedSpace::new(&space.coordinates), seed, 3),
            rates: [SuccessRate::default(); 2],
        })
    }

    /// Takes the parts of a round.
    pub(super) fn receive_parts(&mut self, parts: Vec<Vec<f64>>) {
        self.received = parts;
    }

    /// Adds the evaluations of the round.
    pub(super) fn extend(&mut self, round: &[Vec<f64>]) {
        for (point, parts) in round.iter().zip(mem::take(&mut self.received)) {
            if parts.len() == self.models.len() {
                for (model, part) in self.models.iter_mut().zip(parts) {
                    model.history.push(&model.projected(point), part);
                }
                self.is_stale = true;
            }
        }
    }

    /// Takes the success of a point into account; `is_own` says whether this source proposed it.
    pub(super) fn adapt(&mut self, is_own: bool, is_success: bool) {
        self.rates[usize::from(is_own)].receive(is_success);
    }

    /// Returns the share of this source: its part of the successes, if all sources had as many
    /// points.
    pub(super) fn share(&self) -> f64 {
        if self.models.iter().any(|model| model.history.len() < 2) {
            return 0.0;
        }
        let [others, own] = self.rates.map(SuccessRate::rate);
        (own / (own + others)).clamp(SHARE.0, SHARE.1)
    }

    /// Returns a point at which a violation is probable, apart from those of `round`.
    pub(super) fn propose(&mut self, history: &History, round: &[Vec<f64>]) -> Option<Vec<f64>> {
        if mem::take(&mut self.is_stale) {
            self.models.iter_mut().for_each(|model| model.surrogate.update(&model.history));
            let candidates = self.generator.global(history, CANDIDATES, true);
            self.candidates = self.scored(&candidates)?;
        }
        let mut best = highest(&self.candidates, round)?;
        let (rounds, steps, first_step) = CLIMB;
        for climb in 0..rounds {
            let step = first_step * 0.5_f64.powi(climb);
            let near = self.generator.around(history, &best.1, step, steps);
            let near = highest(&self.scored(&near)?, round);
            best = near.filter(|near| near.0 > best.0).unwrap_or(best);
        }
        Some(best.1)
    }

    /// Returns the points, each with the [score](Self::score) of the robustness.
    fn scored(&self, points: &Candidates) -> Option<Vec<(f64, Vec<f64>)>> {
        let violations: Vec<Vec<f64>> =
            self.models.iter().map(|model| model.violations(points)).collect::<Option<_>>()?;
        let score = |i: usize| self.score(&self.parts.composition, &|part| violations[part][i]);
        Some(points.points().enumerate().map(|(i, point)| (score(i), point.to_vec())).collect())
    }

    /// Returns a logarithm that orders points by the probability that a value is negative: of a
    /// minimum the largest of its operands, of a maximum their product. The windows of one signal
    /// depend on each other, so the smallest of them counts instead of the product.
    fn score(&self, value: &Composition, violation: &dyn Fn(usize) -> f64) -> f64 {
        let signal = |operand: &Composition| match operand {
            Composition::Part(part) => Some(self.parts.signals[*part]),
            _ => None,
        };
        let of = |operands: &[Composition]| -> Vec<f64> {
            operands.iter().map(|operand| self.score(operand, violation)).collect()
        };
        match value {
            Composition::Part(part) => violation(*part),
            Composition::Min(operands) => of(operands).into_iter().fold(f64::NEG_INFINITY, f64::max),
            Composition::Max(operands) => {
                let first = operands.first().and_then(signal);
                let is_one_signal = first.is_some() && operands.iter().all(|x| signal(x) == first);
                let scores = of(operands).into_iter();
                if is_one_signal { scores.fold(f64::INFINITY, f64::min) } else { scores.sum() }
            }
        }
    }
}

/// Returns the point with the highest score that is apart from those of `round`.
fn highest(scored: &[(f64, Vec<f64>)], round: &[Vec<f64>]) -> Option<(f64, Vec<f64>)> {
    let is_apart = |point: &[f64]| {
        let apart = APART * (point.len() as f64).sqrt();
        round.iter().all(|other| distance(point, other) > apart)
    };
    let apart = scored.iter().filter(|(_, point)| is_apart(point));
    apart.max_by(|x, y| x.0.total_cmp(&y.0)).cloned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Coordinate, Parts};

    /// Knots at 0, 1/2 and 1 of an episode act from 0, 0 and 1/2.
    #[test]
    fn a_model_sees_only_the_coordinates_that_act_before_the_end_of_its_part() {
        let parts = Parts { ends: vec![0.5, 0.6], signals: vec![0, 1], composition: Composition::Part(0) };
        let space = SearchSpace {
            begins: vec![0.0, 0.0, 0.5],
            parts: Some(parts),
            ..SearchSpace::from(&[Coordinate::Continuous; 3])
        };
        let trace = Trace::new(&space, 0).expect("two parts");
        assert_eq!((trace.models[0].inputs.as_slice(), trace.models[1].inputs.len()), (&[0, 1][..], 3));
    }

    /// A part ends at the start, where one of two inputs acts.
    #[test]
    fn a_part_at_the_start_has_the_coordinates_that_act_from_there() {
        let space = SearchSpace { begins: vec![0.0, 0.2], ..SearchSpace::from(&[Coordinate::Continuous; 2]) };
        assert_eq!(PartModel::new(&space, 0.0).inputs, [0]);
    }
}
