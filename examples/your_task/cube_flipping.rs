//! Cube flipping: tip a cube onto another face.

use std::{borrow::Cow, sync::Arc};

use mishandle::rollout::Controller;
use mishandle::tasks::kinematic::{ResolvedRate, rotation_between};
use mishandle::tasks::{BoxAxis, Definition, Expert, ExpertInput, ExpertPolicy, Grip, Panda, Quantity};
use mishandle::tasks::{Reward, Scene, Task, TaskFormulas, Variations, effort, limited, one, three};
use mishandle::world::frame::{add, cross, norm, rotate, scale, sub};
use mishandle::world::{Body, Joint, Model, Rows, World, WorldError};

/// The task.
pub struct CubeFlipping;

/// Half an edge of the cube, and the height of the table, m.
const HALF: f64 = 0.05;
const TABLE: f64 = 0.2;

const DEFINITION: Definition = Definition {
    name: "cube-flipping",
    summary: "Tip a cube onto another face.",
    variant_of: None,
    setting: "A cube with edges of 10 cm and 200 g on a table 0.2 m high.",
    held: None,
    start: [0.0, -0.2, 0.0, -2.3, 0.0, 2.1, 0.785, 0.0, 0.0],
    start_noise: 0.0,
    grip: Grip::Fixed(0.0),
    n_substeps: 4,
    velocity_scale: 0.1,
    signals: &[
        one("cube_tilt", "rad", "angle of the face that was on top, from the vertical"),
        one("cube_height", "m", "height of the cube's centre above the table"),
        one("cube_speed", "m/s", "speed of the cube"),
        one("finger_cube_distance", "m", "distance of the finger tips from the cube's centre"),
    ],
    observation: &[
        three("cube", "m", "centre of the cube"),
        three("forward", "", "the cube's own axis that points away from the robot at the start"),
        three("up", "", "the cube's own axis that points up at the start"),
        three("cube_velocity", "m/s", "velocity of the cube"),
        three("cube_from_finger", "m", "cube minus finger tips"),
    ],
    original_reward: REWARD,
    shaped_reward: REWARD,
    initial_box: &[
        axis("cube_x", "m", [0.48, 0.6], "cube's x"),
        axis("cube_y", "m", [-0.15, 0.15], "cube's y"),
        axis("cube_yaw", "rad", [-0.3, 0.3], "turn of the cube about the vertical"),
    ],
    variations: Variations { friction: true, masses: &["cube"], push: Some(("cube", 1.0)), jump: None },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the cube has fallen off the table",
    differences: "There is no original: this task is an example.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cube_tilt >= 1.5)",
    strict: "eventually[0:270](always[0:30](cube_tilt >= 1.5 and cube_tilt <= 1.65 and cube_speed <= 0.02 and \
             finger_cube_distance >= 0.1))",
    safe: "cube_height >= 0.04",
    completion: "cube_tilt >= 1.5",
};

const REWARD: &[Quantity] = &[
    one("near", "", "0.2 (1 - tanh(5 d)), d the distance of the finger tips from the cube"),
    one("tilt", "", "0.5 times the tilt over a right angle, at most 0.5"),
    one("flipped", "", "0.3 where the tilt is at least 1.5 rad, else 0"),
    one("calm", "", "-0.01 times the mean of the arm's squared actions"),
];

const fn axis(name: &'static str, unit: &'static str, bounds: [f64; 2], sets: &'static str) -> BoxAxis {
    BoxAxis { name, unit, paper: bounds, code: bounds, sets }
}

impl Task for CubeFlipping {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(Bound { panda: *panda, cube: model.joint("cube")?, body: model.body("cube")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        Expert::controller(Flip, const { &DEFINITION })
    }
}

/// What the scene reads in the compiled model.
struct Bound {
    panda: Panda,
    cube: Joint,
    body: Body,
}

impl Scene for Bound {
    fn place(&self, x0: &[f64], world: &mut World) {
        let (sin, cos) = (0.5 * x0[2]).sin_cos();
        world.place_free(self.cube, [x0[0], x0[1], TABLE + HALF], [cos, 0.0, 0.0, sin]);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let cube = rows.free_position(self.cube);
        out[0] = rotate(rows.quaternion(self.body), [0.0, 0.0, 1.0])[2].clamp(-1.0, 1.0).acos();
        out[1] = cube[2] - TABLE;
        out[2] = norm(rows.free_velocity(self.cube));
        out[3] = norm(sub(cube, rows.site_position(self.panda.grasp)));
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let (cube, turn) = (rows.free_position(self.cube), rows.quaternion(self.body));
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
        out[3] = effort(action);
    }

    fn lost(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[1] < 0.0
    }
}

/// Goes behind the cube, and turns with it about its far lower edge until it falls by itself.
struct Flip;

/// What it does next; the value in its memory.
const TRAVEL: f64 = 0.0;
const DESCEND: f64 = 1.0;
const TIP: f64 = 2.0;
const RETREAT: f64 = 3.0;

impl ExpertPolicy for Flip {
    const MEMORY: usize = 1;
    const SITE: &'static str = "grasp";
    const REST: [f64; 7] = [0.0, 0.0, 0.0, -2.3, 0.0, 2.3, 0.785];

    fn velocity(&self, seen: &ExpertInput<'_>, arm: &mut ResolvedRate, memory: &mut [f64]) -> [f64; 7] {
        let (cube, forward, up) = (seen.point(0), seen.point(3), seen.point(6));
        // Tipping turns the cube about an axis that stays where it is: the one across, through the far lower edge.
        let (tips, across) = (arm.position(), cross(up, forward));
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
            TRAVEL => limited(scale(sub(above, tips), 5.0), 0.6),
            DESCEND => limited(scale(sub(behind, tips), 5.0), 0.3),
            TIP => add(scale(cross(across, sub(tips, edge)), 0.8), scale(forward, 0.06)),
            _ => limited(scale(sub([0.35, 0.0, 0.5], tips), 3.0), 0.3),
        };
        // The fingers point down, side by side along the edge.
        let x = cross(across, [0.0, 0.0, -1.0]);
        let down = [x[0], across[0], 0.0, x[1], across[1], 0.0, 0.0, 0.0, -1.0];
        let angular = limited(scale(rotation_between(&arm.rotation(), &down), 4.0), 2.0);
        arm.twist(&seen.q, linear, angular)
    }
}
