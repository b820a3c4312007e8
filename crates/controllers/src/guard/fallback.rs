use std::sync::Arc;

use mishandle_rollout::Controller;

/// Who acts after the hand-over.
#[derive(Clone)]
pub enum Fallback {
    /// Another controller. It starts at the hand-over.
    Controller(Arc<dyn Controller>),
    /// Stays where it is.
    Hold(Motion),
    /// Takes back the last actions, the newest one first, and then stays.
    Retreat(Motion, usize),
}

/// Meanings of the numbers of an action, for a robot that shall stop.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Meaning of each number.
    pub meanings: Vec<Meaning>,
    /// Largest absolute value of an action; larger ones are clipped.
    pub limit: f64,
}

/// Meaning of a number of an action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// A change per control step, such as a velocity: 0 is rest.
    Increment,
    /// A place, such as the target of a joint: the last one is rest.
    Position,
    /// A change of the gripper, which keeps its grip also on the way back.
    Grip,
}

impl Fallback {
    /// Returns the number of actions that it remembers.
    pub(crate) fn remembered(&self) -> usize {
        match self {
            Fallback::Controller(_) => 0,
            Fallback::Hold(_) => 1,
            Fallback::Retreat(_, steps) => steps + 1,
        }
    }
}

/// The last actions of a simulation: their number, then the actions, the oldest first.
pub(crate) struct Actions<'a>(pub &'a mut [f64]);

impl Actions<'_> {
    pub fn state_size(remembered: usize, action_size: usize) -> usize {
        if remembered == 0 { 0 } else { 1 + remembered * action_size }
    }

    fn parts(&mut self) -> Option<(&mut f64, &mut [f64])> {
        self.0.split_first_mut()
    }

    /// Adds an action. The oldest one is forgotten if there is no place.
    pub fn push(&mut self, action: &[f32], limit: f64) {
        let Some((count, actions)) = self.parts() else { return };
        let places = actions.len() / action.len();
        if *count as usize == places {
            actions.copy_within(action.len().., 0);
            *count -= 1.0;
        }
        let place = &mut actions[*count as usize * action.len()..][..action.len()];
        for (kept, action) in place.iter_mut().zip(action) {
            *kept = f64::from(*action).clamp(-limit, limit);
        }
        *count += 1.0;
    }

    /// Writes the action that stays where the last action led.
    pub fn hold(&mut self, motion: &Motion, action: &mut [f32]) {
        let Some((count, actions)) = self.parts() else { return };
        let last = (*count as usize).checked_sub(1).map(|last| &actions[last * action.len()..]);
        for (index, (own, meaning)) in action.iter_mut().zip(&motion.meanings).enumerate() {
            *own = match meaning {
                Meaning::Increment | Meaning::Grip => 0.0,
                Meaning::Position => last.map_or(0.0, |last| last[index]) as f32,
            };
        }
    }

    /// Writes the action that takes back the last one, and forgets that one.
    pub fn retreat(&mut self, motion: &Motion, action: &mut [f32]) {
        let size = action.len();
        let Some((count, actions)) = self.parts() else { return };
        let Some(last) = (*count as usize).checked_sub(1) else {
            action.fill(0.0);
            return;
        };
        let taken = &actions[last * size..][..size];
        let before = last.checked_sub(1).map_or(taken, |before| &actions[before * size..][..size]);
        let is_at_end = last == 0;
        for (index, (own, meaning)) in action.iter_mut().zip(&motion.meanings).enumerate() {
            *own = match meaning {
                Meaning::Increment if !is_at_end => -taken[index] as f32,
                Meaning::Increment | Meaning::Grip => 0.0,
                Meaning::Position => before[index] as f32,
            };
        }
        // The oldest action stays: it is where a robot of positions rests.
        if !is_at_end {
            *count -= 1.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(meaning: Meaning, remembered: usize, given: &[f32], steps: usize) -> Vec<f32> {
        let mut state = vec![0.0; Actions::state_size(remembered, 1)];
        let motion = Motion { meanings: vec![meaning], limit: 1.0 };
        given.iter().for_each(|action| Actions(&mut state).push(&[*action], motion.limit));
        let step = |_| {
            let mut action = [9.0];
            Actions(&mut state).retreat(&motion, &mut action);
            action[0]
        };
        (0..steps).map(step).collect()
    }

    #[test]
    fn increments_are_taken_back_and_end_at_rest() {
        let moves = [0.5, 0.25, 3.0, -0.5]; // 3 is clipped to 1
        assert_eq!(run(Meaning::Increment, 4, &moves, 5), [0.5, -1.0, -0.25, 0.0, 0.0]);
        // All that the last three moves changed is taken back.
        assert_eq!(run(Meaning::Increment, 4, &moves, 5).iter().sum::<f32>(), -(0.25 + 1.0 - 0.5));
    }

    #[test]
    fn positions_are_visited_backward() {
        assert_eq!(run(Meaning::Position, 3, &[0.1, 0.2, 0.3, 0.4], 4), [0.3, 0.2, 0.2, 0.2]);
    }

    #[test]
    fn a_grip_is_kept() {
        assert_eq!(run(Meaning::Grip, 3, &[1.0, 1.0], 3), [0.0; 3]);
    }

    #[test]
    fn without_actions_it_stays() {
        assert_eq!(run(Meaning::Position, 3, &[], 2), [0.0; 2]);
    }
}
