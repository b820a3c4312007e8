//! Cube stacking: stack the held cube on another cube and release it.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, norm_xy, rotate_back, sub};
use mishandle_world::{Equality, Joint, Model, Rows, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Quantity, Reward, Scene, Task, TaskFormulas,
    Variations, scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct CubeStacking;

/// Edge of both cubes, m.
const EDGE: f64 = 0.05;

/// The gripper opens if the distance between the cubes' centers is below `RELEASE_DISTANCE` and the
/// cube is at least `RELEASE_HEIGHT` higher than the target, m.
const RELEASE_DISTANCE: f64 = 0.08;
const RELEASE_HEIGHT: f64 = 0.025;

/// Targets of the fingers while the gripper is open and while it holds the cube, m: beyond the
/// stroke, and 2 cm inside the cube's faces.
const OPEN: f64 = 0.08;
const CLOSED: f64 = 0.005;

const DEFINITION: Definition = Definition {
    name: "cube-stacking",
    summary: "Stack the held cube on another cube and release it.",
    variant_of: None,
    scene_description: "Two cubes (edges 5 cm, 20 g each): one is in the hand at (0.34, 0, 0.91) m, the target cube is on the ground.",
    object: Some("cube"),
    held: Some(HeldObject {
        name: "cube",
        attachment: Attachment::Weld,
        mjcf: include_str!("cube.xml"),
        position: [0.34, 0.0, 0.91],
        quaternion: [1.0, 0.0, 0.0, 0.0],
    }),
    start: [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.025, 0.025],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Scene(
        "no effect: the fingers press on the cube until, before a control step, the cubes' centres are less than 8 cm \
         apart and the held one is at least 2.5 cm higher; then they open, and the cube is let go for good",
    ),
    n_substeps: 8,
    velocity_scale: 0.1,
    signals: &[
        scalar("cube_target_horizontal_distance", "m", "horizontal distance between the cubes' centers"),
        scalar(
            "cube_height_above_target",
            "m",
            "height of the cube's center above the target cube's center, signed",
        ),
        scalar("cube_speed", "m/s", "speed of the cube"),
        scalar(
            "finger_cube_distance",
            "m",
            "distance between the fingers' grasp point, midway between their pads, and the cube's center",
        ),
        scalar("cube_tilt", "rad", "angle between the vertical and the closest axis of the cube"),
        scalar("cube_held", "", "1 while the hand holds the cube, 0 after its release"),
    ],
    observation: &[
        vector3("cube", "m", "center of the cube"),
        Quantity {
            name: "cube_quaternion",
            unit: "",
            size: 4,
            meaning: "orientation of the cube (w, x, y, z)",
        },
        vector3("cube_from_target", "m", "center of the cube minus center of the target cube"),
    ],
    original_reward: &[
        scalar(
            "near",
            "",
            "2 / (1 + d), d the distance of the cube from the point 2 cm above the target's centre",
        ),
        scalar(
            "complete",
            "",
            "10 where d < 0.05, the cube is 0.02 m or more above the target and slower than 0.05 m/s, and the midpoint \
             of the finger frames is farther than 0.05 m from it, else 0",
        ),
        scalar("fallen", "", "-0.5 where the cube is lower than 0.05 m, else 0"),
        scalar("over", "", "2 / (1 + d_xy²) where d < 0.2, d_xy the horizontal part of d, else 0"),
    ],
    shaped_reward: &[
        scalar(
            "near",
            "",
            "0.2 (1 - tanh(3 d)), d the distance of the cube from its place on top of the target",
        ),
        scalar("over", "", "0.1 (1 - tanh(15 r)), r the horizontal part of d"),
        scalar("down", "", "0.05 (1 + c), c the cosine between the fingers' direction and straight down"),
        scalar("on", "", "0.2 where r <= 0.024 and the cube is 0.05 ± 0.005 m above the target, else 0"),
        scalar(
            "away",
            "",
            "0.1 min(f / 0.05 m, 1) where it is on, f the distance of the grasp point from the cube",
        ),
        scalar("stacked", "", "0.3 where it is on and away, and slower than 0.05 m/s, else 0"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "target_x",
            unit: "m",
            paper: [0.4, 0.8],
            code: [0.4, 0.8],
            meaning: "x position of the target cube",
        },
        BoxAxis {
            name: "target_y",
            unit: "m",
            paper: [-0.1, 0.3],
            code: [-0.3, 0.1],
            meaning: "y position of the target cube",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["cube", "target"],
        push: Some(("target", 0.5)),
        jump: None,
        sizes: &["cube", "target"],
        thrown: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the cubes are farther than 0.8 m from each other horizontally",
    differences: "In the original, friction alone holds the cube. Here the fingers press on it in the same way, and a weld \
                  to the hand keeps it in place until the gripper first opens, because dropping the cube on the way is not the \
                  failure under study. A released cube is as free as in the original. Its torsional friction comes from \
                  its contact points alone, without the patch friction of PhysX.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cube_target_horizontal_distance <= 0.024 and cube_height_above_target > 0)",
    strict: "eventually[0:270](always[0:30](cube_target_horizontal_distance <= 0.024 and cube_height_above_target >= 0.045 \
             and cube_height_above_target <= 0.055 and cube_speed <= 0.05 and finger_cube_distance >= 0.05))",
    careful: Some(&["always[0:299](cube_held > 0.5 and next(cube_held <= 0.5) implies cube_speed <= 0.1)"]),
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

    fn notes(&self) -> &'static str {
        include_str!("page.md")
    }

    fn cameras(&self) -> [CameraPlace; 2] {
        [CameraPlace::over([1.5, -0.8, 1.15], [0.42, 0.03, 0.45], 1.12), CameraPlace::WRIST]
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene {
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

struct BoundScene {
    panda: Panda,
    cube: Joint,
    target: Joint,
    weld: Equality,
}

impl BoundScene {
    /// Returns the center of the cube minus the center of the target cube, m.
    fn cube_from_target(&self, rows: &Rows<'_>) -> [f64; 3] {
        sub(rows.free_position(self.cube), rows.free_position(self.target))
    }

    fn original(&self, rows: &Rows<'_>, signals: &[f64], out: &mut [f64]) {
        let [x, y, z] = self.cube_from_target(rows);
        let cube = rows.free_position(self.cube);
        let d = norm([x, y, z - 0.02]);
        let r = signals[0];
        let away = norm(sub(self.panda.finger_position(rows), cube)) > 0.05;
        out[0] = 2.0 / (1.0 + d);
        out[1] = if d < 0.05 && z >= 0.02 && signals[2] < 0.05 && away { 10.0 } else { 0.0 };
        out[2] = if cube[2] < 0.05 { -0.5 } else { 0.0 };
        out[3] = if d < 0.2 { 2.0 / (1.0 + r * r) } else { 0.0 };
    }

    fn shaped(&self, rows: &Rows<'_>, signals: &[f64], out: &mut [f64]) {
        let r = signals[0];
        let height = signals[1];
        let speed = signals[2];
        let hand = signals[3];
        let on = r <= 0.024 && (height - EDGE).abs() <= 0.005;
        // The last column of the hand's rotation matrix is the direction of the fingers.
        let down = -rows.site_rotation(self.panda.grasp)[8];
        out[0] = 0.2 * (1.0 - (3.0 * r.hypot(height - EDGE)).tanh());
        out[1] = 0.1 * (1.0 - (15.0 * r).tanh());
        out[2] = 0.05 * (1.0 + down);
        out[3] = if on { 0.2 } else { 0.0 };
        out[4] = if on { 0.1 * (hand / 0.05).min(1.0) } else { 0.0 };
        out[5] = if on && hand >= 0.05 && speed <= 0.05 { 0.3 } else { 0.0 };
    }
}

impl Scene for BoundScene {
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
        let cube = rows.free_position(self.cube);
        let from_target = self.cube_from_target(rows);
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
                out[6] = crate::reward::action_penalty(action);
            }
        }
    }

    fn is_terminal(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[0] > 0.8
    }
}

fn quaternion(rows: &Rows<'_>, joint: Joint) -> [f64; 4] {
    [3, 4, 5, 6].map(|i| rows.qpos[joint.qpos + i])
}

/// Returns the angle between the vertical and the closest axis of a cube, rad.
fn tilt(quaternion: [f64; 4]) -> f64 {
    let vertical = rotate_back(quaternion, [0.0, 0.0, 1.0]);
    // Rounding makes the cosine slightly larger than 1 for a level cube.
    vertical.iter().fold(0.0, |most: f64, c| most.max(c.abs())).min(1.0).acos()
}
