//! Contact forces between the parts of a robot and of its scene, in the physics step just taken.

use mujoco_rs::prelude::MjtObjBase;
use mujoco_rs::wrappers::mj_model::MjtGeomBase;

use crate::{Model, World, WorldError};

/// A part of the robot or of the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// The fingers of the hand.
    Fingers,
    /// The rest of the robot, and what is fixed to it.
    Arm,
    /// The object that the robot manipulates.
    Object,
    /// The ground: planes that are fixed to the world.
    Ground,
    /// All else.
    Fixture,
}

impl Part {
    /// All parts.
    pub const ALL: [Part; 5] = [Part::Fingers, Part::Arm, Part::Object, Part::Ground, Part::Fixture];
}

/// The part of each geom and of each flex of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PartMap {
    geoms: Vec<Part>,
    flexes: Vec<Part>,
}

/// Sums of the normal forces at the contact points between each pair of parts, N.
///
/// Only pairs with the robot or with the object are summed. Forces at several points add up, also
/// if they oppose each other: a pinch with 10 N on each side is 20 N.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartForces([[f64; Part::ALL.len()]; Part::ALL.len()]);

impl PartForces {
    /// Returns the force between two parts, N.
    pub fn between(&self, a: Part, b: Part) -> f64 {
        self.0[a.min(b) as usize][a.max(b) as usize]
    }

    /// Adds a force between two parts, N.
    pub fn add(&mut self, a: Part, b: Part, force: f64) {
        self.0[a.min(b) as usize][a.max(b) as usize] += force;
    }
}

impl Model {
    /// Returns the part of each shape. `object` is the name of a body, which counts with all that
    /// is attached to it, or of a flex.
    ///
    /// # Errors
    /// If the robot, or a body or flex with the name `object`, is missing.
    pub fn part_map(&self, object: Option<&str>) -> Result<PartMap, WorldError> {
        let model = &*self.inner;
        let robot = self.body("link0")?.index();
        let fingers = [self.body("left_finger")?.index(), self.body("right_finger")?.index()];
        let flex = object.and_then(|name| model.name_to_id(MjtObjBase::mjOBJ_FLEX, name));
        let object = match (object, flex) {
            (Some(name), None) => Some(self.body(name)?.index()),
            _ => None,
        };
        let is_vertex = |body: usize| {
            flex.is_some_and(|flex| {
                let vertices = &model.flex_vertbodyid()[model.flex_vertadr()[flex] as usize..];
                vertices[..model.flex_vertnum()[flex] as usize].contains(&(body as i32))
            })
        };
        let is_object = |body: usize| {
            let mut above =
                std::iter::successors(Some(body), |body| Some(model.body_parentid()[*body] as usize))
                    .take_while(|body| *body > 0);
            is_vertex(body) || above.any(|body| Some(body) == object)
        };
        let part = |(geom, kind): (usize, &MjtGeomBase)| {
            let body = model.geom_bodyid()[geom] as usize;
            if is_object(body) {
                Part::Object
            } else if fingers.contains(&body) {
                Part::Fingers
            } else if model.body_rootid()[body] as usize == robot {
                Part::Arm
            } else if model.body_weldid()[body] == 0 && *kind == MjtGeomBase::mjGEOM_PLANE {
                Part::Ground
            } else {
                Part::Fixture
            }
        };
        let of_flex = |index: usize| if Some(index) == flex { Part::Object } else { Part::Fixture };
        Ok(PartMap {
            geoms: model.geom_type().iter().enumerate().map(part).collect(),
            flexes: (0..model.nflex() as usize).map(of_flex).collect(),
        })
    }
}

impl PartMap {
    /// Returns the part of each geom.
    pub fn geoms(&self) -> &[Part] {
        &self.geoms
    }

    /// Returns the part of each flex.
    pub fn flexes(&self) -> &[Part] {
        &self.flexes
    }

    /// Returns the parts of a contact between these geoms, or flexes where a geom is negative.
    fn parts(&self, geoms: [i32; 2], flexes: [i32; 2]) -> Option<[Part; 2]> {
        let part = |side: usize| match usize::try_from(geoms[side]) {
            Ok(geom) => self.geoms.get(geom).copied(),
            Err(_) => self.flexes.get(usize::try_from(flexes[side]).ok()?).copied(),
        };
        let a = part(0)?;
        let b = part(1)?;
        Some([a.min(b), a.max(b)])
    }
}

impl World {
    /// Returns the contact forces of the last [`step`](Self::step). `map` is that of the model, or
    /// of a model with the same document.
    ///
    /// The forces acted during that step; computing them changes nothing.
    pub fn part_forces(&self, map: &PartMap) -> PartForces {
        let mut forces = PartForces::default();
        for (index, contact) in self.data.contact().iter().enumerate() {
            let Some([a, b]) = map.parts(contact.geom, contact.flex) else { continue };
            // What the scene does to itself is not the robot's.
            if a <= Part::Object
                && let Ok([normal, ..]) = self.data.try_contact_force(index)
            {
                forces.add(a, b, normal);
            }
        }
        forces
    }
}
