//! Axes of events: pushes, jumps of a target, slips of a grasp, and the speed of a throw.

use mishandle_rollout::{Axis, AxisKind, AxisValues};

use super::{Parameter, XYZ};
use crate::definition::{Attachment, Definition};
use crate::robot::CONTROL_DT;

/// Components of a push, a jump and a slip.
const PUSH: [&str; 5] = ["push_time", "push_duration", "push_force_x", "push_force_y", "push_force_z"];
const JUMP: [&str; 4] = ["jump_time", "jump_x", "jump_y", "jump_z"];
const SLIP: [&str; 3] = ["slip_time", "slip_x", "slip_z"];

/// Duration of a slip, s: a step would press a held object with the full force of the weld.
const SLIP_DURATION: f64 = 0.1;

/// Latest time of a slip, s. After the release of the object a slip has no effect, and the shipped
/// controllers have released it by then in 277 of 300 random starts.
const LATEST_SLIP: f64 = 1.5;

/// Largest slip along each axis of the hand, m.
const MAX_SLIP: f64 = 0.01;

pub(super) fn events(definition: &Definition) -> Vec<(Axis, Parameter)> {
    let event = |name: &str, unit: &str, bounds, nominal: f64, meaning: &str| {
        Axis::new(AxisKind::Event, name, unit, bounds, Some(nominal)).meaning(meaning)
    };
    let mut axes = Vec::new();
    if let Some((body, force)) = definition.variations.push {
        let parts = PUSH.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("start time of the push on the {body}")),
                1 => event(name, "s", [0.01, 0.2], 0.1, &format!("duration of the push on the {body}")),
                _ => {
                    let meaning = format!("force on the {body} along the world's {} axis", XYZ[index - 2]);
                    event(name, "N", [-force, force], 0.0, &meaning)
                }
            };
            (axis, Parameter::Push(index))
        });
        axes.extend(parts);
    }
    if let Some(body) = definition.variations.jump {
        let parts = JUMP.iter().enumerate().map(|(index, name)| {
            let axis = match index {
                0 => event(name, "s", [0.0, 4.0], 0.0, &format!("time of the jump of the {body}")),
                _ => {
                    let meaning = format!("jump of the {body} along the world's {} axis", XYZ[index - 1]);
                    event(name, "m", [-0.1, 0.1], 0.0, &meaning)
                }
            };
            (axis, Parameter::Jump(index))
        });
        axes.extend(parts);
    }
    if let Some(held) = definition.held.filter(|held| held.attachment == Attachment::Weld) {
        let name = held.name;
        let meanings = [
            format!("time at which the {name} slips in the grasp, within {SLIP_DURATION} s"),
            format!("slip of the {name} along the x axis of the hand, sideways on the finger pads"),
            format!("slip of the {name} along the z axis of the hand, out of the grasp"),
        ];
        let parts = SLIP.iter().zip(meanings).enumerate().map(|(index, (name, meaning))| {
            let axis = match index {
                0 => event(name, "s", [0.0, LATEST_SLIP], 0.0, &meaning),
                _ => event(name, "m", [-MAX_SLIP, MAX_SLIP], 0.0, &meaning),
            };
            (axis, Parameter::Slip(index))
        });
        axes.extend(parts);
    }
    if let Some(object) = definition.variations.thrown {
        let axis = event(
            "throw_speed_scale",
            "",
            [0.8, 1.25],
            1.0,
            &format!("factor of the initial velocity of the {object}"),
        );
        axes.push((axis.with_values(AxisValues::Logarithmic), Parameter::ThrowSpeed));
    }
    axes
}

/// A constant force during an interval of time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Push {
    start: f64,
    end: f64,
    force: [f64; 3],
}

impl Push {
    /// Makes a push from its components in the order of [`PUSH`]; `None` if the force is 0.
    pub(crate) fn new(components: &[f64]) -> Option<Push> {
        let [start, duration, x, y, z] = *components else { return None };
        let force = [x, y, z];
        (force != [0.0; 3]).then_some(Push { start, end: start + duration, force })
    }

    /// Returns the mean force over physics step `substep` of control step `step`, N. A physics step
    /// takes `timestep`, s.
    pub(crate) fn substep_force(&self, step: f64, substep: usize, timestep: f64) -> [f64; 3] {
        self.force(step * CONTROL_DT + substep as f64 * timestep, timestep)
    }

    /// Returns the mean force over the physics step from `time` to `time + step`, s. The push may
    /// cover a part of the step.
    fn force(&self, time: f64, step: f64) -> [f64; 3] {
        let covered = ((time + step).min(self.end) - time.max(self.start)).max(0.0);
        mishandle_world::frame::scale(self.force, covered / step)
    }
}

/// Returns the displacement of the mocap body in control step `step`; `None` if it does not jump in
/// this step.
///
/// `components` has the order of [`JUMP`].
pub(crate) fn jump(components: &[f64], step: usize) -> Option<[f64; 3]> {
    let offset = [components[1], components[2], components[3]];
    let is_due = (components[0] / CONTROL_DT).floor() as usize == step;
    (is_due && offset != [0.0; 3]).then_some(offset)
}

/// Returns the slip along the x and z axes of the hand at the start of control step `step`, m.
///
/// `components` has the order of [`SLIP`].
pub(crate) fn slip(components: &[f64], step: usize) -> [f64; 2] {
    let elapsed = step as f64 * CONTROL_DT - components[0];
    let share = (elapsed / SLIP_DURATION).clamp(0.0, 1.0);
    [share * components[1], share * components[2]]
}

/// Number of components of a push, a jump and a slip.
pub(crate) const PUSH_SIZE: usize = PUSH.len();
pub(crate) const JUMP_SIZE: usize = JUMP.len();
pub(crate) const SLIP_SIZE: usize = SLIP.len();

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_impulse_of_a_push_does_not_depend_on_the_physics_steps() {
        for (start, duration) in [(0.0, 0.1), (0.0123, 0.0507), (0.9999, 0.0101)] {
            let push = Push::new(&[start, duration, 2.0, 0.0, -1.0]).expect("the force is not 0");
            let step = 1.0 / 480.0;
            let impulse: f64 = (0..600).map(|i| push.force(f64::from(i) * step, step)[0] * step).sum();
            assert!((impulse - 2.0 * duration).abs() < 1e-12, "{impulse}");
        }
        assert!(Push::new(&[1.0, 0.1, 0.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn a_jump_happens_once_in_the_control_step_of_its_time() {
        let components = [1.01, 0.1, 0.0, 0.0];
        let steps: Vec<usize> = (0..300).filter(|step| jump(&components, *step).is_some()).collect();
        assert_eq!(steps, [60], "1.01 s is in control step 60, counted from 0");
        assert_eq!(jump(&[1.0, 0.0, 0.0, 0.0], 60), None);
    }

    #[test]
    fn a_slip_takes_its_duration_and_stays() {
        let at = |step| slip(&[1.0, 0.01, -0.004], step);
        assert_eq!((at(0), at(60)), ([0.0, 0.0], [0.0, 0.0]));
        // Three control steps of 1/60 s are half of 0.1 s.
        let half = at(63);
        assert!((half[0] - 0.005).abs() < 1e-12 && (half[1] + 0.002).abs() < 1e-12, "{half:?}");
        assert_eq!((at(66), at(300)), ([0.01, -0.004], [0.01, -0.004]));
    }
}
