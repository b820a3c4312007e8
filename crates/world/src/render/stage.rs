//! A scene in a state as people look at it: where the camera is, and the contacts that are marked.

use mujoco_rs::wrappers::mj_model::{MjtGeomBase, MjtObjBase, MjtProjection};

use super::contacts::{self, Arrow, ContactForce};
use super::view::{self, Surroundings, View};
use super::{CAMERAS, PictureModel, Size};
use crate::frame::{add, norm, sub};
use crate::shapes::{Geom, GeomKind};
use crate::{Body, ElementKind, Model, World, WorldError};

/// The name of a scene's own camera.
const CAMERA: &str = "view";

/// The camera that follows a body.
const FOLLOWING: &str = "close";

/// Vertical field of view of the cameras that are not of the scene, degrees.
pub(super) const FOVY_DEG: f64 = 32.0;

/// Color of the ground of a scene without one.
const GROUND: [f32; 4] = [0.86, 0.87, 0.88, 1.0];

/// States of one scene, and a camera that shows them.
///
/// If the scene has a camera named `view`, that camera is used. Otherwise the camera is placed
/// automatically, so that the whole scene is in the image and few bodies are occluded.
#[derive(Debug)]
pub struct Stage {
    pub(super) world: World,
    pub(super) placement: Placement,
    surroundings: Surroundings,
    /// Width of an image over its height.
    aspect: f64,
    /// The camera moves along if the robot moves far: where the robot is in the first state.
    along: Option<[f64; 3]>,
    framed: View,
    /// The view of the current state.
    pub(super) view: View,
    marks_contacts: bool,
    contacts: Vec<ContactForce>,
}

/// How the camera is placed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Placement {
    /// The camera of the scene with this index.
    Scene(usize),
    /// From the corner from which enough bodies are visible.
    Auto,
    /// From this direction: azimuth and elevation, degrees.
    Direction([f64; 2]),
    /// Around this body, in each state, from this distance, m.
    Follow { body: usize, distance: f64 },
}

/// Where a camera is, in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// Position, m.
    pub position: [f64; 3],
    /// Directions to the right, upwards and backwards in its images.
    pub axes: [[f64; 3]; 3],
    /// Vertical field of view, degrees.
    pub fovy_deg: f64,
}

impl Stage {
    /// Makes the stage of a scene, for images of this size.
    ///
    /// `camera` is one of [`CAMERAS`] or a camera of the scene.
    ///
    /// # Errors
    /// If there is no such camera or body to follow.
    pub fn new(model: &Model, picture: &PictureModel, size: Size, camera: &str) -> Result<Stage, WorldError> {
        Ok(Stage {
            world: model.world(),
            placement: placement(model, camera, picture.follows.as_deref())?,
            surroundings: Surroundings::new(model),
            aspect: f64::from(size.width()) / f64::from(size.height()),
            along: None,
            framed: View::STRAIGHT,
            view: View::STRAIGHT,
            marks_contacts: false,
            contacts: Vec::new(),
        })
    }

    /// Returns the ground plane that pictures of the scene have beside its shapes: none if it has a
    /// plane.
    pub fn ground(&self) -> Option<Geom> {
        ground(self.world.model(), &self.surroundings)
    }

    /// Marks the contact points of the following states.
    pub fn mark_contacts(&mut self) {
        self.marks_contacts = true;
    }

    /// Returns the largest force at a contact point of the current state, N; 0 without marks.
    pub fn largest_contact(&self) -> f64 {
        self.contacts.first().map_or(0.0, |largest| norm(largest.force))
    }

    /// Places the camera so that everything near the robot is in the image in all of these states.
    /// If the robot moves farther than it reaches, the camera moves along. A scene's own camera and
    /// the one that follows a body are unchanged.
    ///
    /// # Panics
    /// If a state is shorter than [`Model::state_size`].
    pub fn frame<'a>(&mut self, states: impl IntoIterator<Item = &'a [f64]>) {
        if matches!(self.placement, Placement::Scene(_) | Placement::Follow { .. }) {
            return;
        }
        let mut points = Vec::new();
        let mut first = None;
        let mut places = Vec::new();
        for state in states {
            first = first.or(Some(state));
            self.set(state);
            let mut near = Vec::new();
            self.surroundings.corners(&self.world, &mut near);
            points.push(near);
            places.push(self.place());
        }
        let start = places.first().copied().unwrap_or_default();
        let is_far = places.iter().any(|place| norm(sub(*place, start)) > self.surroundings.radius());
        self.along = is_far.then_some(start);
        let moved = |place: [f64; 3]| if is_far { sub(place, start) } else { [0.0; 3] };
        let points = points.into_iter().zip(places);
        let corners: Vec<[f64; 3]> = points
            .flat_map(|(near, place)| near.into_iter().map(move |point| sub(point, moved(place))))
            .collect();
        if let Some(first) = first {
            self.set(first);
        }
        let fovy = FOVY_DEG.to_radians();
        self.framed = match self.placement {
            Placement::Direction(direction_deg) => view::fit(&corners, direction_deg, fovy, self.aspect),
            _ => view::best(&mut self.world, &corners, fovy, self.aspect),
        };
    }

    /// Shows a state.
    ///
    /// # Panics
    /// If the state is shorter than [`Model::state_size`].
    pub fn show(&mut self, state: &[f64]) {
        self.set(state);
        self.view = match (self.placement, self.along) {
            (Placement::Follow { body, distance }, _) => {
                let center = self.world.data.xpos()[body];
                View { direction_deg: view::CLOSE_DEG, center, distance }
            }
            (_, Some(start)) => {
                View { center: add(self.framed.center, sub(self.place(), start)), ..self.framed }
            }
            (_, None) => self.framed,
        };
        if self.marks_contacts {
            self.contacts = contacts::forces(&self.world);
        }
    }

    fn set(&mut self, state: &[f64]) {
        self.world.set_state(state);
        self.world.data.forward();
    }

    /// Returns where the robot is.
    pub(super) fn place(&self) -> [f64; 3] {
        self.surroundings.place(&self.world)
    }

    /// Returns where the camera is in the current state. An orthographic camera of the scene
    /// becomes one with `FOVY_DEG`.
    pub fn viewpoint(&self) -> Viewpoint {
        let Placement::Scene(camera) = self.placement else {
            let axes = self.view.axes();
            return Viewpoint { position: self.view.eye(), axes, fovy_deg: FOVY_DEG };
        };
        let model = &self.world.model().inner;
        let data = &self.world.data;
        let turn = data.cam_xmat()[camera];
        let is_perspective = model.cam_projection()[camera] == MjtProjection::mjPROJ_PERSPECTIVE;
        Viewpoint {
            position: data.cam_xpos()[camera],
            axes: [0, 1, 2].map(|axis| [turn[axis], turn[3 + axis], turn[6 + axis]]),
            fovy_deg: if is_perspective { model.cam_fovy()[camera] } else { FOVY_DEG },
        }
    }

    /// Returns the place (m) of each marked contact of the current state, and the force on one of
    /// the two bodies (N), in world axes, the largest first.
    pub fn contacts(&self) -> impl Iterator<Item = [[f64; 3]; 2]> {
        self.contacts.iter().map(|contact| [contact.point, contact.force])
    }

    /// Returns the arrows that mark contacts, as the camera sees them.
    pub fn arrows(&self) -> Vec<Arrow> {
        contacts::arrows(&self.contacts, self.viewpoint().position)
    }
}

/// Returns the ground plane of a scene without a plane.
pub(super) fn ground(model: &Model, surroundings: &Surroundings) -> Option<Geom> {
    let has_plane = model.inner.geom_type().contains(&MjtGeomBase::mjGEOM_PLANE);
    let [x, y, _] = surroundings.start();
    let side = if surroundings.is_mobile() { 0.0 } else { 2.0 * surroundings.scale() };
    (!has_plane).then_some(Geom {
        body: Body(0),
        kind: GeomKind::Plane,
        size: [side, side, 0.1],
        position: [x, y, 0.0],
        quaternion: [1.0, 0.0, 0.0, 0.0],
        is_drawn: true,
        color: GROUND,
        specular: 0.5,
        shininess: 0.5,
        emission: 0.0,
    })
}

/// Finds a camera by its name.
fn placement(model: &Model, name: &str, follows: Option<&str>) -> Result<Placement, WorldError> {
    if let Some((_, direction_deg)) = view::DIRECTIONS.iter().find(|(known, _)| *known == name) {
        return Ok(Placement::Direction(*direction_deg));
    }
    let own = if name == CAMERAS[0] { CAMERA } else { name };
    match (model.inner.name_to_id(MjtObjBase::mjOBJ_CAMERA, own), name) {
        (_, FOLLOWING) => {
            let body = follows.map(|name| model.body(name)).transpose()?;
            let body = body.unwrap_or_else(|| model.followed_body()).0;
            Ok(Placement::Follow { body, distance: view::close_distance(model, body) })
        }
        (Some(id), _) => Ok(Placement::Scene(id)),
        (None, name) if name == CAMERAS[0] => Ok(Placement::Auto),
        (None, name) => {
            let own = model.names(ElementKind::Camera);
            let known = CAMERAS.into_iter().map(str::to_string).chain(own).collect();
            Err(WorldError::Element { kind: "camera", name: name.to_string(), known })
        }
    }
}
