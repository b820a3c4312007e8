//! MuJoCo's renderer.

use std::fmt;

use mujoco_rs::prelude::*;
use mujoco_rs::renderer::MjRenderer;
use mujoco_rs::wrappers::mj_visualization::{MjvCamera, MjvOption, MjvScene};

use super::contacts::{ARROWS, Arrow};
use super::stage::Placement;
use super::view::Surroundings;
use super::{PictureModel, Quality, Size, Stage, light};
use crate::frame::{add, sub};
use crate::{Model, WorldError};

/// Renders states of one scene with OpenGL.
pub struct Renderer {
    stage: Stage,
    inner: MjRenderer,
    /// Width of the rendered image, and number of its pixels per pixel of the picture, in each
    /// direction.
    width: usize,
    factor: usize,
    pixels: Vec<u8>,
}

impl fmt::Debug for Renderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Renderer").field("stage", &self.stage).finish_non_exhaustive()
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
        let bare = picture.compile()?;
        let lit = light::with_lights(&bare, [width, height], quality, &Surroundings::new(&bare));
        let lit = Model::from_xml_with_assets(&lit, &picture.assets)?;
        let model = light::without_others(lit, &bare, quality);
        let stage = Stage::new(&model, picture, size, camera)?;
        let camera = match stage.placement {
            Placement::Scene(id) => MjvCamera::new_fixed(id),
            _ => MjvCamera::new_free(&model.inner),
        };
        let options = MjvOption { geomgroup: bare.drawn_groups().map(u8::from), ..MjvOption::default() };
        let inner = MjRenderer::builder()
            .width(width)
            .height(height)
            .camera(camera)
            .num_visual_user_geom(ARROWS)
            .opts(options)
            .build(&model.inner)
            .map_err(|error| WorldError::Render(error_chain(&error)))?;
        Ok(Renderer { stage, inner, width: width as usize, factor: factor as usize, pixels: Vec::new() })
    }

    /// Returns the stage, to place the camera and to mark contacts. It shows the state of the last
    /// picture.
    pub fn stage(&mut self) -> &mut Stage {
        &mut self.stage
    }

    /// Renders a state: three bytes per pixel (red, green, blue), rows from the top.
    ///
    /// # Errors
    /// If OpenGL fails.
    ///
    /// # Panics
    /// If the state is shorter than [`Model::state_size`].
    pub fn draw(&mut self, state: &[f64]) -> Result<&[u8], WorldError> {
        self.stage.show(state);
        // A camera of the scene has a place of its own.
        let view = self.stage.view;
        let camera = self.inner.camera_mut();
        [camera.azimuth, camera.elevation] = view.direction_deg;
        (camera.lookat, camera.distance) = (view.center, view.distance);
        let place = self.stage.place();
        let data = &mut self.stage.world.data;
        for light in data.light_xpos_mut() {
            *light = add(*light, place);
        }
        mark(&self.stage.arrows(), self.inner.user_scene_mut());
        let rendered = self.inner.sync_data(&mut self.stage.world.data).and_then(|()| self.inner.render());
        rendered.map_err(|error| WorldError::Render(error_chain(&error)))?;
        let rendered = self.inner.rgb_flat().unwrap_or_default();
        if self.factor == 1 {
            return Ok(rendered);
        }
        shrink(rendered, self.width, self.factor, &mut self.pixels);
        Ok(&self.pixels)
    }
}

/// Replaces the arrows of a scene.
fn mark(arrows: &[Arrow], scene: &mut MjvScene) {
    scene.clear_geom();
    let [red, green, blue] = Arrow::COLOR;
    for Arrow { from, to } in arrows {
        // SAFETY: the arrow refers to no element of the model: it has no texture and no mesh.
        #[allow(unsafe_code)]
        let arrow = unsafe {
            scene.try_create_geom(MjtGeom::mjGEOM_ARROW, None, None, None, Some([red, green, blue, 1.0]))
        };
        if let Ok(arrow) = arrow {
            // Shadows of the scene do not darken it.
            arrow.emission = 1.0;
            // MuJoCo draws half of the way.
            arrow.connect(Arrow::RADIUS, *from, add(*to, sub(*to, *from)));
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

/// Averages squares of `factor` x `factor` pixels.
fn shrink(pixels: &[u8], width: usize, factor: usize, out: &mut Vec<u8>) {
    out.clear();
    let samples = factor * factor;
    for rows in pixels.chunks(3 * width * factor) {
        for column in 0..width / factor {
            for channel in 0..3 {
                let at = |i: usize| rows[3 * (i / factor * width + column * factor + i % factor) + channel];
                let sum: usize = (0..samples).map(|i| usize::from(at(i))).sum();
                out.push(((sum + samples / 2) / samples) as u8);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_of_pixels_becomes_their_mean() {
        // 4 x 2 pixels; the red values of the left square are 0, 10, 20, 31, those of the right one
        // all 7.
        let red = [0, 10, 7, 7, 20, 31, 7, 7];
        let pixels: Vec<u8> = red.iter().flat_map(|red| [*red, 1, 2]).collect();
        let mut out = Vec::new();
        shrink(&pixels, 4, 2, &mut out);
        assert_eq!(out, [15, 1, 2, 7, 1, 2]);
    }
}
