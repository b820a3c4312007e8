//! What stands in for the renderer in a build without it.

use super::Size;
use crate::WorldError;

/// Draws states of one scene; in this build there can be none.
#[derive(Debug)]
pub enum Renderer {}

impl Renderer {
    /// Fails.
    ///
    /// # Errors
    /// Always: this build cannot draw.
    pub fn new(_document: &str, _size: Size) -> Result<Renderer, WorldError> {
        Err(WorldError::NoRenderer)
    }

    /// Turns the camera to what the states show.
    pub fn frame<'a>(&mut self, _states: impl IntoIterator<Item = &'a [f64]>) {
        match *self {}
    }

    /// The picture of a state.
    ///
    /// # Errors
    /// None in this build.
    pub fn draw(&mut self, _state: &[f64]) -> Result<&[u8], WorldError> {
        match *self {}
    }
}

/// Fails.
///
/// # Errors
/// Always: this build cannot draw.
pub fn png(_width: u32, _height: u32, _pixels: &[u8]) -> Result<Vec<u8>, WorldError> {
    Err(WorldError::NoRenderer)
}
