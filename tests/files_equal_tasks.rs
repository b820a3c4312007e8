//! Tasks of the benchmark as target files: the same traces, bit for bit.

use crate::tasks_as_files;
use mishandle_camera::sight::View;
use mishandle_camera::{Output, PoseReader, Poses, Renderer, Shot, Size};
use mishandle_rollout::{Episode, Seed};
use mishandle_world::Model;

fn traces_are_equal(task: &str) {
    let [expected, found] = tasks_as_files::targets(task).map(|target| tasks_as_files::simulate(&target, 40));
    for (row, (expected, found)) in expected.iter().zip(&found).enumerate() {
        assert_eq!(expected.trace.names(), found.trace.names());
        for (column, name) in expected.trace.names().iter().enumerate() {
            let bits = |episode: &Episode| -> Vec<u64> {
                episode.trace.column(column).iter().map(|x| x.to_bits()).collect()
            };
            let expected = bits(expected);
            let found = bits(found);
            let differs = expected.iter().zip(&found).position(|(a, b)| a != b);
            assert_eq!((differs, expected.len()), (None, found.len()), "{name} in simulation {row}");
        }
        let robustness = |episode: &Episode| episode.verdict.robustness.map(f64::to_bits);
        assert_eq!(robustness(expected), robustness(found));
    }
}

#[test]
fn point_reaching_as_a_file_has_the_same_traces() {
    traces_are_equal("point-reaching");
}

#[test]
fn ball_balancing_as_a_file_has_the_same_traces() {
    traces_are_equal("ball-balancing");
}

/// The seed draws the offsets of the start in both.
#[test]
fn ball_pushing_as_a_file_has_the_same_traces() {
    traces_are_equal("ball-pushing");
}

#[test]
fn door_opening_as_a_file_has_the_same_traces() {
    traces_are_equal("door-opening");
}

/// A task and its file have one scene, so that the same cameras see the same, also with the object
/// and the robot as parts.
#[test]
fn cameras_of_a_file_see_what_those_of_the_task_see() {
    let task = mishandle_tasks::task("ball-pushing").unwrap();
    let size = Size::new(64, 48).unwrap();
    let table = |place: &mishandle_tasks::CameraPlace| {
        let body = place.body.map_or(String::new(), |name| format!("body = \"{name}\", "));
        let fovy = 2.0 * (0.5 / place.focal_length).atan().to_degrees();
        let name = place.name;
        let from = place.from;
        let to = place.to;
        let up = place.up;
        format!("{name} = {{ {body}position = {from:?}, look_at = {to:?}, up = {up:?}, fovy = {fovy} }}\n")
    };
    let cameras: String = task.cameras().iter().map(table).collect();
    let file =
        tasks_as_files::file("ball-pushing", &format!("[sight]\nobject = \"ball\"\n[cameras]\n{cameras}"));
    let (own, seen) = mishandle_tasks::sight::view(task, size).unwrap();
    let (other, found) = file.view(size).unwrap().unwrap();
    let state = &mishandle::picture::initial_state("ball-pushing", None).unwrap().states[0];
    let image = |model: &Model, view: &View, camera: usize| {
        let mut poses = Poses::default();
        let mut rgb = vec![0; 3 * size.pixels()];
        PoseReader::new(model).read(state, &mut poses);
        let scene = &view.scene;
        let camera = &view.cameras[camera];
        let shot = Shot { scene, poses: &poses, before: None, camera, seed: Seed(0), step: 0 };
        Renderer::new().render(&shot, &mut Output { rgb: Some(&mut rgb), depth: None, segments: None });
        rgb
    };
    for camera in [0, 1] {
        // The focal length is rounded to a field of view.
        let expected = image(&own, &seen, camera);
        let image = image(&other, &found, camera);
        let differing = expected.iter().zip(&image).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        assert!(differing <= 12, "{differing} of {} bytes", image.len());
        assert!(expected.iter().any(|byte| *byte != expected[0]));
    }
    let parts = |view: &View| (0..view.scene.shapes.len()).map(|shape| view.part(shape)).collect::<Vec<_>>();
    assert_eq!(parts(&seen), parts(&found));
    let names = |sight: &mishandle_camera::sight::Sight| -> Vec<String> {
        sight.axes().map(|axis| axis.name.clone()).collect()
    };
    assert_eq!(names(&mishandle_tasks::sight::sight(task.definition())), names(file.sight().unwrap()));
}
