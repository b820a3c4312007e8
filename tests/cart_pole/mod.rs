//! A pole on a cart, which a file describes. An episode takes less than a millisecond.

use std::path::{Path, PathBuf};

pub const MODEL: &str = r#"<mujoco>
  <option timestep="0.01"/>
  <worldbody>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="0.1"/>
      <geom type="box" size="0.15 0.1 0.06" mass="1" contype="0"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" damping="0.002"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02" mass="0.1" contype="0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="force" joint="slide"/></actuator>
</mujoco>"#;

const ROBOT: &str = r#"
format = 1
name = "cartpole"
model.file = "cartpole.xml"
control = { period = 0.02, steps = 100 }
start = { hinge = "tilt" }
observation.state = "[*qpos('slide'), *qvel('slide'), *qpos('hinge'), *qvel('hinge')]"
policy = { action = "10 * action", limit = 1 }
signals.angle = { value = "abs(qpos('hinge')[0])", unit = "rad" }
rewards = { upright = "1 - angle ** 2" }
ends = { fallen = "angle > 0.5" }
formulas = { upright = "always(angle <= 0.3)" }

[axes]
tilt = { range = [-0.1, 0.1], unit = "rad" }
pole = { kind = "model", range = [0.5, 2], nominal = 1, scale = "body_mass('pole')" }
gust = { kind = "event", body = "pole", time = [0.2, 1], duration = 0.1, x = [-3, 3] }
"#;

/// Writes model and file, whose text `change` changes. Returns the path of the file.
pub fn write(folder: &Path, change: impl Fn(String) -> String) -> PathBuf {
    let file = folder.join("cartpole.toml");
    std::fs::write(folder.join("cartpole.xml"), MODEL).unwrap();
    std::fs::write(&file, change(ROBOT.to_string())).unwrap();
    file
}
