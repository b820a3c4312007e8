//! Counterexamples that one controller violates, simulated with an earlier one, too, and drawn.

use std::path::Path;

use mishandle::MishandleError;
use mishandle::counterexample::{AxisValue, Counterexample};
use mishandle::picture::ExampleSimulation;
use mishandle::results::BisectedCandidate;
use mishandle_text::plural;

use crate::controller_pair::{ControllerName, ControllerPair};
use crate::html::{number, short, table, text};

/// Largest number of counterexamples with pictures, so that the page stays small.
const MAX_SHOWN: usize = 4;

/// The two controllers.
const CONTROLLERS: [ControllerName; 2] = [
    ControllerName { label: "Last passing", phrase: "the last passing controller" },
    ControllerName { label: "First failing", phrase: "the first failing controller" },
];

/// Counterexamples that the first failing candidate of a bisection violates.
#[derive(Debug, Default)]
pub struct ViolatedCounterexamples {
    cards: Vec<Card>,
    /// Parts that the page lacks, with the reason.
    notes: Vec<String>,
}

#[derive(Debug)]
struct Card {
    file: String,
    scenario: Vec<AxisValue>,
    pair: ControllerPair,
}

impl ViolatedCounterexamples {
    /// Returns no counterexample, and says why if there are some.
    pub fn skipped(bad: &BisectedCandidate, reason: &str) -> ViolatedCounterexamples {
        let note =
            format!("Simulations of the violated counterexamples and their pictures are missing: {reason}.");
        let notes = if bad.violated.is_empty() { Vec::new() } else { vec![note] };
        ViolatedCounterexamples { cards: Vec::new(), notes }
    }

    /// Simulates at most four of the counterexamples that the first failing candidate violates with
    /// this one and the last passing one, and draws them, in 3-D if they `have_replays`. Returns
    /// `None` if `is_interrupted`, which is called before each.
    ///
    /// If a file is missing or a simulation cannot be run, the page says so.
    pub fn simulate(
        [good, bad]: [&BisectedCandidate; 2],
        have_replays: bool,
        mut is_interrupted: impl FnMut() -> bool,
    ) -> Option<ViolatedCounterexamples> {
        let mut found = ViolatedCounterexamples::default();
        for file in bad.violated.iter().take(MAX_SHOWN) {
            if is_interrupted() {
                return None;
            }
            match card(file, [&good.controller, &bad.controller], have_replays) {
                Ok((card, missing)) => {
                    found.cards.push(card);
                    found.note(missing);
                }
                Err(error) => found.note(Some(format!("{}: {}", text(file), error.with_causes()))),
            }
        }
        let left_out = bad.violated.len().saturating_sub(MAX_SHOWN);
        found.note(
            (left_out > 0).then(|| {
                format!("{} more violated: see the table.", plural(left_out as u64, "counterexample"))
            }),
        );
        Some(found)
    }

    fn note(&mut self, note: Option<String>) {
        self.notes.extend(note.filter(|note| !self.notes.contains(note)));
    }

    /// Returns the section; empty without counterexamples.
    pub(crate) fn html(&self) -> String {
        if self.cards.is_empty() && self.notes.is_empty() {
            return String::new();
        }
        let cards: String = (1..).zip(&self.cards).map(|(place, card)| card.html(place)).collect();
        let notes: String = self.notes.iter().map(|note| format!("<li>{}</li>", text(note))).collect();
        let notes = if notes.is_empty() { notes } else { format!("<ul class=\"notes\">{notes}</ul>\n") };
        format!(
            "<section id=\"counterexamples\">\n<h2>Violated counterexamples</h2>\n{cards}{notes}</section>\n"
        )
    }
}

/// Simulates a counterexample with both controllers. Also returns why there is no picture.
fn card(
    file: &str,
    controllers: [&str; 2],
    has_replay: bool,
) -> Result<(Card, Option<String>), MishandleError> {
    let path = Path::new(file);
    let recorded = Counterexample::read(path)?;
    let simulate = |controller: &str| {
        let resolved = recorded.resolve_with(path.parent().unwrap_or(Path::new(".")), controller)?;
        ExampleSimulation::new(&resolved, &recorded.request(&resolved.space)?)
    };
    let [good, bad] = controllers.map(simulate);
    let (pair, missing) = ControllerPair::draw([good?, bad?], CONTROLLERS, 1, has_replay);
    let missing = missing.map(|error| format!("There are no pictures of the failures: {error}."));
    Ok((Card { file: file.to_string(), scenario: recorded.scenario, pair }, missing))
}

impl Card {
    fn html(&self, place: usize) -> String {
        let shown = |value: Option<f64>| value.map_or("random".to_string(), number);
        let row = |value: &AxisValue| {
            vec![
                text(&short(&value.axis, 40)),
                shown(value.value),
                shown(value.nominal),
                text(&short(&value.unit, 20)),
            ]
        };
        let rows: Vec<Vec<String>> = self.scenario.iter().map(row).collect();
        let scenario = table("Scenario", &["axis", "value", "nominal", "unit"], &rows);
        format!(
            "<article class=\"mode\">\n<h4><code>{}</code></h4>\n{}</article>\n",
            text(&short(&self.file, 120)),
            self.pair.html(&scenario, Some(&format!("counterexample{place}")))
        )
    }
}
