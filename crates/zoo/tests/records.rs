//! The records of the shipped controllers, as other crates read them.

use std::path::Path;

use mishandle::tasks::TASKS;
use mishandle_paper::training_steps;
use mishandle_zoo::{Record, ZooFolder, algorithms};

#[test]
fn the_papers_tables_read_the_training_times_of_the_records() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folder = ZooFolder::new(&root);
    let mut known = 0;
    for task in TASKS {
        let name = task.definition().name;
        for controller in algorithms().chain(["expert"]) {
            let record = Record::load(&folder, name, controller).unwrap();
            let training = record.and_then(|record| record.training);
            let steps = training.and_then(|training| training.training_time).map(|time| time.control_steps);
            assert_eq!(training_steps(&root, name, controller).unwrap(), steps, "{name} {controller}");
            known += usize::from(steps.is_some());
        }
    }
    assert!(known > 0, "no record has a training time");
}
