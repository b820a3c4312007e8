//! Lights of a scene, and automatic placement of the camera.

use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use super::Quality;
use crate::World;
use crate::frame::{add, dot, norm, scale, sub};

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

/// Azimuth, elevation (degrees) and distance (m) of the camera that follows the hand.
pub(super) const CLOSE: ([f64; 2], f64) = ([140.0, -25.0], 0.9);

/// The fraction of bodies that must be visible; otherwise the next direction is tried.
const MIN_VISIBLE: f64 = 0.7;

/// The margin around the scene, as a fraction of the distance.
const MARGIN: f64 = 0.04;

/// The number of iterations of the camera placement. More do not change the image visibly.
const ITERATIONS: usize = 20;

/// Anything farther from the robot's base is ignored, for example a ball that rolled away, m.
const FAR: f64 = 2.0;

/// Number of lights of a fine picture, and radius of the disk of their directions, rad. OpenGL has
/// eight lights; the camera has one of them. Each light costs as much as half a picture with one.
const LIGHTS: usize = 4;
const LIGHT_RADIUS: f64 = 0.025;

/// Horizontal direction of the light per meter of fall, and the point of the ground on its axis, m.
const LIGHT_SLOPE: [f64; 2] = [-0.35, 0.3];
const LIT_POINT: [f64; 2] = [0.345, 0.09];

/// Height of the lights, m.
const LIGHT_HEIGHT: f64 = 3.3;

/// Returns lights with these slopes that together are as bright as one light. Their shadows
/// overlap, and the edges fade.
fn lights(quality: Quality) -> String {
    let count = if quality == Quality::Fine { LIGHTS } else { 1 };
    let light = |i: usize| {
        // Points of a spiral that cover a disk evenly (Vogel, 1979).
        let turn = std::f64::consts::PI * (3.0 - 5_f64.sqrt()) * i as f64;
        let radius = match count {
            1 => 0.0,
            _ => LIGHT_RADIUS * ((i as f64 + 0.5) / count as f64).sqrt(),
        };
        let slope = [LIGHT_SLOPE[0] + radius * turn.cos(), LIGHT_SLOPE[1] + radius * turn.sin()];
        let [x, y] = [0, 1].map(|axis| LIT_POINT[axis] - LIGHT_HEIGHT * slope[axis]);
        let (diffuse, specular) = (0.5 / count as f64, 0.15 / count as f64);
        format!(
            r#"<light directional="true" pos="{x:.6} {y:.6} {LIGHT_HEIGHT}" dir="{:.6} {:.6} -1" diffuse="{diffuse} {diffuse} {diffuse}" specular="{specular} {specular} {specular}"/>
  "#,
            slope[0], slope[1],
        )
    };
    (0..count).map(light).collect()
}

/// Adds lights, a sky, a frame buffer for this image size and, if missing, a ground plane to the
/// document.
pub(super) fn with_lights(
    document: &str,
    [width, height]: [u32; 2],
    quality: Quality,
    has_ground: bool,
) -> String {
    // The area of the shadows around the lit point, m (ground outside of it has stripes), and the
    // size of their map, pixels.
    let (shadow_radius, scale) = (3.2, if quality == Quality::Fine { 2 } else { 3 });
    let shadow_size = (scale * width.max(height)).next_power_of_two().clamp(256, 4096);
    let ground = if has_ground {
        ""
    } else {
        r#"<geom type="plane" size="2 2 0.1" contype="0" conaffinity="0" rgba="0.86 0.87 0.88 1"/>"#
    };
    let additions = format!(
        r#"
<visual>
  <global offwidth="{width}" offheight="{height}" fovy="32"/>
  <headlight ambient="0.42 0.42 0.42" diffuse="0.28 0.28 0.28" specular="0.05 0.05 0.05"/>
  <quality shadowsize="{shadow_size}" offsamples="4"/>
  <map znear="0.05" zfar="12" shadowclip="{shadow_radius}"/>
</visual>
<statistic extent="1"/>
<asset>
  <texture type="skybox" builtin="gradient" rgb1="0.94 0.96 0.98" rgb2="1 1 1" width="64" height="384"/>
</asset>
<worldbody>
  {}{ground}
</worldbody>
</mujoco>"#,
        lights(quality),
    );
    document.trim_end().strip_suffix("</mujoco>").unwrap_or(document).to_string() + &additions
}

/// Appends the corners of the bounding boxes of all shapes except planes, and the vertices of
/// cloths.
pub(super) fn corners(world: &World, out: &mut Vec<[f64; 3]>) {
    let (model, data) = (&world.model().inner, &world.data);
    let kept = |p: &[f64; 3]| norm(*p) < FAR;
    for (geom, kind) in model.geom_type().iter().enumerate() {
        if *kind == MjtGeomBase::mjGEOM_PLANE {
            continue;
        }
        let (bounds, at, turn) = (model.geom_aabb()[geom], data.geom_xpos()[geom], data.geom_xmat()[geom]);
        for corner in 0..8 {
            let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
            let local: [f64; 3] = std::array::from_fn(|i| bounds[i] + sign(i) * bounds[3 + i]);
            let turned = [0, 3, 6]
                .map(|row| turn[row] * local[0] + turn[row + 1] * local[1] + turn[row + 2] * local[2]);
            out.extend(Some(add(at, turned)).filter(kept));
        }
    }
    out.extend(data.flexvert_xpos().iter().copied().filter(kept));
}

/// The placement of a camera.
#[derive(Clone, Copy, Debug)]
pub(super) struct View {
    /// Azimuth and elevation, degrees.
    pub direction_deg: [f64; 2],
    pub center: [f64; 3],
    pub distance: f64,
}

/// Returns the first view of the points from which enough bodies are visible in the current state,
/// or the view with the most visible bodies.
pub(super) fn best(world: &mut World, points: &[[f64; 3]], groups: &[u8; 6], fovy: f64, aspect: f64) -> View {
    let mut best = (f64::NEG_INFINITY, None);
    for azimuth_deg in AZIMUTHS_DEG {
        let view = fit(points, [azimuth_deg, ELEVATION_DEG], fovy, aspect);
        let eye = sub(view.center, scale(forward(view.direction_deg), view.distance));
        let visible = visible_fraction(world, eye, groups);
        if visible > best.0 {
            best = (visible, Some(view));
        }
        if visible >= MIN_VISIBLE {
            break;
        }
    }
    let direction_deg = [AZIMUTHS_DEG[0], ELEVATION_DEG];
    let straight = View { direction_deg, center: [0.0; 3], distance: 1.0 };
    best.1.unwrap_or(straight)
}

/// Returns the fraction of bodies with at least one shape whose center is visible from `eye`.
fn visible_fraction(world: &mut World, eye: [f64; 3], groups: &[u8; 6]) -> f64 {
    let model = world.model().clone();
    let bodies = model.inner.geom_bodyid();
    let (mut there, mut found) = (vec![false; model.inner.nbody() as usize], Vec::new());
    for (geom, kind) in model.inner.geom_type().iter().enumerate() {
        let is_shown = groups.get(model.inner.geom_group()[geom] as usize).is_some_and(|shown| *shown != 0);
        let body = bodies[geom] as usize;
        if *kind == MjtGeomBase::mjGEOM_PLANE || body == 0 || !is_shown {
            continue;
        }
        there[body] = true;
        let direction = sub(world.data.geom_xpos()[geom], eye);
        let (hit, _) = world.data.ray(&eye, &direction, Some(groups), true, None, None);
        if hit.is_some_and(|hit| bodies[hit] as usize == body) && !found.contains(&body) {
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
    let forward = forward(direction_deg);
    let (sin, cos) = direction_deg[0].to_radians().sin_cos();
    let right = [sin, -cos, 0.0];
    let up = crate::frame::cross(right, forward);
    let middle = |along: &dyn Fn([f64; 3]) -> f64| {
        let values = || points.iter().map(|p| along(*p));
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        if low <= high { 0.5 * (low + high) } else { 0.0 }
    };
    let mut center = [right, up, forward]
        .iter()
        .fold([0.0; 3], |sum, axis| add(sum, scale(*axis, middle(&|p| dot(p, *axis)))));
    let (vertical, horizontal) = ((0.5 * fovy).tan(), (0.5 * fovy).tan() * aspect);
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
mod tests {
    use super::*;

    #[test]
    fn the_lights_of_a_fine_picture_are_together_as_bright_as_one() {
        let one = lights(Quality::Fast);
        assert!(
            one.contains(r#"pos="1.500000 -0.900000 3.3" dir="-0.350000 0.300000 -1" diffuse="0.5 0.5 0.5""#),
            "{one}"
        );
        let several = lights(Quality::Fine);
        assert_eq!(several.matches("<light").count(), 4);
        assert_eq!(several.matches(r#"diffuse="0.125 0.125 0.125""#).count(), 4);
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
