//! The failure modes of a hardening with pictures: a failure of each, with the controllers before
//! and after.

use std::cmp::Reverse;
use std::path::Path;

use mishandle::MishandleError;
use mishandle::harden::{ExampleSource, ModeExample, ModeExamples};
use mishandle::results::{Command, HardenedMode, Hardening, ModeChange, Recorded, Words};
use mishandle::rollout::{Axis, Scenario};
use mishandle_text::{path_text, plural};

use crate::controller_pair::{ControllerName, ControllerPair};
use crate::head::values;
use crate::html::{lines, short, table, text};
use crate::pictures::PictureError;
use crate::space::value_text;

/// Largest number of modes with a failure, so that the page stays small.
const MAX_SHOWN: usize = 6;

/// Largest number of axes of a scenario in a table.
const MAX_AXES: usize = 12;

/// The two controllers.
const CONTROLLERS: [ControllerName; 2] = [
    ControllerName { label: "Before", phrase: "the controller before" },
    ControllerName { label: "After", phrase: "the controller after" },
];

/// Failures of some failure modes of a hardening, simulated with both controllers.
#[derive(Debug, Default)]
pub struct HardenedModes {
    cards: Vec<Card>,
    /// Parts that the page lacks, with the reason.
    notes: Vec<String>,
}

/// A failure mode.
#[derive(Debug)]
struct Card {
    mode: HardenedMode,
    source: ExampleSource,
    scenario: Scenario,
    axes: Vec<Axis>,
    /// Path of the controller that fails.
    controller: String,
    pair: ControllerPair,
}

impl HardenedModes {
    /// Returns no failures, and says why.
    pub fn skipped(reason: &str) -> HardenedModes {
        let note = format!(
            "Failures of the modes and their pictures, which take simulations, are missing: {reason}."
        );
        HardenedModes { cards: Vec::new(), notes: vec![note] }
    }

    /// Simulates a failure of each mode, of at most six, with both controllers of a finished
    /// hardening, and draws them, in 3-D if they `have_replays`. Returns `None` if
    /// `is_interrupted`, which is called before each mode.
    ///
    /// If a file of the folder is missing or differs, or a simulation cannot be run, the page says
    /// so.
    pub fn simulate(
        folder: &Path,
        found: &Hardening,
        have_replays: bool,
        mut is_interrupted: impl FnMut() -> bool,
    ) -> Option<HardenedModes> {
        let drawn = HardenedModes::drawn(folder, found, have_replays, &mut is_interrupted);
        drawn.unwrap_or_else(|error| Some(HardenedModes::skipped(&error.with_causes())))
    }

    fn drawn(
        folder: &Path,
        found: &Hardening,
        have_replays: bool,
        is_interrupted: &mut dyn FnMut() -> bool,
    ) -> Result<Option<HardenedModes>, MishandleError> {
        let mut modes = HardenedModes::default();
        let Some(examples) = ModeExamples::open(folder, found)? else { return Ok(Some(modes)) };
        for mode in shown(&found.modes) {
            if is_interrupted() {
                return Ok(None);
            }
            let controller = &examples.controllers()[mode.failing()];
            let example = examples.example(mode)?;
            let axes = controller.space.axes();
            let (card, missing) = card(mode, example, axes, &controller.plan.controller, have_replays);
            modes.cards.push(card);
            let note = missing.map(|error| format!("There are no pictures of the failures: {error}."));
            modes.notes.extend(note.filter(|note| !modes.notes.contains(note)));
        }
        Ok(Some(modes))
    }

    /// Returns a failure with both controllers side by side: one that vanished, if there is one.
    pub(crate) fn lead(&self) -> String {
        let Some(card) = self.cards.get(self.lead_index()) else { return String::new() };
        let with = values(&card.axes, card.scenario.values(), card.pair.control_dt());
        let scene = card.pair.wide(Some("hardened"));
        format!("<p class=\"lead\">The same scenario before and after: {with}.</p>\n{scene}")
    }

    fn lead_index(&self) -> usize {
        self.cards.iter().position(|card| card.mode.change == ModeChange::Vanished).unwrap_or(0)
    }

    /// Returns the modes as HTML.
    pub(crate) fn html(&self, found: &Hardening, words: Words) -> String {
        let card = |(index, card): (usize, &Card)| {
            // The first one has its replay at the top of the page.
            let id = (index != self.lead_index()).then(|| format!("mode{index}"));
            card.html(found, words, id.as_deref())
        };
        let mut out: String = self.cards.iter().enumerate().map(card).collect();
        let left_out = found.modes.len().saturating_sub(self.cards.len());
        if left_out > 0 && !self.cards.is_empty() {
            out.push_str(&format!(
                "<p class=\"notes\">{} more in the table {} no picture here.</p>\n",
                plural(left_out as u64, "mode"),
                if left_out == 1 { "has" } else { "have" }
            ));
        }
        if !self.notes.is_empty() {
            let notes: String = self.notes.iter().map(|note| format!("<li>{}</li>", text(note))).collect();
            out.push_str(&format!("<ul class=\"notes\">{notes}</ul>\n"));
        }
        out
    }
}

/// Returns all modes in the order of the page: by change, then by the number of failures.
pub fn ordered(modes: &[HardenedMode]) -> Vec<&HardenedMode> {
    let mut modes: Vec<&HardenedMode> = modes.iter().collect();
    modes.sort_by_key(|mode| (mode.change, Reverse(mode.after.max(mode.before))));
    modes
}

/// Returns the modes that are drawn: of each change those with the most failures, in turn.
fn shown(modes: &[HardenedMode]) -> Vec<&HardenedMode> {
    let ordered = ordered(modes);
    let rank =
        |index: usize| ordered[..index].iter().filter(|other| other.change == ordered[index].change).count();
    let mut chosen: Vec<usize> = (0..ordered.len()).collect();
    chosen.sort_by_key(|index| (rank(*index), *index));
    chosen.truncate(MAX_SHOWN);
    chosen.sort_unstable();
    chosen.into_iter().map(|index| ordered[index]).collect()
}

/// Draws the same instant of the simulations of a failure with both controllers. Also returns why
/// there is no picture.
fn card(
    mode: &HardenedMode,
    ModeExample { source, simulated }: ModeExample,
    axes: &[Axis],
    controller: &str,
    has_replay: bool,
) -> (Card, Option<PictureError>) {
    let scenario = simulated[0].episode.request.scenario.clone();
    let (pair, missing) = ControllerPair::draw(simulated, CONTROLLERS, mode.failing(), has_replay);
    let mode = mode.clone();
    let axes = axes.to_vec();
    let controller = controller.to_string();
    (Card { mode, source, scenario, axes, controller, pair }, missing)
}

impl Card {
    fn html(&self, found: &Hardening, words: Words, id: Option<&str>) -> String {
        let mode = &self.mode;
        let predicate = match mode.predicate.as_str() {
            "" => "the whole formula".to_string(),
            predicate => format!("<code>{}</code>", text(&short(predicate, 200))),
        };
        let change = match mode.change {
            ModeChange::Appeared => "Appeared",
            ModeChange::Stayed => "Stayed",
            ModeChange::Vanished => "Vanished",
        };
        let out = format!(
            "<article class=\"mode\">\n<h4>{change}: {predicate} is violated <span class=\"count\">{} before, {} after</span></h4>\n\
             <p>{}</p>\n{}",
            plural(mode.before, "failure"),
            mode.after,
            self.source_text(),
            self.pair.html(&self.scenario_table(), id)
        );
        out + &self.commands(found, words) + "</article>\n"
    }

    fn source_text(&self) -> String {
        match &self.source {
            ExampleSource::Worst { .. } => {
                let controller = CONTROLLERS[self.mode.failing()].phrase;
                format!(
                    "Shown is the worst failure that the final searches found in this mode with {controller}."
                )
            }
            ExampleSource::Minimized { round, .. } => format!(
                "Shown is a failure of this mode from round {round}, moved toward the nominal scenario while it failed."
            ),
        }
    }

    /// Returns the scenario. The axes of the mode and those off nominal come first.
    fn scenario_table(&self) -> String {
        let values = self.scenario.values();
        let of_mode = |index: usize| self.mode.axes.contains(&self.axes[index].name);
        let is_nominal = |index: usize| values.get(index).copied().flatten() == self.axes[index].nominal;
        let mut order: Vec<usize> = (0..self.axes.len()).collect();
        order.sort_by_key(|index| (!of_mode(*index), is_nominal(*index)));
        let row = |index: &usize| {
            let axis = &self.axes[*index];
            let name = text(&short(&axis.name, 40));
            let name = if is_nominal(*index) { name } else { format!("<b>{name}</b>") };
            let value = value_text(axis, values.get(*index).copied().flatten());
            vec![name, text(&value), text(&value_text(axis, axis.nominal))]
        };
        let rows: Vec<Vec<String>> = order.iter().take(MAX_AXES).map(row).collect();
        let more = match self.axes.len().saturating_sub(MAX_AXES) {
            0 => String::new(),
            _ => format!("<p class=\"notes\">{MAX_AXES} of {} axes are shown.</p>\n", self.axes.len()),
        };
        table("Scenario", &["axis", "value", "nominal"], &rows) + &more
    }

    /// Returns the commands that run the failure again, folded.
    fn commands(&self, found: &Hardening, words: Words) -> String {
        let commands: Vec<Command> = match &self.source {
            ExampleSource::Worst { run, trial, number } => {
                let recorded = Recorded {
                    run: path_text(run),
                    trial: *trial,
                    simulation: *number,
                    // The run has the path of the machine where it ran.
                    controller: Some(self.controller.clone()),
                };
                vec![Command::Explain(recorded.clone()), Command::Render(recorded)]
            }
            ExampleSource::Minimized { file, .. } => {
                let suite = path_text(file.parent().unwrap_or(Path::new(".")));
                let regress = |controller: &String| Command::Regress {
                    suite,
                    controller: controller.clone(),
                    baseline: None,
                };
                let replay = Command::ReplayFile { file: path_text(file), moved: Vec::new() };
                std::iter::once(replay).chain(found.after.as_ref().map(regress)).collect()
            }
        };
        let commands: Vec<String> = commands.iter().map(words).collect();
        format!("<details><summary>Run it again</summary><pre>{}</pre></details>\n", lines(&commands))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode(change: &str, before: u64, after: u64) -> HardenedMode {
        assert_eq!(ModeChange::new(before, after).name(), change);
        HardenedMode {
            predicate: "gap >= 2".to_string(),
            axes: Vec::new(),
            change: ModeChange::new(before, after),
            before,
            after,
        }
    }

    fn facts(modes: Vec<&HardenedMode>) -> Vec<(&str, u64, u64)> {
        modes.into_iter().map(|mode| (mode.change.name(), mode.before, mode.after)).collect()
    }

    #[test]
    fn new_modes_come_first_and_then_the_largest() {
        let modes =
            [mode("vanished", 9, 0), mode("stayed", 3, 8), mode("stayed", 9, 1), mode("appeared", 0, 2)];
        let expected = [("appeared", 0, 2), ("stayed", 9, 1), ("stayed", 3, 8), ("vanished", 9, 0)];
        assert_eq!(facts(ordered(&modes)), expected);
    }

    #[test]
    fn each_change_has_pictures_also_if_another_one_has_many_modes() {
        let mut modes: Vec<HardenedMode> = (1..=7).map(|count| mode("appeared", 0, count)).collect();
        modes.extend([mode("vanished", 1, 0), mode("stayed", 1, 1), mode("vanished", 4, 0)]);
        let expected = [
            ("appeared", 0, 7),
            ("appeared", 0, 6),
            ("appeared", 0, 5),
            ("stayed", 1, 1),
            ("vanished", 4, 0),
            ("vanished", 1, 0),
        ];
        assert_eq!(facts(shown(&modes)), expected);
    }
}
