//! Images of the cameras of a task.

use mishandle_camera::{Camera, Output, Scene, Size, StateShot, Studio};
use mishandle_dataset::ImageColumn;
use mishandle_rollout::Seed;
use mishandle_tasks::{CameraPlace, TaskError, compose};
use mishandle_world::Model;

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
    names: Vec<String>,
    cameras: Vec<Camera>,
    scene: Scene,
    studio: Studio,
}

impl Cameras {
    pub fn new(resolved: &ResolvedPlan, settings: &CameraSettings) -> Result<Cameras, MishandleError> {
        let task = task(&resolved.plan.target).map_err(|_| MishandleError::InvalidValue {
            what: "the target of images",
            value: resolved.plan.target.clone(),
            expected: "a task, because other targets have no cameras: leave out --cameras",
        })?;
        let failed = |error: String| MishandleError::InvalidValue {
            what: "the scene of the cameras",
            value: error,
            expected: "a scene that the cameras can draw",
        };
        let scene_error = |source| TaskError::Scene { task: task.definition().name, source };
        let document = compose(task).map_err(scene_error)?;
        let model = Model::from_xml(&document).map_err(scene_error)?;
        let scene = Scene::of_model(&model).map_err(|error| failed(error.to_string()))?;
        let [width, height] = settings.size;
        let size = Size::new(width.into(), height.into()).map_err(|error| failed(error.to_string()))?;
        let places = task.cameras();
        let place = |name: &String| {
            places.iter().find(|place| place.name == name).ok_or_else(|| MishandleError::UnknownName {
                kind: "camera",
                name: name.clone(),
                known: places.iter().map(|place| place.name.to_string()).collect(),
            })
        };
        let camera = |name: &String| {
            let CameraPlace { body, from, to, up, focal_length, .. } = *place(name)?;
            let body = body.map_or(Ok(0), |name| model.body(name).map(|body| body.index()));
            let points = [from, to, up].map(|point| point.map(|value| value as f32));
            Ok(Camera::looking(size, body.map_err(scene_error)?, points, focal_length as f32))
        };
        let cameras = settings.names.iter().map(camera).collect::<Result<_, MishandleError>>()?;
        // Images do not depend on the number of threads.
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let studio = Studio::new(&model, threads);
        Ok(Cameras { names: settings.names.clone(), cameras, scene, studio })
    }

    /// Returns the image columns, with LeRobot's usual names.
    pub fn columns(&self) -> Vec<ImageColumn> {
        let column = |(name, camera): (&String, &Camera)| ImageColumn {
            name: format!("observation.images.{name}"),
            width: camera.size.width() as u32,
            height: camera.size.height() as u32,
        };
        self.names.iter().zip(&self.cameras).map(column).collect()
    }

    /// Draws all states of an episode: the images of the first camera, then those of the others.
    pub fn draw(&mut self, states: &[Vec<f64>], seed: Seed) -> Vec<Vec<u8>> {
        let Cameras { cameras, scene, studio, .. } = self;
        let shots: Vec<StateShot<'_>> = cameras
            .iter()
            .flat_map(|camera| states.iter().enumerate().map(move |(step, state)| (camera, step, state)))
            .map(|(camera, step, state)| StateShot {
                state,
                before: None,
                scene,
                camera,
                seed,
                step: step as u64,
            })
            .collect();
        let mut images: Vec<Vec<u8>> =
            shots.iter().map(|shot| vec![0; 3 * shot.camera.size.pixels()]).collect();
        let mut outputs: Vec<Output<'_>> =
            images.iter_mut().map(|rgb| Output { rgb, depth: None, segments: None }).collect();
        studio.render(&shots, &mut outputs);
        drop(outputs);
        images
    }
}
