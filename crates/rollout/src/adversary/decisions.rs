//! When an adversary decides which axes.

use crate::disturbance::AxisRouting;
use crate::{AxisValues, Effect, Space};

/// The decisions of an adversary in an episode: each axis of an offset is decided at the start of
/// the control step in which it begins to act, so that the adversary has seen everything before.
///
/// Offsets of one number of the observation or of the action are one channel of the adversary's
/// action, whichever decision sets them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Decisions {
    /// The decisions, in order. The first is at control step 0.
    all: Vec<Decision>,
    /// Length of the adversary's action.
    channels: usize,
}

/// One decision.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Decision {
    /// Control step, from 0.
    pub step: usize,
    /// Channel, and index of the axis in the space.
    pub axes: Vec<(usize, usize)>,
}

/// What an offset is added to: whether to the action, and the index of the number there.
type Place = (bool, usize);

impl Decisions {
    /// Returns the decisions for the axes of a space that are offsets of observations and actions
    /// with a range of real numbers, and no condition.
    pub(crate) fn new(space: &Space, routing: &AxisRouting, episode_steps: usize) -> Decisions {
        let mut begins: Vec<(usize, Place, usize)> = Vec::new();
        for (axis, effect) in routing.effects() {
            let (profile, place) = match effect {
                Effect::Action { entry, profile } => (profile, (true, *entry)),
                Effect::Observation { entry, profile, .. } => (profile, (false, *entry)),
                _ => continue,
            };
            let known = &space.axes()[*axis];
            let is_free = known.values == AxisValues::Continuous && !known.is_fixed();
            if !is_free || !known.conditions.is_empty() || profile.begin() >= episode_steps {
                continue;
            }
            match begins.iter_mut().find(|(_, _, known)| known == axis) {
                // One axis can offset several numbers.
                Some((begin, _, _)) => *begin = profile.begin().min(*begin),
                None => begins.push((profile.begin(), place, *axis)),
            }
        }
        let mut steps: Vec<usize> = begins.iter().map(|(begin, _, _)| *begin).chain([0]).collect();
        steps.sort_unstable();
        steps.dedup();
        // A decision can set several knots of one number: the first two of a piecewise-linear one.
        let mut channels: Vec<(Place, usize)> = Vec::new();
        let mut all = Vec::with_capacity(steps.len());
        for step in steps {
            let mut seen: Vec<Place> = Vec::new();
            let mut axes = Vec::new();
            for (_, place, axis) in begins.iter().filter(|(begin, _, _)| *begin == step) {
                let channel = (*place, seen.iter().filter(|known| *known == place).count());
                seen.push(*place);
                let known = channels.iter().position(|known| *known == channel);
                let index = known.unwrap_or_else(|| {
                    channels.push(channel);
                    channels.len() - 1
                });
                axes.push((index, *axis));
            }
            all.push(Decision { step, axes });
        }
        Decisions { all, channels: channels.len() }
    }

    /// Returns the decisions, in order.
    pub(crate) fn all(&self) -> &[Decision] {
        &self.all
    }

    /// Returns the length of the adversary's action.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Returns whether an axis is decided.
    pub(crate) fn contains(&self, axis: usize) -> bool {
        self.all.iter().any(|decision| decision.axes.iter().any(|(_, own)| *own == axis))
    }

    /// Returns the number of control steps from a decision to the next one, or to the end.
    pub(crate) fn steps_after(&self, decision: usize, episode_steps: usize) -> usize {
        let next = self.all.get(decision + 1).map_or(episode_steps, |next| next.step);
        next - self.all[decision].step
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Axis, AxisKind, Disturbance, TimeProfile};

    fn decisions(disturbances: &[(&str, Effect)]) -> Decisions {
        let axis = |name: &str| Axis::new(AxisKind::Input, name, "", [-1.0, 1.0], Some(0.0));
        let known: Vec<Disturbance> = disturbances
            .iter()
            .map(|(name, effect)| Disturbance { axis: axis(name), effect: effect.clone() })
            .collect();
        let space = Space::new("s", disturbances.iter().map(|(name, _)| axis(name)).collect());
        let space = space.expect("the axes are valid");
        let none = Space::new("none", vec![]).expect("a space may be empty");
        let routing = AxisRouting::new(&space, &none, &known).expect("all axes are known");
        Decisions::new(&space, &routing, 100)
    }

    fn action(entry: usize, begin: usize) -> Effect {
        Effect::Action { entry, profile: TimeProfile::Constant(begin..begin + 30) }
    }

    #[test]
    fn a_segment_is_decided_at_its_begin_and_each_action_has_a_channel() {
        let all = decisions(&[
            ("a1", action(0, 0)),
            ("a2", action(0, 30)),
            ("b1", action(4, 0)),
            ("b2", action(4, 30)),
        ]);
        let expected = [
            Decision { step: 0, axes: vec![(0, 0), (1, 2)] },
            Decision { step: 30, axes: vec![(0, 1), (1, 3)] },
        ];
        assert_eq!((all.all(), all.channels()), (expected.as_slice(), 2));
        assert_eq!([0, 1].map(|decision| all.steps_after(decision, 100)), [30, 70]);
    }

    #[test]
    fn a_linear_knot_is_decided_at_the_knot_before_it() {
        let knot = |before, at, after| Effect::Observation {
            entry: 2,
            factor: 1.0,
            profile: TimeProfile::Linear { before, at, after },
        };
        let all = decisions(&[("d1", knot(0, 0, 40)), ("d2", knot(0, 40, 90)), ("d3", knot(40, 90, 90))]);
        let expected =
            [Decision { step: 0, axes: vec![(0, 0), (1, 1)] }, Decision { step: 40, axes: vec![(0, 2)] }];
        assert_eq!((all.all(), all.channels()), (expected.as_slice(), 2));
    }

    #[test]
    fn only_offsets_within_the_episode_are_decided() {
        let noise = Effect::ObservationNoise { entries: vec![(0, 1.0)] };
        let all = decisions(&[("delay", Effect::ActionDelay), ("noise", noise), ("late", action(0, 100))]);
        assert_eq!(all.channels(), 0);
        assert!((0..3).all(|axis| !all.contains(axis)));
    }
}
