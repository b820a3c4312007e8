//! COMPARE.md states facts about Mishandle: names, counts and versions. These tests compare them
//! with the code, and their messages say what to write.

use std::collections::BTreeSet;

use mishandle::{Plan, ResolvedPlan};
use mishandle_stl::Formula;

const PAGE: &str = include_str!("../COMPARE.md");

/// Returns the cells of a line of a table. No cell of the page contains an escaped `|`.
fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

/// Returns the cells of Mishandle in the tables of a section, each with the name of its row or
/// column. In a table whose first column is `tool`, Mishandle is a row; in the others it is a
/// column.
fn facts(section: &str) -> Vec<(&'static str, &'static str)> {
    let start = PAGE.find(&format!("\n## {section}\n")).unwrap_or_else(|| panic!("no section {section}"));
    let text = &PAGE[start + 1..];
    let text = &text[..text.find("\n## ").unwrap_or(text.len())];
    let mut facts = Vec::new();
    let mut header: Vec<&str> = Vec::new();
    for line in text.lines() {
        if !line.starts_with('|') {
            header.clear();
        } else if header.is_empty() {
            header = cells(line);
        } else if header[0] == "tool" {
            let row = cells(line);
            if row[0] == "Mishandle" {
                facts.extend(header.iter().copied().zip(row).skip(1));
            }
        } else if let Some(column) = header.iter().position(|name| *name == "Mishandle") {
            let row = cells(line);
            facts.push((row[0], row[column]));
        }
    }
    facts
}

/// Returns the cell of Mishandle in the only row or column `name` of a section.
fn fact(section: &str, name: &str) -> &'static str {
    let found: Vec<&str> = facts(section).iter().filter(|fact| fact.0 == name).map(|fact| fact.1).collect();
    assert_eq!(found.len(), 1, "section {section} has {} cells of Mishandle for {name:?}", found.len());
    found[0]
}

/// Returns the texts between backticks.
fn quoted(text: &str) -> BTreeSet<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// Checks that a cell quotes exactly `names`.
#[track_caller]
fn assert_names<'a>(
    section: &str,
    row: &str,
    stated: impl IntoIterator<Item = &'a str>,
    names: impl IntoIterator<Item = &'a str>,
) {
    let stated: BTreeSet<&str> = stated.into_iter().collect();
    let names: BTreeSet<&str> = names.into_iter().collect();
    let list = names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
    assert_eq!(stated, names, "COMPARE.md, section {section}, {row:?}, column of Mishandle: write {list}");
}

/// Returns a number as the page writes it.
fn number(count: usize) -> &'static str {
    ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve"]
        [count]
}

#[test]
fn the_searches_are_those_of_the_registry() {
    let cell = fact("Falsifiers", "searches shipped");
    let names = mishandle_search::SEARCHES.iter().map(|search| search.name);
    assert_names("Falsifiers", "searches shipped", quoted(cell), names);
}

#[test]
fn the_systems_are_the_tasks_and_the_toys() {
    let cell = fact("Falsifiers", "systems under test");
    // A variant of a task, such as the cloth of 7 by 7 points, is not counted as a task.
    let definitions = mishandle_tasks::TASKS.iter().map(|task| task.definition());
    let tasks: Vec<&str> =
        definitions.filter(|task| task.variant_of.is_none()).map(|task| task.name).collect();
    let toys: Vec<String> = mishandle_toys::TOYS.iter().map(|toy| format!("toy/{}", toy.name())).collect();
    let names = tasks.iter().copied().chain(toys.iter().map(String::as_str));
    assert_names("Falsifiers", "systems under test", quoted(cell), names);
    for count in
        [format!("{} manipulation tasks", number(tasks.len())), format!("{} toys", number(toys.len()))]
    {
        assert!(
            cell.contains(&count),
            "COMPARE.md, section Falsifiers, \"systems under test\": write {count:?}"
        );
    }
}

#[test]
fn the_training_algorithms_are_those_of_the_registry() {
    let cell = fact("Training libraries", "single-agent algorithms");
    let names = mishandle_training::ALGORITHMS.iter().map(|algorithm| algorithm.name);
    assert_names("Training libraries", "single-agent algorithms", quoted(cell), names);
}

const EVALUATION: &str = "Evaluation and stress tests of robot policies";

#[test]
fn the_methods_of_risk_are_those_of_the_crate() {
    let cell = fact(EVALUATION, "probability of a failure");
    let stated = quoted(cell).into_iter().filter(|text| !text.starts_with("mishandle "));
    assert_names(
        EVALUATION,
        "probability of a failure",
        stated,
        mishandle_risk::Method::ALL.map(|(_, name)| name),
    );
}

#[test]
fn the_spaces_are_those_of_the_tasks() {
    let cell = fact(EVALUATION, "perturbations");
    let mut names = BTreeSet::new();
    for task in mishandle_tasks::TASKS {
        let plan = Plan::new(task.definition().name, "expert");
        let spaces = ResolvedPlan::new(&plan).unwrap().target.spaces;
        names.extend(spaces.iter().map(|space| space.name().to_string()));
    }
    assert_names(EVALUATION, "perturbations", quoted(cell), names.iter().map(String::as_str));
}

#[test]
fn the_observations_are_vectors_of_the_stated_sizes() {
    let cell = fact(EVALUATION, "images and language");
    let sizes: Vec<usize> =
        mishandle_tasks::TASKS.iter().map(|task| task.definition().layout().observation_size()).collect();
    let text = format!("{} to {} numbers", sizes.iter().min().unwrap(), sizes.iter().max().unwrap());
    assert!(
        cell.contains(&text),
        "COMPARE.md, section {EVALUATION}, \"images and language\": write {text:?}"
    );
}

/// Returns the long names in the row `name` of the table of operators in `Formula`'s documentation,
/// without abbreviations such as `H`.
fn documented_operators(rows: &[&str]) -> BTreeSet<&'static str> {
    let page = include_str!("../docs/reference/formulas.md");
    let row = |name: &&str| page.lines().find(|line| line.starts_with(&format!("| [{name}]"))).unwrap();
    let words = rows.iter().flat_map(|name| row(name).split('`').skip(1).step_by(2));
    let words = words.map(|text| text.split('(').next().unwrap());
    words.filter(|word| !word.starts_with(char::is_uppercase) && !["sX", "sY"].contains(word)).collect()
}

#[test]
fn the_operators_are_those_of_the_formula() {
    let arithmetic = quoted(fact("Monitors", "arithmetic in formulas"));
    let stated = arithmetic.into_iter().filter(|text| *text != "+ - * /");
    assert_names("Monitors", "arithmetic in formulas", stated, documented_operators(&["functions"]));
    Formula::parse("a + b - c * d / e <= 0").unwrap();
    let past = quoted(fact("Monitors", "past operators"));
    let mut documented = documented_operators(&["historically", "once", "neighbors", "since"]);
    documented.retain(|word| !["next", "s_next"].contains(word));
    assert_names("Monitors", "past operators", past, documented);
    for example in quoted(fact("Monitors", "example")) {
        Formula::parse(example)
            .unwrap_or_else(|error| panic!("COMPARE.md, section Monitors, {example}: {error}"));
    }
}

#[test]
fn version_and_license_are_those_of_the_package() {
    let license = env!("CARGO_PKG_LICENSE").replace(" OR ", " or ");
    let sections = ["Monitors", "Falsifiers", EVALUATION, "Training libraries"];
    for section in sections {
        assert_eq!(fact(section, "license"), license, "section {section}");
        let version = fact(section, "version and date");
        let expected = format!("{}, not released", env!("CARGO_PKG_VERSION"));
        assert_eq!(version, expected, "section {section}");
    }
    let changelog = include_str!("../CHANGELOG.md");
    let heading = format!("\n## {}, unreleased\n", env!("CARGO_PKG_VERSION"));
    assert!(
        changelog.contains(&heading),
        "CHANGELOG.md has a date for this version: write it into COMPARE.md"
    );
}

/// A command that was renamed or removed has exit code 2.
#[test]
fn every_command_of_the_page_exists() {
    let commands: BTreeSet<&str> = quoted(PAGE)
        .into_iter()
        .filter_map(|text| text.strip_prefix("mishandle ")?.split(' ').next())
        .collect();
    assert!(commands.contains("falsify"), "found only {commands:?}");
    for command in commands {
        let code = mishandle_cli::exit_code_of(["mishandle", command, "--help"].map(Into::into), None);
        assert_eq!(code, 0, "COMPARE.md names `mishandle {command}`");
    }
}

/// Features that need the Python package are named by the names that it exports and the packages
/// that its extras install.
#[test]
fn the_python_package_has_what_the_page_names() {
    let exports = include_str!("../python/mishandle/__init__.py");
    let names: BTreeSet<&str> =
        quoted(PAGE).into_iter().filter_map(|text| text.strip_prefix("mishandle.")).collect();
    assert!(names.contains("TaskEnv"), "found only {names:?}");
    for name in names {
        assert!(exports.contains(&format!("    \"{name}\",\n")), "COMPARE.md names `mishandle.{name}`");
    }
    let package = include_str!("../pyproject.toml");
    for (feature, extra) in [("MuJoCo Warp", "mujoco-warp=="), ("Ray cluster", "ray>=")] {
        assert!(
            PAGE.contains(feature) && package.contains(extra),
            "COMPARE.md and pyproject.toml: {feature}"
        );
    }
}
