//! Checks the table of crates in ARCHITECTURE.md against the workspace: crates, levels and
//! dependencies.

use std::collections::BTreeSet;

use anyhow::{Context, Result};
use serde_json::Value;

use super::{Problem, Tree};

const PAGE: &str = "ARCHITECTURE.md";
const COLUMNS: [&str; 5] = ["level", "crate", "purpose", "invariant", "uses"];
/// Chores, which are not part of the product.
const UNLISTED: [&str; 1] = ["xtask"];
/// The crate that links MuJoCo.
const MUJOCO: &str = "world";
/// Crates that must not link MuJoCo, directly or through another crate, because they serve any
/// simulator.
const WITHOUT_MUJOCO: [&str; 13] = [
    "random",
    "files",
    "stl",
    "search",
    "network",
    "store",
    "toys",
    "rollout",
    "controllers",
    "evaluation",
    "training",
    "falsification",
    "risk",
];
/// A package of the workspace, as cargo sees it.
pub struct Package {
    /// Name in the table: `stl` for `mishandle-stl`.
    name: String,
    uses: BTreeSet<String>,
}

/// A row of the table.
struct Row {
    line: usize,
    level: u32,
    name: String,
    uses: BTreeSet<String>,
}

/// Parses the output of `cargo metadata --no-deps`.
///
/// # Errors
/// If the text does not list packages.
pub fn packages(metadata: &str) -> Result<Vec<Package>> {
    let metadata: Value = serde_json::from_str(metadata)?;
    let packages = metadata["packages"].as_array().context("cargo metadata names no packages")?;
    let all: Vec<Package> = packages.iter().map(read).collect::<Result<_>>()?;
    Ok(all.into_iter().filter(|package| !UNLISTED.contains(&package.name.as_str())).collect())
}

fn read(package: &Value) -> Result<Package> {
    let text = |value: &Value| value.as_str().map(str::to_owned).context("cargo metadata lacks a name");
    let is_normal_and_ours =
        |dependency: &&Value| dependency["kind"].is_null() && dependency["path"].is_string();
    let dependencies = package["dependencies"].as_array().map(Vec::as_slice).unwrap_or_default();
    Ok(Package {
        name: short(&text(&package["name"])?),
        uses: dependencies
            .iter()
            .filter(is_normal_and_ours)
            .map(|dependency| Ok(short(&text(&dependency["name"])?)))
            .collect::<Result<_>>()?,
    })
}

fn short(name: &str) -> String {
    name.strip_prefix("mishandle-").unwrap_or(name).to_owned()
}

/// Compares the table with the packages.
pub fn check(tree: &Tree, packages: &[Package]) -> Vec<Problem> {
    let text = tree.file(PAGE).map_or("", |file| &file.text);
    let (first_line, rows) = match table(text) {
        Ok(found) => found,
        Err(problem) => return vec![problem],
    };
    let mut problems: Vec<Problem> = packages
        .iter()
        .filter(|package| rows.iter().all(|row| row.name != package.name))
        .map(|package| problem(first_line, format!("the table has no row for the crate `{}`", package.name)))
        .collect();
    for row in &rows {
        let Some(package) = packages.iter().find(|package| package.name == row.name) else {
            problems.push(problem(row.line, format!("the workspace has no crate `{}`", row.name)));
            continue;
        };
        problems.extend(uses(row, &rows, package).into_iter().map(|what| problem(row.line, what)));
        if WITHOUT_MUJOCO.contains(&row.name.as_str()) {
            problems.extend(path_to_mujoco(package, packages).map(|path| problem(row.line, linked(&path))));
        }
    }
    problems
}

/// Returns the dependency path from a package to the crate that links MuJoCo, both included, if
/// there is one.
fn path_to_mujoco<'a>(package: &'a Package, packages: &'a [Package]) -> Option<Vec<&'a str>> {
    if package.name == MUJOCO {
        return Some(vec![MUJOCO]);
    }
    let used = packages.iter().filter(|other| package.uses.contains(&other.name));
    let rest = used.filter_map(|used| path_to_mujoco(used, packages)).next()?;
    Some([&[package.name.as_str()][..], &rest].concat())
}

fn linked(path: &[&str]) -> String {
    let path: Vec<String> = path.iter().map(|name| format!("`{name}`")).collect();
    format!("{} must not link MuJoCo, but does: {}", path[0], path.join(" -> "))
}

fn problem(line: usize, what: String) -> Problem {
    Problem { path: PAGE.into(), line, what }
}

/// Returns the line of the table's header, and its rows.
fn table(text: &str) -> Result<(usize, Vec<Row>), Problem> {
    let mut lines = (1..).zip(text.lines()).skip_while(|(_, line)| cells(line) != COLUMNS);
    let Some((head, _)) = lines.next() else {
        return Err(problem(1, format!("no table with the columns {}", COLUMNS.join(", "))));
    };
    let rows = lines.skip(1).take_while(|(_, line)| line.starts_with('|'));
    Ok((head, rows.map(|(line, text)| row(line, text)).collect::<Result<_, _>>()?))
}

pub(super) fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

fn row(line: usize, text: &str) -> Result<Row, Problem> {
    let cells = cells(text);
    let [level, name, purpose, invariant, uses] = cells[..] else {
        return Err(problem(line, format!("the row has {} cells, not {}", cells.len(), COLUMNS.len())));
    };
    for (column, cell) in [("purpose", purpose), ("invariant", invariant)] {
        if cell.is_empty() {
            return Err(problem(line, format!("the column `{column}` is empty")));
        }
    }
    Ok(Row {
        line,
        level: level.parse().map_err(|_| problem(line, format!("the level `{level}` is not a number")))?,
        name: quoted(name).next().unwrap_or(name).to_owned(),
        uses: quoted(uses).map(str::to_owned).collect(),
    })
}

/// Returns the parts of a cell between backticks.
pub(super) fn quoted(cell: &str) -> impl Iterator<Item = &str> {
    cell.split('`').skip(1).step_by(2)
}

fn uses(row: &Row, rows: &[Row], package: &Package) -> Vec<String> {
    let below: BTreeSet<String> =
        rows.iter().filter(|other| other.level < row.level).map(|other| other.name.clone()).collect();
    let name = &row.name;
    let too_few = package
        .uses
        .difference(&row.uses)
        .map(|used| format!("`{name}` uses `{used}`, which its row does not name"));
    let too_many = row
        .uses
        .difference(&package.uses)
        .map(|used| format!("`{name}` does not use `{used}`, which its row names"));
    let not_below = package.uses.difference(&below).map(|used| {
        format!("`{name}` is on level {} and uses `{used}`, which is not on a lower one", row.level)
    });
    too_few.chain(too_many).chain(not_below).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "# Page\n\n| level | crate | purpose | invariant | uses |\n|--:|---|---|---|---|\n";

    fn package(name: &str, uses: &[&str]) -> Package {
        let uses = uses.iter().map(|name| (*name).to_owned()).collect();
        Package { name: name.into(), uses }
    }

    /// A workspace of three crates: `stl` and `rollout`, which uses it, and the root package above
    /// both.
    #[track_caller]
    fn check_rows(rows: &str, expected: &[&str]) {
        let page = format!("{HEAD}{rows}\nText.\n");
        let tree = Tree::of(&[(PAGE, &page)]);
        let packages =
            [package("stl", &[]), package("rollout", &["stl"]), package("mishandle", &["stl", "rollout"])];
        let got: Vec<_> = check(&tree, &packages).iter().map(ToString::to_string).collect();
        assert_eq!(got, expected, "{rows}");
    }

    const STL: &str = "| 0 | `stl` | text | no files | – |\n";
    const ROLLOUT: &str = "| 1 | `rollout` | text | no physics | `stl` |\n";
    const ROOT: &str = "| 2 | `mishandle`, the root package | text | no robot | `stl`, `rollout` |\n";

    #[test]
    fn a_true_table_has_no_problems() {
        check_rows(&format!("{STL}{ROLLOUT}{ROOT}"), &[]);
    }

    #[test]
    fn crates_are_those_of_the_workspace() {
        check_rows(
            &format!("{STL}{ROLLOUT}{ROOT}| 3 | `viewer` | text | – | – |\n"),
            &["ARCHITECTURE.md:8: the workspace has no crate `viewer`"],
        );
        check_rows(
            &format!("{STL}{ROLLOUT}"),
            &["ARCHITECTURE.md:3: the table has no row for the crate `mishandle`"],
        );
    }

    #[test]
    fn uses_are_those_of_cargo_and_point_downwards() {
        check_rows(
            &format!("{STL}| 1 | `rollout` | text | no physics | – |\n{ROOT}"),
            &["ARCHITECTURE.md:6: `rollout` uses `stl`, which its row does not name"],
        );
        check_rows(
            &format!("{}{ROLLOUT}{ROOT}", STL.replace('–', "`rollout`")),
            &["ARCHITECTURE.md:5: `stl` does not use `rollout`, which its row names"],
        );
        check_rows(
            &format!("{STL}{}{ROOT}", ROLLOUT.replace('1', "0")),
            &["ARCHITECTURE.md:6: `rollout` is on level 0 and uses `stl`, which is not on a lower one"],
        );
    }

    #[test]
    fn crates_below_the_tasks_do_not_link_mujoco() {
        let packages = [
            package("world", &[]),
            package("controllers", &["world"]),
            package("training", &["controllers"]),
            package("tasks", &["world"]),
        ];
        let page = format!(
            "{HEAD}| 0 | `world` | text | – | – |\n| 2 | `controllers` | text | – | `world` |\n\
             | 3 | `training` | text | – | `controllers` |\n| 3 | `tasks` | text | – | `world` |\n"
        );
        let got: Vec<_> =
            check(&Tree::of(&[(PAGE, &page)]), &packages).iter().map(ToString::to_string).collect();
        assert_eq!(
            got,
            [
                "ARCHITECTURE.md:6: `controllers` must not link MuJoCo, but does: `controllers` -> `world`",
                "ARCHITECTURE.md:7: `training` must not link MuJoCo, but does: `training` -> `controllers` -> `world`",
            ]
        );
    }

    #[test]
    fn a_page_without_the_table_or_with_a_broken_row_says_so() {
        let no_table = check(&Tree::of(&[]), &[]);
        assert_eq!(no_table[0].what, "no table with the columns level, crate, purpose, invariant, uses");
        check_rows("| 0 | `stl` |\n", &["ARCHITECTURE.md:5: the row has 2 cells, not 5"]);
        check_rows("| 0 | `stl` | text | | – |\n", &["ARCHITECTURE.md:5: the column `invariant` is empty"]);
        check_rows(
            "| low | `stl` | text | – | – |\n",
            &["ARCHITECTURE.md:5: the level `low` is not a number"],
        );
    }

    #[test]
    fn packages_are_read_from_cargos_text() {
        let metadata = r#"{"packages": [
            {"name": "mishandle-rollout", "manifest_path": "/x/crates/rollout/Cargo.toml", "dependencies": [
                {"name": "mishandle-stl", "kind": null, "path": "/x/crates/stl"},
                {"name": "mishandle-search", "kind": "dev", "path": "/x/crates/search"},
                {"name": "rayon", "kind": null}]},
            {"name": "mishandle", "manifest_path": "/x/Cargo.toml", "dependencies": []},
            {"name": "xtask", "manifest_path": "/x/xtask/Cargo.toml", "dependencies": []}]}"#;
        let packages = packages(metadata).unwrap();
        let found: Vec<_> = packages.iter().map(|p| (p.name.as_str(), p.uses.len())).collect();
        assert_eq!(found, [("rollout", 1), ("mishandle", 0)]);
        assert!(packages[0].uses.contains("stl"));
    }
}
