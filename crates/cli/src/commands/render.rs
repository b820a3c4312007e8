use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use clap::{Args, ValueEnum};
use mishandle::MishandleError;
use mishandle::inspect::{Event, Explanation};
use mishandle::picture::{
    CameraSettings, Drawing, Film, FrameCaptions, FrameRenderer, SeenStates, StateTrajectory,
};
use mishandle::world::{CAMERAS, Picture, Quality, Size, WorldError, png};
use mishandle_text::{instant, plural};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::interrupt;
use crate::run;
use crate::show::progress::Bar;
use crate::show::video::{self, Video};
use crate::show::{output, simulation};

/// Coordinates of an initial state. Its box is checked later, by an error that names the axis.
const COORDINATE: &str = "a number in the unit of the axis, such as 0.45";

/// Seconds on each side of an event.
const AROUND: &str = "a number of seconds above 0, such as 0.5";

/// Speeds of a video.
const SPEED: &str = "a number from 0.01 to 100, such as 0.25";

/// Render the initial state of a task or target file, or a video or filmstrip of a recorded
/// simulation
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle render ball-pushing --out start.png
  mishandle render ball-pushing --at 0.45,-0.1 --out start.png
  mishandle render robot.toml --out start.png                      a robot that a file describes
  mishandle render --run runs/RUN.sqlite --out video.mp4           the first counterexample
  mishandle render --run runs/RUN.sqlite --trial 2 --simulation 17 --out strip.png   six frames

  mishandle render --run runs/RUN.sqlite --camera auto,close --out two.mp4    two views
  mishandle render --run runs/RUN.sqlite --camera auto,over,wrist --out seen.mp4   what cameras saw
  mishandle render --run runs/RUN.sqlite --around 0.5 --speed 0.25 --out slow.mp4

Pictures of a simulation center on its event, and `render` says which one it is and why. If the
formula is violated by something that must always hold, it is the violation. If the formula needs
one good instant (`eventually`), it is the closest approach. If the formula is satisfied, it is the
instant with the smallest margin. A video holds the event for a second. `--event contact` and
`--event release` center on something else.

Rendering needs no display. Videos need the program ffmpeg.")]
pub struct Arguments {
    /// Name of a task or path of a target file, to render its initial state
    #[arg(conflicts_with = "run")]
    pub target: Option<String>,
    /// Initial state: one value per axis of the initial box, or of the space `starts` of a target
    /// file, in the axis' unit [default: the center of the box, or the nominal values]
    #[arg(long, value_name = "X,Y,...", value_delimiter = ',', allow_hyphen_values = true)]
    #[arg(conflicts_with = "run", value_parser = numbers::number(COORDINATE, |_| true))]
    pub at: Option<Vec<f64>>,
    /// Run file, to render one of its simulations
    #[arg(long, value_name = "RUN")]
    pub run: Option<PathBuf>,
    /// Number of the trial, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", requires = "run", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample,
    /// otherwise the simulation with the minimum robustness]
    #[arg(long, value_name = "N", requires = "run", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub simulation: Option<u32>,
    /// Event of a simulation to center on
    #[arg(long, value_name = "EVENT", requires = "run", default_value = "decisive")]
    pub event: CenterEvent,
    /// Show only this many seconds before and after the event [default: all of an episode of up to
    /// 10 s, otherwise 5]
    #[arg(long, value_name = "SECONDS", requires = "run", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(AROUND, |seconds| seconds > 0.0 && seconds.is_finite()))]
    pub around: Option<f64>,
    /// Speed of a video relative to the simulation [default: 1]
    #[arg(long, value_name = "FACTOR", requires = "run", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(SPEED, |speed| (0.01..=100.0).contains(&speed)))]
    pub speed: Option<f64>,
    /// Output file: .png for a picture or a filmstrip, .mp4 for a video
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    #[command(flatten)]
    pub keys: flags::SettingKeys,
    /// Width of each camera's view and height of the frame, in pixels [default: picture 960x720,
    /// video 640x480, filmstrip 480x360]
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Cameras, side by side in each frame: auto, front, left, right, back, top, close (follows the
    /// hand or the free base), a camera of the MJCF, or one of the target, whose images policies
    /// see: over and wrist for tasks, and those of a target file. These have the light, colors,
    /// faults and delays of the scenario
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = CAMERAS[0])]
    pub camera: Vec<String>,
    /// Width and height of the images of cameras of the target, pixels, each from 1 to 1024
    /// [default: 64x64]
    #[arg(long, value_name = "WxH", value_parser = numbers::image_size)]
    pub image_size: Option<[u16; 2]>,
    /// Draw hard shadows and rougher edges, about four times as fast on a machine without a
    /// graphics card
    #[arg(long)]
    pub fast: bool,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
}

impl Arguments {
    fn cameras(&self) -> Vec<&str> {
        self.camera.iter().map(String::as_str).collect()
    }

    /// Returns those of the cameras that the target has, each once: their images are those that
    /// policies see.
    fn seen(&self, target: &[String]) -> Vec<String> {
        target.iter().filter(|name| self.camera.contains(name)).cloned().collect()
    }

    /// Draws what these cameras of the target see in the states of a simulation.
    fn seen_states(&self, names: Vec<String>, trajectory: &StateTrajectory) -> Result<Option<SeenStates>> {
        let settings = CameraSettings { names, size: self.image_size.unwrap_or(IMAGE_SIZE) };
        Ok(if settings.names.is_empty() { None } else { trajectory.seen_by(&settings)? })
    }

    fn drawing(&self) -> Drawing {
        Drawing::OpenGl(if self.fast { Quality::Fast } else { Quality::Fine })
    }
}

/// Center of pictures of a simulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum CenterEvent {
    /// The violation, closest approach or smallest margin
    #[default]
    Decisive,
    /// The first contact of two parts that do not touch in the first 0.1 s
    Contact,
    /// The release of the held object
    Release,
}

/// The camera is placed by every second state, which is enough to show all motions.
const FIT_STRIDE: usize = 2;

/// Frames per row of a filmstrip.
const STRIP_COLUMNS: usize = 3;

/// Default size of a picture, in pixels.
const PICTURE_SIZE: (u32, u32) = (960, 720);

/// Default size of a video, in pixels.
const VIDEO_SIZE: (u32, u32) = (640, 480);

/// Default size of a frame in a filmstrip, in pixels.
const STRIP_SIZE: (u32, u32) = (480, 360);

/// Default size of the images of cameras of the target, in pixels.
const IMAGE_SIZE: [u16; 2] = [64, 64];

/// Output format, from the extension of the output file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Png,
    Mp4,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let kind = kind(&command.out)?;
    if command.run.is_none() && command.target.is_some() {
        ensure!(
            kind == Kind::Png,
            "an initial state is a single picture: --out must end in .png; for a video give --run RUN"
        );
    }
    let default = match (kind, &command.run) {
        (Kind::Png, None) => PICTURE_SIZE,
        (Kind::Png, Some(_)) => STRIP_SIZE,
        (Kind::Mp4, _) => VIDEO_SIZE,
    };
    let size = size(command.size.as_deref(), default)?;
    let views = command.camera.len();
    ensure!(
        views as u32 * size.width() <= *Size::RANGE.end(),
        "{views} views of {} pixels are wider than {} pixels; set a smaller --size",
        size.width(),
        Size::RANGE.end()
    );
    let engine = command.keys.settings("render")?.engine;
    let controller = engine.controller.as_deref().map(Path::new);
    output::refuse_inputs(&command.out, "--out", command.run.as_deref().into_iter().chain(controller))?;
    // Fails before the simulation if the output cannot be written.
    drop(output::create(&command.out, command.force)?);
    if kind == Kind::Mp4 {
        video::check_encoder()?;
    }
    let (mut renderer, trajectory, event) = match (&command.run, &command.target) {
        (Some(path), _) => recorded(path, command, size)?,
        (None, Some(target)) => {
            let trajectory = mishandle::picture::initial_state(target, command.at.as_deref())?;
            let model = mishandle::resolve::picture_model(target)?;
            let known = mishandle::resolve::camera_names(target)?;
            let names = command.seen(&known);
            check_fits(command, &names, size)?;
            let seen = command.seen_states(names, &trajectory)?;
            let cameras = command.cameras();
            let renderer = FrameRenderer::new(&model, size, command.drawing(), (&cameras, seen), None);
            (renderer.map_err(|error| with_cameras(error, known))?, trajectory, None)
        }
        (None, None) => bail!("nothing to render: give a TARGET or --run RUN"),
    };
    let status = match kind {
        Kind::Png => filmstrip(&mut renderer, &trajectory, event, command)?,
        Kind::Mp4 => video(&mut renderer, &trajectory, event, command)?,
    };
    match status {
        ExitStatus::Interrupted => output::message("interrupted; nothing was written"),
        _ => output::message(&format!("wrote {}", command.out.display())),
    }
    Ok(status)
}

/// Checks that images of cameras of the target, which have these names, fit into frames.
fn check_fits(command: &Arguments, names: &[String], size: Size) -> Result<()> {
    ensure!(
        command.image_size.is_none() || !names.is_empty(),
        "--image-size has no effect without a camera of the target in --camera, such as over for tasks"
    );
    let [width, height] = command.image_size.unwrap_or(IMAGE_SIZE);
    let frame = [size.width(), size.height()];
    ensure!(
        names.is_empty() || u32::from(width) <= frame[0] && u32::from(height) <= frame[1],
        "images of {width}x{height} pixels do not fit into frames of {}x{}; set a larger --size",
        frame[0],
        frame[1]
    );
    Ok(())
}

/// Returns an error that names the cameras of the target, too, if there is no such camera.
fn with_cameras(error: MishandleError, target: Vec<String>) -> MishandleError {
    match error {
        MishandleError::World(WorldError::Element { kind: kind @ "camera", name, mut known }) => {
            known.extend(target);
            WorldError::Element { kind, name, known }.into()
        }
        other => other,
    }
}

fn kind(out: &Path) -> Result<Kind> {
    match out.extension().and_then(|extension| extension.to_str()) {
        Some("png") => Ok(Kind::Png),
        Some("mp4") => Ok(Kind::Mp4),
        _ => bail!("--out is {}; it must end in .png (picture) or .mp4 (video)", out.display()),
    }
}

/// Parses a size such as `960x720`.
fn size(text: Option<&str>, default: (u32, u32)) -> Result<Size> {
    let (width, height) = match text {
        None => default,
        Some(text) => text
            .split_once('x')
            .and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)))
            .unwrap_or((0, 0)),
    };
    let low = Size::RANGE.start();
    let high = Size::RANGE.end();
    match Size::new(width, height) {
        Some(size) => Ok(size),
        None => bail!(
            "--size is {}; it must be WIDTHxHEIGHT in pixels, such as 960x720, both even and from {low} to {high}",
            text.unwrap_or_default()
        ),
    }
}

/// Replays a recorded simulation. Returns its states and the event that pictures center on.
fn recorded(
    path: &Path,
    command: &Arguments,
    size: Size,
) -> Result<(FrameRenderer, StateTrajectory, Option<Event>)> {
    let engine = command.keys.settings("render")?.engine;
    let run = run::read(path, engine.skip_check)?;
    let Some((trial, simulation)) =
        mishandle::replay::select_simulation(&run, command.trial, command.simulation)?
    else {
        bail!("{} has no decided simulation; choose one with --trial and --simulation", path.display());
    };
    let drawing = command.drawing();
    let cameras = command.cameras();
    let model = mishandle::resolve::recorded_picture(run.header())?;
    // Fails before the simulation if pictures cannot be drawn.
    let known = mishandle::resolve::camera_names(&mishandle::resolve::recorded_target(run.header())?)?;
    let names = command.seen(&known);
    check_fits(command, &names, size)?;
    let of_scene: Vec<&str> =
        cameras.iter().copied().filter(|name| !names.iter().any(|seen| seen == name)).collect();
    drop(
        FrameRenderer::new(&model, size, drawing, (&of_scene, None), None)
            .map_err(|error| with_cameras(error, known))?,
    );
    let (replayed, trajectory) =
        mishandle::picture::replay_states(&run, trial, simulation, engine.controller.as_deref())?;
    run::report_build_differences("made", &replayed.build_differences);
    if !replayed.differences.is_empty() {
        bail!("{}", run::differences_text(&replayed.differences));
    }
    ensure!(
        !trajectory.states.is_empty(),
        "simulation {simulation} of trial {trial} has no states to render"
    );
    let point = mishandle::run::box_point(run.header(), trial, &replayed.recorded.scenario);
    output::message(&format!(
        "{}: {}",
        simulation::name(trial, point, simulation),
        plural(replayed.episode.steps, "control step")
    ));
    let last = trajectory.states.len() - 1;
    let released = mishandle::inspect::release(&replayed.episode.trace);
    // An undecided simulation has no explanation.
    let explained = replayed.recorded.robustness.and_then(|_| {
        mishandle::inspect::explain_recorded(run.header(), replayed.recorded, replayed.episode.trace).ok()
    });
    let explanation = explained.as_ref().map(|explained| &explained.explanation);
    let at = |sample| instant(sample, run.header().control_dt);
    for sentence in explanation.map_or(Vec::new(), |found| found.sentences(at)) {
        output::message(&sentence);
    }
    let event = match command.event {
        CenterEvent::Decisive => explanation.and_then(Explanation::event),
        CenterEvent::Contact => match trajectory.first_contact()? {
            Some((event, pair)) => {
                output::message(&format!("first contact: {pair}"));
                Some(event)
            }
            None => bail!("this simulation has no contact but those of the first 0.1 s; leave out --event"),
        },
        CenterEvent::Release => match released {
            Some(event) => Some(event),
            None => bail!("nothing is released in this simulation; leave out --event"),
        },
    };
    if let Some(event) = event {
        output::message(&event.sentence(run.header().control_dt));
    }
    let captions =
        FrameCaptions::new(run.header().control_dt, &run.header().signals, explanation, event.as_ref(), last);
    let seen = command.seen_states(names, &trajectory)?;
    let renderer = FrameRenderer::new(&model, size, drawing, (&cameras, seen), Some(captions))?;
    if !renderer.has_captions() {
        output::message("frames of this size are too small for captions; try --size 320x240");
    }
    Ok((renderer, trajectory, event))
}

/// Renders a picture with up to six frames: start, decisive sample, end, and instants between them.
fn filmstrip(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    command: &Arguments,
) -> Result<ExitStatus> {
    let states = &trajectory.states;
    let last = states.len() - 1;
    let decisive = event.map_or(last, |event| event.sample.min(last));
    let film = Film::new(trajectory.control_dt, last, event.as_ref(), command.around, 1.0);
    let steps = mishandle::picture::strip_samples(event.and_then(|event| event.start), decisive, film.window);
    let count = steps.len();
    renderer.fit(&steps.iter().map(|step| states[*step].as_slice()));
    // As few empty cells as this number of rows has: four frames are two rows of two.
    let columns = count.div_ceil(count.div_ceil(STRIP_COLUMNS));
    let (width, height) = renderer.frame_size();
    let mut whole = Picture::new(columns * width, count.div_ceil(columns) * height, [255; 3]);
    for (i, step) in steps.iter().enumerate() {
        let frame = renderer.draw(*step, &states[*step])?;
        whole.paste(i % columns * width, i / columns * height, width, frame.pixels());
    }
    if count > 1 {
        let time = |step: &usize| {
            let name = event.filter(|_| *step == decisive).map(|event| format!(" ({})", event.kind.name()));
            format!("{:.2} s{}", *step as f64 * trajectory.control_dt, name.unwrap_or_default())
        };
        let times: Vec<String> = steps.iter().map(time).collect();
        output::message(&format!("frames at {}, row by row", times.join(", ")));
    }
    let bytes = png(whole.width() as u32, whole.height() as u32, whole.pixels())?;
    output::write_atomically(&command.out, command.force, &bytes)?;
    Ok(ExitStatus::Done)
}

fn video(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    command: &Arguments,
) -> Result<ExitStatus> {
    let StateTrajectory { states, control_dt, .. } = trajectory;
    let last = states.len() - 1;
    let speed = command.speed.unwrap_or(1.0);
    let film = Film::new(*control_dt, last, event.as_ref(), command.around, speed);
    let (first, end) = film.window;
    if film.window != (0, last) {
        output::message(&format!(
            "the video shows {} to {}",
            instant(first, *control_dt),
            instant(end, *control_dt)
        ));
    }
    renderer.fit(&states[first..=end].iter().step_by(FIT_STRIDE).map(Vec::as_slice));
    // From here on a signal must not end the program directly, because an unfinished file must be
    // removed.
    let bar = Bar::new(film.samples.len() as u64, "frames");
    let cleared = bar.line();
    interrupt::listen(|| (), move || cleared.finish_and_clear())?;
    let file = output::create(&command.out, command.force)?;
    let mut video = Video::start(file, renderer.frame_size(), film.rate)?;
    let mut drawn: Option<(usize, Picture)> = None;
    for (done, sample) in (1..).zip(&film.samples) {
        if interrupt::requested() {
            return Ok(ExitStatus::Interrupted);
        }
        // A held sample is drawn once.
        let picture = match drawn.take() {
            Some((known, picture)) if known == *sample => picture,
            _ => renderer.draw(*sample, &states[*sample])?,
        };
        if video.push_frame(picture.pixels())?.is_break() {
            return Ok(ExitStatus::Interrupted);
        }
        drawn = Some((*sample, picture));
        bar.set_position(done);
    }
    let finished = video.finish()?;
    bar.clear();
    Ok(if finished.is_break() { ExitStatus::Interrupted } else { ExitStatus::Done })
}
