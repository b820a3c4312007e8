//! Random steps from the best point, with a step size that adapts to their success.

use mishandle_random::Sequence;

use crate::gp::space::TypedSpace;

const FIRST_STEP: f64 = 0.1;
const LONGEST_STEP: f64 = 0.3;
const SHORTEST_STEP: f64 = 1e-4;
/// The factors of the step after a success and a failure: the step is stationary if one of five
/// steps succeeds.
const LONGER: f64 = 2.0;
const SHORTER: f64 = 0.840_896_415_253_714_5; // 2^(-1/4)
/// The expected number of changed coordinates, at most.
const CHANGED: f64 = 10.0;

/// A (1+1) evolution strategy with the one-fifth rule. It needs no model, so it works where models
/// fail: on plateaus, cliffs and at the bottom of valleys.
///
/// # Reference
/// Rechenberg, "Evolutionsstrategie", 1973. Kern et al., "Learning probability distributions in
/// continuous evolutionary algorithms", Natural Computing 3, 2004: the form of the rule.
#[derive(Debug, Clone)]
pub(super) struct Polish {
    step: f64,
}

impl Polish {
    /// Creates the strategy with its first step size.
    pub(super) fn new() -> Self {
        Self { step: FIRST_STEP }
    }

    /// Returns a point near `best`.
    pub(super) fn propose(&self, best: &[f64], space: &TypedSpace, stream: &mut Sequence) -> Vec<f64> {
        let d = best.len();
        let share = (CHANGED / d as f64).min(1.0);
        let always = stream.below(d as u64) as usize;
        let mut point = best.to_vec();
        for (k, x) in point.iter_mut().enumerate() {
            if k == always || stream.uniform() < share {
                let (normal, _) = stream.normal_pair();
                *x = space.stepped(k, *x, self.step * normal, stream);
            }
        }
        point
    }

    /// Adapts the step size to the success of a point.
    pub(super) fn receive(&mut self, is_success: bool) {
        self.step = (self.step * if is_success { LONGER } else { SHORTER }).min(LONGEST_STEP);
        if self.step < SHORTEST_STEP {
            self.step = FIRST_STEP;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Coordinate;

    /// The strategy converges on a sphere: 1000 steps in 5 dimensions reach a distance below 1e-3.
    #[test]
    fn steps_converge_on_a_sphere() {
        let space = TypedSpace::new(&[Coordinate::Continuous; 5]);
        let mut polish = Polish::new();
        let mut stream = Sequence::new(2, 0);
        let distance = |u: &[f64]| u.iter().map(|x| (x - 0.4) * (x - 0.4)).sum::<f64>().sqrt();
        let mut best = space.center();
        for _ in 0..1000 {
            let point = polish.propose(&best, &space, &mut stream);
            let is_success = distance(&point) < distance(&best);
            polish.receive(is_success);
            if is_success {
                best = point;
            }
        }
        assert!(distance(&best) < 1e-3, "{best:?}");
    }
}
