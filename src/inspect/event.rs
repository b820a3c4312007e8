//! The event of a simulation that pictures center on.

use mishandle_stl::{Trace, is_violated};

use crate::inspect::Explanation;
use crate::run::violation::failure_instant;
use mishandle_text::instant;

/// An instant of a simulation that pictures center on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// The sample of the event. Of a failure: [`Explanation::instant`].
    pub sample: usize,
    /// Of a failure: the sample that sets the robustness, if it is another one. A violation that
    /// grows has its largest value later, and a closest approach is earlier.
    pub decisive: Option<usize>,
    /// Kind of the event.
    pub kind: EventKind,
}

/// Kind of an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The decisive predicate is violated.
    Violation,
    /// The formula asks for one instant that satisfies it, and none was in time.
    TooLate,
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
            EventKind::TooLate => "too late",
            EventKind::ClosestApproach => "closest approach",
            EventKind::SmallestMargin => "smallest margin",
            EventKind::Contact => "contact",
            EventKind::Release => "release",
        }
    }

    fn reason(self) -> &'static str {
        match self {
            EventKind::Violation => "from this sample on, nothing can satisfy the formula",
            EventKind::TooLate => "the formula asks for one instant that satisfies it, and here none is left",
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
        let Some(decisive) = self.decisive else { return vec![(self.sample, self.kind.name())] };
        let names = match self.kind {
            EventKind::Violation => ["first violation", "largest violation"],
            _ => [self.kind.name(), EventKind::ClosestApproach.name()],
        };
        let mut marks = vec![(self.sample, names[0]), (decisive, names[1])];
        marks.sort_unstable();
        marks
    }

    /// Returns the earlier and the later of the two samples of the event; `None` for the earlier
    /// one if there is one only.
    pub fn ends(&self) -> (Option<usize>, usize) {
        match self.decisive {
            None => (None, self.sample),
            Some(decisive) => (Some(decisive.min(self.sample)), decisive.max(self.sample)),
        }
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
    Some(Event { sample, decisive: None, kind: EventKind::Release })
}

impl Explanation {
    /// Returns the instant of a failure: the first sample after which nothing can satisfy the
    /// formula, or the decisive one if the trace does not decide the formula. It is the one instant
    /// of texts, pictures, films and plots. Of a satisfied formula it is the decisive sample.
    /// `None` if nothing decides.
    pub fn instant(&self) -> Option<usize> {
        let decided = self.decided.filter(|_| is_violated(self.diagnosis.robustness()));
        failure_instant(decided, &self.diagnosis)
    }

    /// Returns the instant and what happens there; `None` if nothing decides.
    pub fn event(&self) -> Option<Event> {
        let path = &self.diagnosis.path;
        let sample = self.instant()?;
        let fails = is_violated(self.diagnosis.robustness());
        let chooses = |operator: &str| matches!(operator, "eventually" | "once" | "until" | "since");
        let kind = match path.iter().filter_map(|found| found.operator).any(chooses) {
            true if fails && self.decided.is_some() => EventKind::TooLate,
            true => EventKind::ClosestApproach,
            false if fails => EventKind::Violation,
            false => EventKind::SmallestMargin,
        };
        let decisive = path.last().map(|last| last.sample).filter(|decisive| *decisive != sample);
        Some(Event { sample, decisive, kind })
    }
}
