//! A search for a violation at one amplitude from a point that almost fails.

use super::amplitude::{is_disturbed, scenario_at};
use super::attempt::{Attempt, Seeds};
use crate::FalsificationError;

/// Number of random scenarios of which the lowest one is the start of an attack.
const RANDOM: u64 = 32;

/// Step of an initial state in the search along the axes, as a fraction of its range.
const START_STEP: f64 = 0.15;

/// Standard deviation of the first generation of CMA-ES.
const DEVIATION: f64 = 0.2;

/// Numbers of axes, those with the lowest robustness first, that are changed together.
const TOGETHER: [usize; 6] = [2, 3, 5, 8, 14, 24];

impl Attempt<'_> {
    /// Attacks from the lowest of some random scenarios at the present amplitude, up to `stop`
    /// simulations of the amplitude. Returns whether there is a violation.
    pub(super) fn attack_from_random(&mut self, stop: u64) -> Result<bool, FalsificationError> {
        let amplitude = self.level().amplitude;
        let count = RANDOM.min(stop.saturating_sub(self.level().simulations));
        let points: Vec<Vec<f64>> = (0..count).map(|number| self.random_point(number)).collect();
        let Some(lowest) = self.lowest_of(&points, amplitude, Seeds::New)? else {
            return Ok(self.level().is_violated);
        };
        self.attack(points[lowest].clone(), Seeds::New, stop)
    }

    /// Attacks from `start`, a point of the unit cube, up to `stop` simulations of the present
    /// amplitude: first along the axes with these seeds, then by CMA-ES with new ones, since a
    /// claim about a random system needs many. Returns whether there is a violation.
    pub(super) fn attack(
        &mut self,
        start: Vec<f64>,
        seeds: Seeds,
        stop: u64,
    ) -> Result<bool, FalsificationError> {
        let start = self.along_the_axes(start, seeds, stop)?;
        self.evolve(Some(start), Some(DEVIATION), stop)?;
        Ok(self.level().is_violated)
    }

    /// Changes one axis at a time, and then the best changes together. Returns the point with the
    /// lowest robustness.
    fn along_the_axes(
        &mut self,
        start: Vec<f64>,
        seeds: Seeds,
        stop: u64,
    ) -> Result<Vec<f64>, FalsificationError> {
        let amplitude = self.level().amplitude;
        let changes = self.changes(&start, amplitude);
        let points: Vec<Vec<f64>> = std::iter::once(start.clone())
            .chain(changes.iter().map(|(axis, value)| with(&start, &[(*axis, *value)])))
            .collect();
        // Half of the simulations are for CMA-ES.
        let needed = (points.len() + TOGETHER.len()) as u64;
        if 2 * needed > stop.saturating_sub(self.level().simulations) {
            return Ok(start);
        }
        let Some(values) = self.values(&points, amplitude, seeds)? else { return Ok(start) };
        let mut better: Vec<(f64, (usize, f64))> = values[1..]
            .iter()
            .zip(&changes)
            .filter(|(value, _)| **value < values[0])
            .map(|(value, change)| (*value, *change))
            .collect();
        better.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut axes = std::collections::BTreeSet::new();
        // At most one change of each axis.
        let chosen: Vec<(usize, f64)> =
            better.iter().map(|(_, change)| *change).filter(|(axis, _)| axes.insert(*axis)).collect();
        let Some(first) = chosen.first() else { return Ok(start) };
        let mut together: Vec<Vec<f64>> = TOGETHER
            .iter()
            .filter(|count| **count < chosen.len())
            .chain([&chosen.len()])
            .map(|count| with(&start, &chosen[..*count]))
            .collect();
        let Some(lowest) = self.values(&together, amplitude, seeds)? else { return Ok(start) };
        let best = (0..lowest.len()).min_by(|a, b| lowest[*a].total_cmp(&lowest[*b]));
        Ok(match best {
            Some(best) if lowest[best] < better[0].0 => together.swap_remove(best),
            _ => with(&start, &[*first]),
        })
    }

    /// Returns changes of single axes: a disturbed axis to each of its ends, another one by a step.
    fn changes(&self, start: &[f64], amplitude: f64) -> Vec<(usize, f64)> {
        let of = |index: usize| {
            let axis = &self.space.axes()[index];
            let u = start[index];
            let ends = match axis {
                axis if axis.is_fixed() || axis.nominal.is_none() => [u, u],
                axis if is_disturbed(axis) && amplitude > 0.0 => [0.0, 1.0],
                axis if super::amplitude::varies_freely(axis) => {
                    [(u - START_STEP).max(0.0), (u + START_STEP).min(1.0)]
                }
                _ => [u, u],
            };
            ends.into_iter().filter(move |end| *end != u).map(move |end| (index, end))
        };
        (0..start.len()).flat_map(of).collect()
    }

    /// Returns a random corner of the cube, for every second number with free axes anywhere.
    fn random_point(&mut self, number: u64) -> Vec<f64> {
        let mut u = self.random_corner();
        if number % 2 == 1 {
            for (u, axis) in u.iter_mut().zip(self.space.axes()) {
                if super::amplitude::varies_freely(axis) {
                    *u = self.random.uniform();
                }
            }
        }
        u
    }

    /// Returns the index of the point with the lowest robustness; `None` after a violation or an
    /// interruption.
    fn lowest_of(
        &mut self,
        points: &[Vec<f64>],
        amplitude: f64,
        seeds: Seeds,
    ) -> Result<Option<usize>, FalsificationError> {
        let Some(values) = self.values(points, amplitude, seeds)? else { return Ok(None) };
        Ok((0..values.len()).min_by(|a, b| values[*a].total_cmp(&values[*b])))
    }

    /// Simulates points and returns their robustness, infinite without a verdict; `None` after a
    /// violation or an interruption.
    fn values(
        &mut self,
        points: &[Vec<f64>],
        amplitude: f64,
        seeds: Seeds,
    ) -> Result<Option<Vec<f64>>, FalsificationError> {
        let mut values = Vec::with_capacity(points.len());
        for batch in points.chunks(crate::repeat::BATCH) {
            let scenarios: Vec<_> = batch.iter().map(|u| scenario_at(&self.space, u, amplitude)).collect();
            let found = self.rollout(&scenarios, seeds)?;
            values.extend(found.iter().map(|value| value.unwrap_or(f64::INFINITY)));
            if self.level().is_violated || self.is_interrupted {
                return Ok(None);
            }
        }
        Ok(Some(values))
    }
}

/// Returns a point with other coordinates.
fn with(start: &[f64], changes: &[(usize, f64)]) -> Vec<f64> {
    let mut point = start.to_vec();
    changes.iter().for_each(|(index, value)| point[*index] = *value);
    point
}
