//! An image after the first allocates no memory.
#![allow(unsafe_code)] // A counting global allocator requires unsafe code.
#![allow(clippy::unwrap_used)]

mod states;

use std::alloc::{GlobalAlloc, Layout, System as Allocator};
use std::cell::Cell;

use mishandle_camera::{Optics, Output, PoseReader, Poses, Renderer, Scene, Shot, Size};
use mishandle_random::Seed;
use mishandle_tasks::TASKS;
use states::{cameras, expert_states};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is forwarded to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        unsafe { Allocator.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { Allocator.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

#[test]
fn an_image_after_the_first_does_not_allocate() {
    for task in TASKS {
        let (model, states) = expert_states(*task, 0.5);
        let size = Size::new(64, 64).unwrap();
        let mut scene = Scene::of_model(&model).unwrap();
        scene.lamps[1].strength = 0.3;
        scene.lamps[1].radius = 0.1;
        let mut camera = cameras(*task, &model, size).swap_remove(0);
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
            let first = ALLOCATIONS.with(Cell::get);
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
            allocated.push(ALLOCATIONS.with(Cell::get) - first);
        }
        assert!(allocated[0] > 0, "{}", task.definition().name);
        assert_eq!(allocated[2..], [0; 3], "{}", task.definition().name);
    }
}
