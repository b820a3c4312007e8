//! Data sets of episodes for imitation learning.
//!
//! - `episode`: what a data set contains, and one episode of it
//! - `lerobot`: LeRobot data sets of version 3.0; `table` writes their Parquet files, `statistics`
//!   computes the numbers that policies are normalized with
//! - `arrays`: one NumPy archive per data set; `archive` writes the file
//!
//! Writers fill a folder that the caller makes appear at once. They know no robot and no simulator.

mod archive;
mod arrays;
mod episode;
#[cfg(feature = "parquet")]
mod lerobot;
#[cfg(feature = "parquet")]
mod statistics;
#[cfg(feature = "parquet")]
mod table;

use std::io;
use std::path::Path;

pub use episode::{Contents, Episode, Fact, ImageColumn, VectorColumn, frames_per_second};

/// Draws an image of the episode that is written: the image column, the frame, and the RGB bytes of
/// its rows from top to bottom.
pub type Draw<'a> = &'a mut dyn FnMut(usize, usize, &mut [u8]) -> io::Result<()>;

/// Writes the episodes of a data set into a folder.
pub trait Writer {
    /// Adds an episode.
    ///
    /// # Errors
    /// Those of the file system and of `draw`.
    fn add(&mut self, episode: &Episode<'_>, draw: Draw<'_>) -> io::Result<()>;

    /// Writes what depends on all episodes. Without this call, the data set is incomplete.
    ///
    /// # Errors
    /// Those of the file system.
    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// Format of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// LeRobot data set of version 3.0: a folder of Parquet and JSON files.
    LeRobot,
    /// A folder with one NumPy archive, `data.npz`.
    Npz,
}

impl Format {
    /// All formats.
    pub const ALL: [Format; 2] = [Format::LeRobot, Format::Npz];

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Format::LeRobot => "lerobot",
            Format::Npz => "npz",
        }
    }

    /// Makes a writer into an empty folder.
    ///
    /// # Errors
    /// Those of the file system, or if this build lacks the format, or the format cannot have the
    /// contents.
    pub fn writer(self, contents: Contents, folder: &Path) -> io::Result<Box<dyn Writer>> {
        match self {
            #[cfg(feature = "parquet")]
            Format::LeRobot => Ok(Box::new(lerobot::LeRobotWriter::new(contents, folder)?)),
            #[cfg(not(feature = "parquet"))]
            Format::LeRobot => Err(io::Error::other("this build has no Parquet: choose the format npz")),
            Format::Npz => Ok(Box::new(arrays::ArrayWriter::new(contents, folder)?)),
        }
    }
}
