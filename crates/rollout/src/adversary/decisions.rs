//! When an adversary decides which axes.

use crate::rollout::Rollout;
use crate::{AxisValues, Effect, Space};

/// Time between two decisions whether an event begins, s.
const EVENT_PERIOD: f64 = 0.5;

/// The decisions of an adversary in an episode.
///
/// Each axis of an offset is decided at the start of the control step in which it begins to act, so
/// that the adversary has seen everything before. Offsets of one number of the observation or of
/// the action are one channel of the adversary's action, whichever decision sets them. An event
/// begins at the first decision that asks for it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Decisions {
    /// The decisions, in order. The first is at control step 0.
    all: Vec<Decision>,
    /// The events.
    events: Vec<Event>,
    /// Length of the adversary's action.
    channels: usize,
}

/// One decision.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Decision {
    /// Control step, from 0.
    pub step: usize,
    /// Channel, and index of the axis in the space, of each offset.
    pub axes: Vec<(usize, usize)>,
}

/// An event that happens at most once.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Event {
    /// Channel that asks for the event with a positive number.
    pub trigger: usize,
    /// Index in the space of the axis that is the time of the event, and its index in the space of
    /// the environment.
    pub time: (usize, usize),
    /// Channel of each other axis, and its indices.
    pub axes: Vec<(usize, (usize, usize))>,
}

/// Place of an offset: whether in the action, and the index of the number there.
type Place = (bool, usize);

/// The control step in which an offset begins, its place, and its axis.
type Begin = (usize, Place, usize);

impl Decisions {
    /// Returns the decisions for the axes of a system's space that are offsets of observations and
    /// actions, and for the events that can begin at any time.
    pub(crate) fn new(rollout: &Rollout) -> Decisions {
        let mut events = events(rollout);
        let steps_of = |event: &Event| asked(rollout, event.time.0);
        events.retain(|event| !steps_of(event).is_empty());
        let asked: Vec<usize> = events.iter().flat_map(steps_of).collect();
        Decisions::of(&offsets(rollout), events, asked.into_iter())
    }

    /// Returns the decisions for these offsets and events. `asked` has the control steps in which
    /// an event can begin.
    fn of(begins: &[Begin], mut events: Vec<Event>, asked: impl Iterator<Item = usize>) -> Decisions {
        let mut steps: Vec<usize> = begins.iter().map(|(begin, _, _)| *begin).chain([0]).collect();
        steps.extend(asked.filter(|_| !events.is_empty()));
        steps.sort_unstable();
        steps.dedup();
        // A decision can set several offsets of one number, such as a bias and a knot of a drift.
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
        let mut channels = channels.len();
        for event in &mut events {
            event.trigger = channels;
            event.axes.iter_mut().zip(channels + 1..).for_each(|((own, _), channel)| *own = channel);
            channels += 1 + event.axes.len();
        }
        Decisions { all, events, channels }
    }

    /// Returns the decisions, in order.
    pub(crate) fn all(&self) -> &[Decision] {
        &self.all
    }

    /// Returns the events.
    pub(crate) fn events(&self) -> &[Event] {
        &self.events
    }

    /// Returns the length of the adversary's action.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Returns whether an axis is decided.
    pub(crate) fn contains(&self, axis: usize) -> bool {
        let offsets = self.all.iter().flat_map(|decision| decision.axes.iter().map(|(_, axis)| *axis));
        let events = self
            .events
            .iter()
            .flat_map(|event| event.axes.iter().map(|(_, (axis, _))| *axis).chain([event.time.0]));
        offsets.chain(events).any(|own| own == axis)
    }

    /// Returns the number of control steps from a decision to the next one, or to the end.
    pub(crate) fn steps_after(&self, decision: usize, episode_steps: usize) -> usize {
        let next = self.all.get(decision + 1).map_or(episode_steps, |next| next.step);
        next - self.all[decision].step
    }
}

/// Returns whether an adversary can choose the value of an axis: from real numbers, always.
fn is_free(space: &Space, axis: usize) -> bool {
    let axis = &space.axes()[axis];
    axis.values == AxisValues::Continuous && !axis.is_fixed() && axis.conditions.is_empty()
}

/// Returns the control steps in which an event can begin: in the middle of a step, within the
/// bounds of the axis that is its time.
fn asked(rollout: &Rollout, time: usize) -> Vec<usize> {
    let (axis, dt) = (&rollout.space.axes()[time], rollout.environment.control_dt());
    let period = (EVENT_PERIOD / dt).round().max(1.0) as usize;
    let first = (axis.low / dt - 0.5).ceil().max(0.0) as usize;
    let within = |step: &usize| (*step as f64 + 0.5) * dt <= axis.high;
    (first..rollout.environment.episode_steps()).step_by(period).take_while(within).collect()
}

/// Returns the offsets of a system.
fn offsets(rollout: &Rollout) -> Vec<Begin> {
    let mut begins: Vec<Begin> = Vec::new();
    for (axis, effect) in rollout.routing.effects() {
        let (profile, place) = match effect {
            Effect::Action { entry, profile } => (profile, (true, *entry)),
            Effect::Observation { entry, profile, .. } => (profile, (false, *entry)),
            _ => continue,
        };
        if !is_free(&rollout.space, *axis) || profile.begin() >= rollout.environment.episode_steps() {
            continue;
        }
        match begins.iter_mut().find(|(_, _, known)| known == axis) {
            // One axis can offset several numbers.
            Some((begin, _, _)) => *begin = profile.begin().min(*begin),
            None => begins.push((profile.begin(), place, *axis)),
        }
    }
    begins
}

/// Returns the events with a free time, without their channels. Other axes that are not free stay
/// with the scenario of the episode.
fn events(rollout: &Rollout) -> Vec<Event> {
    let places = rollout.routing.environment_axes();
    let pair = |axis: &usize| (places[*axis], *axis);
    let event = |axes: Vec<usize>| {
        let (time, others) = axes.split_first()?;
        let free = others.iter().map(pair).filter(|(axis, _)| is_free(&rollout.space, *axis));
        let axes: Vec<(usize, (usize, usize))> = free.map(|axis| (0, axis)).collect();
        let can_begin = is_free(&rollout.space, places[*time]) && !axes.is_empty();
        can_begin.then(|| Event { trigger: 0, time: pair(time), axes })
    };
    rollout.environment.events().into_iter().filter_map(event).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_segment_is_decided_at_its_begin_and_each_action_has_a_channel() {
        let segment = |entry, begin, axis| (begin, (true, entry), axis);
        let begins = [segment(0, 0, 0), segment(0, 30, 1), segment(4, 0, 2), segment(4, 30, 3)];
        let all = Decisions::of(&begins, vec![], 0..100);
        let expected = [
            Decision { step: 0, axes: vec![(0, 0), (1, 2)] },
            Decision { step: 30, axes: vec![(0, 1), (1, 3)] },
        ];
        assert_eq!((all.all(), all.channels()), (expected.as_slice(), 2));
        assert_eq!([0, 1].map(|decision| all.steps_after(decision, 100)), [30, 70]);
        assert!((0..4).all(|axis| all.contains(axis)) && !all.contains(4));
    }

    #[test]
    fn two_knots_that_begin_together_have_two_channels() {
        let knot = |begin, axis| (begin, (false, 2), axis);
        // The first two of three linear knots act from the start on.
        let all = Decisions::of(&[knot(0, 0), knot(0, 1), knot(40, 2)], vec![], 0..100);
        let expected =
            [Decision { step: 0, axes: vec![(0, 0), (1, 1)] }, Decision { step: 40, axes: vec![(0, 2)] }];
        assert_eq!((all.all(), all.channels()), (expected.as_slice(), 2));
    }

    #[test]
    fn events_have_their_own_channels_and_decisions() {
        let event = Event { trigger: 0, time: (5, 0), axes: vec![(0, (6, 1)), (0, (7, 2))] };
        let all = Decisions::of(&[(20, (true, 0), 3)], vec![event], (0..90).step_by(30));
        assert_eq!(all.all().iter().map(|decision| decision.step).collect::<Vec<_>>(), [0, 20, 30, 60]);
        let expected = Event { trigger: 1, time: (5, 0), axes: vec![(2, (6, 1)), (3, (7, 2))] };
        assert_eq!((all.events(), all.channels()), ([expected].as_slice(), 4));
        assert!([3, 5, 6, 7].iter().all(|axis| all.contains(*axis)));
    }
}
