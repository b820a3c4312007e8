//! The pages in `studies/notebook/2026-11-28-paper` are those of the summaries in
//! `studies/experiments/paper/results`.

use std::fs;
use std::path::{Path, PathBuf};

use mishandle_report::Block;
use mishandle_studies::paper::{Results, pages};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns the kept generation of results; `None` before the first one.
fn kept() -> Option<PathBuf> {
    let folders = fs::read_dir(root().join("studies/experiments/paper/results")).ok()?;
    let mut folders: Vec<PathBuf> = folders.map(|entry| entry.unwrap().path()).collect();
    folders.retain(|path| path.is_dir());
    assert!(folders.len() <= 1, "one generation of results is kept: {folders:?}");
    folders.pop()
}

#[test]
fn the_pages_are_recomputed_from_the_summaries() {
    let Some(folder) = kept() else { return eprintln!("skipped: there are no results yet") };
    for (name, page) in pages(&Results::read(&folder).unwrap()) {
        let path = root().join(format!("studies/notebook/2026-11-28-paper/{name}.md"));
        let kept = fs::read_to_string(&path).unwrap();
        assert!(
            kept == page.markdown(),
            "{}: run `studies reproduce tables {} --pages studies/notebook/2026-11-28-paper`",
            path.display(),
            folder.display()
        );
    }
}

/// Counts violations in the files themselves, without the code of the tables.
#[test]
fn the_falsified_trials_of_the_table_are_those_of_the_units() {
    let Some(folder) = kept() else { return eprintln!("skipped: there are no results yet") };
    let results = Results::read(&folder).unwrap();
    let mut counts = Vec::new();
    for campaign in &results.campaigns {
        for run in campaign.runs.iter().filter(|run| run.plan.falsify.is_some()) {
            let path = folder.join(&campaign.name).join(format!("{}.csv", run.facts.name));
            let text = fs::read_to_string(path).unwrap();
            let column = text.lines().next().unwrap().split(',').position(|name| name == "violations");
            let violations = |line: &str| line.split(',').nth(column.unwrap()).unwrap().to_string();
            let trials: Vec<String> = text.lines().skip(1).map(violations).collect();
            let violating = trials.iter().filter(|violations| *violations != "0").count();
            counts.push(format!("{violating} of {}", trials.len()));
        }
    }
    let all = pages(&results);
    let tables = all.iter().flat_map(|(_, page)| &page.blocks).filter_map(|block| match block {
        Block::Table(table) if table.caption.starts_with("Falsified trials") => Some(table),
        _ => None,
    });
    // One column for each generation: `falsified`, or `falsified, second`.
    let is_ours = |name: &str| name.starts_with("falsified") && name != "falsified, paper";
    let cells = tables.flat_map(|table| {
        table.rows.iter().flat_map(|row| table.columns.iter().zip(row)).filter(|(name, _)| is_ours(name))
    });
    let mut shown: Vec<String> = cells.map(|(_, cell)| cell.clone()).filter(|cell| cell != "-").collect();
    shown.sort();
    counts.sort();
    assert_eq!(shown, counts);
}

#[test]
fn the_results_are_small_enough_for_the_repository() {
    fn size(path: &Path) -> u64 {
        if !path.is_dir() {
            return path.metadata().unwrap().len();
        }
        fs::read_dir(path).unwrap().map(|entry| size(&entry.unwrap().path())).sum()
    }
    let Some(folder) = kept() else { return eprintln!("skipped: there are no results yet") };
    assert!(size(&folder) <= 1 << 20, "{} bytes", size(&folder));
}
