//! Images that the cameras of a target see in a simulation, and what they show of its object.

use std::ops::Range;

use mishandle_camera::sight::{Feed, Frame, Sight, Sighting, View};
use mishandle_camera::{Camera, CameraError, Output, PoseReader, Poses, Scene, Size, StateShot, Studio};
use mishandle_rollout::{Image, RolloutError, Scenario, Seed, Space};

use crate::error::{MishandleError, invalid};
use crate::resolve::{TargetSight, target_sight};

/// Cameras of a target.
#[derive(Clone, Debug)]
pub struct CameraSettings {
    /// Their names.
    pub names: Vec<String>,
    /// Width and height of the images, pixels.
    pub size: [u16; 2],
}

/// Cameras that draw states of a target.
#[derive(Debug)]
pub struct TargetCameras {
    /// Indices of the requested cameras, in the order of their names.
    cameras: Vec<usize>,
    /// For each of them, where its image is in what the controller saw in a control step; `None` if
    /// the controller does not see it with this size.
    seen: Vec<Option<Range<usize>>>,
    /// Bytes that the controller sees in a control step.
    seen_bytes: usize,
    sight: Sight,
    space: Space,
    view: View,
    reader: PoseReader,
    start: Poses,
    studio: Studio,
}

/// The view and the arriving images of the cameras in one simulation.
#[derive(Debug)]
pub struct SeenEpisode {
    view: View,
    /// For each camera, which image arrives in each control step.
    frames: Vec<Vec<Frame>>,
    seed: Seed,
}

/// The images of the cameras in an episode.
pub(crate) struct Shown {
    /// The images of the first camera, then those of the others.
    pub images: Vec<Vec<u8>>,
    /// For each camera, what each image shows of the object: pixels, visible share and contrast.
    /// Empty if the target states no object.
    pub sightings: Vec<Vec<f32>>,
}

impl TargetCameras {
    /// Makes cameras of a target: the name of a task, or the path of a target file. Scenarios have
    /// the axes of `space`.
    ///
    /// # Errors
    /// If the target has no such camera, a camera is named twice, or the size is out of range.
    pub fn new(
        target: &str,
        space: &Space,
        settings: &CameraSettings,
    ) -> Result<TargetCameras, MishandleError> {
        let mut names = settings.names.clone();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(invalid(
                "the list of cameras",
                format!("one with {} twice", pair[0]),
                "a list with each camera once",
            ));
        }
        let [width, height] = settings.size;
        let size = Size::new(width.into(), height.into()).map_err(|error: CameraError| {
            let what = "the size of the images";
            let expected = "a size that the cameras can draw";
            invalid(what, error, expected)
        })?;
        let TargetSight { sight, model, view } = target_sight(target, size)?;
        let index = |name: &String| {
            sight.names().position(|known| known == name).ok_or_else(|| MishandleError::UnknownName {
                kind: "camera",
                name: name.clone(),
                known: sight.names().map(ToString::to_string).collect(),
            })
        };
        let cameras: Vec<usize> = settings.names.iter().map(index).collect::<Result<_, MishandleError>>()?;
        // Images do not depend on the number of threads.
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(TargetCameras {
            seen: vec![None; cameras.len()],
            seen_bytes: 0,
            cameras,
            sight,
            space: space.clone(),
            view,
            reader: PoseReader::new(&model),
            start: Poses::default(),
            studio: Studio::new(&model, threads),
        })
    }

    /// Takes the images that a controller saw where they are the same. `sees` are all of them.
    pub(crate) fn seen_by(mut self, sees: &[Image]) -> TargetCameras {
        let [width, height] = self.size();
        let same_image = |name: &str| {
            let expected = Image { camera: name.to_string(), width, height };
            let place = sees.iter().position(|image| *image == expected)?;
            let first = sees[..place].iter().map(Image::bytes).sum();
            Some(first..first + expected.bytes())
        };
        self.seen = self.names().map(same_image).collect();
        self.seen_bytes = sees.iter().map(Image::bytes).sum();
        self
    }

    /// Returns how many bytes the controller saw in a control step, if some are images of these
    /// cameras.
    pub(crate) fn kept_bytes(&self) -> Option<usize> {
        self.seen.iter().any(Option::is_some).then_some(self.seen_bytes)
    }

    /// Returns the names of the cameras.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.cameras.iter().filter_map(|camera| self.sight.names().nth(*camera))
    }

    /// Returns the width and the height of the images, pixels.
    pub fn size(&self) -> [usize; 2] {
        let size = self.view.cameras[self.cameras[0]].size;
        [size.width(), size.height()]
    }

    /// Returns the names of the cameras, if what they show of an object is measured.
    pub(crate) fn measured(&self) -> impl Iterator<Item = &str> {
        self.names().filter(|_| self.view.has_object())
    }

    /// Prepares the images of an episode with these states. `None` without a state.
    ///
    /// # Errors
    /// If two axes of the space have the same name.
    pub fn start(
        &mut self,
        states: &[Vec<f64>],
        scenario: &Scenario,
        seed: Seed,
    ) -> Result<Option<SeenEpisode>, RolloutError> {
        let Some(first) = states.first() else { return Ok(None) };
        self.reader.read(first, &mut self.start);
        let view = self.view.under(&self.space, scenario, &self.start);
        let mut feed = Feed::new(&self.sight, &self.space, scenario, seed)?;
        let mut frames = vec![Vec::with_capacity(states.len()); self.cameras.len()];
        for step in 0..states.len() {
            let arrived = feed.next(step);
            frames.iter_mut().zip(&self.cameras).for_each(|(own, camera)| own.push(arrived[*camera]));
        }
        Ok(Some(SeenEpisode { view, frames, seed }))
    }

    /// Returns the image that arrives from a camera in a control step.
    ///
    /// # Panics
    /// If the camera is not one of [`names`](Self::names), or `states` are not those of the start.
    pub fn image(&mut self, seen: &SeenEpisode, states: &[Vec<f64>], camera: usize, step: usize) -> Vec<u8> {
        let SeenEpisode { view, frames, seed } = seen;
        let frame = frames[camera][step];
        let camera = &view.cameras[frame.camera];
        let shot = frame.shot(&view.scene, camera, |step| states[step].as_slice(), *seed);
        let mut rgb = vec![0; 3 * shot.camera.size.pixels()];
        self.studio.render(&[shot], &mut [Output { rgb: Some(&mut rgb), depth: None, segments: None }]);
        rgb
    }

    /// Draws all states of an episode as they arrive from each camera: faults and delays of cameras
    /// show earlier states. Images that the controller `saw` are not drawn again.
    pub(crate) fn show(
        &mut self,
        states: &[Vec<f64>],
        scenario: &Scenario,
        seed: Seed,
        saw: &[u8],
    ) -> Result<Shown, RolloutError> {
        let Some(seen) = self.start(states, scenario, seed)? else {
            let sightings = vec![Vec::new(); self.measured().count()];
            return Ok(Shown { images: Vec::new(), sightings });
        };
        let SeenEpisode { view, frames, seed } = seen;
        let shots = frames.concat();
        let image_of = |shot: usize| match &self.seen[shot / states.len()] {
            Some(place) => saw[shot % states.len() * self.seen_bytes..][place.clone()].to_vec(),
            None => Vec::new(),
        };
        let mut images: Vec<Vec<u8>> = (0..shots.len()).map(image_of).collect();
        let segments = self.draw(&view.scene, &view.cameras, states, &shots, seed, Some(&mut images));
        if !view.has_object() {
            return Ok(Shown { images, sightings: Vec::new() });
        }
        let alone = self.draw(&view.object_alone(), &view.cameras, states, &shots, seed, None);
        let sighting = |shot: usize| {
            let width = view.cameras[shots[shot].camera].size.width();
            let found = Sighting::new(&view, width, &images[shot], &segments[shot], &alone[shot]);
            [found.pixels as f32, found.visible_share as f32, found.contrast as f32]
        };
        let of_camera =
            |camera: usize| (camera * states.len()..(camera + 1) * states.len()).flat_map(sighting).collect();
        let sightings = (0..self.cameras.len()).map(of_camera).collect();
        Ok(Shown { images, sightings })
    }

    /// Draws shots and returns their segments. Fills those of `images` that are empty.
    fn draw(
        &mut self,
        scene: &Scene,
        cameras: &[Camera],
        states: &[Vec<f64>],
        shots: &[Frame],
        seed: Seed,
        images: Option<&mut [Vec<u8>]>,
    ) -> Vec<Vec<u16>> {
        let shot = |frame: &Frame| {
            let state = |step: usize| states[step].as_slice();
            frame.shot(scene, &cameras[frame.camera], state, seed)
        };
        let shots: Vec<StateShot<'_>> = shots.iter().map(shot).collect();
        let pixels = |shot: &StateShot<'_>| shot.camera.size.pixels();
        let mut segments: Vec<Vec<u16>> = shots.iter().map(|shot| vec![0; pixels(shot)]).collect();
        let outputs = segments.iter_mut().map(|own| Output { rgb: None, depth: None, segments: Some(own) });
        let mut outputs: Vec<Output<'_>> = outputs.collect();
        let images = images.into_iter().flatten().zip(&shots).zip(&mut outputs);
        for ((rgb, shot), output) in images.filter(|((rgb, _), _)| rgb.is_empty()) {
            rgb.resize(3 * pixels(shot), 0);
            output.rgb = Some(rgb);
        }
        self.studio.render(&shots, &mut outputs);
        drop(outputs);
        segments
    }
}
