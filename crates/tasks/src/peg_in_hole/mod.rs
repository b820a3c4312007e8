//! Peg-in-hole: put a peg into a hole and let go of it.

mod expert;
mod reward;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, norm, norm_xy, rotate, scale, sub};
use mishandle_world::{Body, Equality, Joint, Mocap, Model, Rows, Site, World, WorldError};

use crate::definition::{
    BoxAxis, Definition, Grip, Held, Hold, Quantity, Reward, Scene, Task, TaskFormulas, Variations, one,
    three,
};
use crate::robot::Panda;

/// The task.
pub struct PegInHole;

/// The peg's axis in its own frame, towards the cap.
const AXIS: [f64; 3] = [0.0, 1.0, 0.0];

/// Length of the peg's shaft, whose centre is the peg's origin, m.
const SHAFT: f64 = 0.06;

/// Radius and depth of the hole, m.
const RADIUS: f64 = 0.01;
const DEPTH: f64 = 0.05;

/// Height of the point above the hole's bottom around which the gripper lets go of the peg, and how far around it, m.
const RELEASE_HEIGHT: f64 = 0.04;
const RELEASE_DISTANCE: f64 = 0.024;

/// Where the fingers' pads touch the peg's cap, m: it is held 6.3 mm beside the middle.
const TOUCHING: [f64; 2] = [0.0267, 0.0141];

/// Finger targets after the release, m: open near the hole, else closed on nothing.
const OPEN: f64 = 0.04;
const CLOSED: f64 = 0.015;

const DEFINITION: Definition = Definition {
    name: "peg-in-hole",
    summary: "Put a peg into a hole and let go of it.",
    variant_of: None,
    setting: "A block of 0.3 x 0.3 x 0.4 m on the ground has an upright hole in the middle of its top: 1 cm in radius, 5 cm \
              deep. The hand holds a peg of 50 g upright at (0.109, 0, 0.786) m: a shaft 6 mm in radius and 6 cm long, whose \
              middle is the peg's point, and on it a cap 2 cm in radius and 1 cm thick. So there is a play of 4 mm all \
              around; the inserted peg's cap stays 1 cm above the block.",
    held: Some(Held {
        name: "peg",
        hold: Hold::Weld,
        mjcf: include_str!("peg.xml"),
        position: [0.109, 0.0, 0.786],
        // The original's: a symmetric peg's own axes may be turned half about its axis, which takes out the half turn
        // between its world's axes and ours.
        quaternion: [0.5, 0.5, 0.5, 0.5],
    }),
    start: [0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0, TOUCHING[0], TOUCHING[1]],
    start_noise: 0.0,
    grip: Grip::Scene(
        "no effect: the fingers hold the peg until, before a control step, it is within 2.4 cm of the point on the hole's \
         axis 4 cm above its floor; then they open and the peg is let go for good; away from there they close again",
    ),
    n_substeps: 4,
    velocity_scale: 0.02,
    signals: &[
        one(
            "peg_hole_horizontal_distance",
            "m",
            "distance of the peg's origin, the centre of its shaft, from the hole's axis",
        ),
        one(
            "peg_insertion_depth",
            "m",
            "how far the centre of the shaft's lower end is below the block's surface; beside the hole at most 0",
        ),
        one("peg_tilt", "rad", "angle of the peg's axis from upright"),
        one("peg_speed", "m/s", "speed of the peg"),
        one("peg_held", "", "1 while the hand holds the peg, 0 after it let go"),
    ],
    observation: &[
        three("peg", "m", "the peg's origin"),
        Quantity {
            name: "peg_quaternion",
            unit: "",
            size: 4,
            meaning: "orientation of the peg (w, x, y, z), whose own +y points to its cap; (0.5, 0.5, 0.5, 0.5) at the start",
        },
        three("peg_from_hole", "m", "peg minus centre of the hole's floor"),
    ],
    original_reward: reward::ORIGINAL,
    shaped_reward: reward::SHAPED,
    initial_box: &[
        BoxAxis {
            name: "hole_x",
            unit: "m",
            paper: [0.3, 0.7],
            code: [0.4, 0.6],
            sets: "x of the block and its hole",
        },
        BoxAxis {
            name: "hole_y",
            unit: "m",
            paper: [-0.2, 0.2],
            code: [-0.1, 0.1],
            sets: "y of the block and its hole",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["peg"],
        push: Some(("peg", 5.0)),
        jump: Some("block"),
    },
    paper: TaskFormulas {
        success: "always[250:300](peg_hole_horizontal_distance <= 0.12)",
        strict: STRICT,
        safe: SAFE,
        completion: "peg_hole_horizontal_distance <= 0.12",
    },
    code: TaskFormulas {
        success: "always[300:300](peg_hole_horizontal_distance <= 0.1)",
        strict: STRICT,
        safe: SAFE,
        completion: "peg_hole_horizontal_distance <= 0.1",
    },
    termination: "never",
    differences: "The original's fingers hold the peg by friction; here a weld does until the gripper first lets go, since \
                  dropping the peg on the way is not the failure under study. Until then the fingers stand where their \
                  pads touch the peg's cap, 6.3 mm beside the middle of the hand, instead of being driven 5 mm into \
                  it; after that they obey the original's rule. The hole is a polygon of 16 sides around its circle: \
                  the peg's play is 4 mm, in places 4.08 mm. Nothing of the robot fits into the hole, so that it meets \
                  the block as one box; the base and the first link, which cannot reach the block, are not tested against it.",
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

    fn bind(&self, model: &Model, _panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(Bound {
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

struct Bound {
    fingers: [Body; 2],
    /// Its origin is on the fourth joint's axis.
    elbow: Body,
    peg: Joint,
    weld: Equality,
    block: Mocap,
    hole: Site,
}

impl Bound {
    fn quaternion(&self, rows: &Rows<'_>) -> [f64; 4] {
        [3, 4, 5, 6].map(|i| rows.qpos[self.peg.qpos + i])
    }

    /// From the centre of the hole's floor to the peg's origin.
    fn peg_from_hole(&self, rows: &Rows<'_>) -> [f64; 3] {
        sub(rows.free_position(self.peg), rows.site_position(self.hole))
    }
}

impl Scene for Bound {
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
        let (from_hole, axis) = (self.peg_from_hole(rows), rotate(self.quaternion(rows), AXIS));
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

    fn lost(&self, _rows: &Rows<'_>, _signals: &[f64]) -> bool {
        false
    }
}
