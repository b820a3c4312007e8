//! Cube flipping: tip a cube onto another face.

use mishandle::rollout::Controller;
use mishandle::tasks::kinematic::{ResolvedRate, rotation_between};
use mishandle::tasks::{BoxAxis, Definition, GripperMode, LAMP, Quantity, Reward, TaskFormulas, Variations};
use mishandle::tasks::{Expert, ExpertInput, ExpertPolicy, Panda, Scene, Task};
use mishandle::tasks::{action_penalty, clamp_norm, scalar, vector3};
use mishandle::world::frame::{add, cross, norm, rotate, scale, sub};
use mishandle::world::{Body, Joint, Model, Rows, World, WorldError};
use std::{borrow::Cow, sync::Arc};

/// The task.
pub struct CubeFlipping;

/// Half the edge length of the cube, and the height of the table, m.
const HALF: f64 = 0.05;
const TABLE: f64 = 0.2;

const DEFINITION: Definition = Definition {
    name: "cube-flipping",
    summary: "Tip a cube onto another face.",
    variant_of: None,
    scene_description: "A cube (edges 10 cm, 200 g) on a table 0.2 m high.",
    object: Some("cube"),
    held: None,
    start: [0.0, -0.2, 0.0, -2.3, 0.0, 2.1, 0.785, 0.0, 0.0],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Fixed(0.0),
    n_substeps: 8,
    velocity_scale: 0.1,
    signals: &[
        scalar("cube_tilt", "rad", "angle between the initially upward face normal and the vertical"),
        scalar("cube_height", "m", "height of the cube's center above the table"),
        scalar("cube_speed", "m/s", "speed of the cube"),
        scalar("finger_cube_distance", "m", "distance between the fingertips and the cube's center"),
    ],
    observation: &[
        vector3("cube", "m", "center of the cube"),
        vector3("forward", "", "axis of the cube that initially points away from the robot"),
        vector3("up", "", "axis of the cube that initially points up"),
        vector3("cube_velocity", "m/s", "velocity of the cube"),
        vector3("cube_from_finger", "m", "center of the cube minus fingertips"),
    ],
    original_reward: REWARD,
    shaped_reward: REWARD,
    initial_box: &[
        axis("cube_x", "m", [0.48, 0.6], "x position of the cube"),
        axis("cube_y", "m", [-0.15, 0.15], "y position of the cube"),
        axis("cube_yaw", "rad", [-0.3, 0.3], "yaw angle of the cube"),
    ],
    variations: Variations { friction: true, masses: &["cube"], sizes: &["cube"], ..Variations::NONE },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the cube has fallen off the table",
    differences: "This task is an example that is not in the original benchmark.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cube_tilt >= 1.5)",
    strict: "eventually[0:270](always[0:30](cube_tilt >= 1.5 and cube_tilt <= 1.65 and cube_speed <= 0.02 and \
             finger_cube_distance >= 0.1))",
    careful: Some(&[]),
    safe: "cube_height >= 0.04",
    completion: "cube_tilt >= 1.5",
};

const REWARD: &[Quantity] = &[
    scalar("near", "", "0.2 (1 - tanh(5 d)), d the distance between the fingertips and the cube"),
    scalar("tilt", "", "0.5 times the tilt divided by 90 degrees, at most 0.5"),
    scalar("flipped", "", "0.3 if the tilt is at least 1.5 rad, else 0"),
    scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
];

const fn axis(name: &'static str, unit: &'static str, bounds: [f64; 2], meaning: &'static str) -> BoxAxis {
    BoxAxis { name, unit, paper: bounds, code: bounds, meaning }
}

impl Task for CubeFlipping {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene { panda: *panda, cube: model.joint("cube")?, body: model.body("cube")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        Expert::controller(Flip, const { &DEFINITION })
    }
}

/// The elements of the scene in the compiled model.
struct BoundScene {
    panda: Panda,
    cube: Joint,
    body: Body,
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        let (sin, cos) = (0.5 * x0[2]).sin_cos();
        world.place_free(self.cube, [x0[0], x0[1], TABLE + HALF], [cos, 0.0, 0.0, sin]);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        out[0] = rotate(rows.quaternion(self.body), [0.0, 0.0, 1.0])[2].clamp(-1.0, 1.0).acos();
        out[1] = rows.free_position(self.cube)[2] - TABLE;
        out[2] = norm(rows.free_velocity(self.cube));
        out[3] = norm(sub(rows.free_position(self.cube), rows.site_position(self.panda.grasp)));
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let cube = rows.free_position(self.cube);
        let turn = rows.quaternion(self.body);
        out[..3].copy_from_slice(&cube);
        out[3..6].copy_from_slice(&rotate(turn, [1.0, 0.0, 0.0]));
        out[6..9].copy_from_slice(&rotate(turn, [0.0, 0.0, 1.0]));
        out[9..12].copy_from_slice(&rows.free_velocity(self.cube));
        out[12..].copy_from_slice(&sub(cube, rows.site_position(self.panda.grasp)));
    }

    fn reward(&self, _reward: Reward, _rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        out[0] = 0.2 * (1.0 - (5.0 * signals[3]).tanh());
        out[1] = 0.5 * (signals[0] / std::f64::consts::FRAC_PI_2).min(1.0);
        out[2] = if signals[0] >= 1.5 { 0.3 } else { 0.0 };
        out[3] = action_penalty(action);
    }

    fn is_terminal(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[1] < 0.0
    }
}

/// Moves behind the cube and rotates it about its far lower edge until it falls over.
struct Flip;

/// Phases, stored in the memory.
const TRAVEL: f64 = 0.0;
const DESCEND: f64 = 1.0;
const TIP: f64 = 2.0;
const RETREAT: f64 = 3.0;

impl ExpertPolicy for Flip {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.0, 0.0, -2.3, 0.0, 2.3, 0.785];

    fn velocity(&self, input: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let [cube, forward, up] = [0, 3, 6].map(|first| input.point(first));
        let tips = arm.position();
        let across = cross(up, forward);
        let edge = sub(add(cube, scale(forward, HALF)), scale(up, HALF));
        let behind = add(sub(cube, scale(forward, HALF + 0.035)), scale(up, 0.6 * HALF));
        let above = [behind[0], behind[1], TABLE + 0.15];
        memory[0] = match memory[0] {
            TRAVEL if norm(sub(above, tips)) < 0.02 => DESCEND,
            DESCEND if norm(sub(behind, tips)) < 0.01 => TIP,
            TIP if up[2] < 0.4 => RETREAT,
            phase => phase,
        };
        let linear = match memory[0] {
            TRAVEL => clamp_norm(scale(sub(above, tips), 5.0), 0.6),
            DESCEND => clamp_norm(scale(sub(behind, tips), 5.0), 0.3),
            TIP => add(scale(cross(across, sub(tips, edge)), 0.6), scale(forward, 0.06)),
            _ => clamp_norm(scale(sub([0.35, 0.0, 0.5], tips), 3.0), 0.3),
        };
        // The fingers point down and are parallel to the edge.
        let down = [-across[1], across[0], 0.0, across[0], across[1], 0.0, 0.0, 0.0, -1.0];
        arm.twist(&input.q, linear, clamp_norm(scale(rotation_between(&arm.rotation(), &down), 4.0), 2.0))
    }
}
