//! Demonstrations: episodes with what the controller saw and did, as a data set to train on.
//!
//! The scenarios are those of the evaluation of the same plan. With labels, one controller acts and
//! another one says what it would do in each state, as DAgger needs it (Ross, Gordon and Bagnell,
//! "A reduction of imitation learning and structured prediction to no-regret online learning",
//! AISTATS 2011).

mod labels;

use std::collections::HashMap;
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use mishandle_dataset::{Contents, Fact, Format, ImageColumn, VectorColumn, Writer, frames_per_second};
use mishandle_files::AtomicFolder;
use mishandle_results::{Choice, Demonstrations, Key, Remedy};
use mishandle_rollout::{
    Controller, Environment, Episode, Request, Scenario, Seed, System, TrainingScenarios,
};
use mishandle_store::RANDOM_TRIAL;
use mishandle_text::{path_text, plural};
use mishandle_training::{ScenarioDraw, ScenarioOrigin, ScenarioSettings};

use crate::archive::given_scenarios;
use crate::error::{MishandleError, RunError, invalid, problem};
use crate::picture::{
    CameraSettings, Decisions, RecordedController, Recording, RecordingEnvironment, SharedDecisions,
    SharedRecordings, TargetCameras,
};
use crate::plan::{CPU, RecordSettings};
use crate::resolve::{ResolvedPlan, SceneTarget, has_scene, scene_target, training_target};
use crate::run::end_text;
use crate::run::evaluation::with_requests;

use self::labels::{labeler, labels};

/// Bytes of the images of controllers that are in memory until they are written.
const KEPT_BYTES: usize = 1 << 28;

/// Returns how scenarios are drawn from the failures in the archive `path`.
fn draw(path: &Path, share: f64, resolved: &ResolvedPlan) -> Result<ScenarioDraw, MishandleError> {
    if !(0.0..=1.0).contains(&share) {
        return Err(invalid("record.archive-share", share, "a number from 0 to 1"));
    }
    // A robot whose file has no rewards cannot be trained, so only its axes are compared.
    let target = training_target(&resolved.plan.target, CPU).ok();
    let given = given_scenarios(path, &resolved.space, target.as_deref())?;
    let scenarios = TrainingScenarios { given, ..TrainingScenarios::of(resolved.space.clone()) };
    let settings = ScenarioSettings { file_share: share, ..ScenarioSettings::default() };
    Ok(ScenarioDraw::new(scenarios, &settings))
}

/// Returns the format with this name.
fn format(name: &str) -> Result<Format, MishandleError> {
    let known = || Format::ALL.iter().map(|format| format.name().to_string()).collect();
    let found = Format::ALL.into_iter().find(|format| format.name() == name);
    found.ok_or_else(|| MishandleError::UnknownName {
        kind: "format",
        name: name.to_string(),
        known: known(),
    })
}

/// Records the random simulations of an evaluation as a data set in the new folder `out`. A share
/// of them can have scenarios of an archive of failures instead.
///
/// `watch` gets the number of finished simulations after each batch and can stop the recording.
/// Then the result is `None`, and nothing is written: the folder appears when it is complete.
///
/// # Errors
/// If the plan has no table `[evaluate]`, the target has no controller that this program runs, the
/// folder exists, no episode is kept, or a simulation cannot be run or written.
pub fn record(
    resolved: &ResolvedPlan,
    settings: &RecordSettings,
    out: &Path,
    mut watch: impl FnMut(u64) -> ControlFlow<()>,
) -> Result<Option<Demonstrations>, MishandleError> {
    let format = format(&settings.format)?;
    let target = recordable(resolved)?;
    check_rate(resolved, format)?;
    let labeler = settings.relabel.as_deref().map(|name| labeler(resolved, name)).transpose()?;
    let (target, labeler) = match labeler {
        Some(labeler) => {
            let (target, labeler) = target.beside(labeler)?;
            (target, Some(labeler))
        }
        None => (target, None),
    };
    let archive = settings.archive.as_deref().map(|path| draw(path, settings.archive_share, resolved));
    let archive = archive.transpose()?;
    let named = CameraSettings { names: settings.camera.clone(), size: settings.size };
    let named = (!named.names.is_empty()).then_some(&named);
    let named = named.map(|named| TargetCameras::new(&resolved.plan.target, &resolved.space, named));
    let mut cameras = named.transpose()?.map(|cameras| cameras.seen_by(target.controller().sees()));
    let kept_bytes = cameras.as_ref().and_then(TargetCameras::kept_bytes);
    let failed = |source: std::io::Error| match source.kind() {
        ErrorKind::AlreadyExists => {
            invalid("the folder of the data set", path_text(out), "a path where nothing exists")
                .with(Remedy::Another(Key::OUT))
        }
        _ => MishandleError::Write { what: "data set", path: out.to_path_buf(), source },
    };
    let folder = AtomicFolder::create_new(out).map_err(failed)?;
    let contents = contents(resolved, &target, cameras.as_ref(), labeler.is_some());
    let mut writer = format.writer(contents, folder.path()).map_err(failed)?;
    let mut recorder = Recorder::new(resolved, &target, labeler, cameras.is_some(), kept_bytes.is_some())?;
    let mut found = Demonstrations {
        subject: resolved.subject(),
        folder: path_text(out),
        format: settings.format.clone(),
        relabel: settings.relabel.clone(),
        archive: settings.archive.as_deref().map(path_text),
        archived: 0,
        simulations: 0,
        episodes: 0,
        frames: 0,
        successes: 0,
        left_out: 0,
        bytes: 0,
    };
    let (episodes, batch) = resolved
        .plan
        .evaluate
        .as_ref()
        .map_or((0, 1), |evaluate| (evaluate.episodes, u64::from(evaluate.batch.max(1))));
    // Images that are kept until they are written have a limit.
    let steps = resolved.target.episode_steps;
    let fitting = kept_bytes.map_or(batch, |bytes| (KEPT_BYTES / (bytes * steps).max(1)).max(1) as u64);
    let batch = batch.min(fitting);
    while found.simulations < episodes {
        let last = episodes.min(found.simulations + batch);
        let mut requests: Vec<Request> = with_requests(resolved, |requests| {
            let request = |number: u64| requests.request(RANDOM_TRIAL, number as u32);
            (found.simulations + 1..=last).filter_map(|number| request(number).transpose()).collect()
        })?;
        if let Some(archive) = &archive {
            for request in &mut requests {
                if let (ScenarioOrigin::Given, scenario) = archive.draw(request.seed) {
                    request.scenario = scenario;
                    found.archived += 1;
                }
            }
        }
        for mut recorded in recorder.run(&requests)? {
            found.simulations += 1;
            let is_kept = recorded.frames > 0 && (recorded.is_success || !settings.successful);
            if !is_kept {
                found.left_out += 1;
                continue;
            }
            let frames = recorded.frames;
            let is_success = recorded.is_success;
            let images = recorded.show(cameras.as_mut())?;
            recorded.write(&mut *writer, &images).map_err(failed)?;
            found.episodes += 1;
            found.frames += frames as u64;
            found.successes += u64::from(is_success);
        }
        if watch(found.simulations).is_break() {
            return Ok(None);
        }
    }
    if found.episodes == 0 {
        let none = plural(found.simulations, "simulation");
        let error = problem(format!("none of {none} is in the data set, so nothing is written"));
        return Err(error.with(Remedy::Unset(Key::RECORD_SUCCESSFUL)));
    }
    writer.finish().map_err(failed)?;
    std::fs::write(folder.path().join("plan.toml"), resolved.plan.to_toml()).map_err(failed)?;
    found.bytes = size(folder.path()).map_err(failed)?;
    folder.persist().map_err(failed)?;
    Ok(Some(found))
}

/// Returns the target of a plan as one whose observations and actions this program sees.
fn recordable(resolved: &ResolvedPlan) -> Result<SceneTarget, MishandleError> {
    if has_scene(&resolved.target.identity.kind) {
        scene_target(resolved)
    } else {
        Err(invalid(
            "the target of demonstrations",
            &resolved.plan.target,
            "a task or a target file, because this program runs no controller of other targets",
        ))
    }
}

/// Checks that a format can have the control rate of the target.
fn check_rate(resolved: &ResolvedPlan, format: Format) -> Result<(), MishandleError> {
    let dt = resolved.target.control_dt;
    if format == Format::LeRobot && frames_per_second(dt).is_none() {
        let expected = "a whole number of steps per second for the format lerobot";
        let npz = Remedy::set(Key::RECORD_FORMAT, Choice::OneOf(&["npz"]));
        Err(invalid("the control step of the target", format!("{dt} s"), expected).with(npz))
    } else {
        Ok(())
    }
}

/// Returns what the frames of a data set contain, with LeRobot's usual names.
fn contents(
    resolved: &ResolvedPlan,
    target: &SceneTarget,
    cameras: Option<&TargetCameras>,
    is_relabeled: bool,
) -> Contents {
    let actions = (0..target.controller().action_size()).map(|index| target.action_name(index));
    let actions: Vec<String> = actions.collect();
    let column =
        |name: &str, names: &[String]| VectorColumn { name: name.to_string(), names: names.to_vec() };
    let mut vectors =
        vec![column("observation.state", &target.observation_names()), column("action", &actions)];
    if is_relabeled {
        vectors.push(column("action.executed", &actions));
    }
    let names: Vec<&str> = cameras.map_or_else(Vec::new, |cameras| cameras.names().collect());
    let sighting = ["pixels", "visible_share", "contrast"].map(ToString::to_string);
    let measured = cameras.into_iter().flat_map(TargetCameras::measured);
    vectors.extend(measured.map(|name| column(&format!("sight.{name}"), &sighting)));
    let [width, height] = cameras.map_or([0; 2], |cameras| cameras.size().map(|side| side as u32));
    // LeRobot's usual names.
    let image = |name: &&str| ImageColumn { name: format!("observation.images.{name}"), width, height };
    Contents {
        task: target.instruction().to_string(),
        robot: target.robot().to_string(),
        dt: resolved.target.control_dt,
        vectors,
        images: names.iter().map(image).collect(),
    }
}

/// Runs simulations and returns what happened in them.
struct Recorder<'a> {
    resolved: &'a ResolvedPlan,
    system: Box<dyn System>,
    decisions: SharedDecisions,
    labeler: Option<Arc<dyn Controller>>,
    /// The states, if they are labeled or drawn.
    recordings: Option<SharedRecordings>,
    sizes: [usize; 2],
    action_limit: f32,
}

impl<'a> Recorder<'a> {
    fn new(
        resolved: &'a ResolvedPlan,
        target: &SceneTarget,
        labeler: Option<Arc<dyn Controller>>,
        is_drawn: bool,
        keeps_images: bool,
    ) -> Result<Recorder<'a>, MishandleError> {
        let space = &resolved.space;
        let specification = &resolved.specification;
        let scene = target.environment(space, specification, false)?;
        let action_limit = scene.action_limit() as f32;
        let mut environment: Arc<dyn Environment> = scene.clone();
        let mut recordings = None;
        if is_drawn || labeler.is_some() {
            let (recording, shared) = RecordingEnvironment::new(scene);
            environment = Arc::new(recording);
            recordings = Some(shared);
        }
        let decisions = SharedDecisions::default();
        let system = target.system_in(environment, space, specification)?.map_controller(|controller| {
            Arc::new(RecordedController::new(controller, decisions.clone(), keeps_images))
        });
        let controller = target.controller();
        let sizes = [controller.observation_size(), controller.action_size()];
        Ok(Recorder {
            resolved,
            system: Box::new(system),
            decisions,
            labeler,
            recordings,
            sizes,
            action_limit,
        })
    }

    /// Runs a batch of simulations.
    fn run(&mut self, requests: &[Request]) -> Result<Vec<Recorded>, MishandleError> {
        let episodes = self.system.rollout(requests)?;
        let taken = self.decisions.take();
        // All seeds of an evaluation differ.
        let mut decisions: HashMap<_, Decisions> =
            taken.into_iter().map(|taken| (taken.seed, taken)).collect();
        let recordings = self.recordings.as_ref().map_or(Vec::new(), SharedRecordings::take);
        let mut recordings: HashMap<_, Recording> =
            recordings.into_iter().map(|recording| (recording.seed, recording)).collect();
        let recorded = |episode: &Episode| {
            let seed = episode.request.seed;
            let decisions = decisions.remove(&seed).ok_or(MishandleError::Run(RunError::NoEpisode))?;
            self.recorded(episode, decisions, recordings.remove(&seed))
        };
        episodes.iter().map(recorded).collect()
    }

    fn recorded(
        &self,
        episode: &Episode,
        decisions: Decisions,
        recording: Option<Recording>,
    ) -> Result<Recorded, MishandleError> {
        // An episode that failed has an action of the step that failed, too.
        let frames = episode.steps;
        let [observation_size, action_size] = self.sizes;
        let Decisions { seed, mut observations, mut actions, images } = decisions;
        observations.truncate(frames * observation_size);
        actions.truncate(frames * action_size);
        let clip = |action: &mut f32| *action = action.clamp(-self.action_limit, self.action_limit);
        actions.iter_mut().for_each(clip);
        let mut vectors = vec![observations, actions];
        let (mut states, seen) =
            recording.map_or_else(Default::default, |found| (found.states, found.observations));
        states.truncate(frames);
        if let Some(labeler) = &self.labeler {
            let mut labels = labels(&**labeler, seed, &seen[..frames * observation_size])?;
            labels.iter_mut().for_each(clip);
            vectors.insert(1, labels);
        }
        let is_success = episode.is_success();
        let scenario = episode.request.scenario.clone();
        let facts = self.facts(episode);
        Ok(Recorded { seed, scenario, frames, states, images, vectors, is_success, facts })
    }

    /// Returns the facts of an episode that its frames do not contain.
    fn facts(&self, episode: &Episode) -> Vec<(String, Fact)> {
        let Request { number, seed, scenario, .. } = &episode.request;
        let names: Vec<&str> = self.resolved.signals.iter().map(|signal| signal.name.as_str()).collect();
        let number_or_none = |value: Option<f64>| Fact::Number(value.unwrap_or(f64::NAN));
        let mut facts = vec![
            ("simulation".to_string(), Fact::Integer((*number).into())),
            ("seed".to_string(), Fact::Integer(seed.0)),
            ("robustness".to_string(), number_or_none(episode.robustness())),
            ("end".to_string(), Fact::Text(end_text(episode.end, &names))),
        ];
        let axes = self.resolved.space.axes().iter().zip(scenario.values());
        facts.extend(axes.map(|(axis, value)| (format!("scenario.{}", axis.name), number_or_none(*value))));
        facts
    }
}

/// An episode of the data set.
struct Recorded {
    seed: Seed,
    scenario: Scenario,
    frames: usize,
    /// State of each frame, if the states are drawn.
    states: Vec<Vec<f64>>,
    /// Images that the controller saw, if they are in the data set.
    images: Vec<u8>,
    vectors: Vec<Vec<f32>>,
    is_success: bool,
    facts: Vec<(String, Fact)>,
}

impl Recorded {
    /// Draws what the cameras show, adds what it shows of the object, and returns the images.
    fn show(&mut self, cameras: Option<&mut TargetCameras>) -> Result<Vec<Vec<u8>>, MishandleError> {
        let Some(cameras) = cameras else { return Ok(Vec::new()) };
        let shown = cameras.show(&self.states, &self.scenario, self.seed, &self.images)?;
        self.vectors.extend(shown.sightings);
        Ok(shown.images)
    }

    fn write(&self, writer: &mut dyn Writer, images: &[Vec<u8>]) -> std::io::Result<()> {
        let Recorded { frames, vectors, is_success, facts, .. } = self;
        let frames = *frames;
        let is_success = *is_success;
        let mut draw = |camera: usize, frame: usize, pixels: &mut [u8]| {
            pixels.copy_from_slice(&images[camera * frames + frame]);
            Ok(())
        };
        writer.add(&mishandle_dataset::Episode { frames, vectors, is_success, facts }, &mut draw)
    }
}

/// Returns the size of all files in a folder, bytes.
fn size(folder: &Path) -> std::io::Result<u64> {
    let mut bytes = 0;
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        bytes += if entry.file_type()?.is_dir() { size(&entry.path())? } else { entry.metadata()?.len() };
    }
    Ok(bytes)
}
