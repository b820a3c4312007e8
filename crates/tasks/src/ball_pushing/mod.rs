//! Ball pushing: push a ball across a table into a pit.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, norm_xy, sub};
use mishandle_world::{Joint, Model, Rows, Site, World, WorldError};

use crate::definition::{
    BoxAxis, Definition, Grip, Reward, Scene, Task, TaskFormulas, Variations, one, three,
};
use crate::robot::Panda;

/// The task.
pub struct BallPushing;

/// Height at which the ball starts, m: 1 cm above its place on the table.
const START_HEIGHT: f64 = 0.45;

/// Point behind the ball from which it can be pushed, m from its centre: its radius and the depth of a finger.
const BEHIND: f64 = 0.055;

const DEFINITION: Definition = Definition {
    name: "ball-pushing",
    summary: "Push a ball across a table into a pit.",
    variant_of: None,
    setting: "A table 0.4 m high from x = 0.3 to 1.3 m and y = -0.4 to 0.4 m has a pit, x 0.9 to 1.15 m, y -0.15 to 0.15 m, \
              0.1 m deep. A ball of radius 4 cm and 20 g drops onto it from 1 cm.",
    held: None,
    start: [1.157, -1.066, -0.155, -2.239, -1.841, 1.003, 0.469, 0.035, 0.035],
    start_noise: 0.125,
    grip: Grip::Fixed(0.015),
    n_substeps: 4,
    velocity_scale: 0.01,
    signals: &[
        one(
            "ball_hole_distance",
            "m",
            "distance of the ball from a point 5 mm below the pit's floor, at its centre",
        ),
        one("ball_hole_horizontal_distance", "m", "the horizontal part of it"),
        one("ball_height", "m", "height of the ball's centre above the ground"),
        one("ball_speed", "m/s", "speed of the ball"),
        one("finger_ball_distance", "m", "distance of the fingers' grasp point from the ball"),
    ],
    observation: &[
        three("ball_velocity", "m/s", "velocity of the ball"),
        three("ball_angular_velocity", "rad/s", "angular velocity of the ball"),
        three("hole_from_ball", "m", "hole minus ball"),
        three("ball", "m", "centre of the ball"),
    ],
    original_reward: &[
        one(
            "near",
            "",
            "10 (1 - tanh(3 d)), d the horizontal distance of ball and hole, until the ball is past it",
        ),
        one("in", "", "100 where d < 0.1 and the ball is lower than 0.38 m, else 0"),
    ],
    shaped_reward: &[
        one(
            "behind",
            "",
            "0.1 (1 - tanh(3 b)), b the distance of the grasp point from the point behind the ball",
        ),
        one("pushed", "", "0.3 v / 0.5 m/s within ±0.3, v the ball's horizontal velocity towards the hole"),
        one("near", "", "0.3 (1 - tanh(3 d)), d the horizontal distance of ball and hole"),
        one("in", "", "0.6 where d <= 0.13 and the ball is lower than 0.36 m, else 0"),
        one("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis { name: "ball_x", unit: "m", paper: [0.4, 0.6], code: [0.4, 0.6], sets: "ball's x" },
        BoxAxis { name: "ball_y", unit: "m", paper: [-0.1, 0.1], code: [-0.1, 0.1], sets: "ball's y" },
    ],
    variations: Variations { friction: true, masses: &["ball"], push: Some(("ball", 0.1)), jump: None },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the ball is lower than 0.1 m",
    differences: "The original also moves the fingers' start by up to 0.125 m, which on a stroke of 0.04 m means \
                  nothing; here only the arm's joints start with noise. The walls of the pit are as deep as the table.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](ball_hole_distance <= 0.3)",
    strict: "eventually[0:270](always[0:30](ball_hole_horizontal_distance <= 0.13 and ball_height <= 0.36))",
    safe: "ball_hole_distance <= 0.5",
    completion: "always[0:4](ball_hole_distance <= 0.3)",
};

impl Task for BallPushing {
    fn definition(&self) -> &'static Definition {
        const { &DEFINITION }
    }

    fn scene(&self) -> Cow<'static, str> {
        include_str!("scene.xml").into()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(Bound { panda: *panda, ball: model.joint("ball")?, hole: model.site("hole")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct Bound {
    panda: Panda,
    ball: Joint,
    hole: Site,
}

impl Scene for Bound {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place_free(self.ball, [x0[0], x0[1], START_HEIGHT], [1.0, 0.0, 0.0, 0.0]);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let ball = rows.free_position(self.ball);
        let to_hole = sub(rows.site_position(self.hole), ball);
        out[0] = norm(to_hole);
        out[1] = norm_xy(to_hole);
        out[2] = ball[2];
        out[3] = norm(rows.free_velocity(self.ball));
        out[4] = norm(sub(rows.site_position(self.panda.grasp), ball));
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let ball = rows.free_position(self.ball);
        out[..3].copy_from_slice(&rows.free_velocity(self.ball));
        out[3..6].copy_from_slice(&rows.free_angular_velocity(self.ball));
        out[6..9].copy_from_slice(&sub(rows.site_position(self.hole), ball));
        out[9..].copy_from_slice(&ball);
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let (d, height) = (signals[1], signals[2]);
        let (ball, hole) = (rows.free_position(self.ball), rows.site_position(self.hole));
        match reward {
            Reward::Original => {
                out[0] = if ball[0] <= hole[0] { 10.0 * (1.0 - (3.0 * d).tanh()) } else { 0.0 };
                out[1] = if d < 0.1 && height < 0.38 { 100.0 } else { 0.0 };
            }
            Reward::Shaped => {
                let away = 1.0 + BEHIND / d.max(BEHIND);
                let behind =
                    [hole[0] + away * (ball[0] - hole[0]), hole[1] + away * (ball[1] - hole[1]), ball[2]];
                let b = norm(sub(rows.site_position(self.panda.grasp), behind));
                let (to_hole, velocity) = (sub(hole, ball), rows.free_velocity(self.ball));
                let towards = (to_hole[0] * velocity[0] + to_hole[1] * velocity[1]) / d.max(BEHIND);
                out[0] = 0.1 * (1.0 - (3.0 * b).tanh());
                out[1] = 0.3 * (towards / 0.5).clamp(-1.0, 1.0);
                out[2] = 0.3 * (1.0 - (3.0 * d).tanh());
                out[3] = if d <= 0.13 && height <= 0.36 { 0.6 } else { 0.0 };
                out[4] = crate::reward::effort(action);
            }
        }
    }

    fn lost(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[2] < 0.1
    }
}
