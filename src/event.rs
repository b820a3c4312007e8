//! The event of a simulation that pictures center on.

use crate::Explanation;
use crate::explanation_text::instant;

/// An instant of a simulation that pictures center on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// The decisive sample.
    pub sample: usize,
    /// The first sample of the window that violates the predicate, if the event is a violation that starts earlier.
    pub start: Option<usize>,
    /// What happens.
    pub kind: EventKind,
}

/// What happens at an [`Event`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventKind {
    /// The decisive predicate is violated most.
    Violation,
    /// The decisive predicate is closest to being satisfied, or satisfied most clearly, of all samples that count.
    ClosestApproach,
    /// The formula is satisfied, and here it is closest to a violation.
    SmallestMargin,
}

impl EventKind {
    /// Returns the name that pictures show.
    pub fn name(self) -> &'static str {
        match self {
            EventKind::Violation => "violation",
            EventKind::ClosestApproach => "closest approach",
            EventKind::SmallestMargin => "smallest margin",
        }
    }

    fn reason(self) -> &'static str {
        match self {
            EventKind::Violation => "the formula is violated, and this sample sets its robustness",
            EventKind::ClosestApproach => {
                "the formula asks for one instant that satisfies it, and this one comes closest"
            }
            EventKind::SmallestMargin => "the formula is satisfied, and here it is closest to a violation",
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

    /// Says on what the pictures center and why. `control_dt` is the time between two samples, in seconds.
    pub fn sentence(&self, control_dt: f64) -> String {
        let (name, reason) = (self.kind.name(), self.kind.reason());
        format!("the pictures center on the {name} at {}: {reason}", instant(self.sample, control_dt))
    }
}

impl Explanation {
    /// Returns the decisive sample and what happens there; `None` if nothing decides.
    pub fn event(&self) -> Option<Event> {
        let path = &self.diagnosis.path;
        let sample = path.last()?.sample;
        let chooses = |operator: &str| matches!(operator, "eventually" | "once" | "until" | "since");
        let kind = if path.iter().filter_map(|found| found.operator).any(chooses) {
            EventKind::ClosestApproach
        } else if self.diagnosis.robustness() < 0.0 {
            EventKind::Violation
        } else {
            EventKind::SmallestMargin
        };
        let history = self.history.as_ref().filter(|_| kind == EventKind::Violation);
        let start = history.and_then(|history| history.first_and_last).map(|(first, _)| first);
        Some(Event { sample, start: start.filter(|start| *start < sample), kind })
    }
}
