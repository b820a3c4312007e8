//! Ball balancing: keep a ball on a flat tray without a rim.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{norm, norm_xy, rotate, sub};
use mishandle_world::{Body, Joint, Model, Rows, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Reward, Scene, Task, TaskFormulas, Variations,
    scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct BallBalancing;

/// Height of the tray's top above its reference point on the handle, m.
const TOP: f64 = 0.11;

/// Height from which the ball drops, m: 0.08 m above its position on the tray.
const DROP_HEIGHT: f64 = 1.1;

const DEFINITION: Definition = Definition {
    name: "ball-balancing",
    summary: "Balance a falling ball on a flat tray in the robot's hand.",
    variant_of: None,
    scene_description: "The hand holds a flat tray without a rim (radius 0.23 m, 100 g). Its top is 1 m high, its axis is at \
              (0.342, 0) m, and its reference point is 0.11 m below its top. A ball (radius 2 cm, 150 g) drops from a height \
              of 1.1 m.",
    object: Some("ball"),
    held: Some(HeldObject {
        name: "tray",
        attachment: Attachment::Fixed,
        mjcf: include_str!("tray.xml"),
        position: [0.342, 0.0, 0.89],
        quaternion: [1.0, 0.0, 0.0, 0.0],
    }),
    start: [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.004, 0.004],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Fixed(0.004),
    n_substeps: 8,
    velocity_scale: 0.1,
    signals: &[
        scalar(
            "ball_tray_horizontal_distance",
            "m",
            "horizontal distance between the ball and the tray's reference point",
        ),
        scalar(
            "ball_height_above_tray",
            "m",
            "height of the ball's center above the tray's top, along the normal of the tray",
        ),
        scalar("ball_speed", "m/s", "speed of the ball"),
    ],
    observation: &[
        vector3("ball", "m", "center of the ball"),
        vector3(
            "tray_from_ball",
            "m",
            "tray's reference point, 0.11 m below its top, minus center of the ball",
        ),
        vector3("ball_velocity", "m/s", "velocity of the ball"),
    ],
    original_reward: &[
        scalar("near", "", "10 / (1 + d), d the distance of the ball from the tray's reference point"),
        scalar("slow", "", "5 / (1 + v), v the ball's speed"),
        scalar("level", "", "1 / (1 + norm of the change of the tray's quaternion)"),
        scalar("up", "", "1 where the ball is higher than 0.4 m, else 0"),
    ],
    shaped_reward: &[
        scalar("centred", "", "(1 - tanh(6 r)) / (1 + v), r the ball's horizontal distance from the axis"),
        scalar("on", "", "0.2 where r <= 0.1 and the ball is above the tray, else 0"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "ball_x",
            unit: "m",
            paper: [0.2, 0.5],
            code: [0.192, 0.492],
            meaning: "x position of the ball",
        },
        BoxAxis {
            name: "ball_y",
            unit: "m",
            paper: [-0.15, 0.15],
            code: [-0.15, 0.15],
            meaning: "y position of the ball",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["ball", "tray"],
        push: Some(("ball", 1.0)),
        jump: None,
        sizes: &["ball"],
        thrown: None,
    },
    paper: TaskFormulas {
        success: "always[50:200](ball_tray_horizontal_distance <= 0.25)",
        strict: STRICT,
        careful: Some(&[]),
        safe: SAFE,
        completion: COMPLETION,
    },
    code: TaskFormulas {
        success: "always[50:300](ball_tray_horizontal_distance <= 0.25)",
        strict: STRICT,
        careful: Some(&[]),
        safe: SAFE,
        completion: COMPLETION,
    },
    termination: "the ball is farther than 0.54 m from the tray's reference point, or lower than 0.5 m",
    differences: "The original holds the tray by friction alone. Here the tray is a part of the hand, because dropping it \
                  is not the failure under study. The ball hits the ground with a restitution of 0.4. The tray's handle \
                  collides with nothing.",
};

const STRICT: &str = "always[50:300](ball_tray_horizontal_distance <= 0.2 and ball_height_above_tray > 0) \
                      and always[200:300](ball_tray_horizontal_distance <= 0.1)";
const SAFE: &str = "ball_tray_horizontal_distance <= 0.2";
const COMPLETION: &str = "always[0:4](ball_tray_horizontal_distance <= 0.1)";

impl Task for BallBalancing {
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
        // The hand is below the tray, so the camera at the wrist is on a mast.
        let wrist = CameraPlace { from: [0.4, 0.0, -0.2], to: [0.2, 0.0, 0.1], ..CameraPlace::WRIST };
        [CameraPlace::over([1.15, -0.6, 1.55], [0.36, 0.0, 0.9], 1.2), wrist]
    }

    fn bind(&self, model: &Model, _panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene { ball: model.joint("ball")?, tray: model.body("tray")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    ball: Joint,
    tray: Body,
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place_free(self.ball, [x0[0], x0[1], DROP_HEIGHT], [1.0, 0.0, 0.0, 0.0]);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let from_tray = sub(rows.free_position(self.ball), rows.position(self.tray));
        let normal = rotate(rows.quaternion(self.tray), [0.0, 0.0, 1.0]);
        out[0] = norm_xy(from_tray);
        out[1] = mishandle_world::frame::dot(from_tray, normal) - TOP;
        out[2] = norm(rows.free_velocity(self.ball));
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let ball = rows.free_position(self.ball);
        out[..3].copy_from_slice(&ball);
        out[3..6].copy_from_slice(&sub(rows.position(self.tray), ball));
        out[6..].copy_from_slice(&rows.free_velocity(self.ball));
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let r = signals[0];
        let height = signals[1];
        let v = signals[2];
        match reward {
            Reward::Original => {
                let ball = rows.free_position(self.ball);
                let [w, x, y, z] = rows.quaternion(self.tray);
                // The quaternion of a level tray is the identity. q and -q are the same
                // orientation.
                let turned = ((w.abs() - 1.0).powi(2) + x * x + y * y + z * z).sqrt();
                out[0] = 10.0 / (1.0 + norm(sub(ball, rows.position(self.tray))));
                out[1] = 5.0 / (1.0 + v);
                out[2] = 1.0 / (1.0 + turned);
                out[3] = if ball[2] > 0.4 { 1.0 } else { 0.0 };
            }
            Reward::Shaped => {
                out[0] = (1.0 - (6.0 * r).tanh()) / (1.0 + v);
                out[1] = if r <= 0.1 && height > 0.0 { 0.2 } else { 0.0 };
                out[2] = crate::reward::action_penalty(action);
            }
        }
    }

    fn is_terminal(&self, rows: &Rows<'_>, _signals: &[f64]) -> bool {
        let ball = rows.free_position(self.ball);
        norm(sub(ball, rows.position(self.tray))) > 0.54 || ball[2] < 0.5
    }
}
