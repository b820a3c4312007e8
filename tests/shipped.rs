//! The files in `controllers/`: each belongs to one generation, by its name and its header.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use mishandle::controllers::{ControllerFile, Entry};
use mishandle::resolve::onnx_policy;
use mishandle::rollout::Controller;
use mishandle::shipped::{GENERATIONS, Generation, ShippedFile, shipped_controllers};
use mishandle::tasks::TASKS;
use mishandle::training::ALGORITHMS;

/// Largest size of all weights of a generation, bytes: each clone downloads them.
const LARGEST: u64 = 6_000_000;

/// Largest size of a policy that sees, bytes.
const LARGEST_MODEL: u64 = 3_000_000;

/// Returns the files of the generations of all tasks.
fn files() -> Vec<PathBuf> {
    files_with("safetensors")
}

fn files_with(extension: &str) -> Vec<PathBuf> {
    let entries = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect()
    };
    let folders = entries(&Path::new(env!("CARGO_MANIFEST_DIR")).join("controllers"));
    let files = folders.iter().filter(|path| path.is_dir()).flat_map(|folder| entries(folder));
    files.filter(|path| path.extension().is_some_and(|ending| ending == extension)).collect()
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
fn the_first_generation_is_complete_and_each_is_small() {
    let mut found: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
    for path in files() {
        let (count, size) = found.entry(generation(&path).1.name).or_default();
        *count += 1;
        *size += path.metadata().unwrap().len();
    }
    let tasks = TASKS.iter().filter(|task| task.definition().variant_of.is_none()).count();
    assert_eq!(found[Generation::of_paper().name].0, tasks * ALGORITHMS.len());
    for (name, (count, size)) in found {
        assert!(count <= tasks * ALGORITHMS.len() && size <= LARGEST, "{name}: {count} files, {size} bytes");
    }
}

#[test]
fn the_table_of_the_generations_says_how_each_was_trained() {
    let page = std::fs::read_to_string("controllers/README.md").unwrap();
    for Generation { name, training, .. } in &GENERATIONS {
        let row = page.lines().find(|line| line.starts_with(&format!("| {name} |"))).unwrap();
        let on = training.strip_prefix("trained on ").unwrap();
        assert!(row.contains(&format!("| {on} |")), "{row}");
    }
}

/// Errors and lists show them from here.
#[test]
fn the_names_of_a_task_are_those_of_its_files_and_the_expert() {
    for task in TASKS.iter().filter(|task| task.definition().variant_of.is_none()) {
        let definition = task.definition();
        let of_task = |path: &PathBuf| path.parent().unwrap().ends_with(definition.name);
        let name = |path: PathBuf| path.file_stem().unwrap().to_str().unwrap().to_string();
        let all = files().into_iter().chain(files_with("onnx"));
        let mut names: Vec<String> = all.filter(of_task).map(name).collect();
        names.sort();
        names.push("expert".to_string());
        assert_eq!(shipped_controllers(definition), names);
    }
}

/// Where the object is must come from the images: a policy that got it would not need to see.
#[test]
fn the_policies_that_see_get_their_joints_and_images_alone() {
    let models = files_with("onnx");
    assert!(models.len() >= 4, "{models:?}");
    for path in models {
        assert_eq!(path.file_stem().unwrap(), "vision");
        assert!(path.metadata().unwrap().len() <= LARGEST_MODEL, "{}", path.display());
        let name = path.parent().unwrap().file_name().unwrap().to_str().unwrap();
        let policy = onnx_policy(&ShippedFile::Path(path.clone()), Some(name)).unwrap();
        let entries = mishandle::tasks::task(name).unwrap().definition().layout().observation;
        let pixels: usize = policy.sees().iter().map(|image| 3 * image.width * image.height).sum();
        let images: Vec<u8> = (0..pixels).map(|i| (i * i % 251) as u8).collect();
        let act = |hidden: f32, joints: f32| -> Vec<f32> {
            let of = |entry: &Entry| if entry.name.starts_with("joint_") { joints } else { hidden };
            let observation: Vec<f32> =
                entries.iter().flat_map(|entry| vec![of(entry); entry.size]).collect();
            let mut worker = policy.worker();
            let mut actions = vec![0.0; policy.action_size()];
            worker.look(1, &images);
            worker.act(1, &observation, &mut vec![0.0; policy.state_size()], &mut actions);
            actions
        };
        let actions = act(0.3, 0.1);
        assert!(actions.iter().all(|action| action.is_finite()), "{}", path.display());
        assert_eq!(actions, act(-7.0, 0.1), "{}", path.display());
        assert_eq!(actions, act(f32::NAN, 0.1), "{}", path.display());
        assert_ne!(actions, act(0.3, 0.2), "{}", path.display());
    }
}
