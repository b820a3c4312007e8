//! Ball pushing: push a ball across a table into a hole.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, norm_xy, sub};
use mishandle_world::{Joint, Model, Rows, Site, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    BoxAxis, Definition, GripperMode, Reward, Scene, Task, TaskFormulas, Variations, scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct BallPushing;

/// Initial height of the ball, m: 1 cm above its position on the table.
const START_HEIGHT: f64 = 0.45;

/// Distance from the ball's center to the point from which a finger can push it, m: radius of the
/// ball plus depth of a finger.
const BEHIND: f64 = 0.055;

const DEFINITION: Definition = Definition {
    name: "ball-pushing",
    summary: "Push a ball across a table into a hole.",
    variant_of: None,
    scene_description: "A table 0.4 m high extends from x = 0.3 to 1.3 m and y = -0.4 to 0.4 m. It has a pit 0.1 m deep from x = 0.9 to \
              1.15 m and y = -0.15 to 0.15 m. A ball (radius 4 cm, 20 g) drops onto the table from a height of 1 cm.",
    object: Some("ball"),
    held: None,
    start: [1.157, -1.066, -0.155, -2.239, -1.841, 1.003, 0.469, 0.035, 0.035],
    start_noise: 0.125,
    lamp: LAMP,
    grip: GripperMode::Fixed(0.015),
    n_substeps: 8,
    velocity_scale: 0.01,
    signals: &[
        scalar(
            "ball_hole_distance",
            "m",
            "distance between the ball and the hole, the point 5 mm below the center of the pit's floor",
        ),
        scalar("ball_hole_horizontal_distance", "m", "horizontal distance between the ball and the hole"),
        scalar("ball_height", "m", "height of the ball's center above the ground"),
        scalar("ball_speed", "m/s", "speed of the ball"),
        scalar("finger_ball_distance", "m", "distance between the fingers' grasp point and the ball"),
    ],
    observation: &[
        vector3("ball_velocity", "m/s", "velocity of the ball"),
        vector3("ball_angular_velocity", "rad/s", "angular velocity of the ball"),
        vector3("hole_from_ball", "m", "hole minus center of the ball"),
        vector3("ball", "m", "center of the ball"),
    ],
    original_reward: &[
        scalar(
            "near",
            "",
            "10 (1 - tanh(3 d)), d the horizontal distance of ball and hole, until the ball is past it",
        ),
        scalar("in", "", "100 where d < 0.1 and the ball is lower than 0.38 m, else 0"),
    ],
    shaped_reward: &[
        scalar(
            "behind",
            "",
            "0.1 (1 - tanh(3 b)), b the distance of the grasp point from the point behind the ball",
        ),
        scalar(
            "pushed",
            "",
            "0.3 v / 0.5 m/s within ±0.3, v the ball's horizontal velocity towards the hole",
        ),
        scalar("near", "", "0.3 (1 - tanh(3 d)), d the horizontal distance of ball and hole"),
        scalar("in", "", "0.6 where d <= 0.13 and the ball is lower than 0.36 m, else 0"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "ball_x",
            unit: "m",
            paper: [0.4, 0.6],
            code: [0.4, 0.6],
            meaning: "x position of the ball",
        },
        BoxAxis {
            name: "ball_y",
            unit: "m",
            paper: [-0.1, 0.1],
            code: [-0.1, 0.1],
            meaning: "y position of the ball",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["ball"],
        push: Some(("ball", 0.1)),
        jump: None,
        sizes: &["ball"],
        thrown: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the ball is lower than 0.1 m",
    differences: "The fingers of the original start with noise of up to 0.125 m, which is meaningless for a stroke of \
                  0.04 m; here only the arm joints start with noise. The walls of the pit extend down to the ground. The \
                  bounds of the strict formula hold exactly for a ball in the pit: a ball at rest in a corner of the pit is \
                  0.139 m from its center and 0.34 m high; a ball on the table is 0.44 m high, and a ball beside the table \
                  at least 0.315 m away.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](ball_hole_distance <= 0.3)",
    strict: "eventually[0:270](always[0:30](ball_hole_horizontal_distance <= 0.15 and ball_height <= 0.36))",
    careful: Some(&["always[0:300](arm_object_force <= 0.1)"]),
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

    fn notes(&self) -> &'static str {
        include_str!("page.md")
    }

    fn cameras(&self) -> [CameraPlace; 2] {
        [CameraPlace::over([1.8, -0.75, 1.25], [0.68, 0.0, 0.5], 1.12), CameraPlace::WRIST]
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene { panda: *panda, ball: model.joint("ball")?, hole: model.site("hole")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    panda: Panda,
    ball: Joint,
    hole: Site,
}

impl Scene for BoundScene {
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
        let d = signals[1];
        let height = signals[2];
        let ball = rows.free_position(self.ball);
        let hole = rows.site_position(self.hole);
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
                let to_hole = sub(hole, ball);
                let velocity = rows.free_velocity(self.ball);
                let towards = (to_hole[0] * velocity[0] + to_hole[1] * velocity[1]) / d.max(BEHIND);
                out[0] = 0.1 * (1.0 - (3.0 * b).tanh());
                out[1] = 0.3 * (towards / 0.5).clamp(-1.0, 1.0);
                out[2] = 0.3 * (1.0 - (3.0 * d).tanh());
                out[3] = if d <= 0.13 && height <= 0.36 { 0.6 } else { 0.0 };
                out[4] = crate::reward::action_penalty(action);
            }
        }
    }

    fn is_terminal(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[2] < 0.1
    }
}
