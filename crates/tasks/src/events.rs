//! Constants and events of the rows of a batch: what the tails of their state rows say about the
//! next control step.

use mishandle_world::{Body, Change, Mocap, ModelField};

use crate::axes::{self, JUMP_SIZE, PUSH_SIZE, Parameter, Push, SLIP_SIZE};
use crate::environment::TaskEnvironment;

/// Changes that the axes of a space can make in a control step. A tail has the control step, the
/// constants, the push, the jump and the slip of its row. A space without such axes has none.
pub(crate) struct Events {
    /// Length of a tail, 0 if no axis of the space affects steps after the start.
    pub size: usize,
    /// Fields of the model that constants and slips change.
    pub fields: Vec<ModelField>,
    /// Bodies that a push pushes.
    pub pushed: Vec<Body>,
    /// Mocap body that jumps.
    jumping: Option<Mocap>,
    has_slip: bool,
    /// Physics step, s.
    timestep: f64,
    substeps: usize,
}

impl Events {
    pub(crate) fn new(environment: &TaskEnvironment) -> Events {
        let elements = environment.elements();
        let has = |kind: fn(&Parameter) -> bool| environment.space_parameters().iter().any(kind);
        let has_slip = has(|parameter| matches!(parameter, Parameter::Slip(_)));
        let has_push = has(|parameter| matches!(parameter, Parameter::Push(_)));
        let has_jump = has(|parameter| matches!(parameter, Parameter::Jump(_)));
        Events {
            size: environment.tail_size(),
            fields: varying_fields(environment, has_slip),
            pushed: if has_push { elements.push.clone() } else { Vec::new() },
            jumping: elements.jump.filter(|_| has_jump),
            has_slip,
            timestep: environment.model().timestep(),
            substeps: environment.substeps(),
        }
    }

    /// Returns how many numbers the forces of a row have in one control step.
    pub(crate) fn force_size(&self) -> usize {
        if self.pushed.is_empty() { 0 } else { 3 * self.substeps }
    }

    /// Writes the force of the push in each physics step, N.
    pub(crate) fn push(&self, tail: &[f64], forces: &mut [f64]) {
        if forces.is_empty() {
            return;
        }
        let push = Push::new(components(tail).0);
        for (substep, force) in forces.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            *force = push.map_or([0.0; 3], |push| push.substep_force(tail[0], substep, self.timestep));
        }
    }

    /// Moves the mocap body that jumps in this control step. Returns whether there is one.
    pub(crate) fn jump(&self, tail: &[f64], mocap: &mut [f64]) -> bool {
        let Some(body) = self.jumping else { return false };
        let offset = axes::jump(components(tail).1, tail[0] as usize);
        for (position, offset) in mocap[7 * body.index()..].iter_mut().zip(offset.unwrap_or_default()) {
            *position += offset;
        }
        offset.is_some()
    }

    /// Returns whether the slip differs from that of the control step before.
    pub(crate) fn slips(&self, tail: &[f64]) -> bool {
        let step = tail[0] as usize;
        let (_, _, slip) = components(tail);
        self.has_slip && step > 0 && axes::slip(slip, step) != axes::slip(slip, step - 1)
    }
}

/// Returns the fields of the model that the constants of the space, and a slip if it has one,
/// change.
fn varying_fields(environment: &TaskEnvironment, has_slip: bool) -> Vec<ModelField> {
    let elements = environment.elements();
    // The fields of a change do not depend on its value.
    let constants = environment.space_parameters().iter().filter_map(|parameter| match parameter {
        Parameter::Constant(constant) => Some(elements.change(*constant, 1.0)),
        _ => None,
    });
    let slip = has_slip.then(|| elements.slip([1.0; 2])).into_iter().flatten();
    ModelField::of(&constants.chain(slip).collect::<Vec<Change>>())
}

/// Returns the push, the jump and the slip of a tail.
fn components(tail: &[f64]) -> (&[f64], &[f64], &[f64]) {
    let (rest, slip) = tail.split_at(tail.len() - SLIP_SIZE);
    let (rest, jump) = rest.split_at(rest.len() - JUMP_SIZE);
    (&rest[rest.len() - PUSH_SIZE..], jump, slip)
}
