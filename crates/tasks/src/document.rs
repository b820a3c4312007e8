//! The MJCF document of a task: robot, held object and scene.

use mishandle_world::{Model, PANDA, PictureModel, WorldError};

use crate::check::compile;
use crate::definition::{Attachment, HeldObject, Task};
use crate::robot::{CONTROL_DT, JOINTS, Panda};

/// The solref of hard contacts in the documents of robot, held objects and scenes: 2.5 physics
/// steps of 1/120 s.
const HARD_CONTACT: &str = "solref=\"0.0208 1.28\"";

/// The time constant of hard contacts, physics steps. At MuJoCo's limit of 2, an arm that scrapes
/// over a table chatters, and its motion depends on the step: `ppo` pushes the ball into the pit in
/// 178 of 200 episodes with steps of 1/480 s, and in 197 with halved ones. With 2.5 it is 196.
const HARD_CONTACT_STEPS: f64 = 2.5;

/// Returns the MJCF document of a task: the robot, the held object and the scene.
///
/// Hard contacts receive a time constant of 2.5 physics steps of the task. With smaller steps they
/// keep it, so that the physics converges.
///
/// The document contains visual geoms for rendering. [`TaskEnvironment`](crate::TaskEnvironment)
/// removes them, which does not change a bit of the physics and makes a step 20 % faster.
///
/// # Errors
/// If the robot's own document does not compile or has no hand.
pub fn compose(task: &dyn Task) -> Result<String, WorldError> {
    let definition = task.definition();
    let mut in_hand = String::new();
    let mut beside = String::new();
    if let Some(held) = &definition.held {
        let (p, q) = pose_in_hand(held, &definition.start)?;
        match held.attachment {
            Attachment::Fixed => in_hand = body(held, p, q, ""),
            Attachment::Weld => {
                let name = held.name;
                let free =
                    body(held, held.position, held.quaternion, &format!("<freejoint name=\"{name}\"/>"));
                let relpose = numbers(&[p.as_slice(), &q].concat());
                beside = format!(
                    "<worldbody>\n{free}\n</worldbody>\n<equality>\n  <weld name=\"{name}\" body1=\"hand\" \
                     body2=\"{name}\" relpose=\"{relpose}\"/>\n</equality>\n"
                );
            }
        }
    }
    let hand = PANDA.replacen("<!-- held -->", &in_hand, 1);
    let timestep = CONTROL_DT / definition.n_substeps as f64;
    let clock = format!("<option timestep=\"{timestep}\"/>\n");
    let document = hand.replacen("</mujoco>", &format!("{clock}{beside}{}\n</mujoco>", task.scene()), 1);
    Ok(document.replace(HARD_CONTACT, &format!("solref=\"{} 1.28\"", HARD_CONTACT_STEPS * timestep)))
}

/// Returns the model of the pictures of a task.
///
/// # Errors
/// As for [`compose`].
pub fn picture_model(task: &dyn Task) -> Result<PictureModel, WorldError> {
    Ok(PictureModel { follows: Some("hand".to_string()), ..PictureModel::new(compose(task)?) })
}

/// Returns the MJCF of the held object with its name, pose and joint.
fn body(held: &HeldObject, position: [f64; 3], quaternion: [f64; 4], joint: &str) -> String {
    let name = held.name;
    let pos = numbers(&position);
    let quat = numbers(&quaternion);
    held.mjcf.replacen("<body>", &format!("<body name=\"{name}\" pos=\"{pos}\" quat=\"{quat}\">{joint}"), 1)
}

fn numbers(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns the pose of the held object in the frame of the hand, from its world pose while the
/// robot is at `start`.
fn pose_in_hand(held: &HeldObject, start: &[f64; JOINTS]) -> Result<([f64; 3], [f64; 4]), WorldError> {
    use mishandle_world::frame::{inverse, multiply, rotate_back, sub};
    let model = Model::from_xml(PANDA)?;
    let panda = Panda::new(&model)?;
    let hand = model.body("hand")?;
    let mut world = model.world();
    panda.place(start, &mut world);
    world.refresh();
    let rows = world.rows();
    let world_from_hand = rows.quaternion(hand);
    let p = rotate_back(world_from_hand, sub(held.position, rows.position(hand)));
    let q = multiply(inverse(world_from_hand), held.quaternion);
    Ok((p, q))
}

/// Returns the document of [`compose`] with a keyframe `start`, the initial state at the center of
/// the initial box, for other programs.
///
/// MJCF cannot express the velocity limits of the servos and the rule of the gripper.
///
/// # Errors
/// As for [`compose`], or if the scene does not compile.
pub fn compose_with_start(task: &dyn Task) -> Result<String, WorldError> {
    let xml = compose(task)?;
    let definition = task.definition();
    let model = compile(task, &xml)?;
    let panda = Panda::new(&model)?;
    let mut world = model.world();
    let center: Vec<f64> =
        definition.initial_box.iter().map(|axis| 0.5 * (axis.paper[0] + axis.paper[1])).collect();
    panda.place(&definition.start, &mut world);
    task.bind(&model, &panda)?.place(&center, &mut world);
    let (mocap_positions, mocap_quaternions) = world.mocap_poses();
    let mut key = format!(
        "  <key name=\"start\" qpos=\"{}\" qvel=\"{}\" ctrl=\"{}\"",
        numbers(world.qpos()),
        numbers(world.qvel()),
        numbers(&definition.start)
    );
    if !mocap_positions.is_empty() {
        let mpos = mocap_positions.as_flattened();
        let mquat = mocap_quaternions.as_flattened();
        key += &format!(" mpos=\"{}\" mquat=\"{}\"", numbers(mpos), numbers(mquat));
    }
    Ok(xml.replacen("</mujoco>", &format!("<keyframe>\n{key}/>\n</keyframe>\n</mujoco>"), 1))
}
