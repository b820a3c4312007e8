//! The cameras of a file, and what they see.

use mishandle_camera::sight::{Part, PartBodies, Sight, SightCamera, SightEyes, View};
use mishandle_camera::{Camera, Lamp, Size, focal_length};
use mishandle_rollout::{Axis, Image, RolloutError, Space};
use mishandle_world::{Body, CAMERAS, CameraMount, ElementKind, GeomKind, Model, PictureModel, Visuals};

use crate::description::{Control, Description, Named};
use crate::document::{Fields, Item, Key, Text};
use crate::error::{Problem, RobotError};
use crate::model::error_text;
use crate::pattern::missing;
use crate::target::RobotFile;

/// MuJoCo's vertical field of view of a camera that states none, degrees.
const FOVY_DEG: f64 = 45.0;

/// The fields of view that a camera may have, degrees.
const FOVY_RANGE_DEG: std::ops::RangeInclusive<f64> = 1.0..=170.0;

/// Lengths (m) and sines below this are 0: a camera without a direction.
const DEGENERATE: f64 = 1e-6;

/// Largest coordinate, m: images are computed with 24 bits.
const FARTHEST: f64 = 1e6;

/// A camera as a file states it.
#[derive(Clone, Debug)]
pub(crate) enum CameraTable {
    /// A camera of the model.
    Mjcf(Text),
    /// A place in the frame of a body; none is the world.
    Placed { body: Option<Text>, direction: Direction, position: [f64; 3], fovy_deg: f64 },
}

/// The direction of a camera in the frame of its body.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Direction {
    /// To a point, with a direction that is nearly up in images.
    LookAt { point: [f64; 3], up: [f64; 3] },
    /// A unit quaternion: it looks along its -z.
    Quaternion([f64; 4]),
}

/// The cameras of a file, compared with the model.
#[derive(Clone, Debug)]
pub(crate) struct RobotCameras {
    pub sight: Sight,
    cameras: Vec<Camera>,
    bodies: PartBodies,
}

/// Reads a camera of the table `[cameras]`.
pub(crate) fn camera(key: &Key, item: &Item) -> Result<CameraTable, Problem> {
    let name = &key.name;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_';
    if name.is_empty() || !name.chars().all(is_plain) || name.starts_with(|c: char| c.is_ascii_digit()) {
        return Err(Problem::new(&key.span, "the name of a camera has letters, digits and `_`"));
    }
    if CAMERAS.contains(&name.as_str()) {
        let message = format!("`{name}` is a view that every model has; give the camera another name");
        return Err(Problem::new(&key.span, message));
    }
    let mut fields = Fields::new(item.table(name)?, format!("the camera `{name}`"));
    if let Some(mjcf) = fields.text("mjcf")? {
        fields.finish()?;
        return Ok(CameraTable::Mjcf(mjcf));
    }
    let body = fields.text("body")?;
    let position = vector(fields.need("position")?, "position")?;
    let look_at = fields.get("look_at");
    let up = fields.get("up");
    let quaternion = fields.get("quaternion");
    let direction = match (look_at, up, quaternion) {
        (Some(look_at), up, None) => {
            let point = vector(look_at, "look_at")?;
            let up = up.map_or(Ok([0.0, 0.0, 1.0]), |item| vector(item, "up"))?;
            check_direction(position, point, up).map_err(|message| Problem::new(&look_at.span, message))?;
            Direction::LookAt { point, up }
        }
        (None, None, Some(item)) => {
            let quaternion: [f64; 4] = vector(item, "quaternion")?;
            let length = norm(&quaternion);
            if length < DEGENERATE {
                return Err(Problem::new(&item.span, "`quaternion` has the length 0"));
            }
            Direction::Quaternion(quaternion.map(|v| v / length))
        }
        _ => {
            let message = format!(
                "the camera `{name}` needs exactly one of `look_at`, a point, with or without `up`, and `quaternion`"
            );
            return Err(Problem::new(&key.span, message));
        }
    };
    let fovy = fields.get("fovy");
    let fovy_deg = fovy.map_or(Ok(FOVY_DEG), |item| item.number("fovy"))?;
    if let (Some(item), false) = (fovy, FOVY_RANGE_DEG.contains(&fovy_deg)) {
        let low = FOVY_RANGE_DEG.start();
        let high = FOVY_RANGE_DEG.end();
        let message = format!("`fovy` must be the vertical field of view, from {low} to {high} degrees");
        return Err(Problem::new(&item.span, message));
    }
    fields.finish()?;
    Ok(CameraTable::Placed { body, direction, position, fovy_deg })
}

fn vector<const N: usize>(item: &Item, what: &str) -> Result<[f64; N], Problem> {
    let numbers = item.numbers(what)?;
    if numbers.iter().any(|number| number.abs() > FARTHEST) {
        return Err(Problem::new(&item.span, format!("the numbers of `{what}` are at most {FARTHEST}")));
    }
    let message = format!("`{what}` has {N} numbers, not {}", numbers.len());
    numbers.try_into().map_err(|_| Problem::new(&item.span, message))
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Checks that a camera that looks from one point to another has a direction, and an upper edge.
fn check_direction(from: [f64; 3], to: [f64; 3], up: [f64; 3]) -> Result<(), String> {
    // As the camera computes it.
    let back = [0, 1, 2].map(|i| f64::from(from[i] as f32 - to[i] as f32));
    if norm(&back) < DEGENERATE {
        return Err("`look_at` is the position of the camera; it must be another point".to_string());
    }
    let across = [1, 2, 0].map(|i| up[i] * back[(i + 1) % 3] - up[(i + 1) % 3] * back[i]);
    if norm(&across) < DEGENERATE * norm(&back) * norm(&up).max(DEGENERATE) {
        return Err(
            "the view is along `up`; set `up` to a direction across it, such as [1, 0, 0]".to_string()
        );
    }
    Ok(())
}

impl RobotCameras {
    /// Looks up the cameras and the object of a description in its model. `None` without cameras.
    pub(crate) fn new(description: &Description, model: &Model) -> Result<Option<RobotCameras>, Problem> {
        let Description { cameras, object, control, .. } = description;
        if cameras.is_empty() {
            return match object {
                Some(object) => {
                    Err(Problem::new(&object.span, "[sight] needs cameras, in a table [cameras]"))
                }
                None => Ok(None),
            };
        }
        let placed = cameras.iter().map(|named| placed(&named.value, model));
        let placed = placed.collect::<Result<Vec<Camera>, Problem>>()?;
        let bodies = part_bodies(object.as_ref(), model)?;
        let Control { period, steps, .. } = *control;
        let of_sight = |(named, camera): (&Named<CameraTable>, &Camera)| SightCamera {
            name: named.key.name.clone(),
            is_mounted: camera.body != Body::WORLD.index(),
        };
        let of_sight = cameras.iter().zip(&placed).map(of_sight).collect();
        let lamp = Lamp::NOMINAL.direction.map(f64::from);
        let sight = Sight::new(of_sight, &parts(&bodies, model), lamp, period, steps);
        let own = |axis: &Axis| description.axes.iter().find(|named| named.key.name == axis.name);
        if let Some(taken) = sight.axes().find_map(own) {
            let message = format!(
                "every robot with cameras has an axis `{}` already; give this one another name",
                taken.key.name
            );
            return Err(Problem::new(&taken.key.span, message));
        }
        Ok(Some(RobotCameras { sight, cameras: placed, bodies }))
    }
}

/// The size of a camera before its images have one.
fn no_size() -> Size {
    Size::new(1, 1).expect("1 is in the range of sizes")
}

/// Returns a camera of a file, whose images have no size yet.
fn placed(table: &CameraTable, model: &Model) -> Result<Camera, Problem> {
    match table {
        CameraTable::Mjcf(name) => {
            let index = model.find(ElementKind::Camera, &name.text).map_err(|_| {
                let known = model.names(ElementKind::Camera);
                Problem::new(&name.span, missing("camera", &name.text, &known))
            })?;
            let mount = model.camera_at(index);
            if mount.is_plain && FOVY_RANGE_DEG.contains(&mount.fovy_deg) {
                Ok(Camera::of_model(&mount, no_size()))
            } else {
                let low = FOVY_RANGE_DEG.start();
                let high = FOVY_RANGE_DEG.end();
                let message = format!(
                    "the camera `{}` of the model cannot be drawn: it needs the mode `fixed`, and a perspective with a `fovy` \
                         from {low} to {high} degrees",
                    name.text
                );
                Err(Problem::new(&name.span, message))
            }
        }
        CameraTable::Placed { body, direction, position, fovy_deg } => {
            let body = body.as_ref().map_or(Ok(Body::WORLD), |name| body_of(name, model))?;
            let position = *position;
            let fovy_deg = *fovy_deg;
            Ok(match *direction {
                Direction::LookAt { point, up } => {
                    let points = [position, point, up].map(|point| point.map(|v| v as f32));
                    Camera::looking(no_size(), body.index(), points, focal_length(fovy_deg))
                }
                Direction::Quaternion(quaternion) => {
                    let mount = CameraMount { body, position, quaternion, fovy_deg, is_plain: true };
                    Camera::of_model(&mount, no_size())
                }
            })
        }
    }
}

fn body_of(name: &Text, model: &Model) -> Result<Body, Problem> {
    model
        .body(&name.text)
        .map_err(|_| Problem::new(&name.span, missing("body", &name.text, &model.names(ElementKind::Body))))
}

/// Returns the bodies of the object, with those that are mounted on it, and of the robot: what the
/// actuators move.
fn part_bodies(object: Option<&Text>, model: &Model) -> Result<PartBodies, Problem> {
    let all = || (1..model.count(ElementKind::Body)).map(|index| model.body_at(index));
    let object = object.map(|name| body_of(name, model)).transpose()?;
    let object = object.map_or_else(Vec::new, |object| {
        all().filter(|body| model.is_within(*body, object)).map(Body::index).collect()
    });
    Ok(PartBodies { object, robot: model.robot_bodies().into_iter().map(Body::index).collect() })
}

/// Returns the parts that a scene has. A body whose geoms are only visual counts as one without a
/// support.
fn parts(bodies: &PartBodies, model: &Model) -> Vec<Part> {
    let geoms = model.geoms();
    let has = |part: Part| match part {
        Part::Object => !bodies.object.is_empty(),
        Part::Robot => !bodies.robot.is_empty(),
        Part::Floor => geoms.iter().any(|geom| geom.kind == GeomKind::Plane),
        Part::Support => geoms.iter().any(|geom| {
            let body = geom.body.index();
            geom.kind != GeomKind::Plane && !bodies.object.contains(&body) && !bodies.robot.contains(&body)
        }),
    };
    Part::ALL.into_iter().map(|(part, _)| part).filter(|part| has(*part)).collect()
}

/// The cameras that a controller sees through, with the model whose states they show.
#[derive(Clone)]
pub(crate) struct Seen {
    sight: Sight,
    model: Model,
    view: View,
}

impl Seen {
    /// Makes the cameras of a controller that sees `images`. `space` is that of the scenarios.
    pub(crate) fn eyes(
        &self,
        name: &str,
        space: &Space,
        images: &[Image],
    ) -> Result<SightEyes, RolloutError> {
        SightEyes::new(name, &self.sight, self.model.clone(), self.view.clone(), space, images)
    }
}

impl RobotFile {
    /// Returns the cameras of a controller that sees; `None` without cameras.
    pub(crate) fn seen(&self) -> Result<Option<Seen>, RobotError> {
        let Some(RobotCameras { sight, cameras, .. }) = &self.cameras else { return Ok(None) };
        // Each image has a size of its own.
        let Some(camera) = cameras.first() else { return Ok(None) };
        let view = self.view(camera.size)?;
        Ok(view.map(|(model, view)| Seen { sight: sight.clone(), model, view }))
    }

    /// Returns the cameras and the axes of sight, if the file has cameras.
    pub fn sight(&self) -> Option<&Sight> {
        self.cameras.as_ref().map(|cameras| &cameras.sight)
    }

    /// Makes the nominal view of its cameras, with the model whose states they show. `None` without
    /// cameras.
    ///
    /// # Errors
    /// If the scene does not compile, or has too many shapes.
    pub fn view(&self, size: Size) -> Result<Option<(Model, View)>, RobotError> {
        let Some(RobotCameras { sight, cameras, bodies }) = &self.cameras else { return Ok(None) };
        let failed = |error: &dyn std::error::Error| RobotError::Model {
            path: self.model.file.clone(),
            message: error_text(error),
        };
        let PictureModel { document, assets, .. } = self.picture_model();
        let model = Model::from_untrusted(document, assets, Visuals::Keep).map_err(|error| failed(&error))?;
        let cameras = cameras.iter().map(|camera| Camera { size, ..camera.clone() }).collect();
        let view = View::new(sight, &model, cameras, bodies).map_err(|error| failed(&error))?;
        Ok(Some((model, view)))
    }
}
