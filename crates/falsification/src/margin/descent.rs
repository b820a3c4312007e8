//! The search below the smallest violation: one attack after the other, until the budget is spent.

use super::amplitude::{all_scenarios, below, relative};
use super::attempt::{Attempt, Seeds};
use crate::FalsificationError;

/// The first and the last relative distance of the next amplitude from that of the witness. An
/// attack without a violation halves it.
pub(super) const FIRST_STEP: f64 = 0.3;
pub(super) const LAST_STEP: f64 = 0.05;

/// Share of the budget of one attack, and its fewest simulations.
const ATTACK: f64 = 0.1;
const FEWEST: u64 = 16;

/// Fractions of the amplitude of a violation that are tried at once.
const FRACTIONS: [f64; 8] = [0.9, 0.8, 0.7, 0.55, 0.4, 0.25, 0.1, 0.0];

impl Attempt<'_> {
    /// Searches at amplitudes below that of the witness, up to `end` simulations. The first one is
    /// the fraction `step` below.
    pub(super) fn descend(&mut self, end: u64, mut step: f64) -> Result<(), FalsificationError> {
        let mut attacks = 0_u64;
        let share = ((ATTACK * self.settings.budget as f64) as u64).max(FEWEST);
        while let Some(witness) = self.witness.clone() {
            let left = end.saturating_sub(self.simulations).min(share);
            let Some(amplitude) = below(&self.space, self.smallest(), step) else { break };
            if left == 0 || self.is_interrupted || self.is_exhausted(amplitude) {
                break;
            }
            self.enter(amplitude);
            let stop = self.level().simulations + left;
            let has_found = if all_scenarios(&self.space, amplitude, left).is_some() {
                self.search(left)?
            } else if attacks.is_multiple_of(2) {
                let start = relative(&self.space, &witness.request.scenario, amplitude);
                self.attack(start, Seeds::Of(witness.request.seed), stop)?
            } else {
                self.attack_from_random(stop)?
            };
            let level = self.level_mut();
            level.is_complete = has_found || level.is_exhaustive || level.simulations >= stop;
            if has_found {
                self.shrink(end)?;
                attacks = 0;
            } else {
                attacks += 1;
                step = (step / 2.0).max(LAST_STEP);
            }
        }
        Ok(())
    }

    /// Returns whether all scenarios up to an amplitude were simulated without a violation.
    fn is_exhausted(&self, amplitude: f64) -> bool {
        self.levels
            .iter()
            .any(|level| level.is_exhaustive && !level.is_violated && level.amplitude >= amplitude)
    }

    /// Scales the witness toward nominal, in one batch of at most as many simulations as are left
    /// up to `end`. The batch belongs to the amplitude of the witness.
    fn shrink(&mut self, end: u64) -> Result<(), FalsificationError> {
        let Some(witness) = self.witness.clone() else { return Ok(()) };
        let amplitude = self.smallest();
        let count = end.saturating_sub(self.simulations).min(FRACTIONS.len() as u64) as usize;
        if count == 0 || amplitude == 0.0 || self.is_interrupted {
            return Ok(());
        }
        let u = relative(&self.space, &witness.request.scenario, amplitude);
        let scenario = |fraction: &f64| super::amplitude::scenario_at(&self.space, &u, fraction * amplitude);
        let scenarios: Vec<_> = FRACTIONS.iter().take(count).map(scenario).collect();
        self.rollout(&scenarios, Seeds::Of(witness.request.seed))?;
        Ok(())
    }
}
