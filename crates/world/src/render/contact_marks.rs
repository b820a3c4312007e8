//! Arrows at the contact points of a picture.

use mujoco_rs::prelude::*;
use mujoco_rs::wrappers::mj_visualization::MjvScene;

use crate::World;
use crate::frame::{add, norm, scale, sub};

/// Largest number of marked contacts. A picture with more, such as that of a cloth, shows those
/// with the largest forces.
const MOST: usize = 64;

/// Number of arrows that a scene must hold.
pub(super) const ARROWS: u32 = 2 * MOST as u32;

/// Smallest force with an arrow, N.
const LEAST_FORCE: f64 = 0.2;

/// Length of an arrow per force, m/N, and its bounds, m.
const LENGTH: f64 = 0.001;
const LENGTHS: [f64; 2] = [0.04, 0.5];

/// Place of the arrows between the camera and their points, as a fraction of the distance. So close
/// to the camera nothing hides them, and they look as if they were at the points.
const CLOSENESS: f64 = 0.15;

/// Radius of an arrow's shaft, m, and color.
const RADIUS: f64 = 0.006;
const COLOR: [f32; 4] = [0.9, 0.15, 0.05, 1.0];

/// A force at a contact point, in world axes.
pub(super) struct ContactForce {
    pub point: [f64; 3],
    /// Force on one of the two bodies, N.
    pub force: [f64; 3],
}

/// Returns the forces at the contact points of the last evaluation of the dynamics, largest first.
pub(super) fn contact_forces(world: &World) -> Vec<ContactForce> {
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

/// Replaces the arrows of a scene by those of these forces, as a camera at `eye` sees them. Two
/// arrows leave each point, because both bodies feel the force.
pub(super) fn draw(forces: &[ContactForce], eye: [f64; 3], scene: &mut MjvScene) {
    let closer = |point: [f64; 3]| add(eye, scale(sub(point, eye), CLOSENESS));
    scene.clear_geom();
    for ContactForce { point, force } in forces.iter().take(MOST) {
        let size = norm(*force);
        if size < LEAST_FORCE {
            break;
        }
        let length = (LENGTH * size).clamp(LENGTHS[0], LENGTHS[1]);
        let half = scale(*force, 0.5 * length / size);
        for end in [add(*point, half), sub(*point, half)] {
            // SAFETY: the arrow refers to no element of the model: it has no texture and no mesh.
            #[allow(unsafe_code)]
            let arrow =
                unsafe { scene.try_create_geom(MjtGeom::mjGEOM_ARROW, None, None, None, Some(COLOR)) };
            if let Ok(arrow) = arrow {
                // Shadows of the scene do not darken it.
                arrow.emission = 1.0;
                arrow.connect(CLOSENESS * RADIUS, closer(*point), closer(end));
            }
        }
    }
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
        let found = contact_forces(&world);
        assert_eq!(found.len(), 1);
        assert!((norm(found[0].force) - 5.0).abs() < 1e-3, "{:?}", found[0].force);
        let [x, y, z] = found[0].point;
        assert!((x - 0.2).abs() < 1e-3 && (y - 0.1).abs() < 1e-3 && z.abs() < 1e-3, "{:?}", found[0].point);
        let mut scene = MjvScene::new(&model.inner, ARROWS as usize);
        draw(&found, [2.0, 0.0, 1.0], &mut scene);
        assert_eq!(scene.ffi().ngeom, 2, "an arrow to each side");
        draw(&[], [2.0, 0.0, 1.0], &mut scene);
        assert_eq!(scene.ffi().ngeom, 0);
    }
}
