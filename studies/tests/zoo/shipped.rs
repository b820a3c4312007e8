//! The files in `controllers/`: each belongs to one generation, by its name and its header.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mishandle::controllers::ControllerFile;
use mishandle::tasks::TASKS;
use mishandle::training::ALGORITHMS;
use mishandle_studies::{GENERATIONS, Generation};

/// Largest size of all weights of a generation, bytes: each clone downloads them.
const LARGEST: u64 = 6_000_000;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Returns the files of the generations of all tasks.
fn files() -> Vec<PathBuf> {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    let folders = entries(&repository().join("controllers"));
    let files = folders.iter().filter(|path| path.is_dir()).flat_map(|folder| entries(folder));
    files.filter(|path| path.extension().is_some_and(|ending| ending == "safetensors")).collect()
}

fn generation(path: &Path) -> (&'static str, &'static Generation) {
    let name = path.file_stem().unwrap().to_str().unwrap();
    Generation::of(name).unwrap_or_else(|| panic!("{} has no name of a generation", path.display()))
}

#[test]
fn each_file_is_of_the_task_and_the_algorithm_that_its_name_states() {
    for path in files() {
        let header = ControllerFile::load(&path).unwrap().header;
        let task = path.parent().unwrap().file_name().unwrap().to_str().unwrap();
        assert_eq!(
            (&header.task[..], &header.algorithm[..]),
            (task, generation(&path).0),
            "{}",
            path.display()
        );
    }
}

#[test]
fn each_generation_is_complete_and_small() {
    let mut found: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
    for path in files() {
        let (count, size) = found.entry(generation(&path).1.name).or_default();
        *count += 1;
        *size += path.metadata().unwrap().len();
    }
    let tasks = TASKS.iter().filter(|task| task.definition().variant_of.is_none()).count();
    assert_eq!(found.len(), GENERATIONS.len());
    for (name, (count, size)) in found {
        assert!(count == tasks * ALGORITHMS.len() && size <= LARGEST, "{name}: {count} files, {size} bytes");
    }
}

#[test]
fn the_table_of_the_generations_says_how_each_was_trained() {
    let page = std::fs::read_to_string(repository().join("controllers/README.md")).unwrap();
    for Generation { name, training, .. } in &GENERATIONS {
        let row = page.lines().find(|line| line.starts_with(&format!("| {name} |"))).unwrap();
        let on = training.strip_prefix("trained on ").unwrap();
        assert!(row.contains(&format!("| {on} |")), "{row}");
    }
}
