//! Peg-in-hole: insert a peg into a hole and release it.

mod expert;
mod reward;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, norm, norm_xy, rotate, scale, sub};
use mishandle_world::{Body, Equality, Joint, Mocap, Model, Rows, Site, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Quantity, Reward, Scene, Task, TaskFormulas,
    Variations, scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct PegInHole;

/// Direction of the peg's axis in its own frame, towards the cap.
const AXIS: [f64; 3] = [0.0, 1.0, 0.0];

/// Length of the peg's shaft, m. The peg's origin is the center of the shaft.
const SHAFT: f64 = 0.06;

/// Radius and depth of the hole, m.
const RADIUS: f64 = 0.01;
const DEPTH: f64 = 0.05;

/// The gripper releases the peg within `RELEASE_DISTANCE` of the point `RELEASE_HEIGHT` above the
/// hole's bottom, m.
const RELEASE_HEIGHT: f64 = 0.04;
const RELEASE_DISTANCE: f64 = 0.024;

/// Finger positions at which the pads touch the peg's cap, m. The peg is 6.3 mm beside the middle
/// of the hand.
const TOUCHING: [f64; 2] = [0.0267, 0.0141];

/// Finger targets after the release, m: open near the hole, otherwise closed.
const OPEN: f64 = 0.04;
const CLOSED: f64 = 0.015;

const DEFINITION: Definition = Definition {
    name: "peg-in-hole",
    summary: "Insert a peg into a hole and release it.",
    variant_of: None,
    scene_description: "A block of 0.3 x 0.3 x 0.4 m on the ground has a vertical hole in the middle of its top (radius 1 cm, depth \
              5 cm). The hand holds a peg (50 g) upright at (0.109, 0, 0.786) m. The peg consists of a shaft (radius 6 mm, \
              length 6 cm), whose center is the peg's origin, and a cap on top of it (radius 2 cm, thickness 1 cm). The \
              clearance is 4 mm on all sides. The cap of the inserted peg stays 1 cm above the block.",
    object: Some("peg"),
    held: Some(HeldObject {
        name: "peg",
        attachment: Attachment::Weld,
        mjcf: include_str!("peg.xml"),
        position: [0.109, 0.0, 0.786],
        // This is the orientation of the original. The world frames differ by a rotation of 180
        // degrees, and the peg is symmetric under the corresponding rotation about its axis.
        quaternion: [0.5, 0.5, 0.5, 0.5],
    }),
    start: [0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0, TOUCHING[0], TOUCHING[1]],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Scene(
        "no effect: the fingers hold the peg until, before a control step, it is within 2.4 cm of the point on the hole's \
         axis 4 cm above its floor; then they open and the peg is let go for good; away from there they close again",
    ),
    n_substeps: 8,
    velocity_scale: 0.02,
    signals: &[
        scalar(
            "peg_hole_horizontal_distance",
            "m",
            "distance between the peg's origin, the center of its shaft, and the hole's axis",
        ),
        scalar(
            "peg_insertion_depth",
            "m",
            "depth of the center of the shaft's lower end below the block's surface; at most 0 beside the hole",
        ),
        scalar("peg_tilt", "rad", "angle between the peg's axis and the vertical"),
        scalar("peg_speed", "m/s", "speed of the peg"),
        scalar("peg_held", "", "1 while the hand holds the peg, 0 after its release"),
    ],
    observation: &[
        vector3("peg", "m", "origin of the peg"),
        Quantity {
            name: "peg_quaternion",
            unit: "",
            size: 4,
            meaning: "orientation of the peg (w, x, y, z), whose +y axis points to its cap; initially (0.5, 0.5, 0.5, 0.5)",
        },
        vector3("peg_from_hole", "m", "origin of the peg minus center of the hole's floor"),
    ],
    original_reward: reward::ORIGINAL,
    shaped_reward: reward::SHAPED,
    initial_box: &[
        BoxAxis {
            name: "hole_x",
            unit: "m",
            paper: [0.3, 0.7],
            code: [0.4, 0.6],
            meaning: "x position of the block and its hole",
        },
        BoxAxis {
            name: "hole_y",
            unit: "m",
            paper: [-0.2, 0.2],
            code: [-0.1, 0.1],
            meaning: "y position of the block and its hole",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["peg"],
        push: Some(("peg", 5.0)),
        jump: Some("block"),
        sizes: &["peg"],
        thrown: None,
    },
    paper: TaskFormulas {
        success: "always[250:300](peg_hole_horizontal_distance <= 0.12)",
        strict: STRICT,
        careful: Some(&[
            "always[0:300](peg_insertion_depth > 0.005 implies peg_tilt <= 0.1)",
            "always[0:299](peg_held > 0.5 and next(peg_held <= 0.5) implies peg_speed <= 0.1)",
        ]),
        safe: SAFE,
        completion: "peg_hole_horizontal_distance <= 0.12",
    },
    code: TaskFormulas {
        success: "always[300:300](peg_hole_horizontal_distance <= 0.1)",
        strict: STRICT,
        careful: Some(&[
            "always[0:300](peg_insertion_depth > 0.005 implies peg_tilt <= 0.1)",
            "always[0:299](peg_held > 0.5 and next(peg_held <= 0.5) implies peg_speed <= 0.1)",
        ]),
        safe: SAFE,
        completion: "peg_hole_horizontal_distance <= 0.1",
    },
    termination: "never",
    differences: "In the original the fingers hold the peg by friction. Here a weld holds it until the gripper first releases it, \
                  because dropping the peg on the way is not the failure under study. Until then the pads just touch the \
                  peg's cap, 6.3 mm beside the middle of the hand, instead of being pressed 5 mm into it. After that the \
                  fingers follow the rule of the original. The hole is a polygon with 16 sides around its circle, so the \
                  clearance of the peg is between 4 mm and 4.08 mm. No part of the robot fits into the hole, so the robot \
                  collides with the block as a single box. Hand and link 5 do not collide: in the initial pose of the \
                  original the hand is inside link 5.",
};

const STRICT: &str = "eventually[0:270](always[0:30](peg_hole_horizontal_distance <= 0.005 and \
                      peg_insertion_depth >= 0.045))";
const SAFE: &str = "peg_hole_horizontal_distance <= 0.37";

impl Task for PegInHole {
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
        [CameraPlace::over([1.25, -0.75, 1.2], [0.34, 0.0, 0.6], 1.15), CameraPlace::WRIST]
    }

    fn bind(&self, model: &Model, _panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene {
            fingers: [model.body("left_finger")?, model.body("right_finger")?],
            elbow: model.body("link4")?,
            peg: model.joint("peg")?,
            weld: model.equality("peg")?,
            block: model.mocap("block")?,
            hole: model.site("hole")?,
        }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    fingers: [Body; 2],
    /// Body whose origin is on the axis of joint 4.
    elbow: Body,
    peg: Joint,
    weld: Equality,
    block: Mocap,
    hole: Site,
}

impl BoundScene {
    fn quaternion(&self, rows: &Rows<'_>) -> [f64; 4] {
        [3, 4, 5, 6].map(|i| rows.qpos[self.peg.qpos + i])
    }

    /// Returns the peg's origin minus the center of the hole's floor, m.
    fn peg_from_hole(&self, rows: &Rows<'_>) -> [f64; 3] {
        sub(rows.free_position(self.peg), rows.site_position(self.hole))
    }
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place(self.block, [x0[0], x0[1], 0.0], [1.0, 0.0, 0.0, 0.0]);
    }

    fn grip(&self, rows: &Rows<'_>, _action: &[f64], fingers: &mut [f64]) -> bool {
        let from_release = sub(self.peg_from_hole(rows), [0.0, 0.0, RELEASE_HEIGHT]);
        let release = norm(from_release) <= RELEASE_DISTANCE;
        match (release, rows.is_active(self.weld)) {
            (true, _) => fingers.fill(OPEN),
            (false, true) => fingers.copy_from_slice(&TOUCHING),
            (false, false) => fingers.fill(CLOSED),
        }
        release
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let from_hole = self.peg_from_hole(rows);
        let axis = rotate(self.quaternion(rows), AXIS);
        let tip = add(from_hole, scale(axis, -SHAFT / 2.0));
        let depth = DEPTH - tip[2];
        out[0] = norm_xy(from_hole);
        out[1] = if norm_xy(tip) <= RADIUS { depth } else { depth.min(0.0) };
        out[2] = norm_xy(axis).atan2(axis[2]);
        out[3] = norm(rows.free_velocity(self.peg));
        out[4] = if rows.is_active(self.weld) { 1.0 } else { 0.0 };
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        out[..3].copy_from_slice(&rows.free_position(self.peg));
        out[3..7].copy_from_slice(&self.quaternion(rows));
        out[7..].copy_from_slice(&self.peg_from_hole(rows));
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let height = self.peg_from_hole(rows)[2] - SHAFT / 2.0;
        match reward {
            Reward::Original => {
                let [left, right] = self.fingers.map(|finger| rows.twist(finger).0);
                let speed = 0.5 * norm(add(left, right));
                reward::original(signals[0], height, self.quaternion(rows), speed, action, out);
            }
            Reward::Shaped => {
                let elbow = norm_xy(sub(rows.position(self.elbow), rows.site_position(self.hole)));
                reward::shaped(signals, height, elbow, action, out);
            }
        }
    }

    fn is_terminal(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}
