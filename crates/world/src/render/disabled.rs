//! Replacement for the renderer in builds without the feature `render`.

use super::{Picture, PictureModel, Quality, Size};
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
    pub fn mark_contacts(&mut self) {
        match *self {}
    }

    /// Never called, since there is no renderer.
    pub fn largest_contact(&self) -> f64 {
        match *self {}
    }

    /// Never called, since there is no renderer.
    pub fn frame<'a>(&mut self, _states: impl IntoIterator<Item = &'a [f64]>) {
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

/// Returns an error.
///
/// # Errors
/// Always: this build cannot render.
pub fn png(_width: u32, _height: u32, _pixels: &[u8]) -> Result<Vec<u8>, WorldError> {
    Err(WorldError::NoRenderer)
}

/// Returns an error.
///
/// # Errors
/// Always: this build cannot render.
pub fn animated_png(_frames: &[(Picture, u16)]) -> Result<Vec<u8>, WorldError> {
    Err(WorldError::NoRenderer)
}
