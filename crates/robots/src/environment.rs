use std::ops::Range;
use std::sync::Arc;

use mishandle_rollout::{
    Axis, Environment, EnvironmentFacts, EnvironmentWorker, Eyes, Image, RolloutError, START_OFFSET,
    SolverChange, Space,
};
use mishandle_world::{Body, FullState, Mocap, Model, Servo, frame};

use crate::axes::{Draw, Parameter};
use crate::cameras::Seen;
use crate::change::ModelChange;
use crate::description::Over;
use crate::events::{EVENT_SIZE, Event, force, slip};
use crate::phase::Phase;
use crate::worker::RobotWorker;

/// The compiled expressions and numbers of a robot.
#[derive(Clone)]
pub(crate) struct Robot {
    pub name: String,
    /// The model without visual geoms, at the start of an episode.
    pub model: Model,
    pub keyframe: Option<usize>,
    pub control_dt: f64,
    pub episode_steps: usize,
    pub substeps: usize,
    /// Values of positions and velocities at the start, and where they belong.
    pub start: Phase,
    pub start_positions: Vec<Vec<usize>>,
    pub start_velocities: Vec<Vec<usize>>,
    pub start_mocap: Vec<Mocap>,
    /// Physics steps between the start and sample 0.
    pub settling: usize,
    /// Distance by which every joint coordinate moves at the end of a start, rad or m.
    pub start_offset: f64,
    /// Conditions under which no episode starts.
    pub invalid: Phase,
    /// Places of the parts of the memory; their start values are the last ones of `start`.
    pub memory: Vec<Range<usize>>,
    /// The next values of the memory.
    pub next: Phase,
    /// Servos of the first actuators, if the controls are targets of servos.
    pub servos: Vec<Servo>,
    /// The controls.
    pub command: Phase,
    /// The controls before the first action arrives; empty if the action is 0 then.
    pub hold: Phase,
    /// Actuators that get the controls, in the order of the expression.
    pub actuated: Vec<usize>,
    pub control_ranges: Vec<Option<[f64; 2]>>,
    /// Signals with a reduction over the physics steps.
    pub measured: Phase,
    /// Reduction and index among the signals of each.
    pub reductions: Vec<(Over, usize)>,
    /// Number of physics steps from one of their values to the next.
    pub measured_every: usize,
    /// Parts of the observation, then the other signals, then the rewards, then the ends.
    pub sample: Phase,
    /// First entry and size of each part of the observation.
    pub parts: Vec<(usize, usize)>,
    /// Bounds of each number of the observation.
    pub clips: Vec<Option<[f64; 2]>>,
    /// Index among the signals of each signal without a reduction.
    pub plain_signals: Vec<usize>,
    pub signals: Arc<[String]>,
    pub signal_clips: Vec<Option<[f64; 2]>>,
    pub reward_terms: Vec<String>,
    /// Number of conditions that end a training episode.
    pub ends: usize,
    pub observation_size: usize,
    pub action_size: usize,
    pub action_limit: f64,
    /// Nominal values of the axes.
    pub values: Vec<f64>,
    /// Changes of the model by axes, then those by slips.
    pub changes: Vec<ModelChange>,
    pub events: Vec<Event>,
    /// Indices of the slips among the events.
    pub slips: Vec<usize>,
    pub draws: Vec<Draw>,
    /// Axes of the environment and what they set.
    pub axes: Vec<(Axis, Parameter)>,
    /// Names of the axes of sight, which change images and nothing here.
    pub sight_axes: Vec<String>,
    /// The cameras of a controller that sees.
    pub seen: Option<Seen>,
}

/// A robot of a file as an environment.
///
/// A state row contains MuJoCo's state, the number of control steps, the values of the axes that
/// expressions read, those of the model, the components of the events, the memory, and the last
/// action.
#[derive(Clone)]
pub struct RobotEnvironment {
    pub(crate) robot: Arc<Robot>,
    facts: EnvironmentFacts,
    /// The parameters that the first axes set; the others are of sight.
    pub(crate) parameters: Arc<[Parameter]>,
}

impl RobotEnvironment {
    /// Makes the environment over the axes of `space` that belong to the robot.
    pub(crate) fn over(robot: Arc<Robot>, space: &Space) -> Result<RobotEnvironment, RolloutError> {
        let parameter = |axis: &Axis| {
            let found = robot.axes.iter().find(|(known, _)| known.name == axis.name);
            Some((axis.clone(), found?.1))
        };
        let own = space.axes().iter().filter_map(parameter);
        let (mut axes, parameters): (Vec<Axis>, Vec<Parameter>) = own.unzip();
        axes.extend(space.axes().iter().filter(|axis| robot.sight_axes.contains(&axis.name)).cloned());
        let facts = EnvironmentFacts {
            name: robot.name.clone(),
            space: Space::new(space.name(), axes)?,
            signals: robot.signals.clone(),
            reward_terms: robot.reward_terms.clone(),
            observation_size: robot.observation_size,
            exact_size: 0,
            action_size: robot.action_size,
            action_limit: robot.action_limit,
            state_size: robot.model.state_size() + robot.tail_size(),
            control_dt: robot.control_dt,
            episode_steps: robot.episode_steps,
        };
        Ok(RobotEnvironment { robot, facts, parameters: parameters.into() })
    }

    /// Returns the environment over the axes of `space` that belong to it. The others belong to
    /// disturbances.
    ///
    /// # Errors
    /// If two axes have the same name.
    pub fn with_own_axes(&self, space: &Space) -> Result<RobotEnvironment, RolloutError> {
        RobotEnvironment::over(self.robot.clone(), space)
    }

    /// Returns the compiled model.
    pub fn model(&self) -> &Model {
        &self.robot.model
    }
}

impl Robot {
    /// Returns the robot under a change of its physics that no verdict may depend on. Signals over
    /// physics steps have values at the same instants.
    pub(crate) fn with_solver_change(&self, change: SolverChange) -> Robot {
        match change {
            SolverChange::HalfStep => Robot {
                model: self.model.with_timestep(0.5 * self.model.timestep()),
                substeps: 2 * self.substeps,
                settling: 2 * self.settling,
                measured_every: 2 * self.measured_every,
                ..self.clone()
            },
            SolverChange::OtherCollider => Robot { model: self.model.with_other_collider(), ..self.clone() },
            SolverChange::MovedStart => Robot { start_offset: START_OFFSET, ..self.clone() },
        }
    }

    /// Returns the expression of the controls of a control step, in which an action has arrived or
    /// not.
    pub(crate) fn controls(&self, has_arrived: bool) -> &Phase {
        if has_arrived || self.hold.is_empty() { &self.command } else { &self.hold }
    }

    pub(crate) fn tail_size(&self) -> usize {
        let own = 1 + self.values.len() + self.axis_changes() + EVENT_SIZE * self.events.len();
        own + self.memory_size() + self.action_size
    }

    /// Returns the number of changes of the model by axes.
    fn axis_changes(&self) -> usize {
        self.changes.len() - self.slips.len()
    }

    fn memory_size(&self) -> usize {
        self.memory.last().map_or(0, |place| place.end)
    }

    /// Returns the tail of the state row of an undisturbed episode.
    pub(crate) fn nominal_tail(&self) -> Vec<f64> {
        let mut tail = vec![0.0];
        tail.extend(&self.values);
        tail.extend(self.changes[..self.axis_changes()].iter().map(|change| change.nominal));
        tail.extend(self.events.iter().flat_map(|event| event.nominal));
        tail.resize(self.tail_size(), 0.0);
        tail
    }

    /// Returns the place of a parameter in the tail.
    pub(crate) fn place(&self, parameter: Parameter) -> usize {
        let changes = 1 + self.values.len();
        let events = changes + self.axis_changes();
        match parameter {
            Parameter::Value(index) => 1 + index,
            Parameter::Change(index) => changes + index,
            Parameter::Event { event, component } => events + EVENT_SIZE * event + component,
            Parameter::Draw(number) => 1 + self.draws[number].index,
        }
    }
}

impl Environment for RobotEnvironment {
    fn facts(&self) -> &EnvironmentFacts {
        &self.facts
    }

    fn eyes(&self, images: &[Image]) -> Result<Arc<dyn Eyes>, RolloutError> {
        match &self.robot.seen {
            Some(seen) => Ok(Arc::new(seen.eyes(&self.robot.name, self.space(), images)?)),
            None => {
                let camera = images.first().map(|image| image.camera.clone()).unwrap_or_default();
                let environment = self.robot.name.clone();
                Err(RolloutError::NoCamera { environment, camera, known: Vec::new() })
            }
        }
    }

    fn worker(&self) -> Box<dyn EnvironmentWorker> {
        self.worker_of(1)
    }

    fn worker_of(&self, rows: usize) -> Box<dyn EnvironmentWorker> {
        Box::new(self.robot_worker(rows))
    }
}

impl RobotEnvironment {
    pub(crate) fn robot_worker(&self, rows: usize) -> RobotWorker {
        RobotWorker::new(self.robot.clone(), self.parameters.clone(), rows)
    }

    /// Makes a recorder for state rows of this environment. Each body is a part of its contacts.
    pub fn full_state(&self) -> FullState {
        let model = &self.robot.model;
        FullState::new(Box::new(self.robot_worker(1)), model, model.contact_parts(&[]))
            .with_actuators_and_bodies(model)
    }
}

/// The parts of the tail of a state row on which the model depends.
#[derive(Clone, Copy)]
pub(crate) struct ModelParts<'a> {
    pub changes: &'a [f64],
    pub events: &'a [[f64; EVENT_SIZE]],
}

/// The parts of the tail of a state row.
pub(crate) struct Tail<'a> {
    pub step: &'a mut f64,
    pub values: &'a [f64],
    pub model: ModelParts<'a>,
    pub memory: &'a mut [f64],
    pub action: &'a mut [f64],
}

impl Robot {
    pub(crate) fn split<'a>(&self, tail: &'a mut [f64]) -> Tail<'a> {
        let (step, rest) = tail.split_at_mut(1);
        let (values, rest) = rest.split_at_mut(self.values.len());
        let (changes, rest) = rest.split_at_mut(self.axis_changes());
        let (events, rest) = rest.split_at_mut(EVENT_SIZE * self.events.len());
        let (memory, action) = rest.split_at_mut(self.memory_size());
        let model = ModelParts { changes, events: events.as_chunks().0 };
        Tail { step: &mut step[0], values, model, memory, action }
    }

    /// Returns the values of the axes that change the model, and the components of the events.
    pub(crate) fn model_parts<'a>(&self, tail: &'a [f64]) -> ModelParts<'a> {
        let (changes, rest) = tail[1 + self.values.len()..].split_at(self.axis_changes());
        ModelParts { changes, events: &rest.as_chunks().0[..self.events.len()] }
    }

    /// Returns the bodies of the pushes, one for each push.
    pub(crate) fn pushed(&self) -> impl Iterator<Item = Body> {
        self.events.iter().filter_map(Event::pushed)
    }

    /// Returns the mean force of all pushes on a body over the physics step from `time`, N.
    pub(crate) fn force_on(&self, body: Body, events: &[[f64; EVENT_SIZE]], time: f64) -> [f64; 3] {
        let own = self.events.iter().zip(events).filter(|(event, _)| event.pushed() == Some(body));
        let forces = own.map(|(_, push)| force(push, time, self.model.timestep()));
        forces.fold([0.0; 3], frame::add)
    }

    /// Writes the values of all changes of the model in the physics step that starts at `time`;
    /// without a time, those before the episode.
    pub(crate) fn write_changes(&self, parts: ModelParts<'_>, time: Option<f64>, values: &mut Vec<f64>) {
        values.clear();
        values.extend(parts.changes);
        let of_slips = self.slips.iter().zip(&self.changes[parts.changes.len()..]);
        values.extend(of_slips.map(|(event, change)| {
            time.and_then(|time| slip(&parts.events[*event], time, self.model.timestep()))
                .unwrap_or(change.nominal)
        }));
    }
}
