//! Pictures of failures: of targets with a scene, and of systems that draw themselves.

use mishandle::counterexample::CounterexampleReplay;
use mishandle::inspect::{Event, ExplainedSimulation, Explanation, explain_episode};
use mishandle::picture::{Drawing, ExampleSimulation, FrameCaptions, FrameRenderer};
use mishandle::rollout::{Episode, Request, Scenario, Seed};
use mishandle::store::{RunHeader, Simulation, SimulationEnd};
use mishandle::world::{CAMERAS, Picture, PictureModel, Size, WorldError, animated_png, png};
use mishandle::{Compared, MishandleError, ResolvedPlan};

use crate::seen::{Seen, seen};

/// Size of the pictures with which a page begins, and of those that a system draws itself, pixels.
pub const PICTURE: (u32, u32) = (640, 480);

/// Size of the other pictures: half of it.
const SMALL: (u32, u32) = (320, 240);

/// Size of the pictures of a matrix of runs.
pub const THUMBNAIL: (u32, u32) = (160, 120);

/// Largest number of simulations with pictures, so that the page stays small.
pub const MAX_STRIPS: usize = 4;

/// Longest time of a film before and after the event, s, its speed, and the time for which it holds
/// a mark and its end, ms.
const AROUND: f64 = 1.0;
const SPEED: f64 = 0.5;
const HOLD: f64 = 1000.0;

/// Largest number of frames of a film without its marks.
const MAX_FRAMES: usize = 40;

/// The instant of a failure, beside the same instant of the nominal simulation.
#[derive(Debug, Default)]
pub struct LeadPictures {
    /// A PNG image.
    pub failing: Option<Vec<u8>>,
    /// The nominal simulation with the same seed, if another axis decides and it has a verdict.
    pub nominal: Option<ExplainedSimulation>,
    /// A PNG image of it.
    pub beside: Option<Vec<u8>>,
    /// A small PNG image of the failure, without a caption.
    pub thumbnail: Option<Vec<u8>>,
}

/// Pictures of a simulation.
#[derive(Clone, Debug, Default)]
pub struct Pictures {
    pub frames: Vec<Frame>,
    pub film: Option<Film>,
    /// The images that the policy saw, if it sees.
    pub seen: Option<Seen>,
}

/// A picture of a simulation.
#[derive(Clone, Debug)]
pub struct Frame {
    pub sample: usize,
    pub png: Vec<u8>,
}

/// A film around the event of a simulation.
#[derive(Clone, Debug)]
pub struct Film {
    /// First and last sample.
    pub window: (usize, usize),
    /// An animated PNG.
    pub png: Vec<u8>,
}

/// A reason why there are no pictures.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The simulation cannot be replayed.
    #[error(transparent)]
    Replay(#[from] MishandleError),
    /// A picture cannot be encoded.
    #[error(transparent)]
    Encode(#[from] WorldError),
    /// A system that draws itself did not.
    #[error("{0}")]
    Painter(String),
    /// The caller ended the drawing.
    #[error("the drawing was interrupted")]
    Interrupted,
}

/// Draws a system that is not part of this program while it simulates.
pub trait Painter {
    /// Asks for pictures of these samples of the next simulation.
    fn begin(&mut self, samples: &[usize]);

    /// Returns the pictures of the simulation, one for each sample, with the bytes of
    /// [`PICTURE`] pixels (red, green, blue).
    ///
    /// # Errors
    /// If the system did not draw them.
    fn take(&mut self) -> Result<Vec<Vec<u8>>, String>;
}

/// Returns whether the drawing must end; called before each picture.
pub type MustEnd<'a> = &'a mut dyn FnMut() -> bool;

/// Returns the request of a recorded simulation, which runs to its end.
pub fn request(recorded: &Simulation) -> Request {
    Request::new(Scenario::new(recorded.scenario.clone()), Seed(recorded.seed))
}

/// Returns the request of the nominal scenario with the same seed, unless it is the same.
fn nominal(resolved: &ResolvedPlan, recorded: &Simulation) -> Option<Request> {
    let nominal = Request::new(resolved.space.nominal(), Seed(recorded.seed));
    (!nominal.scenario.is_same(&request(recorded).scenario)).then_some(nominal)
}

/// Renders the instant of a failure, and the same instant of the nominal simulation. A target
/// without a scene has no pictures, but a nominal simulation.
pub fn lead(
    resolved: &ResolvedPlan,
    header: &RunHeader,
    explained: &ExplainedSimulation,
) -> Result<LeadPictures, PictureError> {
    let nominal = nominal(resolved, &explained.recorded);
    if !mishandle::resolve::has_scene(&header.target.kind) {
        let nominal = nominal.map(|request| simulated(resolved, &request)).transpose()?;
        return Ok(LeadPictures { nominal: nominal.flatten(), ..LeadPictures::default() });
    }
    let example = ExampleSimulation::new(resolved, &request(&explained.recorded))?;
    check(&example.episode, &explained.recorded)?;
    let nominal = nominal.map(|request| ExampleSimulation::new(resolved, &request)).transpose()?;
    let sample = explained.explanation.instant().unwrap_or(usize::MAX);
    let mut shown = Vec::new();
    let beside = nominal.iter().filter_map(|nominal| Some((&nominal.explained.as_ref()?.1, nominal)));
    let both = std::iter::once((explained, &example)).chain(beside);
    for (found, example) in both {
        let states = example.trajectory.states.as_slice();
        let sample = sample.min(states.len().saturating_sub(1));
        let explanation = &found.explanation;
        // The nominal simulation is shown at the instant of the failure, whatever it is there.
        let event = explanation.event().filter(|_| shown.is_empty());
        shown.push(Instant { header, states, explanation, event, sample });
    }
    let mut frames = instants(&shown, PICTURE)?.into_iter().map(|frame| frame.png);
    let thumbnail = instants(&shown[..1], THUMBNAIL)?.pop().map(|frame| frame.png);
    Ok(LeadPictures {
        thumbnail,
        failing: frames.next(),
        beside: frames.next(),
        nominal: nominal.and_then(|nominal| nominal.explained).map(|(_, found)| found),
    })
}

/// As [`lead`], of a system that draws itself.
pub fn painted_lead(
    resolved: &ResolvedPlan,
    header: &RunHeader,
    explained: &ExplainedSimulation,
    painter: &mut dyn Painter,
) -> Result<LeadPictures, PictureError> {
    let sample = explained.explanation.instant().unwrap_or(0);
    let found = lead(resolved, header, explained)?;
    let (episode, failing) = painted(&[sample], &request(&explained.recorded), resolved, painter)?;
    if let Some(episode) = episode {
        check(&episode, &explained.recorded)?;
    }
    let nominal = nominal(resolved, &explained.recorded);
    let beside = nominal.map(|nominal| painted(&[sample], &nominal, resolved, painter)).transpose()?;
    let encode =
        |pixels: Option<&Vec<u8>>| pixels.map(|pixels| png(PICTURE.0, PICTURE.1, pixels)).transpose();
    Ok(LeadPictures {
        failing: encode(failing.first())?,
        beside: encode(beside.as_ref().and_then(|(_, pictures)| pictures.first()))?,
        thumbnail: failing.first().map(|pixels| png(SMALL.0, SMALL.1, &halved(pixels))).transpose()?,
        ..found
    })
}

/// Simulates a request; `None` without a verdict.
fn simulated(
    resolved: &ResolvedPlan,
    request: &Request,
) -> Result<Option<ExplainedSimulation>, PictureError> {
    let episode =
        resolved.system()?.rollout(std::slice::from_ref(request)).map_err(MishandleError::from)?.pop();
    let episode = episode.filter(|episode| episode.robustness().is_some());
    Ok(episode.map(|episode| explain_episode(resolved, &episode)).transpose()?.map(|(_, found)| found))
}

/// Simulates a request of a system that draws these samples of it. A sample after the end has no
/// picture.
fn painted(
    samples: &[usize],
    request: &Request,
    resolved: &ResolvedPlan,
    painter: &mut dyn Painter,
) -> Result<(Option<Episode>, Vec<Vec<u8>>), PictureError> {
    painter.begin(samples);
    let episode = resolved.system()?.rollout(std::slice::from_ref(request)).map_err(MishandleError::from);
    let pictures = painter.take();
    let episode = episode?.pop();
    let pictures = pictures.map_err(PictureError::Painter)?;
    let bytes = 3 * (PICTURE.0 * PICTURE.1) as usize;
    if pictures.iter().any(|pixels| pixels.len() != bytes) {
        return Err(PictureError::Painter(format!("a picture has not {bytes} bytes")));
    }
    Ok((episode, pictures))
}

/// Checks that a simulation that ran again is the recorded one.
fn check(episode: &Episode, recorded: &Simulation) -> Result<(), PictureError> {
    let is_stopped = matches!(recorded.end, SimulationEnd::Stopped { .. });
    let bits = |rho: Option<f64>| rho.map(f64::to_bits);
    if is_stopped || bits(episode.robustness()) == bits(recorded.robustness) {
        return Ok(());
    }
    let Simulation { trial, number, .. } = recorded;
    let difference = format!("robustness of simulation {number} of trial {trial}");
    Err(MishandleError::differs(Compared::Plan, vec![difference]).into())
}

/// Renders some instants of each simulation, the decisive one among them, and a film around it.
/// Targets without a scene have no pictures.
pub fn strips(
    header: &RunHeader,
    resolved: &ResolvedPlan,
    simulations: &[ExplainedSimulation],
    must_end: MustEnd<'_>,
) -> Result<Vec<Pictures>, PictureError> {
    if simulations.is_empty() || !mishandle::resolve::has_scene(&header.target.kind) {
        return Ok(Vec::new());
    }
    let model = mishandle::resolve::recorded_picture(header)?;
    simulations
        .iter()
        .take(MAX_STRIPS)
        .map(|explained| strip(&model, header, resolved, explained, &mut *must_end))
        .collect()
}

/// As [`strips`], of a system that draws itself, which simulates each again.
pub fn painted_strips(
    simulations: &[ExplainedSimulation],
    resolved: &ResolvedPlan,
    painter: &mut dyn Painter,
    must_end: MustEnd<'_>,
) -> Result<Vec<Pictures>, PictureError> {
    let mut strips = Vec::new();
    for explained in simulations.iter().take(MAX_STRIPS) {
        if must_end() {
            return Err(PictureError::Interrupted);
        }
        strips.push(painted_strip(explained, resolved, painter)?);
    }
    Ok(strips)
}

fn painted_strip(
    explained: &ExplainedSimulation,
    resolved: &ResolvedPlan,
    painter: &mut dyn Painter,
) -> Result<Pictures, PictureError> {
    let last = explained.recorded.steps as usize;
    let event = explained.explanation.event();
    let shown = strip_samples(event.as_ref(), last);
    let reel = Reel::new(event.as_ref(), last, resolved.target.control_dt);
    let mut samples: Vec<usize> = shown.iter().chain(&reel.samples).copied().collect();
    samples.sort_unstable();
    samples.dedup();
    let (episode, pictures) = painted(&samples, &request(&explained.recorded), resolved, painter)?;
    if let Some(episode) = episode {
        check(&episode, &explained.recorded)?;
    }
    if pictures.len() != samples.len() {
        let message = format!("{} pictures of {} samples were drawn", pictures.len(), samples.len());
        return Err(PictureError::Painter(message));
    }
    let pictures: Vec<Vec<u8>> = pictures.iter().map(|pixels| halved(pixels)).collect();
    let of = |sample: &usize| samples.binary_search(sample).ok().map(|index| &pictures[index]);
    let mut frames = Vec::new();
    for sample in &shown {
        if let Some(pixels) = of(sample) {
            frames.push(Frame { sample: *sample, png: png(SMALL.0, SMALL.1, pixels)? });
        }
    }
    let picture = |sample: &usize| {
        let width = SMALL.0 as usize;
        let height = SMALL.1 as usize;
        let mut picture = Picture::new(width, height, [u8::MAX; 3]);
        if let Some(pixels) = of(sample) {
            picture.paste(0, 0, width, pixels);
        }
        picture
    };
    let film: Vec<(Picture, u16)> = reel.samples.iter().map(picture).zip(reel.delays).collect();
    Ok(Pictures { frames, film: Some(Film { window: reel.window, png: animated_png(&film)? }), seen: None })
}

/// Returns a picture of half the size: the means of two by two pixels.
fn halved(pixels: &[u8]) -> Vec<u8> {
    let row = 3 * PICTURE.0 as usize;
    let mut small = Vec::with_capacity(pixels.len() / 4);
    for pair in pixels.chunks_exact(2 * row) {
        for left in (0..row).step_by(6) {
            small.extend((left..left + 3).map(|at| {
                let sum: u16 =
                    [at, at + 3, at + row, at + row + 3].map(|at| u16::from(pair[at])).iter().sum();
                (sum / 4) as u8
            }));
        }
    }
    small
}

/// Returns the samples of the pictures of a simulation with samples 0 to `last`.
pub fn strip_samples(event: Option<&Event>, last: usize) -> Vec<usize> {
    let (start, end) = event.map_or((None, last), Event::ends);
    mishandle::picture::strip_samples(start, end, 0, last)
}

fn strip(
    model: &PictureModel,
    header: &RunHeader,
    resolved: &ResolvedPlan,
    explained: &ExplainedSimulation,
    must_end: MustEnd<'_>,
) -> Result<Pictures, PictureError> {
    let request = request(&explained.recorded);
    let (episode, trajectory) = mishandle::picture::simulate_states(resolved, &request)?;
    check(&episode, &explained.recorded)?;
    let shown = Shown::new(header, &trajectory.states, &explained.explanation);
    let pictures = shown.pictures(model, &mut *must_end)?;
    if must_end() {
        return Err(PictureError::Interrupted);
    }
    let seen = seen(resolved, &request, &explained.explanation)?;
    Ok(Pictures { seen, ..pictures })
}

/// Renders a counterexample that was simulated again, as [`strips`] does for simulations of a run.
pub fn of_replay(
    resolved: &ResolvedPlan,
    request: &Request,
    replay: &CounterexampleReplay,
    must_end: MustEnd<'_>,
) -> Result<Pictures, PictureError> {
    let (_, trajectory) = mishandle::picture::simulate_states(resolved, request)?;
    let model = mishandle::resolve::recorded_picture(&replay.header)?;
    let explanation = &replay.explained.explanation;
    let shown = Shown::new(&replay.header, &trajectory.states, explanation);
    let pictures = shown.pictures(&model, must_end)?;
    Ok(Pictures { seen: seen(resolved, request, explanation)?, ..pictures })
}

/// An instant of a simulation.
pub struct Instant<'a> {
    pub header: &'a RunHeader,
    /// States of the whole simulation.
    pub states: &'a [Vec<f64>],
    pub explanation: &'a Explanation,
    /// The instant that the caption marks.
    pub event: Option<Event>,
    pub sample: usize,
}

/// Renders instants of simulations of the same target in the same view, with this width and height.
pub fn instants(instants: &[Instant<'_>], size: (u32, u32)) -> Result<Vec<Frame>, PictureError> {
    let Some(first) = instants.first() else { return Ok(Vec::new()) };
    let model = mishandle::resolve::recorded_picture(first.header)?;
    let Some(size) = Size::new(size.0, size.1) else { return Ok(Vec::new()) };
    let states = instants.iter().filter_map(|instant| instant.states.get(instant.sample));
    let view: Vec<&[f64]> = states.map(Vec::as_slice).collect();
    let mut frames = Vec::new();
    for Instant { header, states, explanation, event, sample } in instants {
        let shown = Shown { event: *event, ..Shown::new(header, states, explanation) };
        frames.extend(shown.frames(&model, size, &[*sample], &view, &mut || false)?);
    }
    Ok(frames)
}

/// A simulation of which pictures are drawn.
struct Shown<'a> {
    header: &'a RunHeader,
    states: &'a [Vec<f64>],
    explanation: &'a Explanation,
    event: Option<Event>,
}

impl<'a> Shown<'a> {
    fn new(header: &'a RunHeader, states: &'a [Vec<f64>], explanation: &'a Explanation) -> Shown<'a> {
        Shown { header, states, explanation, event: explanation.event() }
    }

    /// Renders some instants and a film around the event.
    fn pictures(&self, model: &PictureModel, must_end: MustEnd<'_>) -> Result<Pictures, PictureError> {
        let Some(last) = self.states.len().checked_sub(1) else { return Ok(Pictures::default()) };
        let Some(size) = Size::new(SMALL.0, SMALL.1) else { return Ok(Pictures::default()) };
        let event = self.event.as_ref();
        let samples = strip_samples(event, last);
        let view: Vec<&[f64]> = samples.iter().map(|sample| self.states[*sample].as_slice()).collect();
        let frames = self.frames(model, size, &samples, &view, &mut *must_end)?;
        let mut renderer = self.renderer(model, size)?;
        let film = film(&mut renderer, self.states, event, self.header.control_dt, must_end)?;
        Ok(Pictures { frames, film: Some(film), seen: None })
    }

    fn renderer(&self, model: &PictureModel, size: Size) -> Result<FrameRenderer, PictureError> {
        let header = self.header;
        let last = self.states.len().saturating_sub(1);
        let explanation = Some(self.explanation);
        let event = self.event.as_ref();
        let captions = FrameCaptions::new(header.control_dt, &header.signals, explanation, event, last);
        Ok(FrameRenderer::new(model, size, Drawing::Rays, &CAMERAS[..1], None, Some(captions))?)
    }

    /// Renders samples in a view that shows all states of `view`.
    fn frames(
        &self,
        model: &PictureModel,
        size: Size,
        samples: &[usize],
        view: &[&[f64]],
        must_end: MustEnd<'_>,
    ) -> Result<Vec<Frame>, PictureError> {
        let mut renderer = self.renderer(model, size)?;
        renderer.fit(&view.iter().copied());
        let picture = |sample: &usize| -> Result<Frame, PictureError> {
            if must_end() {
                return Err(PictureError::Interrupted);
            }
            let picture = renderer.draw(*sample, &self.states[*sample])?;
            Ok(Frame { sample: *sample, png: png(size.width(), size.height(), picture.pixels())? })
        };
        samples.iter().map(picture).collect()
    }
}

/// Renders a short film around the event.
fn film(
    renderer: &mut FrameRenderer,
    states: &[Vec<f64>],
    event: Option<&Event>,
    control_dt: f64,
    must_end: MustEnd<'_>,
) -> Result<Film, PictureError> {
    let Reel { window, samples, delays } = Reel::new(event, states.len().saturating_sub(1), control_dt);
    renderer.fit(&samples.iter().map(|sample| states[*sample].as_slice()));
    let mut frames = Vec::with_capacity(samples.len());
    for (sample, delay) in samples.iter().zip(delays) {
        if must_end() {
            return Err(PictureError::Interrupted);
        }
        frames.push((renderer.draw(*sample, &states[*sample])?, delay));
    }
    Ok(Film { window, png: animated_png(&frames)? })
}

/// The samples of a film around an event.
struct Reel {
    /// First and last sample.
    window: (usize, usize),
    samples: Vec<usize>,
    /// Time for which each sample is shown, ms.
    delays: Vec<u16>,
}

impl Reel {
    fn new(event: Option<&Event>, last: usize, control_dt: f64) -> Reel {
        let (from, to) = mishandle::picture::Film::new(control_dt, last, event, Some(AROUND), SPEED).window;
        let marks: Vec<usize> =
            event.map_or(Vec::new(), Event::marks).into_iter().map(|(sample, _)| sample).collect();
        let stride = (to - from).div_ceil(MAX_FRAMES).max(1);
        let is_marked = |sample: usize| marks.contains(&sample);
        let shown =
            |sample: &usize| (*sample - from).is_multiple_of(stride) || is_marked(*sample) || *sample == to;
        let samples: Vec<usize> = (from..=to).filter(shown).collect();
        let delay = |(index, sample): (usize, &usize)| {
            let held = if is_marked(*sample) || *sample == to { HOLD } else { 0.0 };
            let next = samples.get(index + 1).copied().unwrap_or(*sample);
            (1000.0 * control_dt * (next - sample) as f64 / SPEED + held).round() as u16
        };
        let delays = samples.iter().enumerate().map(delay).collect();
        Reel { window: (from, to), samples, delays }
    }
}
