use crate::{Scenario, Seed};

/// An image that a controller gets, besides its observation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Name of the camera.
    pub camera: String,
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
}

impl Image {
    /// Returns the number of its bytes: red, green and blue of each pixel, rows from the top.
    pub fn bytes(&self) -> usize {
        3 * self.width * self.height
    }
}

/// Cameras that show the states of an [`Environment`](crate::Environment) to a controller.
///
/// Cameras are shared and immutable. Each thread makes its own [`EyesWorker`].
pub trait Eyes: Send + Sync {
    /// Makes a worker for this number of simulations on one thread.
    fn worker(&self, rows: usize) -> Box<dyn EyesWorker>;
}

/// Renders the images of the simulations of one thread.
///
/// An image is a function of the scenario, the seed and the states of its simulation. It does not
/// depend on the other rows.
pub trait EyesWorker: Send {
    /// Starts a simulation in a row. `scenario` is the environment's part.
    fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, state: &[f64]);

    /// Writes the images of a row in control step `step`, one after another; `None` if nobody needs
    /// them. Otherwise the buffer is always the same one of the row. Steps must come in order from
    /// 0, each with the state in which the controller acts.
    fn look(&mut self, row: usize, step: usize, state: &[f64], images: Option<&mut [u8]>);
}

/// The images of the rows of one thread.
pub(crate) struct Sight {
    eyes: Box<dyn EyesWorker>,
    /// Bytes of all images of a row.
    bytes: usize,
    images: Vec<u8>,
}

impl Sight {
    pub(crate) fn new(eyes: &dyn Eyes, images: &[Image], rows: usize) -> Sight {
        let bytes = images.iter().map(Image::bytes).sum();
        Sight { eyes: eyes.worker(rows), bytes, images: vec![0; rows * bytes] }
    }

    /// Starts a simulation in a row.
    pub(crate) fn start(&mut self, row: usize, scenario: &Scenario, seed: Seed, state: &[f64]) {
        self.eyes.start(row, scenario, seed, state);
    }

    /// Renders the images of a row, if they are needed. Otherwise the row keeps earlier ones.
    pub(crate) fn look(&mut self, row: usize, step: usize, state: &[f64], is_needed: bool) {
        let images = &mut self.images[row * self.bytes..][..self.bytes];
        self.eyes.look(row, step, state, is_needed.then_some(images));
    }

    /// Returns the images of the first rows.
    pub(crate) fn images(&self, rows: usize) -> &[u8] {
        &self.images[..rows * self.bytes]
    }
}
