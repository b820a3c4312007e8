//! Checks the table of rooms in ARCHITECTURE.md against the sources: the folders of a crate, and
//! what each imports from the others.

use std::collections::BTreeSet;

use super::crates::{cells, quoted};
use super::imports::{imports, module};
use super::{File, Problem, Tree};

const PAGE: &str = "ARCHITECTURE.md";
const COLUMNS: [&str; 4] = ["folder", "room", "holds", "uses"];

/// In the column `uses`: no part of the room, a file or a folder, uses another one.
const APART: &str = "not each other";

/// Files that may use every room: they are the root of a library or a program.
const ROOTS: [&str; 3] = ["lib.rs", "main.rs", "command_line.rs"];

/// A row of the table.
struct Room<'a> {
    line: usize,
    folder: &'a str,
    name: &'a str,
    uses: BTreeSet<&'a str>,
    is_apart: bool,
}

/// Compares the table with the sources.
pub fn check(tree: &Tree) -> Vec<Problem> {
    let text = tree.file(PAGE).map_or("", |file| &file.text);
    let rooms = match table(text) {
        Ok(rooms) => rooms,
        Err(problem) => return vec![problem],
    };
    let mut folders: Vec<&str> = rooms.iter().map(|room| room.folder).collect();
    folders.dedup();
    folders
        .into_iter()
        .flat_map(|folder| {
            let rooms: Vec<&Room<'_>> = rooms.iter().filter(|room| room.folder == folder).collect();
            check_folder(tree, folder, &rooms)
        })
        .collect()
}

fn check_folder(tree: &Tree, folder: &str, rooms: &[&Room<'_>]) -> Vec<Problem> {
    let files: Vec<(&str, &File)> =
        tree.files.iter().filter_map(|file| Some((within(folder, &file.path)?, file))).collect();
    let has = |room: &str| files.iter().any(|(path, _)| within(room, path).is_some());
    let missing = rooms.iter().filter(|room| !has(room.name));
    let mut problems: Vec<Problem> = missing
        .map(|room| page_problem(room.line, format!("`{folder}` has no folder `{}`", room.name)))
        .collect();
    problems.extend(order(rooms));
    problems.extend(without_row(folder, rooms, &files));
    let reexported = reexported(rooms, &files);
    let mut used = BTreeSet::new();
    for (path, file) in &files {
        let module = module(path);
        if ROOTS.contains(path) || module.last() == Some(&"tests") || !path.ends_with(".rs") {
            continue;
        }
        let own = rooms.iter().find(|room| module.first() == Some(&room.name));
        for import in imports(&module, &file.text) {
            let first = import.path.first().map_or("", String::as_str);
            let found = match (own, rooms.iter().find(|room| room.name == first)) {
                (_, None) if import.is_absolute && reexported.contains(first) => {
                    Some(format!("uses `{first}` through the root of the crate; import it from its room"))
                }
                (None, Some(_)) => {
                    Some(format!("is below all rooms and uses the room `{first}`; move it into a room"))
                }
                (Some(own), Some(other)) if own.name != other.name => {
                    used.insert((own.name, other.name));
                    let what = || format!("`{}` uses `{first}`, which its row does not name", own.name);
                    (!own.uses.contains(first)).then(what)
                }
                (Some(own), Some(_)) if own.is_apart => other_part(&module, &import.path, own, &files),
                _ => None,
            };
            let problem = |what| Problem { path: file.path.clone(), line: import.line, what };
            problems.extend(found.map(problem));
        }
    }
    for room in rooms {
        let idle = room.uses.iter().filter(|other| !used.contains(&(room.name, **other)));
        problems.extend(idle.map(|other| {
            page_problem(room.line, format!("`{}` does not use `{other}`, which its row names", room.name))
        }));
    }
    problems
}

/// Rooms use rooms of earlier rows only, so that their arrows form no circle.
fn order(rooms: &[&Room<'_>]) -> Vec<Problem> {
    let mut problems = Vec::new();
    for (place, room) in rooms.iter().enumerate() {
        let is_above = |name: &&&str| rooms[..place].iter().any(|above| above.name == **name);
        let others = room.uses.iter().filter(|name| !is_above(name));
        problems.extend(others.map(|other| {
            page_problem(
                room.line,
                format!("`{}` uses `{other}`, which is no room of an earlier row", room.name),
            )
        }));
    }
    problems
}

/// Finds folders that are not rooms. The folder of a module `x.rs` is a part of that module.
fn without_row(folder: &str, rooms: &[&Room<'_>], files: &[(&str, &File)]) -> Vec<Problem> {
    let names: BTreeSet<&str> = files.iter().filter_map(|(path, _)| Some(path.split_once('/')?.0)).collect();
    let is_known = |name: &str| {
        let file = format!("{name}.rs");
        rooms.iter().any(|room| room.name == name) || files.iter().any(|(path, _)| *path == file)
    };
    let line = rooms.first().map_or(1, |room| room.line);
    let unknown = names.into_iter().filter(|name| !is_known(name));
    unknown
        .map(|name| page_problem(line, format!("the table has no row for the folder `{folder}/{name}`")))
        .collect()
}

/// Returns the names that the root of the crate re-exports from rooms.
fn reexported(rooms: &[&Room<'_>], files: &[(&str, &File)]) -> BTreeSet<String> {
    let root = files.iter().find(|(path, _)| *path == "lib.rs").map_or("", |(_, file)| &file.text);
    let from = |name: &str| {
        rooms.iter().any(|room| room.name == name)
            || files.iter().any(|(path, _)| path.strip_suffix(".rs") == Some(name))
    };
    let statements = root.split("\npub use ").skip(1);
    let absolute = statements.map(|rest| format!("use crate::{};", rest.split(';').next().unwrap_or(rest)));
    let paths = absolute.flat_map(|text| imports(&[], &text));
    let items = paths.filter(|import| import.path.len() > 1 && from(&import.path[0]));
    items.filter_map(|mut import| import.path.pop()).collect()
}

/// Describes the use of another part of the same room.
fn other_part(module: &[&str], path: &[String], room: &Room<'_>, files: &[(&str, &File)]) -> Option<String> {
    let own = module.get(1)?;
    let other = path.get(1)?;
    let part = format!("{}/{other}", room.name);
    let is_part = files
        .iter()
        .any(|(path, _)| path.strip_suffix(".rs") == Some(&part) || within(&part, path).is_some());
    (is_part && own != other)
        .then(|| format!("`{own}` uses `{other}`; parts of this room do not use each other"))
}

/// Returns the path below a folder.
fn within<'a>(folder: &str, path: &'a str) -> Option<&'a str> {
    path.strip_prefix(folder)?.strip_prefix('/')
}

fn page_problem(line: usize, what: String) -> Problem {
    Problem { path: PAGE.into(), line, what }
}

fn table(text: &str) -> Result<Vec<Room<'_>>, Problem> {
    let mut lines = (1..).zip(text.lines()).skip_while(|(_, line)| cells(line) != COLUMNS);
    if lines.next().is_none() {
        return Err(page_problem(1, format!("no table with the columns {}", COLUMNS.join(", "))));
    }
    lines.skip(1).take_while(|(_, line)| line.starts_with('|')).map(|(line, text)| row(line, text)).collect()
}

fn row(line: usize, text: &str) -> Result<Room<'_>, Problem> {
    let cells = cells(text);
    let [folder, name, holds, uses] = cells[..] else {
        return Err(page_problem(line, format!("the row has {} cells, not {}", cells.len(), COLUMNS.len())));
    };
    if holds.is_empty() {
        return Err(page_problem(line, "the column `holds` is empty".to_owned()));
    }
    let bare = |cell: &'_ str| -> Option<()> { (!cell.contains('`')).then_some(()) };
    if bare(folder).or(bare(name)).is_some() {
        return Err(page_problem(line, "folder and room are written between backticks".to_owned()));
    }
    Ok(Room {
        line,
        folder: folder.trim_matches('`'),
        name: name.trim_matches('`'),
        uses: quoted(uses).collect(),
        is_apart: uses.contains(APART),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# Page\n\n| folder | room | holds | uses |\n|---|---|---|---|\n";
    const PLAN: &str = "| `src` | `plan` | text | – |\n";
    const RUN: &str = "| `src` | `run` | text | `plan` |\n";

    #[track_caller]
    fn check_tree(rows: &str, files: &[(&str, &str)], expected: &[&str]) {
        let page = format!("{HEAD}{rows}\nText.\n");
        let files = [&[(PAGE, page.as_str())], files].concat();
        let got: Vec<_> = check(&Tree::of(&files)).iter().map(ToString::to_string).collect();
        assert_eq!(got, expected, "{rows}");
    }

    /// Two rooms below a root that re-exports a name of each.
    #[track_caller]
    fn check_sources(rows: &str, plan: &str, run: &str, error: &str, expected: &[&str]) {
        let root = "pub mod plan;\npub mod run;\n\npub use plan::Plan;\npub use run::{evaluate, falsify};\n";
        let files = [
            ("src/error.rs", error),
            ("src/error/curve.rs", ""),
            ("src/lib.rs", root),
            ("src/plan/mod.rs", plan),
            ("src/run/evaluate.rs", run),
            ("src/run/mod.rs", "mod evaluate;\npub use evaluate::evaluate;\n"),
        ];
        check_tree(rows, &files, expected);
    }

    const USES_PLAN: &str = "use crate::error::Error;\nuse crate::plan::Plan;\n";

    #[test]
    fn a_true_table_has_no_problems() {
        check_sources(&format!("{PLAN}{RUN}"), "", USES_PLAN, "", &[]);
    }

    #[test]
    fn arrows_are_those_of_the_table() {
        let rows = format!("{PLAN}{}", RUN.replace("`plan`", "–"));
        let what = "src/run/evaluate.rs:2: `run` uses `plan`, which its row does not name";
        check_sources(&rows, "", USES_PLAN, "", &[what]);
        let what = "src/run/evaluate.rs:1: `run` uses `plan`, which its row does not name";
        check_sources(&rows, "", "use super::super::plan::Plan;\n", "", &[what]);
        let what = "ARCHITECTURE.md:6: `run` does not use `plan`, which its row names";
        check_sources(&format!("{PLAN}{RUN}"), "", "", "", &[what]);
    }

    #[test]
    fn arrows_form_no_circle() {
        let plan = PLAN.replace('–', "`run`");
        let what = "ARCHITECTURE.md:5: `plan` uses `run`, which is no room of an earlier row";
        check_sources(&format!("{plan}{RUN}"), "use crate::run::evaluate;\n", USES_PLAN, "", &[what]);
    }

    #[test]
    fn rooms_are_imported_by_name_and_lower_files_use_none() {
        let rows = format!("{PLAN}{RUN}");
        let what =
            "src/run/evaluate.rs:3: uses `Plan` through the root of the crate; import it from its room";
        check_sources(&rows, "", &format!("{USES_PLAN}use crate::{{Plan}};\n"), "", &[what]);
        let what = "src/error.rs:1: is below all rooms and uses the room `plan`; move it into a room";
        check_sources(&rows, "", USES_PLAN, "use crate::plan::Plan;\n", &[what]);
    }

    #[test]
    fn folders_are_those_of_the_table() {
        let files = [("src/plan/mod.rs", ""), ("src/other/mod.rs", "")];
        check_tree(PLAN, &files, &["ARCHITECTURE.md:5: the table has no row for the folder `src/other`"]);
        check_tree(PLAN, &[], &["ARCHITECTURE.md:5: `src` has no folder `plan`"]);
    }

    const CLI: &str = "| `crates/cli/src` | `flags` | text | – |\n\
                       | `crates/cli/src` | `commands` | text | `flags`, not each other |\n";

    #[test]
    fn parts_of_a_room_can_be_apart() {
        let files = |replay| {
            [
                ("crates/cli/src/commands.rs", "mod falsify;\nmod replay;\n"),
                ("crates/cli/src/commands/falsify.rs", "use crate::flags;\n"),
                (
                    "crates/cli/src/commands/falsify/text.rs",
                    "use super::Arguments;\nuse super::super::run;\n",
                ),
                ("crates/cli/src/commands/replay.rs", replay),
                ("crates/cli/src/flags/mod.rs", ""),
            ]
        };
        check_tree(CLI, &files(""), &[]);
        for import in ["use super::falsify;\n", "use crate::commands::{falsify::Arguments};\n"] {
            let what = "crates/cli/src/commands/replay.rs:1: `replay` uses `falsify`; parts of this room do not use each other";
            check_tree(CLI, &files(import), &[what]);
        }
    }

    #[test]
    fn a_page_without_the_table_or_with_a_broken_row_says_so() {
        let no_table = check(&Tree::of(&[]));
        assert_eq!(no_table[0].what, "no table with the columns folder, room, holds, uses");
        check_tree("| `src` | `plan` |\n", &[], &["ARCHITECTURE.md:5: the row has 2 cells, not 4"]);
        check_tree("| `src` | `plan` | | – |\n", &[], &["ARCHITECTURE.md:5: the column `holds` is empty"]);
        let bare = "ARCHITECTURE.md:5: folder and room are written between backticks";
        check_tree("| src | `plan` | text | – |\n", &[], &[bare]);
    }
}
