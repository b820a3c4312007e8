//! Arrows at the contact points of a picture.

use crate::World;
use crate::frame::{add, norm, scale, sub};

/// Largest number of marked contacts. A picture with more, such as that of a cloth, shows those
/// with the largest forces.
const MOST: usize = 64;

/// Largest number of arrows of a picture.
#[cfg(feature = "render")]
pub(super) const ARROWS: u32 = 2 * MOST as u32;

/// Smallest force with an arrow, N.
const LEAST_FORCE: f64 = 0.2;

/// Length of an arrow per force, m/N, and its bounds, m.
const LENGTH: f64 = 0.000_25;
const LENGTHS: [f64; 2] = [0.01, 0.125];

/// Place of the arrows between the camera and their points, as a fraction of the distance. So close
/// to the camera nothing hides them, and they look as if they were at the points.
const CLOSENESS: f64 = 0.15;

/// Radius of the shaft of an arrow at its contact point, m.
const RADIUS: f64 = 0.002;

/// A force at a contact point, in world axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactForce {
    pub point: [f64; 3],
    /// Force on one of the two bodies, N.
    pub force: [f64; 3],
}

/// An arrow that marks a contact, before everything else in the image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrow {
    /// Its start, m.
    pub from: [f64; 3],
    /// Its tip, m.
    pub to: [f64; 3],
}

impl Arrow {
    /// Radius of the shaft, m.
    pub const RADIUS: f64 = CLOSENESS * RADIUS;

    /// Color, which light does not change: red, green, blue.
    pub const COLOR: [f32; 3] = [0.9, 0.15, 0.05];
}

/// Returns the forces at the contact points of the last evaluation of the dynamics, largest first.
pub(super) fn forces(world: &World) -> Vec<ContactForce> {
    let mut found: Vec<ContactForce> = (world.data.contact().iter().enumerate())
        .filter_map(|(index, contact)| {
            let local = world.data.try_contact_force(index).ok()?;
            // The rows of the frame are the axes of the contact in world axes.
            let axis = |row: usize| -> [f64; 3] { std::array::from_fn(|i| contact.frame[3 * row + i]) };
            let force = (0..3).fold([0.0; 3], |sum, row| add(sum, scale(axis(row), local[row])));
            Some(ContactForce { point: contact.pos, force })
        })
        .collect();
    found.sort_by(|a, b| norm(b.force).total_cmp(&norm(a.force)));
    found
}

/// Returns the arrows of these forces as a camera at `eye` sees them. Two arrows leave each point,
/// because both bodies feel the force.
pub(super) fn arrows(forces: &[ContactForce], eye: [f64; 3]) -> Vec<Arrow> {
    let closer = |point: [f64; 3]| add(eye, scale(sub(point, eye), CLOSENESS));
    let is_large = |found: &&ContactForce| norm(found.force) >= LEAST_FORCE;
    let of_force = |ContactForce { point, force }: &ContactForce| {
        let size = norm(*force);
        let way = scale(*force, (LENGTH * size).clamp(LENGTHS[0], LENGTHS[1]) / size);
        [add(*point, way), sub(*point, way)].map(|end| Arrow { from: closer(*point), to: closer(end) })
    };
    forces.iter().take(MOST).take_while(is_large).flat_map(of_force).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::Model;

    #[test]
    fn a_ball_at_rest_has_one_mark_with_its_weight_at_its_lowest_point() {
        let scene = r#"<mujoco><option gravity="0 0 -10" timestep="0.002"/><worldbody>
            <geom type="plane" size="1 1 0.1"/>
            <body pos="0.2 0.1 0.05"><freejoint/><geom size="0.05" mass="0.5"/></body>
            </worldbody></mujoco>"#;
        let model = Model::from_xml(scene).unwrap();
        let mut world = model.world();
        (0..2000).for_each(|_| world.step());
        world.data.forward();
        let found = forces(&world);
        assert_eq!(found.len(), 1);
        assert!((norm(found[0].force) - 5.0).abs() < 1e-3, "{:?}", found[0].force);
        let [x, y, z] = found[0].point;
        assert!((x - 0.2).abs() < 1e-3 && (y - 0.1).abs() < 1e-3 && z.abs() < 1e-3, "{:?}", found[0].point);
        // The larger force has the longer arrow: 0.05 m to each side for 200 N.
        let large = ContactForce { force: [0.0, 0.0, 200.0], ..found[0] };
        let eye = [x + 2.0, y, z];
        let [up, down] = arrows(&[large], eye)[..] else { panic!("an arrow to each side") };
        let expected = Arrow { from: [x + 1.7, y, z], to: [x + 1.7, y, z + 0.0075] };
        assert!(norm(sub(up.from, expected.from)) < 1e-12 && norm(sub(up.to, expected.to)) < 1e-12);
        assert!(norm(sub(down.to, [x + 1.7, y, z - 0.0075])) < 1e-12);
        assert_eq!(arrows(&[ContactForce { force: [0.0, 0.1, 0.0], ..large }], eye), []);
    }
}
