//! Names of a file: one that hides another, or that nothing has, is an error.

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{Component, Noise, Target};

const MODEL: &str = r#"<mujoco><worldbody><body>
  <joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size="0.1 0.1 0.1"/>
</body></worldbody><actuator><motor name="force" joint="slide"/></actuator></mujoco>"#;

const FILE: &str = r#"format = 1
name = "cart"
model.file = "cart.xml"
control = { period = 0.02, steps = 10 }
observation = { x = { value = "qpos('slide')", unit = "m" } }
policy = { expression = "-x", action = "action" }
signals.place = "qpos('slide')"
formulas.near = "always(place <= 1)"
"#;

/// Reads the file with further lines, from line 9 on.
fn target(lines: &str) -> Result<Target, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("cart.xml"), MODEL).unwrap();
    let path = folder.path().join("cart.toml");
    std::fs::write(&path, format!("{FILE}{lines}\n")).unwrap();
    let file = RobotFile::read(&path).map_err(|error| error.to_string())?;
    let RobotPolicy::Expression(policy) = file.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    file.target(policy.clone(), vec![component], Noise::default()).map_err(|error| error.to_string())
}

fn axes(target: &Target, space: &str) -> Vec<String> {
    target.space(space).unwrap().axes().iter().map(|axis| axis.name.clone()).collect()
}

#[test]
fn a_space_of_the_file_has_all_axes_that_it_names() {
    let found =
        target("axes.push = { range = [0, 1] }\nspaces.mine = [\"bias_x\", \"push\", \"action_delay\"]")
            .unwrap();
    assert_eq!(axes(&found, "mine"), ["bias_x", "push", "action_delay"]);
    let error =
        target("axes.push = { range = [0, 1] }\nspaces.mine = [\"push\", \"action_dely\"]").unwrap_err();
    assert!(error.contains("line 10") && error.contains("action_delay"), "{error}");
}

#[test]
fn no_name_hides_another_one() {
    for (lines, name) in [
        ("axes.action = { range = [0, 1] }", "action"),
        ("axes.time = { range = [0, 1] }", "time"),
        ("constants.pi = 3", "pi"),
        ("memory.action = { start = \"0\", next = \"1\" }", "action"),
        ("constants.tilt = 3\naxes.tilt = { range = [0, 1] }", "tilt"),
        ("axes.tilt = { range = [0, 1] }\nmemory.tilt = { start = \"0\", next = \"1\" }", "tilt"),
        ("axes.action_delay = { range = [0, 3] }", "action_delay"),
        ("axes.bias_x = { kind = \"model\", range = [0, 3], add = \"body_mass('.*')\" }", "bias_x"),
    ] {
        let error = target(lines).map(|_| ()).unwrap_err();
        assert!(error.contains(&format!("`{name}`")) && error.contains("line"), "{lines}: {error}");
    }
    // A delay of the file takes the place of that of every robot.
    let own = target("axes.action_delay = { kind = \"model\", delay = \"action\", range = [0, 7] }").unwrap();
    let delay = own.space("delay").unwrap();
    let found: Vec<f64> =
        delay.axes().iter().filter(|axis| axis.name == "action_delay").map(|axis| axis.high).collect();
    assert_eq!(found, [7.0]);
}
