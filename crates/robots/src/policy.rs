//! Policies that are expressions of the observation.

use std::sync::Arc;

use crate::expression::{Argument, Compiler, Meaning, Names, Place, Program, Reader, Reading, Size, value};
use mishandle_rollout::{Controller, ControllerWorker, Seed};

use crate::axes::{ObservedPart, observed};
use crate::description::Expression;
use crate::error::Problem;
use crate::library::Library;
use crate::quantity::Quantity;

/// A policy that is an expression of the parts of the observation and of the time.
pub(crate) struct ExpressionPolicy {
    program: Arc<Program<Quantity>>,
    place: Place,
    observation_size: usize,
    control_dt: f64,
}

/// The names that a policy may use: parts of its observation, constants, the time.
pub(crate) struct PolicyNames<'a> {
    pub library: &'a Library<'a>,
    pub parts: &'a [ObservedPart],
}

impl Names<Quantity> for PolicyNames<'_> {
    fn name(&self, name: &str) -> Result<Meaning<Quantity>, String> {
        if let Some(part) = self.parts.iter().find(|part| part.name == name) {
            let size = if part.size == 1 { Size::Number } else { Size::Vector(part.size) };
            return Ok(Meaning::Reading(Reading { what: observed(part), size }));
        }
        let meaning = self.library.name(name).map_err(|message| {
            let parts: Vec<&str> = self.parts.iter().map(|part| part.name.as_str()).collect();
            format!("{message}; parts of the observation: {}", parts.join(", "))
        })?;
        match &meaning {
            Meaning::Reading(Reading { what: Quantity::Parameter(_), .. }) => {
                Err(format!("a policy does not know the axis `{name}`; it sees the observation"))
            }
            _ => Ok(meaning),
        }
    }

    fn reads(&self, function: &str) -> bool {
        self.library.reads(function)
    }

    fn call(&self, function: &str, arguments: &[Argument]) -> Result<Reading<Quantity>, String> {
        match function {
            "joint_low" | "joint_high" => self.library.call(function, arguments),
            _ => Err(format!("a policy does not see `{function}`; make it a part of the observation")),
        }
    }

    fn functions(&self) -> Vec<String> {
        vec!["joint_low".to_string(), "joint_high".to_string()]
    }
}

impl ExpressionPolicy {
    pub(crate) fn new(
        expression: &Expression,
        library: &Library<'_>,
        parts: &[ObservedPart],
        control_dt: f64,
    ) -> Result<ExpressionPolicy, Problem> {
        let mut compiler = Compiler::new();
        let text = &expression.text;
        let place = compiler
            .add(&expression.node, &PolicyNames { library, parts })
            .map_err(|error| Problem::of_expression(&text.span, &text.text, &error))?;
        let observation_size = parts.iter().map(|part| part.size).sum();
        Ok(ExpressionPolicy { program: Arc::new(compiler.program()), place, observation_size, control_dt })
    }
}

impl Controller for ExpressionPolicy {
    fn observation_size(&self) -> usize {
        self.observation_size
    }

    fn action_size(&self) -> usize {
        self.place.size()
    }

    /// The number of control steps.
    fn state_size(&self) -> usize {
        1
    }

    fn worker(&self) -> Box<dyn ControllerWorker> {
        Box::new(Worker {
            program: self.program.clone(),
            place: self.place.clone(),
            memory: self.program.memory(),
            control_dt: self.control_dt,
        })
    }
}

struct Worker {
    program: Arc<Program<Quantity>>,
    place: Place,
    memory: Vec<f64>,
    control_dt: f64,
}

/// The part of a simulation that policies see.
pub(crate) struct Observation<'a> {
    pub numbers: &'a [f32],
    pub time: f64,
}

impl Reader<Quantity> for Observation<'_> {
    fn read(&mut self, what: &Quantity, out: &mut [f64]) {
        match what {
            Quantity::Observed(range) => {
                out.iter_mut()
                    .zip(&self.numbers[range.clone()])
                    .for_each(|(out, number)| *out = f64::from(*number));
            }
            Quantity::Time => out[0] = self.time,
            Quantity::Constants(values) => out.copy_from_slice(values),
            // The names of a policy have no other quantities.
            _ => out.fill(f64::NAN),
        }
    }

    fn list(&mut self, _what: &Quantity, _each: &mut dyn FnMut(f64)) {}
}

impl ControllerWorker for Worker {
    fn reset(&mut self, state: &mut [f64], _seed: Seed) {
        state.fill(0.0);
    }

    fn act(&mut self, rows: usize, observations: &[f32], states: &mut [f64], actions: &mut [f32]) {
        let size = observations.len() / rows.max(1);
        let action_size = self.place.size();
        for row in 0..rows {
            let numbers = &observations[row * size..][..size];
            let mut reader = Observation { numbers, time: states[row] * self.control_dt };
            self.program.run(&mut self.memory, &mut reader);
            let action = value(&self.memory, &self.place);
            for (out, number) in actions[row * action_size..][..action_size].iter_mut().zip(action) {
                *out = *number as f32;
            }
            states[row] += 1.0;
        }
    }
}
