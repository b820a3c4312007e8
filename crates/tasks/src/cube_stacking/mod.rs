//! Cube stacking: set the cube in the hand down on another one, and let go of it.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, norm_xy, rotate_back, sub};
use mishandle_world::{Equality, Joint, Model, Rows, World, WorldError};

use crate::definition::{
    BoxAxis, Definition, Grip, Held, Hold, Quantity, Reward, Scene, Task, TaskFormulas, Variations, one,
    three,
};
use crate::robot::Panda;

/// The task.
pub struct CubeStacking;

/// Edge of both cubes, m.
const EDGE: f64 = 0.05;

/// The gripper opens where the cubes' centres are closer than this and the cube is higher than the target, m.
const RELEASE_DISTANCE: f64 = 0.08;
const RELEASE_HEIGHT: f64 = 0.025;

/// Targets of the fingers while the gripper is open and while it holds, m: wider than their stroke, and 2 cm inside
/// the cube's faces.
const OPEN: f64 = 0.08;
const CLOSED: f64 = 0.005;

const DEFINITION: Definition = Definition {
    name: "cube-stacking",
    summary: "Set the cube that the robot holds down on another cube, and let go of it.",
    variant_of: None,
    setting: "Two cubes with edges of 5 cm, 20 g each: one in the hand, at (0.34, 0, 0.91) m, one on the ground.",
    held: Some(Held {
        name: "cube",
        hold: Hold::Weld,
        mjcf: include_str!("cube.xml"),
        position: [0.34, 0.0, 0.91],
        quaternion: [1.0, 0.0, 0.0, 0.0],
    }),
    start: [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.025, 0.025],
    start_noise: 0.0,
    grip: Grip::Scene(
        "no effect: the fingers press on the cube until, before a control step, the cubes' centres are less than 8 cm \
         apart and the held one is at least 2.5 cm higher; then they open, and the cube is let go for good",
    ),
    n_substeps: 4,
    velocity_scale: 0.1,
    signals: &[
        one("cube_target_horizontal_distance", "m", "horizontal distance of the cubes' centres"),
        one("cube_height_above_target", "m", "height of the cube's centre above the target cube's, signed"),
        one("cube_speed", "m/s", "speed of the cube"),
        one(
            "finger_cube_distance",
            "m",
            "distance of the fingers' grasp point, midway between their pads, from the cube's centre",
        ),
        one("cube_tilt", "rad", "angle between the vertical and the cube's axis that is closest to it"),
        one("cube_held", "", "1 while the hand holds the cube, 0 after it let go"),
    ],
    observation: &[
        three("cube", "m", "centre of the cube"),
        Quantity { name: "cube_quaternion", unit: "", size: 4, meaning: "orientation of the cube, w x y z" },
        three("cube_from_target", "m", "cube minus target cube"),
    ],
    original_reward: &[
        one(
            "near",
            "",
            "2 / (1 + d), d the distance of the cube from the point 2 cm above the target's centre",
        ),
        one(
            "complete",
            "",
            "10 where d < 0.05, the cube is 0.02 m or more above the target and slower than 0.05 m/s, and the midpoint \
             of the finger frames is farther than 0.05 m from it, else 0",
        ),
        one("fallen", "", "-0.5 where the cube is lower than 0.05 m, else 0"),
        one("over", "", "2 / (1 + d_xy²) where d < 0.2, d_xy the horizontal part of d, else 0"),
    ],
    shaped_reward: &[
        one(
            "near",
            "",
            "0.2 (1 - tanh(3 d)), d the distance of the cube from its place on top of the target",
        ),
        one("over", "", "0.1 (1 - tanh(15 r)), r the horizontal part of d"),
        one("down", "", "0.05 (1 + c), c the cosine between the fingers' direction and straight down"),
        one("on", "", "0.2 where r <= 0.024 and the cube is 0.05 ± 0.005 m above the target, else 0"),
        one(
            "away",
            "",
            "0.1 min(f / 0.05 m, 1) where it is on, f the distance of the grasp point from the cube",
        ),
        one("stacked", "", "0.3 where it is on and away, and slower than 0.05 m/s, else 0"),
        one("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis { name: "target_x", unit: "m", paper: [0.4, 0.8], code: [0.4, 0.8], sets: "target cube's x" },
        BoxAxis {
            name: "target_y",
            unit: "m",
            paper: [-0.1, 0.3],
            code: [-0.3, 0.1],
            sets: "target cube's y",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["cube", "target"],
        push: Some(("target", 0.5)),
        jump: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the cubes are farther than 0.8 m from each other horizontally",
    differences: "In the original friction alone holds the cube. Here the fingers press on it in the same way, and a \
                  weld to the hand keeps it in place until the gripper opens for the first time: dropping the cube on \
                  the way is not the failure under study. A cube that was let go is as free as in the original. It twists \
                  on what it lies on by the friction of its contact points alone, without PhysX's patch. \
                  The ground stops hand and arm.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cube_target_horizontal_distance <= 0.024 and cube_height_above_target > 0)",
    strict: "eventually[0:270](always[0:30](cube_target_horizontal_distance <= 0.024 and cube_height_above_target >= 0.045 \
             and cube_height_above_target <= 0.055 and cube_speed <= 0.05 and finger_cube_distance >= 0.05))",
    safe: "cube_target_horizontal_distance <= 0.35 and cube_height_above_target >= 0.02",
    completion: "cube_target_horizontal_distance <= 0.024 and cube_height_above_target > 0",
};

impl Task for CubeStacking {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(Bound {
            panda: *panda,
            cube: model.joint("cube")?,
            target: model.joint("target")?,
            weld: model.equality("cube")?,
        }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct Bound {
    panda: Panda,
    cube: Joint,
    target: Joint,
    weld: Equality,
}

impl Bound {
    /// The cube's centre, seen from the target's.
    fn cube_from_target(&self, rows: &Rows<'_>) -> [f64; 3] {
        sub(rows.free_position(self.cube), rows.free_position(self.target))
    }

    fn original(&self, rows: &Rows<'_>, signals: &[f64], out: &mut [f64]) {
        let [x, y, z] = self.cube_from_target(rows);
        let (cube, d, r) = (rows.free_position(self.cube), norm([x, y, z - 0.02]), signals[0]);
        let away = norm(sub(self.panda.finger_position(rows), cube)) > 0.05;
        out[0] = 2.0 / (1.0 + d);
        out[1] = if d < 0.05 && z >= 0.02 && signals[2] < 0.05 && away { 10.0 } else { 0.0 };
        out[2] = if cube[2] < 0.05 { -0.5 } else { 0.0 };
        out[3] = if d < 0.2 { 2.0 / (1.0 + r * r) } else { 0.0 };
    }

    fn shaped(&self, rows: &Rows<'_>, signals: &[f64], out: &mut [f64]) {
        let (r, height, speed, hand) = (signals[0], signals[1], signals[2], signals[3]);
        let on = r <= 0.024 && (height - EDGE).abs() <= 0.005;
        // The last column of the hand's rotation is where the fingers point.
        let down = -rows.site_rotation(self.panda.grasp)[8];
        out[0] = 0.2 * (1.0 - (3.0 * r.hypot(height - EDGE)).tanh());
        out[1] = 0.1 * (1.0 - (15.0 * r).tanh());
        out[2] = 0.05 * (1.0 + down);
        out[3] = if on { 0.2 } else { 0.0 };
        out[4] = if on { 0.1 * (hand / 0.05).min(1.0) } else { 0.0 };
        out[5] = if on && hand >= 0.05 && speed <= 0.05 { 0.3 } else { 0.0 };
    }
}

impl Scene for Bound {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place_free(self.target, [x0[0], x0[1], 0.5 * EDGE], [1.0, 0.0, 0.0, 0.0]);
    }

    fn grip(&self, rows: &Rows<'_>, _action: &[f64], fingers: &mut [f64]) -> bool {
        let from_target = self.cube_from_target(rows);
        let open = norm(from_target) < RELEASE_DISTANCE && from_target[2] >= RELEASE_HEIGHT;
        fingers.fill(if open { OPEN } else { CLOSED });
        open
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let (cube, from_target) = (rows.free_position(self.cube), self.cube_from_target(rows));
        out[0] = norm_xy(from_target);
        out[1] = from_target[2];
        out[2] = norm(rows.free_velocity(self.cube));
        out[3] = norm(sub(rows.site_position(self.panda.grasp), cube));
        out[4] = tilt(quaternion(rows, self.cube));
        out[5] = if rows.is_active(self.weld) { 1.0 } else { 0.0 };
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        out[..3].copy_from_slice(&rows.free_position(self.cube));
        out[3..7].copy_from_slice(&quaternion(rows, self.cube));
        out[7..].copy_from_slice(&self.cube_from_target(rows));
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        match reward {
            Reward::Original => self.original(rows, signals, out),
            Reward::Shaped => {
                self.shaped(rows, signals, out);
                out[6] = crate::reward::effort(action);
            }
        }
    }

    fn lost(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[0] > 0.8
    }
}

fn quaternion(rows: &Rows<'_>, joint: Joint) -> [f64; 4] {
    [3, 4, 5, 6].map(|i| rows.qpos[joint.qpos + i])
}

/// Angle between the vertical and the closest of a cube's axes, rad.
fn tilt(quaternion: [f64; 4]) -> f64 {
    let vertical = rotate_back(quaternion, [0.0, 0.0, 1.0]);
    // The cosine is a hair above 1 for a level cube.
    vertical.iter().fold(0.0, |most: f64, c| most.max(c.abs())).min(1.0).acos()
}
