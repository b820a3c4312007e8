//! The sight of the cameras of a task.

use mishandle_camera::sight::{Part, PartBodies, Sight, SightCamera, SightEyes, View, image_size};
use mishandle_camera::{Camera, Size};
use mishandle_rollout::{Image, RolloutError, Space};
use mishandle_world::{Body, ElementKind, Model, PANDA, WorldError};

use crate::axes::size_axis;
use crate::cameras::{CAMERA_NAMES, CameraPlace};
use crate::definition::{Definition, Task};
use crate::document::compose;
use crate::robot::{CONTROL_DT, EPISODE_STEPS};

/// Returns the cameras and the axes of sight of a task.
pub fn sight(definition: &Definition) -> Sight {
    let camera = |name: &str| SightCamera { name: name.to_string(), is_mounted: name == CAMERA_NAMES[1] };
    // A task without an object is about its target, and nothing else stands on the ground.
    let has_support = definition.object.is_some();
    let parts = Part::ALL.map(|(part, _)| part).into_iter();
    let parts: Vec<Part> = parts.filter(|part| has_support || *part != Part::Support).collect();
    Sight::new(CAMERA_NAMES.map(camera).to_vec(), &parts, definition.lamp, CONTROL_DT, EPISODE_STEPS)
}

/// Makes the nominal view of a task, with the model whose states it shows.
///
/// # Errors
/// If the scene does not compile.
pub fn view(task: &dyn Task, size: Size) -> Result<(Model, View), WorldError> {
    let model = Model::from_xml(&compose(task)?)?;
    let cameras = task.cameras().iter().map(|place| camera(place, &model, size)).collect::<Result<_, _>>()?;
    let bodies = part_bodies(task.definition(), &model)?;
    let view = View::new(&sight(task.definition()), &model, cameras, &bodies)
        .map_err(|error| WorldError::Model(error.to_string()))?;
    let sizes = task.definition().variations.sizes.iter();
    let sizes = sizes.map(|name| Ok((size_axis(name), model.body(name)?)));
    let view = view.with_sizes(&model, sizes.collect::<Result<_, WorldError>>()?);
    Ok((model, view))
}

/// Makes the cameras of a controller that sees `images` of a task.
pub(crate) fn eyes(
    definition: &Definition,
    space: &Space,
    images: &[Image],
) -> Result<SightEyes, RolloutError> {
    let name = definition.name;
    let failed = |what: String| RolloutError::System(format!("the cameras of {name}: {what}"));
    let task = crate::task(name).ok_or_else(|| failed("there is no such task".to_string()))?;
    let first = images.first().ok_or_else(|| failed("the controller sees no image".to_string()))?;
    let (model, view) = view(task, image_size(first)?).map_err(|error| failed(error.to_string()))?;
    SightEyes::new(name, &sight(definition), model, view, space, images)
}

fn camera(place: &CameraPlace, model: &Model, size: Size) -> Result<Camera, WorldError> {
    let body = place.body.map_or(Ok(0), |name| model.body(name).map(Body::index))?;
    let points = [place.from, place.to, place.up].map(|point| point.map(|v| v as f32));
    Ok(Camera::looking(size, body, points, place.focal_length as f32))
}

fn part_bodies(definition: &Definition, model: &Model) -> Result<PartBodies, WorldError> {
    let robot = Model::from_xml(PANDA)?.names(ElementKind::Body);
    let names = model.names(ElementKind::Body);
    // A task without an object is about its target.
    let object = definition.object.or(definition.variations.jump);
    let object = object.map_or_else(Vec::new, |name| match model.flex(name) {
        Ok(flex) => flex.bodies().map(Body::index).collect(),
        Err(_) => model.body(name).map_or_else(|_| Vec::new(), |body| vec![body.index()]),
    });
    Ok(PartBodies { object, robot: (1..names.len()).filter(|body| robot.contains(&names[*body])).collect() })
}
