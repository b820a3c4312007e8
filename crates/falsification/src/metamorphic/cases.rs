//! Source cases, and the follow-up cases that relations derive from them.

use mishandle_rollout::{Axis, Request, Scenario, Seed, Space};

use super::MetamorphicSettings;
use super::relation::Relation;
use crate::FalsificationError;

/// Random source cases of a space, and their follow-up cases.
#[derive(Clone, Debug)]
pub struct Cases {
    sources: Space,
    space: Space,
    seed: Seed,
}

impl Cases {
    /// Makes the cases of a seed. Source cases are random scenarios of `sources`. `space` begins
    /// with the same axes, with bounds that also hold the follow-up cases; its further axes are
    /// nominal in source cases.
    pub fn new(sources: Space, space: Space, seed: Seed) -> Cases {
        Cases { sources, space, seed }
    }

    /// Returns the space from which source cases are drawn.
    pub fn sources(&self) -> &Space {
        &self.sources
    }

    /// Checks that each relation can change its axes, and has a follow-up case within the bounds.
    ///
    /// # Errors
    /// If a change does not fit its axis, no axis is changed, an axis is changed that has no value
    /// in source cases, or all follow-up cases of a relation are outside of the bounds.
    pub fn check(
        &self,
        relations: &[Relation],
        settings: MetamorphicSettings,
    ) -> Result<(), FalsificationError> {
        settings.check(relations)?;
        for relation in relations {
            for (index, change) in &relation.changes {
                let axis = &self.space.axes()[*index];
                change.check(axis)?;
                let is_drawn = *index < self.sources.dimension();
                if !is_drawn && axis.nominal.is_none() {
                    return Err(FalsificationError::Change {
                        axis: axis.name.clone(),
                        change: change.to_string(),
                        expected: "a change of an axis that source cases have: add it to the axes"
                            .to_string(),
                    });
                }
            }
            let number = |index: u64| u32::try_from(index).unwrap_or(u32::MAX);
            let mut numbers = (1..=settings.pairs).map(number);
            let has_follow_up =
                |number| self.follow_up(relation, &self.source(number).scenario, 1.0).is_some();
            if !numbers.any(has_follow_up) {
                let bounds = |(index, _): &(usize, _)| {
                    let Axis { name, low, high, .. } = &self.space.axes()[*index];
                    format!("{name} from {low} to {high}")
                };
                return Err(FalsificationError::NoFollowUp {
                    relation: relation.name.clone(),
                    pairs: settings.pairs,
                    bounds: relation.changes.iter().map(bounds).collect::<Vec<_>>().join(", "),
                });
            }
        }
        Ok(())
    }

    /// Returns source case `number`, counted from 1: scenario and seed of simulation `number` of an
    /// evaluation with the same seed.
    pub(super) fn source(&self, number: u32) -> Request {
        let index = u64::from(number.saturating_sub(1));
        let drawn = self.sources.sample(self.seed, index);
        let further = self.space.axes()[self.sources.dimension()..].iter().map(|axis| axis.nominal);
        let values = drawn.values().iter().copied().chain(further).collect();
        let scenario = self.space.canonical(Scenario::new(values));
        Request {
            trial: MetamorphicSettings::SOURCES,
            number,
            ..Request::new(scenario, self.seed.child(index))
        }
    }

    /// Returns the follow-up case of a source case, with a share from 0 to 1 of the change; `None`
    /// if it is outside of the bounds.
    pub(super) fn follow_up(&self, relation: &Relation, source: &Scenario, share: f64) -> Option<Scenario> {
        let mut values = source.values().to_vec();
        for (index, change) in &relation.changes {
            values[*index] = Some(change.apply(&self.space.axes()[*index], source.get(*index)?, share)?);
        }
        Some(self.space.canonical(Scenario::new(values)))
    }
}
