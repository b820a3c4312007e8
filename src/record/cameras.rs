//! Images of the cameras of a task, and what they show of its object.

use mishandle_camera::{Camera, CameraError, Output, PoseReader, Poses, Scene, Size, StateShot, Studio};
use mishandle_dataset::{ImageColumn, VectorColumn};
use mishandle_rollout::{RolloutError, Scenario, Seed, Space};
use mishandle_tasks::sight::{Feed, Frame, Sighting, View};
use mishandle_tasks::{CAMERA_NAMES, TaskError};

use crate::error::MishandleError;
use crate::resolve::{ResolvedPlan, task};

/// Cameras of a data set.
#[derive(Clone, Debug)]
pub struct CameraSettings {
    /// Names of cameras of the task.
    pub names: Vec<String>,
    /// Width and height of the images, pixels.
    pub size: [u16; 2],
}

/// Cameras that draw states of a task.
pub(super) struct Cameras {
    /// Indices of the cameras of the data set.
    cameras: Vec<usize>,
    space: Space,
    view: View,
    reader: PoseReader,
    start: Poses,
    studio: Studio,
}

/// The images of the cameras in an episode.
pub(super) struct Shown {
    /// The images of the first camera, then those of the others.
    pub images: Vec<Vec<u8>>,
    /// For each camera, what each image shows of the object: pixels, visible share and contrast.
    pub sightings: Vec<Vec<f32>>,
}

impl Cameras {
    pub fn new(resolved: &ResolvedPlan, settings: &CameraSettings) -> Result<Cameras, MishandleError> {
        let task = task(&resolved.plan.target).map_err(|_| MishandleError::InvalidValue {
            what: "the target of images",
            value: resolved.plan.target.clone(),
            expected: "a task, because other targets have no cameras: leave out --cameras",
        })?;
        let mut names = settings.names.clone();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(MishandleError::InvalidValue {
                what: "the list of cameras",
                value: format!("one with {} twice", pair[0]),
                expected: "a list with each camera once",
            });
        }
        let [width, height] = settings.size;
        let size = Size::new(width.into(), height.into()).map_err(|error: CameraError| {
            let (what, expected) = ("the size of the images", "a size that the cameras can draw");
            MishandleError::InvalidValue { what, value: error.to_string(), expected }
        })?;
        let scene_error = |source| TaskError::Scene { task: task.definition().name, source };
        let (model, view) = View::new(task, size).map_err(scene_error)?;
        let index = |name: &String| {
            CAMERA_NAMES.iter().position(|known| known == name).ok_or_else(|| MishandleError::UnknownName {
                kind: "camera",
                name: name.clone(),
                known: CAMERA_NAMES.map(ToString::to_string).to_vec(),
            })
        };
        // Images do not depend on the number of threads.
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Cameras {
            cameras: settings.names.iter().map(index).collect::<Result<_, MishandleError>>()?,
            space: resolved.space.clone(),
            view,
            reader: PoseReader::new(&model),
            start: Poses::default(),
            studio: Studio::new(&model, threads),
        })
    }

    /// Returns the image columns, with LeRobot's usual names.
    pub fn image_columns(&self) -> Vec<ImageColumn> {
        let column = |camera: &usize| ImageColumn {
            name: format!("observation.images.{}", CAMERA_NAMES[*camera]),
            width: self.view.cameras[*camera].size.width() as u32,
            height: self.view.cameras[*camera].size.height() as u32,
        };
        self.cameras.iter().map(column).collect()
    }

    /// Returns the columns of what the images show of the object.
    pub fn sighting_columns(&self) -> Vec<VectorColumn> {
        let column = |camera: &usize| VectorColumn {
            name: format!("sight.{}", CAMERA_NAMES[*camera]),
            names: ["pixels", "visible_share", "contrast"].map(ToString::to_string).to_vec(),
        };
        self.cameras.iter().map(column).collect()
    }

    /// Draws all states of an episode as they arrive from each camera: faults and delays of cameras
    /// show earlier states.
    pub fn show(
        &mut self,
        states: &[Vec<f64>],
        scenario: &Scenario,
        seed: Seed,
    ) -> Result<Shown, RolloutError> {
        let Some(first) = states.first() else {
            return Ok(Shown { images: Vec::new(), sightings: vec![Vec::new(); self.cameras.len()] });
        };
        self.reader.read(first, &mut self.start);
        let view = self.view.under(&self.space, scenario, &self.start);
        let mut feed = Feed::new(&self.space, scenario, seed)?;
        let frames: Vec<_> = (0..states.len()).map(|step| feed.next(step)).collect();
        let shots: Vec<(usize, usize)> = self
            .cameras
            .iter()
            .flat_map(|camera| frames.iter().map(|frame| frame[*camera]))
            .map(|Frame { camera, step }| (camera, step))
            .collect();
        let (images, segments) = self.draw(&view.scene, &view.cameras, states, &shots, seed);
        let (_, alone) = self.draw(&view.object_alone(), &view.cameras, states, &shots, seed);
        let sighting = |shot: usize| {
            let width = view.cameras[shots[shot].0].size.width();
            let found = Sighting::new(&view, width, &images[shot], &segments[shot], &alone[shot]);
            [found.pixels as f32, found.visible_share as f32, found.contrast as f32]
        };
        let of_camera =
            |camera: usize| (camera * states.len()..(camera + 1) * states.len()).flat_map(sighting).collect();
        let sightings = (0..self.cameras.len()).map(of_camera).collect();
        Ok(Shown { images, sightings })
    }

    /// Draws shots, which are a camera and a state each. Returns colors and segments.
    fn draw(
        &mut self,
        scene: &Scene,
        cameras: &[Camera],
        states: &[Vec<f64>],
        shots: &[(usize, usize)],
        seed: Seed,
    ) -> (Vec<Vec<u8>>, Vec<Vec<u16>>) {
        let shot = |(camera, step): &(usize, usize)| StateShot {
            state: &states[*step],
            before: step.checked_sub(1).map(|before| states[before].as_slice()),
            scene,
            camera: &cameras[*camera],
            seed: seed.child(*camera as u64),
            step: *step as u64,
        };
        let shots: Vec<StateShot<'_>> = shots.iter().map(shot).collect();
        let pixels = |shot: &StateShot<'_>| shot.camera.size.pixels();
        let mut images: Vec<Vec<u8>> = shots.iter().map(|shot| vec![0; 3 * pixels(shot)]).collect();
        let mut segments: Vec<Vec<u16>> = shots.iter().map(|shot| vec![0; pixels(shot)]).collect();
        let mut outputs: Vec<Output<'_>> = images
            .iter_mut()
            .zip(&mut segments)
            .map(|(rgb, segments)| Output { rgb, depth: None, segments: Some(segments) })
            .collect();
        self.studio.render(&shots, &mut outputs);
        drop(outputs);
        (images, segments)
    }
}
