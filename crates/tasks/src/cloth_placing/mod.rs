//! Cloth placing: put a cloth down on a table.

mod expert;
mod sheet;

use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

use mishandle_rollout::Controller;
use mishandle_world::frame::{add, norm, norm_xy, scale, sub};
use mishandle_world::{Body, Equality, Flex, Mocap, Model, Rows, Site, World, WorldError};

use crate::cameras::{CameraPlace, LAMP};
use crate::definition::{
    Attachment, BoxAxis, Definition, GripperMode, HeldObject, Reward, Scene, Task, TaskFormulas, Variations,
    scalar, vector3,
};
use crate::robot::{ARM_JOINTS, Panda};
use sheet::Sheet;

/// The task, with a cloth of one grid size.
pub struct ClothPlacing {
    sheet: Sheet,
    definition: &'static LazyLock<Definition>,
}

/// Grid of the benchmark.
const FINE: Sheet = Sheet { vertices: 11 };

/// Coarser grid with faster steps.
const COARSE: Sheet = Sheet { vertices: 7 };

const NAME: &str = "cloth-placing";

static FINE_DEFINITION: LazyLock<Definition> = LazyLock::new(|| definition(NAME, None, FINE));
static COARSE_DEFINITION: LazyLock<Definition> =
    LazyLock::new(|| definition("cloth-placing-7x7", Some(NAME), COARSE));

/// Summary of the variant with the coarser grid.
const COARSE_SUMMARY: &str = "Place a cloth with 7 x 7 instead of 11 x 11 vertices on a table. It simulates faster, for \
     experiments; train and evaluate controllers on the grid of the benchmark.";

/// The task of the benchmark.
pub static CLOTH_PLACING: ClothPlacing = ClothPlacing { sheet: FINE, definition: &FINE_DEFINITION };

/// The same task with the coarser grid.
pub static CLOTH_PLACING_7X7: ClothPlacing = ClothPlacing { sheet: COARSE, definition: &COARSE_DEFINITION };

/// Half the side of the table, m.
const HALF_TABLE: f64 = 0.15;

/// The gripper opens automatically if the centroid is above the marker within this horizontal
/// distance (m) and the mean velocity of the vertices is below this speed (m/s).
const FORCED_DISTANCE: f64 = 0.07;
const FORCED_SPEED: f64 = 0.1;

/// Finger position beyond which the gripper releases the cloth, m.
const LET_GO: f64 = 0.005;

/// Finger target when the gripper opens automatically, m. It exceeds the stroke.
const FULLY_OPEN: f64 = 0.15;

/// Definition of both grid sizes without the held object.
const DEFINITION: Definition = Definition {
    name: NAME,
    summary: "Place a cloth on a table.",
    variant_of: None,
    scene_description: "A square cloth (side 0.3 m, 605 g, 11 x 11 vertices in the benchmark) hangs from the closed fingers in the \
              vertical plane y = 0, with its center at (0.5, 0, 0.65) m. A table of 0.3 x 0.3 x 0.4 m has a rim 1 cm wide and \
              2 cm high around its top. The marker is the center of the top at a height of 0.4 m.",
    object: Some("cloth"),
    held: None,
    start: [0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.5, 0.0001, 0.0001],
    start_noise: 0.0,
    lamp: LAMP,
    grip: GripperMode::Scene(
        "the fingers' targets, moved by 0.0125 m at 1, within 0 and 0.04 m. They open by themselves while the cloth's \
         centroid is within 7 cm of the marker's axis, above the marker, and the mean velocity of its vertices is below \
         0.1 m/s. The cloth is let go for good then, or when a finger is open by more than 5 mm",
    ),
    n_substeps: 4,
    velocity_scale: 0.1,
    signals: &[
        scalar(
            "cloth_target_distance",
            "m",
            "distance between the cloth's centroid and the center of the table's top",
        ),
        scalar(
            "cloth_target_horizontal_distance",
            "m",
            "horizontal distance between the cloth's centroid and the center of the table's top",
        ),
        scalar("cloth_height_above_target", "m", "height of the centroid above the table's top"),
        scalar(
            "cloth_vertices_over_table",
            "",
            "fraction of the cloth's vertices that are inside the table's outline in the top view and not below its top",
        ),
        scalar("cloth_speed", "m/s", "root mean square of the speeds of the cloth's vertices"),
        scalar(
            "cloth_spread",
            "m",
            "root mean square of the vertices' horizontal distances from the centroid",
        ),
        scalar("cloth_released", "", "1 after the gripper has released the cloth, else 0"),
    ],
    observation: &[
        vector3("cloth", "m", "centroid of the cloth"),
        vector3("cloth_from_target", "m", "centroid of the cloth minus center of the table's top"),
        vector3("target", "m", "center of the table's top"),
    ],
    original_reward: &[
        scalar("near", "", "7 / (1 + d), d the distance of the centroid from the centre of the table's top"),
        scalar(
            "placed",
            "",
            "10 where d < 0.05 and the mean velocity of the vertices is below 0.1 m/s, else 0",
        ),
        scalar(
            "upright",
            "",
            "1 / (1 + r), r the norm of the left finger's quaternion minus that of pointing down",
        ),
        scalar("high", "", "1 where the centroid is higher than 0.3 m, else 0"),
        scalar("cloth_calm", "", "1 / (1 + v), v the norm of the vertices' mean velocity"),
        scalar("fingers_calm", "", "1 / (1 + w), w the norm of the fingers' mean twist"),
    ],
    shaped_reward: &[
        scalar("near", "", "0.3 (1 - tanh(3 d)), d the horizontal distance of the centroid from the marker"),
        scalar("over", "", "0.2 times the share of vertices over the table"),
        scalar(
            "low",
            "",
            "0.1 times that share times (1 - tanh(5 |h|)), h the centroid's height above the marker",
        ),
        scalar("let_go", "", "0.1 times that share once the gripper has let go"),
        scalar(
            "placed",
            "",
            "1 where d <= 0.05, four fifths of the vertices are over the table, the cloth is let go and slower \
             than 0.05 m/s, else 0",
        ),
        scalar("thrown", "", "-0.5 tanh(2 v) once the gripper has let go, v the speed of the cloth"),
        scalar("calm", "", "-0.01 times the mean of the arm's squared actions"),
    ],
    initial_box: &[
        BoxAxis {
            name: "table_x",
            unit: "m",
            paper: [0.45, 0.75],
            code: [0.35, 0.65],
            meaning: "x position of the table",
        },
        BoxAxis {
            name: "table_y",
            unit: "m",
            paper: [-0.35, 0.35],
            code: [-0.35, 0.35],
            meaning: "y position of the table",
        },
    ],
    variations: Variations {
        friction: true,
        masses: &["cloth"],
        push: Some(("cloth", 0.02)),
        jump: Some("table"),
        sizes: &[],
        thrown: None,
    },
    paper: FORMULAS,
    code: FORMULAS,
    termination: "the centroid is lower than 0.1 m",
    differences: DIFFERENCES,
};

fn definition(name: &'static str, variant_of: Option<&'static str>, sheet: Sheet) -> Definition {
    let held = HeldObject {
        name: "pinch",
        attachment: Attachment::Fixed,
        // Each definition is made once per process.
        mjcf: sheet.pinch().leak(),
        position: sheet::CENTER,
        quaternion: [1.0, 0.0, 0.0, 0.0],
    };
    let summary = if variant_of.is_some() { COARSE_SUMMARY } else { DEFINITION.summary };
    Definition { name, summary, variant_of, held: Some(held), ..DEFINITION }
}

const FORMULAS: TaskFormulas = TaskFormulas {
    success: "eventually[0:300](cloth_target_distance <= 0.25)",
    strict: "eventually[0:270](always[0:30](cloth_target_horizontal_distance <= 0.05 and cloth_vertices_over_table >= 0.8 \
             and cloth_height_above_target <= 0.05 and cloth_speed <= 0.05 and cloth_released >= 0.5))",
    careful: Some(&["always[300:300](cloth_spread >= 0.03)"]),
    safe: "cloth_target_distance <= 0.3",
    completion: "cloth_target_distance <= 0.25",
};

const DIFFERENCES: &str = "The strict formula requires a fraction of the vertices over the table, not a spread-out cloth; `cloth_spread` \
    distinguishes a spread-out cloth from a heap. Its upper height of 0.05 m excludes a cloth that hangs from the gripper \
    after the release: the rim is 0.02 m high, and the centroid of a heap on the table was at most 0.024 m high in 189 \
    episodes of the expert and of PPO. The original holds the cloth by friction alone. Here the four vertices \
    around the fingertips are attached to the hand until the gripper opens automatically or a finger opens by more than \
    5 mm. The release is permanent. The quality of the grasp is not under study. Vertices collide with table, ground and \
    fingers, but the edges between them do not, so a fold may penetrate a corner by less than half the grid spacing. The \
    cloth does not collide with itself, with the hand or, above the grasp, with the fingers. It has no bending stiffness \
    and no air drag; those of the original are small compared with its stretching stiffness and its weight.";

impl Task for ClothPlacing {
    fn definition(&self) -> &'static Definition {
        self.definition
    }

    fn scene(&self) -> Cow<'static, str> {
        self.sheet.fill(include_str!("scene.xml")).into()
    }

    fn notes(&self) -> &'static str {
        include_str!("page.md")
    }

    fn cameras(&self) -> [CameraPlace; 2] {
        [CameraPlace::over([1.5, -0.7, 1.2], [0.53, 0.0, 0.54], 1.15), CameraPlace::WRIST]
    }

    fn bind(&self, model: &Model, panda: &Panda) -> Result<Box<dyn Scene>, WorldError> {
        Ok(Box::new(BoundScene {
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

struct BoundScene {
    panda: Panda,
    fingers: [Body; 2],
    cloth: Flex,
    pinch: Equality,
    table: Mocap,
    marker: Site,
}

impl BoundScene {
    fn centroid(&self, rows: &Rows<'_>) -> [f64; 3] {
        mean(rows.vertices(self.cloth))
    }

    /// Returns the speed of the centroid, m/s.
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

impl Scene for BoundScene {
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
        let vertices = rows.vertices(self.cloth);
        let marker = rows.site_position(self.marker);
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
        let centroid = self.centroid(rows);
        let marker = rows.site_position(self.marker);
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
                // A thrown cloth passes over the table quickly, but rarely comes to rest at its
                // center.
                out[5] = -0.5 * released * (2.0 * speed).tanh();
                out[6] = crate::reward::action_penalty(action);
            }
        }
    }

    fn is_terminal(&self, rows: &Rows<'_>, _signals: &[f64]) -> bool {
        self.centroid(rows)[2] < 0.1
    }
}

/// Returns the norm of a quaternion minus the 180 degree rotation about x. Both signs are the same
/// orientation.
fn from_pointing_down([w, x, y, z]: [f64; 4]) -> f64 {
    (w * w + (x.abs() - 1.0).powi(2) + y * y + z * z).sqrt()
}
