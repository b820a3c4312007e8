/// Task, robot and columns of a data set.
#[derive(Clone, Debug)]
pub struct Contents {
    /// The task in words, as policies that follow instructions read it.
    pub task: String,
    /// Name of the robot.
    pub robot: String,
    /// Duration of a frame, s.
    pub dt: f64,
    /// Vectors of each frame.
    pub vectors: Vec<VectorColumn>,
    /// Images of each frame.
    pub images: Vec<ImageColumn>,
}

/// A vector of each frame.
#[derive(Clone, Debug)]
pub struct VectorColumn {
    /// Name of the column, such as `action`.
    pub name: String,
    /// Name of each number.
    pub names: Vec<String>,
}

/// An RGB image of each frame.
#[derive(Clone, Debug)]
pub struct ImageColumn {
    /// Name of the column, such as `observation.images.table`.
    pub name: String,
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
}

impl ImageColumn {
    /// Returns the number of bytes of an image.
    pub fn bytes(&self) -> usize {
        3 * self.width as usize * self.height as usize
    }
}

/// An episode to write.
#[derive(Clone, Copy, Debug)]
pub struct Episode<'a> {
    /// Number of frames, at least 1.
    pub frames: usize,
    /// The numbers of all frames of each vector column, frame by frame.
    pub vectors: &'a [Vec<f32>],
    /// Whether the episode is a success.
    pub is_success: bool,
    /// Further facts, by name; the same names for all episodes.
    pub facts: &'a [(String, Fact)],
}

/// A fact of an episode.
#[derive(Clone, Debug, PartialEq)]
pub enum Fact {
    /// An integer, such as a seed.
    Integer(u64),
    /// A number; NaN if it is missing.
    Number(f64),
    /// A text.
    Text(String),
}

/// Returns the number of frames per second; `None` unless it is an integer, as LeRobot needs it.
///
/// # Example
/// ```
/// use mishandle_dataset::frames_per_second;
/// assert_eq!(frames_per_second(1.0 / 60.0), Some(60));
/// assert_eq!(frames_per_second(0.03), None);
/// ```
pub fn frames_per_second(dt: f64) -> Option<u32> {
    let rate = (1.0 / dt).round();
    let is_integer = (1.0..=1e6).contains(&rate) && (rate * dt - 1.0).abs() < 1e-9;
    is_integer.then_some(rate as u32)
}
