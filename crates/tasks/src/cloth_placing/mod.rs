//! Cloth placing: put a cloth down on a table.

mod expert;
mod sheet;

use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, norm, norm_xy, scale, sub};
use mishandle_world::{Body, Equality, Flex, Mocap, Model, Rows, Site, World, WorldError};

use crate::definition::{
    BoxAxis, Definition, Grip, Held, Hold, Reward, Scene, Task, TaskFormulas, Variations, one, three,
};
use crate::robot::{ARM_JOINTS, Panda};
use sheet::Sheet;

/// The task, on a cloth of one size of grid.
pub struct ClothPlacing {
    sheet: Sheet,
    definition: &'static LazyLock<Definition>,
}

/// The benchmark's grid.
const FINE: Sheet = Sheet { vertices: 11 };

/// A coarser grid, cheaper to step.
const COARSE: Sheet = Sheet { vertices: 7 };

const NAME: &str = "cloth-placing";

static FINE_DEFINITION: LazyLock<Definition> = LazyLock::new(|| definition(NAME, None, FINE));
static COARSE_DEFINITION: LazyLock<Definition> =
    LazyLock::new(|| definition("cloth-placing-7x7", Some(NAME), COARSE));

/// What the coarser grid is for.
const COARSE_SUMMARY: &str = "Carry a cloth of 7 x 7 vertices, in place of 11 x 11, to a table and lay it down there: cheaper to \
     step, to try things on; controllers are measured on the benchmark's grid.";

/// The benchmark's task.
pub static CLOTH_PLACING: ClothPlacing = ClothPlacing { sheet: FINE, definition: &FINE_DEFINITION };

/// The same cloth on the coarser grid.
pub static CLOTH_PLACING_7X7: ClothPlacing = ClothPlacing { sheet: COARSE, definition: &COARSE_DEFINITION };

/// Half the side of the table, m.
const HALF_TABLE: f64 = 0.15;

/// The gripper opens by itself when the centroid is this close to the marker, horizontally (m), above it, and the mean
/// velocity of the vertices is below this (m/s).
const FORCED_DISTANCE: f64 = 0.07;
const FORCED_SPEED: f64 = 0.1;

/// Opening of a finger that lets go of the cloth, m.
const LET_GO: f64 = 0.005;

/// What a finger is told when the gripper opens by itself, m: more than it can.
const FULLY_OPEN: f64 = 0.15;

/// What both sizes of grid share: the benchmark's, with empty hands.
const DEFINITION: Definition = Definition {
    name: NAME,
    summary: "Carry a cloth to a table and lay it down there.",
    variant_of: None,
    setting: "A square cloth of 0.3 m and 605 g, 11 x 11 vertices in the benchmark, hangs upright from the closed fingers, its middle at (0.5, 0, 0.65) m, in the plane \
              of x and z. A table of 0.3 x 0.3 x 0.4 m has a rim 1 cm wide and 2 cm high around its top; the marker is the \
              middle of the top, 0.4 m high.",
    held: None,
    start: [0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.5, 0.0001, 0.0001],
    start_noise: 0.0,
    grip: Grip::Scene(
        "the fingers' targets, moved by 0.0125 m at 1, within 0 and 0.04 m. They open by themselves while the cloth's \
         centroid is within 7 cm of the marker's axis, above the marker, and the mean velocity of its vertices is below \
         0.1 m/s. The cloth is let go for good then, or when a finger is open by more than 5 mm",
    ),
    n_substeps: 4,
    velocity_scale: 0.1,
    signals: &[
        one(
            "cloth_target_distance",
            "m",
            "distance of the cloth's centroid from the centre of the table's top",
        ),
        one("cloth_target_horizontal_distance", "m", "the horizontal part of it"),
        one("cloth_height_above_target", "m", "height of the centroid above the table's top"),
        one(
            "cloth_vertices_over_table",
            "",
            "share of the cloth's vertices that are inside the table's outline, seen from above, and not below \
             its top",
        ),
        one("cloth_speed", "m/s", "root mean square of the speeds of the cloth's vertices"),
        one("cloth_spread", "m", "root mean square of the vertices' horizontal distances from the centroid"),
        one("cloth_released", "", "1 once the gripper has let go, else 0"),
    ],
    observation: &[
        three("cloth", "m", "centroid of the cloth"),
        three("cloth_from_target", "m", "centroid minus the centre of the table's top"),
        three("target", "m", "centre of the table's top"),
    ],
    original_reward: &[
        one("near", "", "7 / (1 + d), d the distance of the centroid from the centre of the table's top"),
        one("placed", "", "10 where d < 0.05 and the mean velocity of the vertices is below 0.1 m/s, else 0"),
        one(
            "upright",
            "",
            "1 / (1 + r), r the norm of the left finger's quaternion minus that of pointing down",
        ),
        one("high", "", "1 where the centroid is higher than 0.3 m, else 0"),
        one("cloth_calm", "", "1 / (1 + v), v the norm of the vertices' mean velocity"),
        one("fingers_calm", "", "1 / (1 + w), w the norm of the fingers' mean twist"),
    ],
    shaped_reward: &[
        one("near", "", "0.3 (1 - tanh(3 d)), d the horizontal distance of the centroid from the marker"),
        one("over", "", "0.2 times the share of vertices over the table"),
        one(
            "low",
            "",
            "0.1 times that share times (1 - tanh(5 |h|)), h the centroid's height above the marker",
        ),
        one("let_go", "", "0.1 times that share once the gripper has let go"),
        one(
            "placed",
            "",
            "1 where d <= 0.05, four fifths of the vertices are over the table, the cloth is let go and slower \
             than 0.05 m/s, else 0",
        ),
        one("thrown", "", "-0.5 tanh(2 v) once the gripper has let go, v the speed of the cloth"),
        one("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis { name: "table_x", unit: "m", paper: [0.45, 0.75], code: [0.35, 0.65], sets: "table's x" },
        BoxAxis { name: "table_y", unit: "m", paper: [-0.35, 0.35], code: [-0.35, 0.35], sets: "table's y" },
    ],
    variations: Variations {
        friction: true,
        masses: &["cloth"],
        push: Some(("cloth", 0.02)),
        jump: Some("table"),
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the centroid is lower than 0.1 m",
    differences: DIFFERENCES,
};

fn definition(name: &'static str, variant_of: Option<&'static str>, sheet: Sheet) -> Definition {
    let held = Held {
        name: "pinch",
        hold: Hold::Fixed,
        // Made once and kept for as long as the program runs.
        mjcf: sheet.pinch().leak(),
        position: sheet::CENTRE,
        quaternion: [1.0, 0.0, 0.0, 0.0],
    };
    let summary = if variant_of.is_some() { COARSE_SUMMARY } else { DEFINITION.summary };
    Definition { name, summary, variant_of, held: Some(held), ..DEFINITION }
}

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cloth_target_distance <= 0.25)",
    strict: "eventually[0:270](always[0:30](cloth_target_horizontal_distance <= 0.05 and cloth_vertices_over_table >= 0.8 \
             and cloth_speed <= 0.05 and cloth_released >= 0.5))",
    safe: "cloth_target_distance <= 0.3",
    completion: "cloth_target_distance <= 0.25",
};

const DIFFERENCES: &str = "The strict formula counts the cloth that lies on the table, spread or in a heap: the share of its vertices over the \
    table, not their spread; `cloth_spread` tells which. The original pinches the cloth by friction alone. Here the four vertices around the finger \
    tips are tied to the hand until the gripper opens by itself or a finger is open by more than 5 mm, and never again \
    after that; how well a finger grips is not what is tested. Vertices touch table, ground and fingers, edges between \
    them do not, so a fold may cut a corner by less than half the grid's spacing; the cloth does not touch itself, nor \
    the hand, nor, above the pinch, the fingers. It has no stiffness in bending and feels no air: the original's are \
    small beside its stretching stiffness and its weight.";

impl Task for ClothPlacing {
    fn definition(&self) -> &'static Definition {
        self.definition
    }

    fn scene(&self) -> Cow<'static, str> {
        self.sheet.fill(include_str!("scene.xml")).into()
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(Bound {
            panda: *panda,
            fingers: [model.body("left_finger")?, model.body("right_finger")?],
            cloth: model.flex("cloth")?,
            pinch: model.equality("pinch_0")?,
            table: model.mocap("table")?,
            marker: model.site("marker")?,
        }))
    }

    fn expert(&self) -> Result<Arc<dyn Controller>, WorldError> {
        expert::expert(self.definition)
    }
}

struct Bound {
    panda: Panda,
    fingers: [Body; 2],
    cloth: Flex,
    pinch: Equality,
    table: Mocap,
    marker: Site,
}

impl Bound {
    fn centroid(&self, rows: &Rows<'_>) -> [f64; 3] {
        mean(rows.vertices(self.cloth))
    }

    /// Speed of the centroid, m/s.
    fn mean_speed(&self, rows: &Rows<'_>) -> f64 {
        norm(mean(rows.vertex_velocities(self.cloth)))
    }
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    scale(points.iter().fold([0.0; 3], |sum, point| add(sum, *point)), 1.0 / points.len() as f64)
}

fn mean_of(points: &[[f64; 3]], number: impl Fn([f64; 3]) -> f64) -> f64 {
    points.iter().map(|point| number(*point)).sum::<f64>() / points.len() as f64
}

impl Scene for Bound {
    fn place(&self, x0: &[f64], world: &mut World) {
        world.place(self.table, [x0[0], x0[1], 0.0], [1.0, 0.0, 0.0, 0.0]);
    }

    fn grip(&self, rows: &Rows<'_>, action: &[f64], fingers: &mut [f64]) -> bool {
        self.panda.move_fingers(action, fingers);
        let from_marker = sub(self.centroid(rows), rows.site_position(self.marker));
        let forced = norm_xy(from_marker) < FORCED_DISTANCE
            && from_marker[2] > 0.0
            && self.mean_speed(rows) < FORCED_SPEED;
        if forced {
            fingers.fill(FULLY_OPEN);
        }
        forced || self.panda.joints()[ARM_JOINTS..].iter().any(|finger| rows.qpos[finger.qpos] > LET_GO)
    }

    fn signals(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let (vertices, marker) = (rows.vertices(self.cloth), rows.site_position(self.marker));
        let centroid = mean(vertices);
        let from_marker = sub(centroid, marker);
        let is_over = |vertex: [f64; 3]| {
            let [x, y, z] = sub(vertex, marker);
            f64::from(x.abs() <= HALF_TABLE && y.abs() <= HALF_TABLE && z >= 0.0)
        };
        let squared_speed = |v: [f64; 3]| norm(v).powi(2);
        let squared_distance = |vertex: [f64; 3]| norm_xy(sub(vertex, centroid)).powi(2);
        out[0] = norm(from_marker);
        out[1] = norm_xy(from_marker);
        out[2] = from_marker[2];
        out[3] = mean_of(vertices, is_over);
        out[4] = mean_of(rows.vertex_velocities(self.cloth), squared_speed).sqrt();
        out[5] = mean_of(vertices, squared_distance).sqrt();
        out[6] = if rows.is_active(self.pinch) { 0.0 } else { 1.0 };
    }

    fn observe(&self, rows: &Rows<'_>, out: &mut [f64]) {
        let (centroid, marker) = (self.centroid(rows), rows.site_position(self.marker));
        out[..3].copy_from_slice(&centroid);
        out[3..6].copy_from_slice(&sub(centroid, marker));
        out[6..].copy_from_slice(&marker);
    }

    fn reward(&self, reward: Reward, rows: &Rows<'_>, signals: &[f64], action: &[f64], out: &mut [f64]) {
        let [distance, horizontal, height, over, speed, _, released] =
            std::array::from_fn(|signal| signals[signal]);
        match reward {
            Reward::Original => {
                let v = self.mean_speed(rows);
                let [left, right] = self.fingers.map(|finger| rows.twist(finger));
                let w = norm(scale(add(left.0, right.0), 0.5)).hypot(norm(scale(add(left.1, right.1), 0.5)));
                out[0] = 7.0 / (1.0 + distance);
                out[1] = if distance < 0.05 && v < 0.1 { 10.0 } else { 0.0 };
                out[2] = 1.0 / (1.0 + from_pointing_down(rows.quaternion(self.fingers[0])));
                out[3] = if self.centroid(rows)[2] > 0.3 { 1.0 } else { 0.0 };
                out[4] = 1.0 / (1.0 + v);
                out[5] = 1.0 / (1.0 + w);
            }
            Reward::Shaped => {
                let placed = horizontal <= 0.05 && over >= 0.8 && speed <= 0.05 && released >= 0.5;
                out[0] = 0.3 * (1.0 - (3.0 * horizontal).tanh());
                out[1] = 0.2 * over;
                out[2] = 0.1 * over * (1.0 - (5.0 * height.abs()).tanh());
                out[3] = 0.1 * over * released;
                out[4] = if placed { 1.0 } else { 0.0 };
                // A cloth that is thrown is soon over the table, but only by luck at its middle.
                out[5] = -0.5 * released * (2.0 * speed).tanh();
                out[6] = crate::reward::effort(action);
            }
        }
    }

    fn lost(&self, rows: &Rows<'_>, _signals: &[f64]) -> bool {
        self.centroid(rows)[2] < 0.1
    }
}

/// Norm of a quaternion minus the half turn about x, of which both signs mean the same.
fn from_pointing_down([w, x, y, z]: [f64; 4]) -> f64 {
    (w * w + (x.abs() - 1.0).powi(2) + y * y + z * z).sqrt()
}
