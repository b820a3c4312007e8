//! The vertices of a flex are contiguous, and switching constraints off does not break its edges.

use mishandle_world::{Model, World, WorldError};

/// Returns a triangle of three point masses, one of them fixed to the world; `last` is the body of
/// the third vertex.
fn triangle(last: &str) -> Result<Model, WorldError> {
    let slides = "<joint type=\"slide\" axis=\"1 0 0\"/><joint type=\"slide\" axis=\"0 1 0\"/>\
                  <joint type=\"slide\" axis=\"0 0 1\"/><geom size=\"0.01\" mass=\"1\" contype=\"0\" conaffinity=\"0\"/>";
    Model::from_xml(&format!(
        "<mujoco><worldbody>
           <body name=\"post\"><freejoint/><geom size=\"0.1\" contype=\"0\" conaffinity=\"0\"/></body>
           <body name=\"a\" pos=\"0 0 1\">{slides}<site name=\"a\"/></body>
           <body name=\"b\" pos=\"1 0 1\">{slides}</body>
           {}
         </worldbody>
         <deformable>
           <flex name=\"cloth\" dim=\"2\" body=\"a b c\" element=\"0 1 2\"><contact contype=\"0\" conaffinity=\"0\"/></flex>
         </deformable>
         <equality>
           <flex flex=\"cloth\"/>
           <connect name=\"tie\" body1=\"a\" anchor=\"0 0 0\"/>
         </equality></mujoco>",
        last.replace("{slides}", slides)
    ))
}

fn steps(world: &mut World, seconds: f64) {
    let steps = (seconds / world.model().timestep()).round() as usize;
    (0..steps).for_each(|_| world.step());
    world.refresh();
}

#[test]
fn positions_and_velocities_are_ordered_by_vertex() {
    let model = triangle("<body name=\"c\" pos=\"0 1 1\">{slides}</body>").unwrap();
    let cloth = model.flex("cloth").unwrap();
    assert_eq!(cloth.vertices, 3);
    let mut world = model.world();
    // After the free body's seven positions and six velocities.
    world.qpos_mut()[7 + 3] = 0.5;
    world.qvel_mut()[6 + 3 + 1] = -2.0;
    world.refresh();
    let rows = world.rows();
    assert_eq!(rows.vertices(cloth), [[0.0, 0.0, 1.0], [1.5, 0.0, 1.0], [0.0, 1.0, 1.0]]);
    assert_eq!(rows.vertex_velocities(cloth), [[0.0; 3], [0.0, -2.0, 0.0], [0.0; 3]]);
}

#[test]
fn a_released_cloth_keeps_its_edge_lengths() {
    let model = triangle("<body name=\"c\" pos=\"0 1 1\">{slides}</body>").unwrap();
    let cloth = model.flex("cloth").unwrap();
    let tie = model.equality("tie").unwrap();
    let mut world = model.world();
    steps(&mut world, 0.2);
    assert!((world.rows().vertices(cloth)[0][2] - 1.0).abs() < 0.01, "the tie does not hold");
    world.switch_all(false);
    assert!(!world.rows().is_active(tie));
    steps(&mut world, 1.0);
    let vertices = world.rows().vertices(cloth).to_vec();
    assert!(vertices[0][2] < -1.0, "it does not fall: {vertices:?}");
    let length =
        |a: usize, b: usize| (0..3).map(|i| (vertices[a][i] - vertices[b][i]).powi(2)).sum::<f64>().sqrt();
    assert!((length(0, 1) - 1.0).abs() < 0.05 && (length(0, 2) - 1.0).abs() < 0.05, "{vertices:?}");
}

#[test]
fn a_flex_with_unsupported_vertices_is_an_error() {
    let unknown =
        triangle("<body name=\"c\" pos=\"0 1 1\">{slides}</body>").unwrap().flex("tent").unwrap_err();
    assert!(unknown.to_string().contains("cloth"), "{unknown}");
    // A vertex that moves along one axis only; a vertex with rotated axes.
    for last in [
        "<body name=\"c\" pos=\"0 1 1\"><joint type=\"slide\"/><geom size=\"0.01\" mass=\"1\" contype=\"0\" conaffinity=\"0\"/></body>",
        "<body name=\"c\" pos=\"0 1 1\" euler=\"0 0 90\">{slides}</body>",
    ] {
        let error = triangle(last).unwrap().flex("cloth").unwrap_err();
        assert!(matches!(error, WorldError::UnsupportedFlex(_)), "{error}");
    }
}
