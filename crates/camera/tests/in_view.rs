//! The cameras of the tasks see the objects.

use crate::states::{cameras, expert_states};
use mishandle_camera::Size;
use mishandle_tasks::TASKS;

/// Along the expert's episodes from both corners and the center of the initial box, the object is
/// in the image of the camera over the table for at least 90 % of the time.
#[test]
fn the_camera_over_the_table_sees_the_object() {
    for task in TASKS {
        let definition = task.definition();
        for place in [0.0, 0.5, 1.0] {
            let (model, states) = expert_states(*task, place);
            let camera = cameras(*task, &model, Size::new(64, 64).unwrap()).swap_remove(0);
            let object = definition.object.unwrap_or("target");
            let mut world = model.world();
            let mut is_seen = |state: &&Vec<f64>| {
                world.set_state(state);
                world.refresh();
                let at = match model.flex(object) {
                    Ok(flex) => world.rows().vertices(flex)[0],
                    Err(_) => world.rows().position(model.body(object).unwrap()),
                };
                let p = camera.pose.local_point(at.map(|v| v as f32));
                let slope = [p[0], p[1]].map(|v| (v / p[2] * camera.focal_length).abs());
                p[2] < 0.0 && slope.iter().all(|slope| *slope < 0.5)
            };
            let seen = states.iter().filter(|state| is_seen(state)).count() as f64 / states.len() as f64;
            assert!(seen > 0.9, "{} from {place} of its box: {seen} of the time", definition.name);
        }
    }
}
