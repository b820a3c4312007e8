mod film;
mod view;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use mishandle::MishandleError;
use mishandle::inspect::{Event, Explanation};
use mishandle::picture::{
    CameraSettings, Drawing, Film, FrameCaptions, FrameRenderer, SeenStates, StateTrajectory,
};
use mishandle::plan::{CenterEvent, Settings};
use mishandle::store::RunHeader;
use mishandle::world::{CAMERAS, Picture, PictureModel, Quality, Size, WorldError, png};
use mishandle_text::{instant, plural};

use crate::exit_status::ExitStatus;
use crate::flags::{self, numbers};
use crate::run::path_kind::{self, PathKind};
use crate::run::{self, counterexample};
use crate::show::{output, simulation, video};

/// Coordinates of an initial state. Its box is checked later, by an error that names the axis.
const COORDINATE: &str = "a number in the unit of the axis, such as 0.45";

/// Speeds of a video.
const SPEED: &str = "a number from 0.01 to 100, such as 0.25";

/// Render the initial state of a target, or a video, a filmstrip or a viewer of a recorded
/// simulation
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  mishandle render ball-pushing --out start.png
  mishandle render ball-pushing --at 0.45,-0.1 --out start.png
  mishandle render robot.toml --out start.png                      a robot that a file describes
  mishandle render runs/RUN.sqlite --out video.mp4                 the first counterexample
  mishandle render runs/RUN.sqlite --trial 2 --simulation 17 --out strip.png   six frames
  mishandle render failure.json --out failure.mp4                  an exported counterexample
  mishandle render runs/RUN.sqlite --view --speed 0.25             MuJoCo's own viewer

  mishandle render runs/RUN.sqlite --camera auto,close --out two.mp4    two views
  mishandle render runs/RUN.sqlite --camera auto,over,wrist --out seen.mp4   what cameras saw
  mishandle render runs/RUN.sqlite -k render.around=0.5 --speed 0.25 --out slow.mp4
  mishandle render runs/RUN.sqlite -k render.around=1 --out film.apng   for a README

Pictures of a simulation center on its event, and `render` says which one it is and why. If the
formula is violated by something that must always hold, it is the violation. If the formula needs
one good instant (`eventually`), it is the closest approach. If the formula is satisfied, it is the
instant with the smallest margin. A video holds the event for a second. `-k render.event=contact`
and `-k render.event=release` center on something else.

Rendering needs no display. Videos need the program ffmpeg. An animated PNG (.apng) needs neither
ffmpeg nor OpenGL, and has the same bytes on every machine: our ray caster draws it.

The viewer comes from the Python package `mujoco`, which must be installed and needs a display. The
simulation runs again and must be bit-identical to its record. Then its states play in a loop: space
pauses, the arrows left and right go one control step back and forth, Ctrl-Q closes.")]
pub struct Arguments {
    /// Task or target file (.toml), to render its initial state; or run file or exported
    /// counterexample (.json), to render a simulation
    #[arg(value_name = "TARGET|RUN|FILE.json")]
    pub target: String,
    /// Initial state: one value per axis of the initial box, or of the space `starts` of a target
    /// file, in the axis' unit [default: the center of the box, or the nominal values]
    #[arg(long, value_name = "X,Y,...", value_delimiter = ',', allow_hyphen_values = true)]
    #[arg(value_parser = numbers::number(COORDINATE, |_| true))]
    pub at: Option<Vec<f64>>,
    /// Number of the trial of a run, from 1 [default: 1 with --simulation, otherwise any]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub trial: Option<u32>,
    /// Number of the simulation within its trial, from 1 [default: the first counterexample,
    /// otherwise the simulation with the minimum robustness]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = numbers::integer::<u32>(flags::NUMBERS))]
    pub simulation: Option<u32>,
    /// Cameras, side by side in each frame: auto, front, left, right, back, top, close (follows the
    /// hand or the free base), a camera of the MJCF, or one of the target, whose images policies
    /// see: over and wrist for tasks, and those of a target file. These have the light, colors,
    /// faults and delays of the scenario
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', default_value = CAMERAS[0])]
    pub camera: Vec<String>,
    /// Width of each camera's view and height of the frame, in pixels [default: picture 960x720,
    /// video 640x480, filmstrip 480x360, .apng 320x240]
    #[arg(long, value_name = "WxH")]
    pub size: Option<String>,
    /// Speed of a video or of the viewer relative to the simulation [default: 1]
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    #[arg(value_parser = numbers::number(SPEED, |speed| (0.01..=100.0).contains(&speed)))]
    pub speed: Option<f64>,
    /// Open the simulation in MuJoCo's viewer
    #[arg(long, conflicts_with_all = ["out", "camera", "size"])]
    pub view: bool,
    /// Output file: .png for a picture or a filmstrip, .mp4 for a video, .apng for a small one
    #[arg(long, value_name = "FILE", required_unless_present = "view")]
    pub out: Option<PathBuf>,
    /// Overwrite FILE if it exists
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub keys: flags::Keys,
}

/// The subject of a picture, and the place where it goes.
struct Job<'a> {
    command: &'a Arguments,
    settings: &'a Settings,
    out: &'a Path,
    size: Size,
}

impl Job<'_> {
    fn cameras(&self) -> Vec<&str> {
        self.command.camera.iter().map(String::as_str).collect()
    }

    /// Returns those of the cameras that the target has, each once: their images are those that
    /// policies see.
    fn seen(&self, target: &[String]) -> Vec<String> {
        target.iter().filter(|name| self.command.camera.contains(name)).cloned().collect()
    }

    fn image_size(&self) -> [u16; 2] {
        self.settings.render.image_size.unwrap_or(IMAGE_SIZE)
    }

    /// Draws what these cameras of the target see in the states of a simulation.
    fn seen_states(&self, names: Vec<String>, trajectory: &StateTrajectory) -> Result<Option<SeenStates>> {
        let settings = CameraSettings { names, size: self.image_size() };
        Ok(if settings.names.is_empty() { None } else { trajectory.seen_by(&settings)? })
    }

    fn drawing(&self) -> Drawing {
        if kind(self.out).is_ok_and(|kind| kind == Kind::Apng) {
            return Drawing::Rays;
        }
        Drawing::OpenGl(if self.settings.render.fast { Quality::Fast } else { Quality::Fine })
    }
}

/// Frames per row of a filmstrip.
const STRIP_COLUMNS: usize = 3;

/// Default size of a picture, in pixels.
const PICTURE_SIZE: (u32, u32) = (960, 720);

/// Default size of a video, in pixels.
const VIDEO_SIZE: (u32, u32) = (640, 480);

/// Default size of an animated PNG, in pixels.
const APNG_SIZE: (u32, u32) = (320, 240);

/// Default size of a frame in a filmstrip, in pixels.
const STRIP_SIZE: (u32, u32) = (480, 360);

/// Default size of the images of cameras of the target, in pixels.
const IMAGE_SIZE: [u16; 2] = [64, 64];

/// Output format, from the extension of the output file.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Png,
    Apng,
    Mp4,
}

pub fn run(command: &Arguments) -> Result<ExitStatus> {
    let (settings, _) = command.keys.settings("render")?;
    let path = Path::new(&command.target);
    let subject = path_kind::of(path)?;
    let is_recorded = matches!(subject, PathKind::Run | PathKind::Counterexample);
    if is_recorded {
        ensure!(command.at.is_none(), "--at is an initial state of a target; leave it out");
        if matches!(subject, PathKind::Counterexample) {
            flags::check_flags(command.trial, command.simulation)?;
        }
    } else {
        let chosen = command.trial.is_some() || command.simulation.is_some() || command.speed.is_some();
        ensure!(
            !chosen,
            "--trial, --simulation and --speed are about a recorded simulation; name a run file"
        );
    }
    if command.view {
        return view::run(command, &subject, &settings);
    }
    let out = command.out.as_deref().context("--out must name the picture or video to create")?;
    let kind = kind(out)?;
    ensure!(
        is_recorded || kind == Kind::Png,
        "an initial state is a single picture: --out must end in .png; for a video name a run file"
    );
    let default = match kind {
        Kind::Png if is_recorded => STRIP_SIZE,
        Kind::Png => PICTURE_SIZE,
        Kind::Apng => APNG_SIZE,
        Kind::Mp4 => VIDEO_SIZE,
    };
    let size = size(command.size.as_deref(), default)?;
    let views = command.camera.len();
    ensure!(
        views as u32 * size.width() <= *Size::RANGE.end(),
        "{views} views of {} pixels are wider than {} pixels; set a smaller --size",
        size.width(),
        Size::RANGE.end()
    );
    let controller = settings.engine.controller.as_deref().map(Path::new);
    output::refuse_inputs(
        out,
        "--out",
        [Some(path).filter(|_| is_recorded), controller].into_iter().flatten(),
    )?;
    // Fails before the simulation if the output cannot be written.
    drop(output::create(out, command.force)?);
    if kind == Kind::Mp4 {
        video::check_encoder()?;
    }
    let job = Job { command, settings: &settings, out, size };
    let (mut renderer, trajectory, event) = match subject {
        PathKind::Run => of_run(path, &job)?,
        PathKind::Counterexample => of_counterexample(path, &job)?,
        _ => start(&command.target, &job)?,
    };
    let status = match kind {
        Kind::Png => filmstrip(&mut renderer, &trajectory, event, &job)?,
        Kind::Apng => film::animation(&mut renderer, &trajectory, event, &job)?,
        Kind::Mp4 => film::video(&mut renderer, &trajectory, event, &job)?,
    };
    match status {
        ExitStatus::Interrupted => output::message("interrupted; nothing was written"),
        _ => output::message(&format!("wrote {}", out.display())),
    }
    Ok(status)
}

/// The subject of pictures: its states, and the event that they center on.
type Drawn = (FrameRenderer, StateTrajectory, Option<Event>);

/// Draws the initial state of a target.
fn start(target: &str, job: &Job<'_>) -> Result<Drawn> {
    let trajectory = mishandle::picture::initial_state(target, job.command.at.as_deref())?;
    let model = mishandle::resolve::picture_model(target)?;
    let known = mishandle::resolve::camera_names(target)?;
    let names = job.seen(&known);
    check_fits(job, &names)?;
    let seen = job.seen_states(names, &trajectory)?;
    let renderer = FrameRenderer::new(&model, job.size, job.drawing(), &job.cameras(), seen, None);
    Ok((renderer.map_err(|error| with_cameras(error, known))?, trajectory, None))
}

/// Checks that images of cameras of the target, which have these names, fit into frames.
fn check_fits(job: &Job<'_>, names: &[String]) -> Result<()> {
    ensure!(
        job.settings.render.image_size.is_none() || !names.is_empty(),
        "render.image-size has no effect without a camera of the target in --camera, such as over for tasks"
    );
    let [width, height] = job.image_size();
    let frame = [job.size.width(), job.size.height()];
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
        Some("apng") => Ok(Kind::Apng),
        Some("mp4") => Ok(Kind::Mp4),
        _ => bail!("--out is {}; it must end in .png (picture), .mp4 or .apng (video)", out.display()),
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

/// Replays a simulation of a run.
fn of_run(path: &Path, job: &Job<'_>) -> Result<Drawn> {
    let engine = &job.settings.engine;
    let run = run::read(path, engine.skip_check)?;
    let choice = (job.command.trial, job.command.simulation);
    let Some((trial, simulation)) = mishandle::replay::select_simulation(&run, choice.0, choice.1)? else {
        bail!("{} has no decided simulation; choose one with --trial and --simulation", path.display());
    };
    let header = run.header();
    let scene = Scene::new(&mishandle::resolve::recorded_target(header)?, job)?;
    let (replayed, trajectory) =
        mishandle::picture::replay_states(&run, trial, simulation, engine.controller.as_deref())?;
    run::report_build_differences("made", &replayed.build_differences);
    if !replayed.differences.is_empty() {
        bail!("{}", run::differences_text(&replayed.differences));
    }
    let point = mishandle::run::box_point(header, trial, &replayed.recorded.scenario);
    let name = simulation::name(trial, point, simulation);
    output::message(&format!("{name}: {}", plural(replayed.episode.steps, "control step")));
    let released = mishandle::inspect::release(&replayed.episode.trace);
    // An undecided simulation has no explanation.
    let explained = replayed.recorded.robustness.and_then(|_| {
        mishandle::inspect::explain_recorded(header, replayed.recorded, replayed.episode.trace).ok()
    });
    let explanation = explained.as_ref().map(|explained| &explained.explanation);
    scene.draw(header, explanation, released, trajectory)
}

/// Simulates an exported counterexample again.
fn of_counterexample(path: &Path, job: &Job<'_>) -> Result<Drawn> {
    let (recorded, replayed) = counterexample::replay(path, job.settings.engine.moved())?;
    ensure!(
        replayed.differences.is_empty(),
        "the counterexample differs from the replay:\n  {}",
        replayed.differences.join("\n  ")
    );
    let folder = path.parent().unwrap_or(Path::new(""));
    let resolved = recorded.resolve(folder, job.settings.engine.moved())?;
    let scene = Scene::new(&resolved.plan.target, job)?;
    let request = recorded.request(&resolved.space)?;
    let (episode, trajectory) = mishandle::picture::simulate_states(&resolved, &request)?;
    let name = simulation::name(recorded.trial, None, recorded.simulation);
    output::message(&format!("{name}: {}", plural(episode.steps, "control step")));
    let released = mishandle::inspect::release(&episode.trace);
    scene.draw(&replayed.header, Some(&replayed.explained.explanation), released, trajectory)
}

/// The scene of a recorded simulation.
struct Scene<'a> {
    job: &'a Job<'a>,
    model: PictureModel,
    /// Cameras of the target.
    seen: Vec<String>,
}

impl<'a> Scene<'a> {
    /// Fails before the simulation if pictures cannot be drawn.
    fn new(target: &str, job: &'a Job<'a>) -> Result<Scene<'a>> {
        let model = mishandle::resolve::picture_model(target)?;
        let known = mishandle::resolve::camera_names(target)?;
        let seen = job.seen(&known);
        check_fits(job, &seen)?;
        let of_scene: Vec<&str> =
            job.cameras().into_iter().filter(|name| !seen.iter().any(|seen| seen == name)).collect();
        drop(
            FrameRenderer::new(&model, job.size, job.drawing(), &of_scene, None, None)
                .map_err(|error| with_cameras(error, known))?,
        );
        Ok(Scene { job, model, seen })
    }

    /// Says what the pictures center on.
    fn draw(
        self,
        header: &RunHeader,
        explanation: Option<&Explanation>,
        released: Option<Event>,
        trajectory: StateTrajectory,
    ) -> Result<Drawn> {
        let Scene { job, model, seen } = self;
        ensure!(!trajectory.states.is_empty(), "the simulation has no states to render");
        let last = trajectory.states.len() - 1;
        let at = |sample| instant(sample, header.control_dt);
        for sentence in explanation.map_or(Vec::new(), |found| found.sentences(at)) {
            output::message(&sentence);
        }
        let event = match job.settings.render.event {
            CenterEvent::Decisive => explanation.and_then(Explanation::event),
            CenterEvent::Contact => match trajectory.first_contact()? {
                Some((event, pair)) => {
                    output::message(&format!("first contact: {pair}"));
                    Some(event)
                }
                None => bail!("this simulation has no contact after the first 0.1 s; leave out render.event"),
            },
            CenterEvent::Release => match released {
                Some(event) => Some(event),
                None => bail!("nothing is released in this simulation; leave out render.event"),
            },
        };
        if let Some(event) = event {
            output::message(&event.sentence(header.control_dt));
        }
        let captions =
            FrameCaptions::new(header.control_dt, &header.signals, explanation, event.as_ref(), last);
        let captions = if job.settings.render.contacts { captions.marking_contacts() } else { captions };
        let seen = job.seen_states(seen, &trajectory)?;
        let cameras = job.cameras();
        let renderer = FrameRenderer::new(&model, job.size, job.drawing(), &cameras, seen, Some(captions))?;
        if !renderer.has_captions() {
            output::message("frames of this size are too small for captions; try --size 320x240");
        }
        Ok((renderer, trajectory, event))
    }
}

/// Renders a picture with up to six frames: start, decisive sample, end, and instants between them.
fn filmstrip(
    renderer: &mut FrameRenderer,
    trajectory: &StateTrajectory,
    event: Option<Event>,
    job: &Job<'_>,
) -> Result<ExitStatus> {
    let states = &trajectory.states;
    let last = states.len() - 1;
    let center = event.map_or(last, |event| event.sample.min(last));
    let (start, end) = event.map_or((None, last), |event| event.ends());
    let film = Film::new(trajectory.control_dt, last, event.as_ref(), job.settings.render.around, 1.0);
    let (from, to) = film.window;
    let steps = mishandle::picture::strip_samples(start, end, from, to);
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
            let name = event.filter(|_| *step == center).map(|event| format!(" ({})", event.kind.name()));
            format!("{:.2} s{}", *step as f64 * trajectory.control_dt, name.unwrap_or_default())
        };
        let times: Vec<String> = steps.iter().map(time).collect();
        output::message(&format!("frames at {}, row by row", times.join(", ")));
    }
    let bytes = png(whole.width() as u32, whole.height() as u32, whole.pixels())?;
    output::write_atomically(job.out, job.command.force, &bytes)?;
    Ok(ExitStatus::Done)
}
