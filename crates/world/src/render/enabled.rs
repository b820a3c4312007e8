use std::fmt;
use std::sync::Arc;

use mujoco_rs::prelude::*;
use mujoco_rs::renderer::MjRenderer;
use mujoco_rs::wrappers::mj_model::MjtGeomBase;
use mujoco_rs::wrappers::mj_visualization::{MjvCamera, MjvOption};

use super::contact_marks;
use super::picture::shrink;
use super::view::{self, View};
use super::{CAMERAS, Quality, Size};
use crate::frame::norm;
use crate::{Assets, ElementKind, Model, World, WorldError};

/// The name of a scene's own camera.
const CAMERA: &str = "view";

/// The camera that follows the hand, and the name of its body.
const FOLLOWING: &str = "close";
const HAND: &str = "hand";

/// Groups that are not rendered: the robot's collision shapes and its sites.
const HIDDEN_GEOMS: usize = 3;
const HIDDEN_SITES: usize = 4;

/// Renders states of one scene.
///
/// If the scene has a camera named `view`, that camera is used. Otherwise the camera is placed
/// automatically, so that the whole scene is in the image and few bodies are occluded.
pub struct Renderer {
    world: World,
    inner: MjRenderer,
    /// Width of the rendered image, and number of its pixels per pixel of the picture, in each
    /// direction.
    width: usize,
    factor: usize,
    pixels: Vec<u8>,
    placement: Placement,
    marks_contacts: bool,
    /// Largest force at a contact point of the picture, N.
    largest_contact: f64,
}

/// How the camera is placed.
#[derive(Clone, Copy, Debug)]
enum Placement {
    /// A camera of the scene.
    Scene,
    /// From the corner from which enough bodies are visible.
    Auto,
    /// From this direction: azimuth and elevation, degrees.
    Direction([f64; 2]),
    /// Around this body, in each state.
    Follow(usize),
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("world", &self.world).finish_non_exhaustive()
    }
}

impl Renderer {
    /// Creates a renderer of the scene in an MJCF document. Adds lights, a sky and, if missing, a
    /// ground plane.
    ///
    /// `camera` is one of [`CAMERAS`](super::CAMERAS) or a camera of the scene.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, there is no such camera, or OpenGL is not available.
    pub fn new(document: &str, size: Size, quality: Quality, camera: &str) -> Result<Renderer, WorldError> {
        Renderer::with_assets(document, &Arc::default(), size, quality, camera)
    }

    /// Creates a renderer of a document that refers to these files.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub fn with_assets(
        document: &str,
        assets: &Arc<Assets>,
        size: Size,
        quality: Quality,
        camera: &str,
    ) -> Result<Renderer, WorldError> {
        let is_large = size.width().max(size.height()) > *Size::RANGE.end() / 2;
        let factor = if quality == Quality::Fine && !is_large { 2 } else { 1 };
        let [width, height] = [factor * size.width(), factor * size.height()];
        let bare = Model::from_xml_with_assets(document, assets.clone())?;
        let has_ground = bare.inner.geom_type().contains(&MjtGeomBase::mjGEOM_PLANE);
        let lit = view::with_lights(document, [width, height], quality, has_ground);
        let model = Model::from_xml_with_assets(&lit, assets.clone())?;
        let (placement, camera) = place(&model, camera)?;
        let mut options = MjvOption::default();
        options.geomgroup[HIDDEN_GEOMS] = 0;
        options.sitegroup[HIDDEN_SITES] = 0;
        let inner = MjRenderer::builder()
            .width(width)
            .height(height)
            .camera(camera)
            .num_visual_user_geom(contact_marks::ARROWS)
            .opts(options)
            .build(&model.inner)
            .map_err(|error| WorldError::Render(error_chain(&error)))?;
        Ok(Renderer {
            world: model.world(),
            inner,
            width: width as usize,
            factor: factor as usize,
            pixels: Vec::new(),
            placement,
            marks_contacts: false,
            largest_contact: 0.0,
        })
    }

    /// Draws an arrow at each contact point in the following pictures. Its length is proportional
    /// to the force, 0.1 m for 100 N, from 0.04 to 0.5 m.
    pub fn mark_contacts(&mut self) {
        self.marks_contacts = true;
    }

    /// Returns the largest force at a contact point of the last picture, N; 0 without marks.
    pub fn largest_contact(&self) -> f64 {
        self.largest_contact
    }

    /// Places the camera so that everything is in the image in all of these states. A scene's own
    /// camera and the one that follows the hand are unchanged.
    ///
    /// # Panics
    /// If a state is shorter than [`Model::state_size`].
    pub fn frame<'a>(&mut self, states: impl IntoIterator<Item = &'a [f64]>) {
        if matches!(self.placement, Placement::Scene | Placement::Follow(_)) {
            return;
        }
        let mut corners = Vec::new();
        let mut first = None;
        for state in states {
            first = first.or(Some(state));
            self.world.set_state(state);
            self.world.data.forward();
            view::corners(&self.world, &mut corners);
        }
        if let Some(first) = first {
            self.world.set_state(first);
            self.world.data.forward();
        }
        let global = &self.world.model().inner.vis().global;
        let aspect = f64::from(global.offwidth) / f64::from(global.offheight);
        let fovy = f64::from(global.fovy).to_radians();
        let groups = self.inner.opts().geomgroup;
        let view = match self.placement {
            Placement::Direction(direction_deg) => view::fit(&corners, direction_deg, fovy, aspect),
            _ => view::best(&mut self.world, &corners, &groups, fovy, aspect),
        };
        self.set_view(&view);
    }

    fn set_view(&mut self, view: &View) {
        let camera = self.inner.camera_mut();
        [camera.azimuth, camera.elevation] = view.direction_deg;
        (camera.lookat, camera.distance) = (view.center, view.distance);
    }

    /// Renders a state: three bytes per pixel (red, green, blue), rows from the top.
    ///
    /// # Errors
    /// If OpenGL fails.
    ///
    /// # Panics
    /// If the state is shorter than [`Model::state_size`].
    pub fn draw(&mut self, state: &[f64]) -> Result<&[u8], WorldError> {
        self.world.set_state(state);
        self.world.data.forward();
        if let Placement::Follow(body) = self.placement {
            let (direction_deg, distance) = view::CLOSE;
            self.set_view(&View { direction_deg, center: self.world.data.xpos()[body], distance });
        }
        if self.marks_contacts {
            let forces = contact_marks::contact_forces(&self.world);
            self.largest_contact = forces.first().map_or(0.0, |largest| norm(largest.force));
            let (eye, ..) = self.inner.camera().frame(&self.world.data);
            contact_marks::draw(&forces, eye, self.inner.user_scene_mut());
        }
        let rendered = self.inner.sync_data(&mut self.world.data).and_then(|()| self.inner.render());
        rendered.map_err(|error| WorldError::Render(error_chain(&error)))?;
        let rendered = self.inner.rgb_flat().unwrap_or_default();
        if self.factor == 1 {
            return Ok(rendered);
        }
        shrink(rendered, self.width, self.factor, &mut self.pixels);
        Ok(&self.pixels)
    }
}

/// Finds a camera by its name.
fn place(model: &Model, name: &str) -> Result<(Placement, MjvCamera), WorldError> {
    let scene = |name: &str| model.inner.name_to_id(MjtObjBase::mjOBJ_CAMERA, name);
    let free = |placement| Ok((placement, MjvCamera::new_free(&model.inner)));
    if let Some((_, direction_deg)) = view::DIRECTIONS.iter().find(|(known, _)| *known == name) {
        return free(Placement::Direction(*direction_deg));
    }
    let own = if name == CAMERAS[0] { CAMERA } else { name };
    match (scene(own), name) {
        (_, FOLLOWING) => free(Placement::Follow(model.body(HAND)?.0)),
        (Some(id), _) => Ok((Placement::Scene, MjvCamera::new_fixed(id))),
        (None, name) if name == CAMERAS[0] => free(Placement::Auto),
        (None, name) => {
            let own = model.names(ElementKind::Camera);
            let known = CAMERAS.into_iter().map(str::to_string).chain(own).collect();
            Err(WorldError::Element { kind: "camera", name: name.to_string(), known })
        }
    }
}

/// Formats an error with its causes on one line.
fn error_chain(error: &dyn std::error::Error) -> String {
    std::iter::successors(Some(error), |error| error.source())
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join(": ")
}

/// Encodes an image as PNG. It has three bytes per pixel and rows from the top.
///
/// # Errors
/// If the number of bytes does not match the size.
pub fn png(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, WorldError> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(pixels));
    written.map_err(|error| WorldError::Render(error.to_string()))?;
    Ok(file)
}
