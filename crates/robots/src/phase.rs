//! Expressions that are evaluated at the same time.

use crate::expression::{Compiler, Place, Program, value};

use crate::description::{Expression, Over};
use crate::error::Problem;
use crate::library::Library;
use crate::quantity::{Currency, Quantity, View};

/// Expressions that are evaluated together, and the places of their values.
#[derive(Clone)]
pub(crate) struct Phase {
    program: Program<Quantity>,
    places: Vec<Place>,
    reads_poses: bool,
    reads_forces: bool,
    reads_external_forces: bool,
}

/// The memory of a phase for one worker.
#[derive(Clone, Debug)]
pub(crate) struct Memory(Vec<f64>);

/// Collects the expressions of a phase.
pub(crate) struct PhaseBuilder<'a> {
    compiler: Compiler<Quantity>,
    places: Vec<Place>,
    library: &'a Library<'a>,
}

impl<'a> PhaseBuilder<'a> {
    pub(crate) fn new(library: &'a Library<'a>) -> PhaseBuilder<'a> {
        PhaseBuilder { compiler: Compiler::new(), places: Vec::new(), library }
    }

    /// Adds an expression and returns the number of its numbers.
    pub(crate) fn add(&mut self, expression: &Expression) -> Result<usize, Problem> {
        let text = &expression.text;
        let place = self
            .compiler
            .add(&expression.node, self.library)
            .map_err(|error| Problem::of_expression(&text.span, &text.text, &error))?;
        let size = place.size();
        self.places.push(place);
        Ok(size)
    }

    /// Returns whether the value of an added expression is a number and not a vector.
    pub(crate) fn is_number(&self, index: usize) -> bool {
        self.places[index].is_number()
    }

    /// Adds an expression with this number of numbers; one number serves for all of them.
    pub(crate) fn add_sized(
        &mut self,
        expression: &Expression,
        size: usize,
        what: &str,
    ) -> Result<(), Problem> {
        match self.add(expression)? {
            found if found == size || found == 1 => Ok(()),
            found => {
                let message = format!("{what} needs {size} numbers, and the expression has {found}");
                Err(Problem::new(&expression.text.span, message))
            }
        }
    }

    pub(crate) fn finish(self) -> Phase {
        let program = self.compiler.program();
        let reads = |currency| program.reads().any(|what| what.currency() == currency);
        let reads_poses = reads(Currency::Pose);
        let reads_forces = reads(Currency::Dynamic);
        let reads_external_forces = program.reads().any(|what| matches!(what, Quantity::ExternalForces(_)));
        Phase { program, places: self.places, reads_poses, reads_forces, reads_external_forces }
    }
}

impl Phase {
    pub(crate) fn memory(&self) -> Memory {
        Memory(self.program.memory())
    }

    /// Returns whether it needs forward kinematics.
    pub(crate) fn reads_poses(&self) -> bool {
        self.reads_poses
    }

    /// Returns whether it reads forces or sensors, which follow from a physics step.
    pub(crate) fn reads_forces(&self) -> bool {
        self.reads_forces
    }

    /// Returns whether it reads external forces, which nothing else computes.
    pub(crate) fn reads_external_forces(&self) -> bool {
        self.reads_external_forces
    }

    /// Returns whether it reads anything that may change during an episode.
    pub(crate) fn reads_state(&self) -> bool {
        let is_fixed = |what: &Quantity| matches!(what, Quantity::Parameter(_) | Quantity::Constants(_));
        self.program.reads().any(|what| !is_fixed(what))
    }

    /// Returns whether it reads the control of an actuator before number `end`.
    pub(crate) fn reads_controls(&self, end: usize) -> bool {
        let is_before = |what: &Quantity| match what {
            Quantity::Controls(actuators) => actuators.iter().any(|actuator| *actuator < end),
            _ => false,
        };
        self.program.reads().any(is_before)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Returns the number of expressions.
    pub(crate) fn len(&self) -> usize {
        self.places.len()
    }

    pub(crate) fn run(&self, memory: &mut Memory, view: &mut View<'_>) {
        self.program.run(&mut memory.0, view);
    }

    /// Returns the value of an expression after a run.
    pub(crate) fn value<'m>(&self, memory: &'m Memory, index: usize) -> &'m [f64] {
        value(&memory.0, &self.places[index])
    }

    /// Writes the value of an expression, a single number into each place.
    pub(crate) fn write(&self, memory: &Memory, index: usize, out: &mut [f64]) {
        match self.value(memory, index) {
            [number] => out.fill(*number),
            numbers => out.copy_from_slice(numbers),
        }
    }
}

impl Over {
    /// Adds the value after a physics step to those of the steps before; `count` is their number.
    pub(crate) fn add(self, before: f64, value: f64, count: usize) -> f64 {
        match self {
            _ if count == 0 => value,
            Over::Max => {
                if before.is_nan() || before > value {
                    before
                } else {
                    value
                }
            }
            Over::Min => {
                if before.is_nan() || before < value {
                    before
                } else {
                    value
                }
            }
            Over::Sum | Over::Mean => before + value,
        }
    }

    pub(crate) fn finish(self, value: f64, count: usize) -> f64 {
        if self == Over::Mean { value / count as f64 } else { value }
    }
}
