//! Pairs of a comparison in which one controller fails and the other does not, with pictures of
//! both at the instant of the failure.

use mishandle::MishandleError;
use mishandle::picture::ExampleSimulation;
use mishandle::resolve::{has_scene, recorded_plan};
use mishandle::results::{ComparedPair, Comparison};
use mishandle::rollout::{Axis, Request, Scenario, Seed};
use mishandle::run::recorded_axis;
use mishandle::store::RunFile;

use crate::controller_pair::{ControllerName, ControllerPair};
use crate::head::values;
use crate::html::text;

/// Largest numbers of new and of fixed failures with pictures, so that the page stays small.
const MAX_SHOWN: [usize; 2] = [3, 2];

const CONTROLLERS: [ControllerName; 2] = [
    ControllerName { label: "A", phrase: "controller A" },
    ControllerName { label: "B", phrase: "controller B" },
];

/// Pairs that flipped, drawn.
#[derive(Debug, Default)]
pub struct FlippedPairs {
    cards: Vec<Card>,
    /// Why pictures are missing.
    notes: Vec<String>,
}

#[derive(Debug)]
struct Card {
    heading: String,
    pair: ControllerPair,
}

impl FlippedPairs {
    /// Simulates the clearest new and fixed failures with both controllers of a comparison, and
    /// draws them, in 3-D if they `have_replays`: those with the lowest robustness. A target
    /// without a scene has none. Ends early if `is_interrupted`. If a simulation cannot be run, the
    /// page says so.
    pub fn simulate(
        found: &Comparison,
        runs: [&RunFile; 2],
        have_replays: bool,
        mut is_interrupted: impl FnMut() -> bool,
    ) -> FlippedPairs {
        let mut pairs = FlippedPairs::default();
        let header = runs[0].header();
        if !has_scene(&header.target.kind) {
            return pairs;
        }
        let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
        let lists = [(1, &found.new_failures), (0, &found.fixed_failures)];
        for ((failing, list), most) in lists.into_iter().zip(MAX_SHOWN) {
            let robustness = |pair: &&ComparedPair| {
                let found = if failing == 1 { pair.second_robustness } else { pair.first_robustness };
                found.map_or(f64::INFINITY, |found| found.0)
            };
            let mut list: Vec<&ComparedPair> = list.iter().collect();
            list.sort_by(|a, b| robustness(a).total_cmp(&robustness(b)));
            for pair in list.into_iter().take(most) {
                if is_interrupted() {
                    return pairs;
                }
                match card(pair, failing, runs, &axes, have_replays) {
                    Ok(card) => pairs.cards.push(card),
                    Err(error) => {
                        let note = format!("A pair has no pictures: {}.", error.with_causes());
                        pairs.notes.extend((!pairs.notes.contains(&note)).then_some(note));
                    }
                }
            }
        }
        pairs
    }

    /// Returns the pairs as HTML; empty without one.
    pub(crate) fn html(&self) -> String {
        let card = |(number, Card { heading, pair }): (usize, &Card)| {
            let scene = pair.wide(Some(&format!("pair{number}")));
            format!("<article class=\"mode\">\n<h4>{heading}</h4>\n{scene}</article>\n")
        };
        let cards: String = (1..).zip(&self.cards).map(card).collect();
        let notes = self.notes.iter().map(|note| format!("<p class=\"notes\">{}</p>\n", text(note)));
        let out = cards + &notes.collect::<String>();
        if out.is_empty() { out } else { format!("<h3>Pairs that flipped</h3>\n{out}") }
    }
}

fn card(
    pair: &ComparedPair,
    failing: usize,
    runs: [&RunFile; 2],
    axes: &[Axis],
    has_replay: bool,
) -> Result<Card, MishandleError> {
    let simulate = |run: &RunFile| {
        let resolved = recorded_plan(run.header(), None)?;
        let scenario = Scenario::new(pair.scenario.values().copied().collect());
        ExampleSimulation::new(&resolved, &Request::new(scenario, Seed(pair.seed.0)))
    };
    let [first, second] = runs.map(simulate);
    let (drawn, missing) = ControllerPair::draw([first?, second?], CONTROLLERS, failing, has_replay);
    let missing =
        missing.map_or(String::new(), |error| format!(" (no pictures: {})", text(&error.to_string())));
    let scenario: Vec<Option<f64>> = pair.scenario.values().copied().collect();
    let what = if failing == 1 { "New: B fails" } else { "Fixed: A fails" };
    Ok(Card {
        heading: format!("{what} {}{missing}", values(axes, &scenario, runs[0].header().control_dt)),
        pair: drawn,
    })
}
