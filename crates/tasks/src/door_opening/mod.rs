//! Door opening: pull a door open by its lever handle.
//!
//! Every initial state is reachable: the expert opens the doors of all four corners. The nearest
//! corner of the farthest door's lever is 0.955 m from the shoulder, and the tip of an open finger
//! reaches 0.984 m. A finger on the lever pulls by friction alone.

mod expert;
mod rewards;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, norm, rotate, sub};
use mishandle_world::{Body, Joint, Mocap, Model, Rows, Site, World, WorldError};

use crate::cameras::CameraPlace;
use crate::definition::{
    BoxAxis, Definition, GripperMode, Quantity, Reward, Scene, Task, TaskFormulas, Variations, scalar,
    vector3,
};
use crate::robot::Panda;

/// The task.
pub struct DoorOpening;

/// Palm point of the original benchmark in the frame of link 7, m: 4 cm along y from the midpoint
/// of the finger frames.
const GRASP_IN_LINK7: [f64; 3] = [0.0, 0.04, 0.1654];

/// Horizontal positions of the hinge axis and the handle point in the panel's frame, m, which the
/// expert uses.
const HINGE: [f64; 2] = [0.005, -0.464];
const HANDLE: [f64; 2] = [-0.0533, 0.1962];

const DEFINITION: Definition = Definition {
    name: "door-opening",
    summary: "Pull a door open by its lever handle.",
    variant_of: None,
    scene_description: "A door of 0.762 x 1.519 m and 1 kg in a frame. The initial box moves the frame; at its center the frame is \
              0.8 m in front of the robot. The vertical hinge is 0.464 m to the right of the frame's middle, has a friction of \
              0.01 N m, and opens from 0 to 120 degrees towards the robot. There is no latch. The lever is fixed to the left \
              side of the door at a height of 0.81 m; its bar is 11 cm long, 3 cm deep and 3.35 cm high.",
    object: Some("panel"),
    held: None,
    start: [1.157, -1.066, -0.155, -2.239, -1.841, 1.003, 0.469, 0.035, 0.035],
    start_noise: 0.125,
    // On the side that the camera and the robot are on.
    lamp: [-0.45, 0.35, 1.0],
    grip: GripperMode::Scene("the fingers' targets, moved by 0.0125 m at 1, within 0 and 0.04 m"),
    n_substeps: 8,
    velocity_scale: 0.1,
    signals: &[
        scalar("door_yaw_deg", "deg", "yaw angle of the door; 0 is closed"),
        scalar("door_yaw_rate", "rad/s", "yaw rate of the door"),
        scalar(
            "finger_handle_distance",
            "m",
            "distance between the midpoint of the finger frames and the handle point",
        ),
    ],
    observation: &[
        vector3("handle", "m", "position of the handle point, at the free end of the lever"),
        Quantity {
            name: "handle_quaternion",
            unit: "",
            size: 4,
            meaning: "orientation of the handle (w, x, y, z), which turns with the door",
        },
        vector3(
            "handle_from_grasp",
            "m",
            "handle point minus palm point of the original, which is 4 cm beside the midpoint of the finger frames",
        ),
    ],
    original_reward: &[
        scalar(
            "distance",
            "",
            "2 G, G = 1 / (1 + d²)², doubled where d <= 0.02, d from the fingers' midpoint to the handle",
        ),
        scalar(
            "rotation",
            "",
            "0.25 (sgn(c) c² + sgn(c') c'²), c the cosine between the hand's z and the handle's x, c' between its y and the handle's z",
        ),
        scalar(
            "around",
            "",
            "10 A, A = 0.5 where the left finger is above and the right below the handle, else 0",
        ),
        scalar("opened", "", "70 (A / (1 + e²) + yaw), e = |60° - yaw| in rad"),
        scalar(
            "finger_distance",
            "",
            "100 times the sum of 0.04 m - |height of a finger above the handle|, where A > 0",
        ),
        scalar("closed_fingers", "", "10 times the sum of 0.04 m - a finger's position, where d <= 0.03"),
        scalar("action", "", "-0.01 times the sum of the squared actions"),
        scalar("bonus", "", "0.5 where e < 0.7, A more where e < 0.5, 2 A more where e < 0.2"),
    ],
    shaped_reward: &[
        scalar(
            "near",
            "",
            "0.15 (1 - tanh(4 d)), d from the point between the finger pads to the lever; in full from 15° on",
        ),
        scalar(
            "around",
            "",
            "0.1 u l g, u and l how far a pad is above and below the lever's middle over half its height, g from 0 to 1 as \
             d falls from 0.1 to 0.05; in full from 15° on",
        ),
        scalar(
            "closed",
            "",
            "0.05 u l g times how far the fingers are closed on the lever; in full from 15° on",
        ),
        scalar("opening", "", "0.15 times the yaw rate over 0.7 rad/s, within ±0.15; in full from 45° on"),
        scalar("opened", "", "0.8 times the share of 45° that it is open, at most 0.8"),
        scalar("open", "", "0.3 from 45° on"),
        scalar("effort", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "door_x",
            unit: "m",
            paper: [0.75, 0.85],
            code: [0.795, 0.805],
            meaning: "x position of the door frame",
        },
        BoxAxis {
            name: "door_y",
            unit: "m",
            paper: [-0.1, 0.1],
            code: [-0.025, 0.025],
            meaning: "y position of the door frame",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["panel"],
        push: Some(("panel", 10.0)),
        jump: None,
        sizes: &[],
        thrown: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "never",
    differences: "As in the original, the frame is a solid slab that fills the doorway. The frame, the panel and the levers \
                  collide with the whole robot and with nothing else. The original observes a handle that is 0.3 m \
                  beside the real one and computes the reward from one finger instead of two; here both are correct. \
                  The fingers of the original start with noise of up to 0.125 m, which is meaningless for a stroke of \
                  0.04 m; here only the arm joints start with noise. The original limits the hinge to 3.5 rad/s; pulling \
                  does not reach this limit, so it is omitted. The small cube at the free end of the lever has no mass here.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](door_yaw_deg >= 20)",
    strict: "eventually[0:270](always[0:30](door_yaw_deg >= 45))",
    careful: Some(&[]),
    safe: "door_yaw_deg >= 0.1",
    completion: "door_yaw_deg >= 20",
};

impl Task for DoorOpening {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn notes(&self) -> &'static str {
        include_str!("page.md")
    }

    fn cameras(&self) -> [CameraPlace; 2] {
        // On the other side of the hand, the lever would be inside the camera.
        let wrist = CameraPlace {
            from: [-0.075, 0.0, 0.035],
            to: [-0.025, 0.0, 0.16],
            up: [-1.0, 0.0, 0.0],
            ..CameraPlace::WRIST
        };
        [CameraPlace::over([-0.52, 1.12, 1.45], [0.42, 0.0, 0.78], 1.2), wrist]
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene {
            panda: *panda,
            link7: model.body("link7")?,
            left_finger: model.body("left_finger")?,
            right_finger: model.body("right_finger")?,
            frame: model.mocap("frame")?,
            panel: model.body("panel")?,
            hinge: model.joint("door")?,
            handle: model.site("handle")?,
        }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    panda: Panda,
    link7: Body,
    left_finger: Body,
    right_finger: Body,
    frame: Mocap,
    panel: Body,
    hinge: Joint,
    handle: Site,
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place(self.frame, [x0[0], x0[1], 0.0], [1.0, 0.0, 0.0, 0.0]);
    }

    fn grip(&self, _rows: &Rows<'_>, action: &[f64], fingers: &mut [f64]) -> bool {
        self.panda.move_fingers(action, fingers);
        false
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        out[0] = rows.qpos[self.hinge.qpos].to_degrees();
        out[1] = rows.qvel[self.hinge.dof];
        out[2] = norm(sub(self.panda.finger_position(rows), rows.site_position(self.handle)));
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let handle = rows.site_position(self.handle);
        let grasp = add(rows.position(self.link7), rotate(rows.quaternion(self.link7), GRASP_IN_LINK7));
        out[..3].copy_from_slice(&handle);
        out[3..7].copy_from_slice(&rows.quaternion(self.panel));
        out[7..].copy_from_slice(&sub(handle, grasp));
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        match reward {
            Reward::Original => out.copy_from_slice(&self.original(rows, signals, action)),
            Reward::Shaped => out.copy_from_slice(&self.shaped(rows, signals, action)),
        }
    }

    fn is_terminal(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn hinge_and_handle_constants_match_the_scene() {
        let model = Model::from_xml(&crate::compose(&DoorOpening).unwrap()).unwrap();
        let mut world = model.world();
        let handle = model.site("handle").unwrap();
        world.place(model.mocap("frame").unwrap(), [0.0; 3], [1.0, 0.0, 0.0, 0.0]);
        let mut at = |yaw: f64| {
            world.qpos_mut()[model.joint("door").unwrap().qpos] = yaw;
            world.refresh();
            let [x, y, _] = world.rows().site_position(handle);
            [x, y]
        };
        let closed = at(0.0);
        let quarter = at(std::f64::consts::FRAC_PI_2);
        // A rotation by 90 degrees maps the offset (a, b) from the hinge to (-b, a).
        let a = HANDLE[0] - HINGE[0];
        let b = HANDLE[1] - HINGE[1];
        for (found, expected) in
            closed.iter().chain(&quarter).zip([HANDLE[0], HANDLE[1], HINGE[0] - b, HINGE[1] + a])
        {
            assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
        }
    }
}
