//! Steps from the best point without a model, and how many points they deserve.

use mishandle_random::Sequence;

use crate::gp::space::TypedSpace;

/// Pseudo-counts of successes and trials.
const PRIOR: (f64, f64) = (0.5, 2.0);
/// Counts are halved at this number of trials, so that old results fade.
const MEMORY: f64 = 32.0;
/// The share of a kind of step is this multiple of its rate of success: below a rate of 1/2, two
/// kinds leave room.
const SHARE: f64 = 2.0;
/// The largest share of all kinds of steps.
const LARGEST: f64 = 0.9;

/// The rate at which a kind of step finds lower values.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SuccessRate {
    successes: f64,
    trials: f64,
}

impl SuccessRate {
    /// Takes the result of a step into account.
    pub(super) fn receive(&mut self, is_success: bool) {
        self.trials += 1.0;
        self.successes += f64::from(u8::from(is_success));
        if self.trials >= MEMORY {
            self.trials *= 0.5;
            self.successes *= 0.5;
        }
    }

    pub(super) fn rate(self) -> f64 {
        (self.successes + PRIOR.0) / (self.trials + PRIOR.1)
    }
}

/// Returns the shares of two kinds of steps among the points without a model.
///
/// # Reference
/// Thierens, "An adaptive pursuit strategy for allocating operator probabilities", GECCO 2005:
/// shares that follow success.
pub(super) fn shares(rates: [SuccessRate; 2]) -> [f64; 2] {
    let shares = rates.map(|rate| SHARE * rate.rate());
    let scale = LARGEST / shares.iter().sum::<f64>().max(LARGEST);
    shares.map(|share| share * scale)
}

/// Returns `best` with another value of one coordinate, uniform in its range. Such steps follow
/// separable functions, in which each coordinate has an effect of its own.
pub(super) fn changed_coordinate(best: &[f64], space: &TypedSpace, stream: &mut Sequence) -> Vec<f64> {
    let mut point = best.to_vec();
    let k = stream.below(best.len() as u64) as usize;
    point[k] = stream.uniform();
    space.snap(&mut point);
    point
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Without trials each rate is 1/4: twice that are 0.5 each, scaled to 0.9 in total. After 6
    /// failures it is 0.5/8.
    #[test]
    fn shares_follow_success() {
        assert_eq!(shares([SuccessRate::default(); 2]), [0.45, 0.45]);
        let mut failed = SuccessRate::default();
        (0..6).for_each(|_| failed.receive(false));
        assert_eq!(shares([failed; 2]), [0.125, 0.125]);
        let mut successful = SuccessRate::default();
        (0..4).for_each(|i| successful.receive(i % 2 == 0));
        // 2 · 2.5/6 beside 2 · 1/16, scaled to 0.9.
        let scale = 0.9 / (5.0 / 6.0 + 0.125);
        assert!((shares([successful, failed])[0] - 5.0 / 6.0 * scale).abs() < 1e-15);
    }

    /// After 32 failures a success has the weight of 1 of 17: (1 + 0.5) / (17 + 2).
    #[test]
    fn old_results_fade() {
        let mut rate = SuccessRate::default();
        (0..32).for_each(|_| rate.receive(false));
        rate.receive(true);
        assert!((rate.rate() - 1.5 / 19.0).abs() < 1e-15);
    }

    #[test]
    fn one_coordinate_changes() {
        let space = TypedSpace::new(&[crate::Coordinate::Continuous; 6]);
        let best = space.center();
        let mut stream = Sequence::new(1, 0);
        let changes = |point: Vec<f64>| -> Vec<usize> { (0..6).filter(|&k| point[k] != best[k]).collect() };
        let changed: Vec<Vec<usize>> =
            (0..100).map(|_| changes(changed_coordinate(&best, &space, &mut stream))).collect();
        assert!(changed.iter().all(|k| k.len() == 1));
        assert!((0..6).all(|k| changed.contains(&vec![k])), "every coordinate has its turn");
    }
}
