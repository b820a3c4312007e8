use std::fmt;

use mujoco_rs::prelude::*;
use mujoco_rs::renderer::MjRenderer;
use mujoco_rs::wrappers::mj_visualization::{MjvCamera, MjvOption};

use super::contact_marks;
use super::light;
use super::picture::shrink;
use super::view::{self, Surroundings, View};
use super::{CAMERAS, PictureModel, Quality, Size};
use crate::frame::{add, norm, sub};
use crate::{ElementKind, Model, World, WorldError};

/// The name of a scene's own camera.
const CAMERA: &str = "view";

/// The camera that follows a body.
const FOLLOWING: &str = "close";

/// Group of the robot's sites, which are not rendered.
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
    surroundings: Surroundings,
    /// The camera moves along if the robot moves far: where the robot is in the first state.
    along: Option<[f64; 3]>,
    view: Option<View>,
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
    /// Around this body, in each state, from this distance, m.
    Follow { body: usize, distance: f64 },
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("world", &self.world).finish_non_exhaustive()
    }
}

impl Renderer {
    /// Creates a renderer of a scene. Replaces its lights, and adds a sky and, if missing, a ground
    /// plane.
    ///
    /// `camera` is one of [`CAMERAS`](super::CAMERAS) or a camera of the scene.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, there is no such camera, or OpenGL is not available.
    pub fn new(
        picture: &PictureModel,
        size: Size,
        quality: Quality,
        camera: &str,
    ) -> Result<Renderer, WorldError> {
        let is_large = size.width().max(size.height()) > *Size::RANGE.end() / 2;
        let factor = if quality == Quality::Fine && !is_large { 2 } else { 1 };
        let [width, height] = [factor * size.width(), factor * size.height()];
        let PictureModel { document, assets, follows, is_untrusted } = picture;
        let bare = match is_untrusted {
            true => Model::from_untrusted(document, assets.clone()),
            false => Model::from_xml_with_assets(document, assets.clone()),
        }?;
        let surroundings = Surroundings::new(&bare);
        let lit = light::with_lights(&bare, [width, height], quality, &surroundings);
        let model = light::without_others(Model::from_xml_with_assets(&lit, assets.clone())?, &bare, quality);
        let (placement, camera) = place(&model, camera, follows.as_deref())?;
        let mut options = MjvOption { geomgroup: bare.drawn_groups().map(u8::from), ..MjvOption::default() };
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
            surroundings,
            along: None,
            view: None,
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

    /// Places the camera so that everything near the robot is in the image in all of these states.
    /// If the robot moves farther than it reaches, the camera moves along. A scene's own camera and
    /// the one that follows a body are unchanged.
    ///
    /// # Panics
    /// If a state is shorter than [`Model::state_size`].
    pub fn frame<'a>(&mut self, states: impl IntoIterator<Item = &'a [f64]>) {
        if matches!(self.placement, Placement::Scene | Placement::Follow { .. }) {
            return;
        }
        let (mut points, mut first, mut places) = (Vec::new(), None, Vec::new());
        for state in states {
            first = first.or(Some(state));
            self.world.set_state(state);
            self.world.data.forward();
            let mut near = Vec::new();
            self.surroundings.corners(&self.world, &mut near);
            points.push(near);
            places.push(self.surroundings.place(&self.world));
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
        self.view = Some(view);
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
        let place = self.surroundings.place(&self.world);
        if let Placement::Follow { body, distance } = self.placement {
            let (direction_deg, center) = (view::CLOSE_DEG, self.world.data.xpos()[body]);
            self.set_view(&View { direction_deg, center, distance });
        } else if let (Some(start), Some(view)) = (self.along, self.view) {
            self.set_view(&View { center: add(view.center, sub(place, start)), ..view });
        }
        for light in self.world.data.light_xpos_mut() {
            *light = add(*light, place);
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
fn place(model: &Model, name: &str, follows: Option<&str>) -> Result<(Placement, MjvCamera), WorldError> {
    let scene = |name: &str| model.inner.name_to_id(MjtObjBase::mjOBJ_CAMERA, name);
    let free = |placement| Ok((placement, MjvCamera::new_free(&model.inner)));
    if let Some((_, direction_deg)) = view::DIRECTIONS.iter().find(|(known, _)| *known == name) {
        return free(Placement::Direction(*direction_deg));
    }
    let own = if name == CAMERAS[0] { CAMERA } else { name };
    match (scene(own), name) {
        (_, FOLLOWING) => {
            let body = follows.map(|name| model.body(name)).transpose()?;
            let body = body.map_or_else(|| model.followed_body(), |body| body.0);
            free(Placement::Follow { body, distance: view::close_distance(model, body) })
        }
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
