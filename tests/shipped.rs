//! The files in `controllers/`: names, and the policies that see.

use std::path::{Path, PathBuf};

use mishandle::controllers::Entry;
use mishandle::resolve::onnx_policy;
use mishandle::shipped::{ShippedFile, shipped_controllers};
use mishandle::tasks::TASKS;

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
        let policy = onnx_policy(&ShippedFile::Path(path.clone()), Some(name)).unwrap().controller;
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
