//! The event of a simulation that pictures center on.

use mishandle_stl::{Trace, is_violated};

use crate::inspect::{Explanation, PredicateHistory};
use mishandle_text::instant;

/// An instant of a simulation that pictures center on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// The sample of the event.
    pub sample: usize,
    /// The first sample of the window that violates the predicate, if the event is a violation that
    /// starts earlier.
    pub start: Option<usize>,
    /// Kind of the event.
    pub kind: EventKind,
}

/// Kind of an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The decisive predicate is violated most.
    Violation,
    /// The decisive predicate is closest to being satisfied, or satisfied most clearly, of all
    /// samples that count.
    ClosestApproach,
    /// The formula is satisfied, and here it is closest to a violation.
    SmallestMargin,
    /// Two parts of the scene touch that do not touch in the first 0.1 s.
    Contact,
    /// The gripper releases the held object.
    Release,
}

impl EventKind {
    /// Returns the name that pictures show.
    pub fn name(self) -> &'static str {
        match self {
            EventKind::Violation => "violation",
            EventKind::ClosestApproach => "closest approach",
            EventKind::SmallestMargin => "smallest margin",
            EventKind::Contact => "contact",
            EventKind::Release => "release",
        }
    }

    fn reason(self) -> &'static str {
        match self {
            EventKind::Violation => "the formula is violated, and this sample sets its robustness",
            EventKind::ClosestApproach => {
                "the formula asks for one instant that satisfies it, and this one comes closest"
            }
            EventKind::SmallestMargin => "the formula is satisfied, and here it is closest to a violation",
            EventKind::Contact => "two parts touch for the first time that do not touch in the first 0.1 s",
            EventKind::Release => "the gripper releases the held object",
        }
    }
}

impl Event {
    /// Returns the samples that pictures mark, with their texts, in order of time.
    pub fn marks(&self) -> Vec<(usize, &'static str)> {
        let start = self.start.map(|start| (start, "first violation"));
        let name = if start.is_some() { "largest violation" } else { self.kind.name() };
        start.into_iter().chain([(self.sample, name)]).collect()
    }

    /// Says on what the pictures center and why. `control_dt` is the time between two samples, in
    /// seconds.
    pub fn sentence(&self, control_dt: f64) -> String {
        let name = self.kind.name();
        let reason = self.kind.reason();
        format!("the pictures center on the {name} at {}: {reason}", instant(self.sample, control_dt))
    }
}

/// Returns the release of the held object: the first sample at which a signal `…_held` falls below
/// 0.5, or a signal `…_released` reaches 0.5. `None` without such a signal, or if the object is not
/// released.
///
/// # Example
/// ```
/// use mishandle::stl::Trace;
/// let mut trace = Trace::new(["cube_height".to_string(), "cube_held".to_string()].into());
/// for sample in [[0.2, 1.0], [0.1, 1.0], [0.1, 0.0]] {
///     trace.push(&sample);
/// }
/// assert_eq!(mishandle::inspect::release(&trace).map(|event| event.sample), Some(2));
/// ```
pub fn release(trace: &Trace) -> Option<Event> {
    let first = |(column, name): (usize, &String)| {
        let values = trace.column(column);
        let is_released = |value: &f64| match name {
            name if name.ends_with("_held") => *value < 0.5,
            name if name.ends_with("_released") => *value >= 0.5,
            _ => false,
        };
        values.first().filter(|value| !is_released(value))?;
        values.iter().position(is_released)
    };
    let sample = trace.names().iter().enumerate().filter_map(first).min()?;
    Some(Event { sample, start: None, kind: EventKind::Release })
}

impl Explanation {
    /// Returns the decisive sample and what happens there; `None` if nothing decides.
    pub fn event(&self) -> Option<Event> {
        let path = &self.diagnosis.path;
        let sample = path.last()?.sample;
        let chooses = |operator: &str| matches!(operator, "eventually" | "once" | "until" | "since");
        let kind = if path.iter().filter_map(|found| found.operator).any(chooses) {
            EventKind::ClosestApproach
        } else if is_violated(self.diagnosis.robustness()) {
            EventKind::Violation
        } else {
            EventKind::SmallestMargin
        };
        let history = self.history.as_ref().filter(|_| kind == EventKind::Violation);
        let start = history.and_then(PredicateHistory::first_and_last).map(|(first, _)| first);
        Some(Event { sample, start: start.filter(|start| *start < sample), kind })
    }
}
