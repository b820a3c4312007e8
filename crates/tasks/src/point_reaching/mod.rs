//! Point reaching: bring the fingers to a point in space and keep them there.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, sub};
use mishandle_world::{Body, Mocap, Model, Rows, World, WorldError};

use crate::cameras::LAMP;
use crate::definition::{
    BoxAxis, Definition, GripperMode, Reward, Scene, Task, TaskFormulas, Variations, scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct PointReaching;

const DEFINITION: Definition = Definition {
    name: "point-reaching",
    summary: "Bring the fingers to a point in space and keep them there.",
    variant_of: None,
    scene_description: "The target is a point in the air, drawn as a sphere with a radius of 2.5 cm. There are no contacts. \
              The hand starts at (0.24, 0, 0.92) m and points forward.",
    object: None,
    held: None,
    start: [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.01, 0.01],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Fixed(0.01),
    n_substeps: 4,
    velocity_scale: 0.1,
    signals: &[
        scalar("finger_target_distance", "m", "distance between the midpoint of the fingers and the target"),
        scalar("finger_twist", "", "norm of the left finger's twist, which mixes m/s and rad/s"),
    ],
    observation: &[
        vector3("target", "m", "position of the target"),
        vector3("finger", "m", "midpoint of the two finger frames"),
        vector3("finger_from_target", "m", "midpoint of the finger frames minus target"),
    ],
    original_reward: &[
        scalar("near", "", "1 / (1 + d)"),
        scalar("there", "", "10 where d < 0.03 and v < 0.02, else 0"),
        scalar("slow", "", "0.1 / (1 + v)"),
    ],
    shaped_reward: &[
        scalar("near", "", "0.5 (1 - tanh(4 d))"),
        scalar("there", "", "0.5 (1 - tanh(25 d))"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "target_x",
            unit: "m",
            paper: [0.3, 0.7],
            code: [0.3, 0.7],
            meaning: "x position of the target",
        },
        BoxAxis {
            name: "target_y",
            unit: "m",
            paper: [-0.4, 0.4],
            code: [-0.4, 0.4],
            meaning: "y position of the target",
        },
        BoxAxis {
            name: "target_z",
            unit: "m",
            paper: [0.4, 0.8],
            code: [0.4, 0.8],
            meaning: "z position of the target",
        },
    ],
    variations: Variations {
        friction: false,
        masses: &[],
        push: Some(("hand", 50.0)),
        jump: Some("target"),
        sizes: &[],
        thrown: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "never",
    differences: "The finger position is the midpoint of both fingers; the original uses the left finger, which is at most 1 cm \
                  away from it. There are no contacts.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "always[50:300](finger_target_distance <= 0.12)",
    strict: "always[150:300](finger_target_distance <= 0.03)",
    careful: Some(&[]),
    safe: "finger_target_distance < 0.6",
    completion: "finger_target_distance <= 0.12",
};

impl Task for PointReaching {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn notes(&self) -> &'static str {
        include_str!("page.md")
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene {
            panda: *panda,
            target: model.body("target")?,
            target_mocap: model.mocap("target")?,
        }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    panda: Panda,
    target: Body,
    target_mocap: Mocap,
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place(self.target_mocap, [x0[0], x0[1], x0[2]], [1.0, 0.0, 0.0, 0.0]);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        out[0] = norm(sub(self.panda.finger_position(rows), rows.position(self.target)));
        out[1] = self.panda.finger_twist(rows);
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let target = rows.position(self.target);
        let finger = self.panda.finger_position(rows);
        out[..3].copy_from_slice(&target);
        out[3..6].copy_from_slice(&finger);
        out[6..].copy_from_slice(&sub(finger, target));
    }

    fn reward(&self, reward: Reward, _rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let d = signals[0];
        let v = signals[1];
        let terms = match reward {
            Reward::Original => {
                [1.0 / (1.0 + d), if d < 0.03 && v < 0.02 { 10.0 } else { 0.0 }, 0.1 / (1.0 + v)]
            }
            Reward::Shaped => [
                0.5 * (1.0 - (4.0 * d).tanh()),
                0.5 * (1.0 - (25.0 * d).tanh()),
                crate::reward::action_penalty(action),
            ],
        };
        out.copy_from_slice(&terms);
    }

    fn is_terminal(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}
