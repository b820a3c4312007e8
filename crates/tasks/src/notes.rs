//! Notes on tasks: Markdown pages that both the documentation and the command line show.
//!
//! A page may have any text before its first section. A section is a line `## TITLE` with the title
//! of a [`Topic`], followed by a table. The first column is the subject of a note, and the header
//! names the other cells.

use crate::definition::Task;
use crate::environment::TaskError;

/// Notes on all tasks of the benchmark.
const EVERY_TASK: &str = include_str!("every_task.md");

/// Name of the page [`EVERY_TASK`] in error messages.
const EVERY_TASK_NAME: &str = "every task";

/// The subject of a section of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Topic {
    /// Differences from the paper.
    Paper,
    /// Physics that a reader of the MJCF does not see.
    Physics,
    /// Behavior on which the success formula does not depend.
    Success,
    /// Known weaknesses of the shipped controllers.
    Weaknesses,
}

impl Topic {
    /// All topics, in the order of a page.
    pub const ALL: [Topic; 4] = [Topic::Paper, Topic::Physics, Topic::Success, Topic::Weaknesses];

    /// Returns the name in JSON documents.
    pub fn name(self) -> &'static str {
        match self {
            Topic::Paper => "paper",
            Topic::Physics => "physics",
            Topic::Success => "success",
            Topic::Weaknesses => "weaknesses",
        }
    }

    /// Returns the title of the section.
    pub fn title(self) -> &'static str {
        match self {
            Topic::Paper => "Differences from the paper",
            Topic::Physics => "Physics that the MJCF does not show",
            Topic::Success => "What success does not say",
            Topic::Weaknesses => "Known weaknesses of the shipped controllers",
        }
    }
}

/// A note: one row of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Topic.
    pub topic: Topic,
    /// Whether the note applies to every task of the benchmark.
    pub is_shared: bool,
    /// First cell. A note on weaknesses starts with the names of controllers, separated by commas.
    pub subject: &'static str,
    /// Names and texts of the other cells.
    pub cells: Vec<(&'static str, &'static str)>,
}

/// Returns the notes on a task by topic, and after those of each topic the shared ones.
///
/// # Errors
/// If a page has an unknown section, or text in a section that is not a table.
///
/// # Example
/// ```
/// use mishandle_tasks::{Topic, notes, task};
///
/// let notes = notes(task("point-reaching").unwrap()).unwrap();
/// let success = notes.iter().find(|note| note.topic == Topic::Paper && note.subject == "success").unwrap();
/// assert_eq!(success.cells[0].0, "paper");
/// ```
pub fn notes(task: &dyn Task) -> Result<Vec<Note>, TaskError> {
    let page = task.notes();
    if page.is_empty() {
        return Ok(Vec::new());
    }
    let error = |task, problem| TaskError::Field { task, field: "notes", problem };
    let name = task.definition().name;
    let mut notes = parse(page, false).map_err(|problem| error(name, problem))?;
    notes.extend(parse(EVERY_TASK, true).map_err(|problem| error(EVERY_TASK_NAME, problem))?);
    notes.sort_by_key(|note| note.topic as usize);
    Ok(notes)
}

/// Returns the notes on a page, or the problem of the first invalid line.
fn parse(page: &'static str, is_shared: bool) -> Result<Vec<Note>, String> {
    let mut notes = Vec::new();
    let mut topic = None;
    let mut header = Vec::new();
    for (number, line) in (1..).zip(page.lines()) {
        if let Some(title) = line.strip_prefix("## ") {
            let found = Topic::ALL.into_iter().find(|topic| topic.title() == title);
            topic = Some(found.ok_or_else(|| format!("line {number}: there is no section `{title}`"))?);
            header.clear();
        }
        let Some(topic) = topic.filter(|_| !line.is_empty() && !line.starts_with("## ")) else {
            continue;
        };
        let cells = cells(line).ok_or_else(|| format!("line {number}: expected a row of a table"))?;
        if header.is_empty() {
            header = cells;
        } else if cells.len() != header.len() {
            return Err(format!("line {number}: expected {} cells, found {}", header.len(), cells.len()));
        } else if !cells.iter().all(|cell| cell.chars().all(|c| c == '-')) {
            let cells: Vec<_> = header.iter().copied().zip(cells).collect();
            notes.push(Note { topic, is_shared, subject: cells[0].1, cells: cells[1..].to_vec() });
        }
    }
    Ok(notes)
}

/// Returns the cells of a row `| a | b |`.
fn cells(line: &str) -> Option<Vec<&str>> {
    Some(line.strip_prefix('|')?.strip_suffix('|')?.split('|').map(str::trim).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TASKS;

    #[test]
    fn a_table_is_read_by_its_header() {
        let page =
            "# A\n\ntext\n\n## What success does not say\n\n| what | fact |\n|---|---|\n| a | 1 |\n| b | |\n";
        let note = |subject, fact| Note {
            topic: Topic::Success,
            is_shared: false,
            subject,
            cells: vec![("fact", fact)],
        };
        assert_eq!(parse(page, false), Ok(vec![note("a", "1"), note("b", "")]));
    }

    #[test]
    fn an_invalid_line_is_reported_with_its_number() {
        let error = |page| parse(page, true).unwrap_err();
        assert_eq!(error("# A\n## B\n"), "line 2: there is no section `B`");
        let start = "## What success does not say\n\n| what | fact |\n|---|---|\n";
        let page = |rest: &str| -> &'static str { format!("{start}{rest}").leak() };
        assert_eq!(error(page("text\n")), "line 5: expected a row of a table");
        assert_eq!(error(page("| a |\n")), "line 5: expected 2 cells, found 1");
    }

    #[test]
    fn every_task_of_the_benchmark_has_notes_on_each_topic() {
        for task in TASKS {
            let name = task.definition().name;
            let notes = notes(*task).unwrap();
            for topic in Topic::ALL {
                for is_shared in [false, true] {
                    let found = notes.iter().any(|note| note.topic == topic && note.is_shared == is_shared);
                    assert!(found, "{name}: {topic:?}, shared: {is_shared}");
                }
            }
            for note in notes {
                let is_complete = note.cells.iter().all(|(name, text)| !name.is_empty() && !text.is_empty());
                assert!(is_complete && !note.subject.is_empty(), "{name}: {note:?}");
            }
        }
    }
}
