//! Automatic placement of the camera.

use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use crate::frame::{add, cross, dot, norm, scale, sub};
use crate::{Body, Model, World};

/// The camera directions: at the robot from its front right, slightly from above, or from another
/// corner if bodies are occluded.
const AZIMUTHS_DEG: [f64; 4] = [140.0, -140.0, 40.0, -40.0];
const ELEVATION_DEG: f64 = -22.0;

/// Azimuth and elevation of the cameras with a fixed direction, degrees. The robot faces along x;
/// `left` and `right` are its sides.
pub(super) const DIRECTIONS: [(&str, [f64; 2]); 5] = [
    ("front", [180.0, ELEVATION_DEG]),
    ("left", [-90.0, ELEVATION_DEG]),
    ("right", [90.0, ELEVATION_DEG]),
    ("back", [0.0, ELEVATION_DEG]),
    ("top", [0.0, -89.0]),
];

/// Azimuth and elevation (degrees) and least distance (m) of the camera that follows a body.
pub(super) const CLOSE_DEG: [f64; 2] = [140.0, -25.0];
const CLOSE: f64 = 0.9;

/// The fraction of bodies that must be visible; otherwise the next direction is tried.
const MIN_VISIBLE: f64 = 0.7;

/// The margin around the scene, as a fraction of the distance.
const MARGIN: f64 = 0.04;

/// The number of iterations of the camera placement. More do not change the image visibly.
const ITERATIONS: usize = 20;

/// Anything farther from the base of an arm is ignored, for example a ball that rolled away, m. The
/// distance is larger for a robot that reaches farther.
const FAR: f64 = 2.0;

/// Where the robot is and how far it reaches; what is near it is in pictures.
#[derive(Clone, Debug)]
pub(super) struct Surroundings {
    /// Top-level bodies of the robot.
    roots: Vec<usize>,
    /// Size of the scene: 1 for an arm, more for a robot that reaches farther.
    scale: f64,
    /// Where the robot is in the initial state of the model.
    start: [f64; 3],
    is_mobile: bool,
}

impl Surroundings {
    pub(super) fn new(model: &Model) -> Surroundings {
        let roots = model.robot_roots();
        let is_mobile = model.inner.jnt_bodyid().iter().any(|body| roots.contains(&(*body as usize)));
        let mut surroundings = Surroundings { roots, scale: 1.0, start: [0.0; 3], is_mobile };
        let mut world = model.world();
        world.data.forward();
        surroundings.start = surroundings.place(&world);
        let mut corners = Vec::new();
        for root in surroundings.roots.iter().filter(|root| **root > 0) {
            let of_tree = |geom: usize| {
                model.inner.body_rootid()[model.inner.geom_bodyid()[geom] as usize] as usize == *root
            };
            let base = world.data.xpos()[*root];
            let geoms = (0..model.inner.ngeom() as usize).filter(|geom| of_tree(*geom));
            geoms.for_each(|geom| corners.extend(box_of(&world, geom).map(|corner| sub(corner, base))));
        }
        let reach = corners.into_iter().map(norm).fold(0.0, f64::max);
        surroundings.scale = (reach / FAR).max(1.0);
        surroundings
    }

    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    pub(super) fn start(&self) -> [f64; 3] {
        self.start
    }

    /// Returns whether the base of the robot moves.
    pub(super) fn is_mobile(&self) -> bool {
        self.is_mobile
    }

    /// Returns the distance beyond which things are not near the robot, m.
    pub(super) fn radius(&self) -> f64 {
        FAR * self.scale
    }

    /// Returns where the robot is.
    pub(super) fn place(&self, world: &World) -> [f64; 3] {
        world.data.xpos()[self.roots[0]]
    }

    /// Appends the corners of the bounding boxes of all shapes except planes, and the vertices of
    /// cloths: those of the robot, and those near it.
    pub(super) fn corners(&self, world: &World, out: &mut Vec<[f64; 3]>) {
        let model = &world.model().inner;
        let data = &world.data;
        let is_near = |point: &[f64; 3]| {
            self.roots.iter().any(|root| norm(sub(*point, data.xpos()[*root])) < self.radius())
        };
        for (geom, kind) in model.geom_type().iter().enumerate() {
            if *kind == MjtGeomBase::mjGEOM_PLANE {
                continue;
            }
            let root = model.body_rootid()[model.geom_bodyid()[geom] as usize] as usize;
            let is_robot = root > 0 && self.roots.contains(&root);
            out.extend(box_of(world, geom).into_iter().filter(|corner| is_robot || is_near(corner)));
        }
        out.extend(data.flexvert_xpos().iter().copied().filter(is_near));
    }
}

/// Returns the corners of the bounding box of a geom.
fn box_of(world: &World, geom: usize) -> [[f64; 3]; 8] {
    let data = &world.data;
    let bounds = world.model().inner.geom_aabb()[geom];
    let at = data.geom_xpos()[geom];
    let turn = data.geom_xmat()[geom];
    std::array::from_fn(|corner| {
        let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let local: [f64; 3] = std::array::from_fn(|i| bounds[i] + sign(i) * bounds[3 + i]);
        let turned =
            [0, 3, 6].map(|row| turn[row] * local[0] + turn[row + 1] * local[1] + turn[row + 2] * local[2]);
        add(at, turned)
    })
}

/// Returns the distance from which a camera shows a body and what it carries, m.
pub(super) fn close_distance(model: &Model, body: usize) -> f64 {
    let mut world = model.world();
    world.data.forward();
    let is_part = |geom: &usize| model.is_within(model.body_of_geom(*geom), Body(body));
    let geoms = (0..model.inner.ngeom() as usize).filter(is_part);
    let corners = geoms.flat_map(|geom| box_of(&world, geom));
    let radius = corners.map(|corner| norm(sub(corner, world.data.xpos()[body]))).fold(0.0, f64::max);
    let fovy = f64::from(model.inner.vis().global.fovy).to_radians();
    // A ball around the body fits between the upper and the lower edge.
    (radius / (0.5 * fovy).sin()).max(CLOSE)
}

/// The placement of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// Azimuth and elevation, degrees.
    pub direction_deg: [f64; 2],
    pub center: [f64; 3],
    pub distance: f64,
}

impl View {
    /// The view of the origin from nearby.
    pub(super) const STRAIGHT: View =
        View { direction_deg: [AZIMUTHS_DEG[0], ELEVATION_DEG], center: [0.0; 3], distance: 1.0 };

    /// Returns where the camera is.
    pub(super) fn eye(&self) -> [f64; 3] {
        sub(self.center, scale(forward(self.direction_deg), self.distance))
    }

    /// Returns the directions to the right, upwards and backwards in the image.
    pub(super) fn axes(&self) -> [[f64; 3]; 3] {
        let forward = forward(self.direction_deg);
        let (sin, cos) = self.direction_deg[0].to_radians().sin_cos();
        let right = [sin, -cos, 0.0];
        [right, cross(right, forward), scale(forward, -1.0)]
    }
}

/// Returns the first view of the points from which enough bodies are visible in the current state,
/// or the view with the most visible bodies.
pub(super) fn best(world: &mut World, points: &[[f64; 3]], fovy: f64, aspect: f64) -> View {
    let mut best = (f64::NEG_INFINITY, View::STRAIGHT);
    for azimuth_deg in AZIMUTHS_DEG {
        let view = fit(points, [azimuth_deg, ELEVATION_DEG], fovy, aspect);
        let visible = visible_fraction(world, view.eye());
        if visible > best.0 {
            best = (visible, view);
        }
        if visible >= MIN_VISIBLE {
            break;
        }
    }
    best.1
}

/// Returns the fraction of bodies with at least one shape whose center is visible from `eye`.
fn visible_fraction(world: &mut World, eye: [f64; 3]) -> f64 {
    let model = world.model().clone();
    let bodies = model.inner.geom_bodyid();
    let groups = model.drawn_groups();
    let mut there = vec![false; model.inner.nbody() as usize];
    let mut found = Vec::new();
    for (geom, kind) in model.inner.geom_type().iter().enumerate() {
        let is_shown = groups.get(model.inner.geom_group()[geom] as usize).is_some_and(|shown| *shown);
        let body = bodies[geom] as usize;
        if *kind == MjtGeomBase::mjGEOM_PLANE || body == 0 || !is_shown {
            continue;
        }
        there[body] = true;
        let direction = sub(world.data.geom_xpos()[geom], eye);
        let hit = world.ray(eye, direction);
        if hit.is_some_and(|(hit, _)| bodies[hit] as usize == body) && !found.contains(&body) {
            found.push(body);
        }
    }
    found.len() as f64 / there.iter().filter(|there| **there).count().max(1) as f64
}

/// Returns the viewing direction of a camera.
fn forward(direction_deg: [f64; 2]) -> [f64; 3] {
    let [azimuth, elevation] = direction_deg.map(f64::to_radians);
    [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()]
}

/// Places a camera with this direction so that all points are in the image and centered.
pub(super) fn fit(points: &[[f64; 3]], direction_deg: [f64; 2], fovy: f64, aspect: f64) -> View {
    let [right, up, back] = View { direction_deg, ..View::STRAIGHT }.axes();
    let forward = scale(back, -1.0);
    let middle = |along: &dyn Fn([f64; 3]) -> f64| {
        let values = || points.iter().map(|p| along(*p));
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        if low <= high { 0.5 * (low + high) } else { 0.0 }
    };
    let mut center = [right, up, forward]
        .iter()
        .fold([0.0; 3], |sum, axis| add(sum, scale(*axis, middle(&|p| dot(p, *axis)))));
    let vertical = (0.5 * fovy).tan();
    let horizontal = (0.5 * fovy).tan() * aspect;
    let mut distance = 1.0;
    for _ in 0..ITERATIONS {
        let needed = points.iter().map(|p| {
            let offset = sub(*p, center);
            let beside = (dot(offset, right).abs() / horizontal).max(dot(offset, up).abs() / vertical);
            beside - dot(offset, forward)
        });
        distance = (1.0 + MARGIN) * needed.fold(0.5, f64::max);
        // Perspective: the center in the image differs from the center in space.
        for axis in [right, up] {
            let middle = middle(&|p| {
                let offset = sub(p, center);
                dot(offset, axis) / (distance + dot(offset, forward))
            });
            center = add(center, scale(axis, middle * distance));
        }
    }
    View { direction_deg, center, distance }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// Returns a robot of this length at `offset`, with a block beside it and one 30 m away.
    fn scene([x, y, z]: [f64; 3], length: f64) -> Model {
        let block =
            |from: f64| format!(r#"<geom type="box" size="0.1 0.1 0.1" pos="{} {y} {z}"/>"#, x + from);
        let robot = format!(
            r#"<body pos="{x} {y} {z}"><joint name="lift" type="slide" axis="0 0 1"/>
            <geom type="box" size="0.1 0.1 {}"/></body>"#,
            length / 2.0
        );
        let actuator = r#"<actuator><motor joint="lift"/></actuator>"#;
        let near = block(0.5);
        let far = block(30.0);
        let xml = format!("<mujoco><worldbody>{near}{far}{robot}</worldbody>{actuator}</mujoco>");
        Model::from_xml(&xml).unwrap()
    }

    #[test]
    fn what_is_near_a_robot_is_in_its_pictures_wherever_it_is() {
        let corners = |offset: [f64; 3]| {
            let model = scene(offset, 1.0);
            let mut world = model.world();
            let mut corners = Vec::new();
            world.data.forward();
            Surroundings::new(&model).corners(&world, &mut corners);
            corners
        };
        let first = corners([0.0; 3]);
        // Those of the robot and of the block beside it.
        assert_eq!(first.len(), 16);
        for offset in [[5.0, 0.0, 0.0], [-40.0, 7.0, 2.0]] {
            for (moved, corner) in corners(offset).into_iter().zip(&first) {
                assert!(norm(sub(moved, add(*corner, offset))) < 1e-9);
            }
        }
    }

    #[test]
    fn the_scale_of_a_scene_is_that_of_its_robot() {
        let scale = |length: f64| Surroundings::new(&scene([9.0, 0.0, 0.0], length)).scale();
        assert_eq!(scale(1.0), 1.0);
        // Its corners are (0.1, 0.1, 6) from its base.
        assert!((scale(12.0) - 36.02_f64.sqrt() / 2.0).abs() < 1e-9);
    }

    #[test]
    fn a_camera_shows_a_body_with_what_it_carries() {
        // The camera of a model sees 45 degrees by default.
        let sin = 22.5_f64.to_radians().sin();
        assert!((close_distance(&scene([9.0, 0.0, 0.0], 12.0), 1) - 36.02_f64.sqrt() / sin).abs() < 1e-9);
        assert_eq!(close_distance(&scene([9.0, 0.0, 0.0], 0.2), 1), CLOSE);
    }

    #[test]
    fn the_field_of_view_determines_the_distance() {
        // Two points 2 m apart across the view: each is 1 m from the center, at half of 90 degrees
        // from a distance of 1 m.
        let azimuth = AZIMUTHS_DEG[0].to_radians();
        let right = [azimuth.sin(), -azimuth.cos(), 0.0];
        let fovy = std::f64::consts::FRAC_PI_2;
        let points = [right, scale(right, -1.0)];
        let fit = |aspect| fit(&points, [AZIMUTHS_DEG[0], ELEVATION_DEG], fovy, aspect);
        assert!(norm(fit(1.0).center) < 1e-12);
        assert!((fit(1.0).distance - (1.0 + MARGIN)).abs() < 1e-12);
        // An image twice as wide as high needs half the distance.
        assert!((fit(2.0).distance - 0.5 * (1.0 + MARGIN)).abs() < 1e-12);
    }

    #[test]
    fn a_camera_from_above_fits_what_is_horizontal() {
        // The long side of 2 m is along y, across the image of a camera that looks down with the
        // robot's front at the top.
        let points = [[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]];
        let view = fit(&points, [0.0, -90.0], std::f64::consts::FRAC_PI_2, 2.0);
        assert!((view.distance - 0.5 * (1.0 + MARGIN)).abs() < 1e-12, "{view:?}");
    }
}
