//! Notes of people on rows of the tables, and on the paper: `studies/experiments/paper/notes.toml`.

use serde::Deserialize;

const NOTES: &str = include_str!("../../experiments/paper/notes.toml");

/// All notes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Notes {
    #[serde(default, rename = "note")]
    notes: Vec<Note>,
    /// Differences between the experiments that concern every row.
    #[serde(default, rename = "difference")]
    pub differences: Vec<DifferenceNote>,
    /// Facts about the paper that matter for the comparison.
    #[serde(default, rename = "paper")]
    pub paper: Vec<PaperNote>,
}

/// A note on the rows of a table. A key that it lacks fits every value.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Note {
    table: String,
    task: String,
    controller: Option<String>,
    search: Option<String>,
    preset: Option<String>,
    text: String,
    /// Whether the paper's values of these rows are compared with ours; otherwise they are only
    /// shown.
    #[serde(default = "yes")]
    compare: bool,
}

fn yes() -> bool {
    true
}

/// A difference between the experiments.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct DifferenceNote {
    /// The tables that it concerns.
    pub tables: Vec<String>,
    /// The difference.
    pub text: String,
}

/// A fact about the paper with its evidence.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PaperNote {
    /// The tables that it concerns.
    pub tables: Vec<String>,
    /// The fact.
    pub text: String,
    /// How it can be checked.
    pub evidence: String,
}

/// A row of a table.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row<'a> {
    pub table: &'a str,
    pub task: &'a str,
    pub controller: &'a str,
    pub search: &'a str,
    pub preset: &'a str,
}

impl Notes {
    /// Reads the notes. They are part of the program, and a test reads them.
    pub fn new() -> Notes {
        toml::from_str(NOTES).unwrap_or_default()
    }

    /// Returns the texts of the notes on a row.
    pub fn on(&self, row: &Row<'_>) -> impl Iterator<Item = &str> {
        self.fitting(row).map(|note| note.text.as_str())
    }

    /// Returns whether the paper's values of a row are compared with ours.
    pub fn compares(&self, row: &Row<'_>) -> bool {
        self.fitting(row).all(|note| note.compare)
    }

    fn fitting(&self, row: &Row<'_>) -> impl Iterator<Item = &Note> {
        let row = *row;
        let fits = |key: &Option<String>, value: &str| key.as_deref().is_none_or(|key| key == value);
        self.notes.iter().filter(move |note| {
            note.table == row.table
                && note.task == row.task
                && fits(&note.controller, row.controller)
                && fits(&note.search, row.search)
                && fits(&note.preset, row.preset)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The paper prints the same values for both tasks, and they fit `ball-pushing` better.
    #[test]
    fn the_repeated_rows_of_peg_in_hole_are_not_compared() {
        let notes: Notes = toml::from_str(NOTES).unwrap();
        let row =
            |task| Row { table: "falsification", task, controller: "ppo", search: "random", preset: "paper" };
        assert!(!notes.compares(&row("peg-in-hole")));
        assert!(notes.compares(&row("ball-pushing")));
        assert!(notes.compares(&Row { table: "performance", ..row("peg-in-hole") }));
    }

    #[test]
    fn the_notes_are_read_and_name_known_rows() {
        let notes: Notes = toml::from_str(NOTES).unwrap();
        assert!(!notes.paper.is_empty());
        let tasks: Vec<String> = mishandle::resolve::target_names();
        for note in &notes.notes {
            assert!(tasks.contains(&note.task), "{}", note.task);
            assert!(["performance", "falsification"].contains(&note.table.as_str()), "{}", note.table);
        }
    }
}
