//! An image after the first allocates no memory.
#![allow(clippy::unwrap_used)]

#[path = "../../stl/tests/allocation_counter/mod.rs"]
mod allocation_counter;
mod states;

use allocation_counter::ALLOCATIONS;
use mishandle_camera::{Optics, Output, PoseReader, Poses, Renderer, Scene, Shot, Size};
use mishandle_random::Seed;
use mishandle_tasks::TASKS;
use mishandle_tasks::sight::view;
use states::expert_states;

#[test]
fn an_image_after_the_first_does_not_allocate() {
    for task in TASKS {
        let (model, states) = expert_states(*task, 0.5);
        let size = Size::new(64, 64).unwrap();
        let mut scene = Scene::of_model(&model).unwrap();
        scene.lamps[1].strength = 0.3;
        scene.lamps[1].radius = 0.1;
        let mut camera = view(*task, size).unwrap().1.cameras.swap_remove(0);
        camera.optics = Optics { samples: 2, aperture: 0.01, focus: 1.0, shutter: 0.5 };
        camera.effects.blur = 1.0;
        camera.effects.read_noise = 0.01;
        camera.effects.compression = 1.0;
        let mut reader = PoseReader::new(&model);
        let mut renderer = Renderer::new();
        let mut now = Poses::default();
        let mut before = Poses::default();
        let mut rgb = vec![0; 3 * size.pixels()];
        let mut depth = vec![0.0; size.pixels()];
        let mut segments = vec![0; size.pixels()];
        let mut allocated = Vec::new();
        for step in [100, 1, 100, 150, 300] {
            let first = ALLOCATIONS.get();
            reader.read(&states[step - 1], &mut before);
            reader.read(&states[step], &mut now);
            let shot = Shot {
                scene: &scene,
                poses: &now,
                before: Some(&before),
                camera: &camera,
                seed: Seed(0),
                step: step as u64,
            };
            let mut output =
                Output { rgb: Some(&mut rgb), depth: Some(&mut depth), segments: Some(&mut segments) };
            renderer.render(&shot, &mut output);
            allocated.push(ALLOCATIONS.get() - first);
        }
        assert!(allocated[0] > 0, "{}", task.definition().name);
        assert_eq!(allocated[2..], [0; 3], "{}", task.definition().name);
    }
}
