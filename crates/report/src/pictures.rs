//! Pictures of failures of tasks.

use mishandle::store::RunFile;
use mishandle::world::{CAMERAS, Quality, Size, WorldError, png};
use mishandle::{ExplainedSimulation, FrameCaptions, FrameRenderer, MishandleError};

/// Size of a picture, pixels.
pub const PICTURE: (u32, u32) = (320, 240);

/// Largest number of simulations with pictures, so that the page stays small.
const MAX_STRIPS: usize = 4;

/// A picture of a simulation.
#[derive(Clone, Debug)]
pub struct Frame {
    pub sample: usize,
    pub png: Vec<u8>,
}

/// A reason why there are no pictures.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The simulation cannot be replayed.
    #[error(transparent)]
    Replay(#[from] MishandleError),
    /// The scene cannot be rendered.
    #[error(transparent)]
    Render(#[from] WorldError),
}

/// Renders some instants of each simulation, the decisive one among them. Other targets than tasks have no pictures.
pub fn strips(
    run: &RunFile,
    simulations: &[ExplainedSimulation],
    controller: Option<&str>,
) -> Result<Vec<Vec<Frame>>, PictureError> {
    let Ok(task) = mishandle::task(&run.header().target.name) else { return Ok(Vec::new()) };
    let Some(size) = Size::new(PICTURE.0, PICTURE.1) else { return Ok(Vec::new()) };
    if simulations.is_empty() {
        return Ok(Vec::new());
    }
    let document = mishandle::scene_mjcf(task)?;
    simulations
        .iter()
        .take(MAX_STRIPS)
        .map(|explained| strip(&document, size, run, explained, controller))
        .collect()
}

fn strip(
    document: &str,
    size: Size,
    run: &RunFile,
    explained: &ExplainedSimulation,
    controller: Option<&str>,
) -> Result<Vec<Frame>, PictureError> {
    let (trial, number) = (explained.recorded.trial, explained.recorded.number);
    let (replayed, trajectory) = mishandle::replay_states(run, trial, number, controller)?;
    if !replayed.differences.is_empty() {
        return Err(MishandleError::RunMismatch { differences: replayed.differences }.into());
    }
    let states = &trajectory.states;
    let Some(last) = states.len().checked_sub(1) else { return Ok(Vec::new()) };
    let event = explained.explanation.event();
    let decisive = event.map_or(last, |event| event.sample);
    let header = run.header();
    let captions = FrameCaptions::new(header.control_dt, &header.signals, Some(&explained.explanation), last);
    let mut renderer = FrameRenderer::new(document, size, Quality::Fine, &CAMERAS[..1], Some(captions))?;
    let samples = mishandle::strip_samples(event.and_then(|event| event.start), decisive, (0, last));
    renderer.fit(&samples.iter().map(|sample| states[*sample].as_slice()));
    let picture = |sample: usize| -> Result<Frame, PictureError> {
        let picture = renderer.draw(sample, &states[sample])?;
        Ok(Frame { sample, png: png(PICTURE.0, PICTURE.1, picture.pixels())? })
    };
    samples.into_iter().map(picture).collect()
}
