//! Contact forces agree with statics.

use mishandle_world::Model;

/// A table of 2 kg on the ground, and on it a ball of 0.5 kg. A box without a name belongs to the
/// table.
const SCENE: &str = r#"<mujoco>
  <option gravity="0 0 -10" timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="1 1 0.1"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0.9 0 0.1"/>
    <body name="table" pos="0 0 0.1">
      <freejoint name="table"/>
      <geom type="box" size="0.2 0.2 0.1" mass="1.5"/>
      <body pos="0.1 0.1 0.11"><geom type="box" size="0.01 0.01 0.01" mass="0.5"/></body>
    </body>
    <body name="ball" pos="0 0 0.25"><freejoint name="ball"/><geom size="0.05" mass="0.5"/></body>
  </worldbody>
</mujoco>"#;

#[test]
fn bodies_at_rest_press_on_each_other_with_their_weight() {
    let model = Model::from_xml(SCENE).unwrap();
    let parts = model.contact_parts(&[]);
    let pairs: Vec<String> = parts.pairs().map(|pair| pair.join("-")).collect();
    let expected = ["ground-table", "ground-ball", "scene-table", "scene-ball", "table-ball"];
    assert_eq!(pairs, expected);
    let mut world = model.world();
    for _ in 0..2000 {
        world.step();
    }
    let mut forces = Vec::new();
    world.contact_forces(&parts, &mut forces);
    // The ground carries 2.5 kg, at several points; the table carries 0.5 kg at one point.
    let near = |force: f64, expected: f64| (force - expected).abs() < 1e-3;
    assert!(near(forces[0], 25.0), "{forces:?}");
    assert_eq!(forces[1..4], [0.0; 3]);
    assert!(near(forces[4], 5.0), "{forces:?}");
    assert!(forces[5] >= 5.0 && forces[5] < 25.0, "{forces:?}");
}
