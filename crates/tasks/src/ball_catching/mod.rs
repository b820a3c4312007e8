//! Ball catching: catch a thrown ball in a box, and keep it there.
//!
//! Every initial state is reachable within the limits of Franka's data sheet: the expert catches
//! balls from the whole initial box. It meets the farther ones after their first bounce, which the
//! formulas allow.

mod expert;

use std::borrow::Cow;
use std::sync::Arc;

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, dot, norm, norm_xy, scale, sub};
use mishandle_world::{Joint, Model, Rows, Site, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Reward, Scene, Task, TaskFormulas, Variations,
    scalar, vector3,
};
use crate::robot::Panda;

/// The task.
pub struct BallCatching;

/// Height from which the ball is thrown, m.
const THROW_HEIGHT: f64 = 1.5;

/// Initial velocity of the ball, m/s: towards the robot.
const THROW_VELOCITY: [f64; 3] = [-1.0, 0.0, 0.0];

/// Position of the box's origin while the robot is in its initial pose, m.
const ORIGIN: [f64; 3] = [0.35, 0.0, 0.88];

const GRAVITY: f64 = 9.81;

/// Height of the box's floor above the tool point, and of the tool point above the box's origin, m.
const FLOOR: f64 = 0.005;

/// Depth of the box, m.
const DEPTH: f64 = 0.1;

/// Distance from the box's axis within which a ball below the mouth is in the box, m. A ball in a
/// corner of the cavity is 0.025 √2 = 0.0354 m from the axis, a ball that touches the box from
/// outside 0.05 m.
const INSIDE: f64 = 0.04;

const DEFINITION: Definition = Definition {
    name: "ball-catching",
    summary: "Catch a ball thrown towards the robot in a box, and keep it there.",
    variant_of: None,
    scene_description: "The hand holds an open box (2 g) with a cavity of 7 x 7 x 10 cm. Its floor is at (0.35, 0, 0.89) m, and the \
              tool point is 5 mm below the middle of the floor. A ball (radius 1 cm, 1 g) is thrown horizontally towards the \
              robot from a height of 1.5 m at 1 m/s.",
    object: Some("ball"),
    held: Some(HeldObject {
        name: "box",
        attachment: Attachment::Fixed,
        mjcf: include_str!("box.xml"),
        position: ORIGIN,
        quaternion: [1.0, 0.0, 0.0, 0.0],
    }),
    start: [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785, 0.04, 0.04],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Fixed(0.04),
    // A missed ball of 2 cm meets the ground at 5.4 m/s. In 1/1200 s it moves 4.5 mm: less than a
    // quarter of its size.
    n_substeps: 20,
    velocity_scale: 0.1,
    signals: &[
        scalar(
            "ball_box_horizontal_distance",
            "m",
            "horizontal distance between the ball and the tool point, 5 mm below the middle of the box's floor",
        ),
        scalar(
            "ball_height_above_box_floor",
            "m",
            "height of the ball's center above the box's floor, along the box's axis",
        ),
        scalar("ball_height", "m", "height of the ball's center above the ground"),
        scalar("ball_speed", "m/s", "speed of the ball"),
        scalar("box_tilt", "rad", "angle between the box's axis and the vertical"),
    ],
    observation: &[
        vector3("ball", "m", "center of the ball"),
        vector3("tool_from_ball", "m", "tool point minus center of the ball"),
        vector3("ball_velocity", "m/s", "velocity of the ball"),
    ],
    original_reward: &[
        scalar("near", "", "1 / (1 + 100 d), d the distance of the ball from the tool point"),
        scalar("slow", "", "1 / (1 + 100 v), v the ball's speed"),
        scalar("caught", "", "0.5 where d < 0.03, else 0"),
        scalar("effort", "", "-0.01 (1 - 1 / (1 + s)), s the sum of the arm's squared actions"),
    ],
    shaped_reward: &[
        scalar(
            "intercept",
            "",
            "0.15 (1 - tanh(2 m)) + 0.15 (1 - tanh(15 m)) while the ball is above the box's mouth, m the horizontal \
             distance from its middle at which the ball will come down to it",
        ),
        scalar("caught", "", "0.5 where the ball is in the box, else 0"),
        scalar("held", "", "0.2 where the strict formula's condition holds, else 0"),
        scalar("level", "", "0.2 times the cosine of the box's tilt where the ball is in the box, else 0"),
        scalar("still", "", "0.1 / (1 + 10 v) where the ball is in the box, v its speed, else 0"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "ball_x",
            unit: "m",
            paper: [1.05, 1.15],
            code: [1.05, 1.15],
            meaning: "x position of the ball",
        },
        BoxAxis {
            name: "ball_y",
            unit: "m",
            paper: [-0.05, 0.05],
            code: [-0.05, 0.05],
            meaning: "y position of the ball",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["ball", "box"],
        push: Some(("ball", 0.005)),
        jump: None,
        sizes: &["ball"],
        thrown: Some("ball"),
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the ball is lower than 0.02 m: on the ground",
    differences: "The bound of the strict formula is 0.04 m, because a ball in a corner of the box is 0.0354 m from its axis and \
                  a ball outside at least 0.05 m. The original holds the box by friction alone, with almost no clearance. \
                  Here the box is a part of the hand, because dropping it is not the failure under study.",
};

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "always[50:300](ball_box_horizontal_distance <= 0.1)",
    strict: "always[100:300](ball_box_horizontal_distance <= 0.04 and ball_height_above_box_floor >= 0 \
             and ball_height_above_box_floor <= 0.1)",
    careful: Some(&[]),
    safe: "ball_box_horizontal_distance <= 0.2",
    completion: "always[0:4](ball_box_horizontal_distance <= 0.1)",
};

impl Task for BallCatching {
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
        [CameraPlace::over([1.1, -1.4, 1.35], [0.52, 0.0, 0.93], 1.05), CameraPlace::WRIST]
    }

    fn bind(&self, model: &Model, _panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene { ball: model.joint("ball")?, tool: model.site("tool")? }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert()
    }
}

struct BoundScene {
    ball: Joint,
    tool: Site,
}

impl BoundScene {
    /// Returns the direction of the box's axis, from its floor to its mouth.
    fn axis(&self, rows: &Rows<'_>) -> [f64; 3] {
        let rotation = rows.site_rotation(self.tool);
        [rotation[2], rotation[5], rotation[8]]
    }
}

impl Scene for BoundScene {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place_free(self.ball, [x0[0], x0[1], THROW_HEIGHT], [1.0, 0.0, 0.0, 0.0]);
        world.qvel_mut()[self.ball.dof..][..3].copy_from_slice(&THROW_VELOCITY);
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let ball = rows.free_position(self.ball);
        let from_tool = sub(ball, rows.site_position(self.tool));
        let axis = self.axis(rows);
        out[0] = norm_xy(from_tool);
        out[1] = dot(from_tool, axis) - FLOOR;
        out[2] = ball[2];
        out[3] = norm(rows.free_velocity(self.ball));
        out[4] = axis[2].clamp(-1.0, 1.0).acos();
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let ball = rows.free_position(self.ball);
        out[..3].copy_from_slice(&ball);
        out[3..6].copy_from_slice(&sub(rows.site_position(self.tool), ball));
        out[6..].copy_from_slice(&rows.free_velocity(self.ball));
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let distance = signals[0];
        let height = signals[1];
        let speed = signals[3];
        let ball = rows.free_position(self.ball);
        let tool = rows.site_position(self.tool);
        match reward {
            Reward::Original => {
                let d = norm(sub(tool, ball));
                let s: f64 = action[..7].iter().map(|a| a * a).sum();
                out[0] = 1.0 / (1.0 + 100.0 * d);
                out[1] = 1.0 / (1.0 + 100.0 * speed);
                out[2] = if d < 0.03 { 0.5 } else { 0.0 };
                out[3] = -0.01 * (1.0 - 1.0 / (1.0 + s));
            }
            Reward::Shaped => {
                let axis = self.axis(rows);
                let mouth = add(tool, scale(axis, FLOOR + DEPTH));
                let miss = miss(ball, rows.free_velocity(self.ball), mouth);
                let deep = (0.0..=DEPTH).contains(&height);
                // The distance is perpendicular to the box's axis, which is tilted while the box
                // turns.
                let inside = deep && norm(sub(sub(ball, tool), scale(axis, height + FLOOR))) <= INSIDE;
                let held = deep && distance <= INSIDE;
                out[0] = miss.map_or(0.0, |m| 0.15 * (2.0 - (2.0 * m).tanh() - (15.0 * m).tanh()));
                out[1] = if inside { 0.5 } else { 0.0 };
                out[2] = if held { 0.2 } else { 0.0 };
                out[3] = if inside { 0.2 * axis[2] } else { 0.0 };
                out[4] = if inside { 0.1 / (1.0 + 10.0 * speed) } else { 0.0 };
                out[5] = crate::reward::action_penalty(action);
            }
        }
    }

    fn is_terminal(&self, _rows: &Rows<'_>, signals: &[f64]) -> bool {
        signals[2] < 0.02
    }
}

/// Returns the horizontal distance from `mouth` at which a ball in free flight falls to its height;
/// `None` if the ball is below it.
fn miss(ball: [f64; 3], velocity: [f64; 3], mouth: [f64; 3]) -> Option<f64> {
    let time = fall_time(ball[2] - mouth[2], velocity[2])?;
    let at = |i: usize| ball[i] + velocity[i] * time - mouth[i];
    Some(at(0).hypot(at(1)))
}

/// Returns the time (s) until a ball in free flight with the upward velocity `velocity`, m/s, is
/// `height`, m, lower; `None` if `height` is negative.
fn fall_time(height: f64, velocity: f64) -> Option<f64> {
    (height >= 0.0).then(|| (velocity + (velocity * velocity + 2.0 * GRAVITY * height).sqrt()) / GRAVITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fall_time_matches_a_hand_calculation() {
        // A fall of 4.905 m from rest takes 1 s. A throw at 9.81 m/s takes 1 s to the top and 1 s
        // back.
        assert!((fall_time(4.905, 0.0).unwrap_or(0.0) - 1.0).abs() < 1e-12);
        assert!((fall_time(0.0, 9.81).unwrap_or(0.0) - 2.0).abs() < 1e-12);
        assert_eq!(fall_time(-0.01, 9.81), None);
    }

    #[test]
    fn the_miss_distance_is_measured_at_the_height_of_the_mouth() {
        // During its fall of 1 s the ball flies 1 m to x = 0.1 and 0.5 m to y = 0.4.
        let found = miss([1.1, -0.1, 5.905], [-1.0, 0.5, 0.0], [0.4, 0.0, 1.0]);
        assert!((found.unwrap_or(0.0) - 0.5).abs() < 1e-12, "{found:?}");
        assert_eq!(miss([0.4, 0.0, 0.9], [0.0; 3], [0.4, 0.0, 1.0]), None);
    }
}
