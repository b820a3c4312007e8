//! Replacement for MuJoCo's renderer in builds without the feature `render`.

use super::{PictureModel, Quality, Size, Stage};
use crate::WorldError;

/// Renders states of one scene. Never exists in this build.
#[derive(Debug)]
pub enum Renderer {}

impl Renderer {
    /// Returns an error.
    ///
    /// # Errors
    /// Always: this build cannot render.
    pub fn new(
        _picture: &PictureModel,
        _size: Size,
        _quality: Quality,
        _camera: &str,
    ) -> Result<Renderer, WorldError> {
        Err(WorldError::NoRenderer)
    }

    /// Never called, since there is no renderer.
    pub fn stage(&mut self) -> &mut Stage {
        match *self {}
    }

    /// Never called, since there is no renderer.
    ///
    /// # Errors
    /// None.
    pub fn draw(&mut self, _state: &[f64]) -> Result<&[u8], WorldError> {
        match *self {}
    }
}
