//! Everything that cameras see: shapes, lamps and background.

use std::sync::Arc;

use crate::form::Form;
use crate::material::{Color, Material};
use crate::mesh::Mesh;
use crate::vector::{Pose, add, scale, unit};

/// A shape of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The index of the body that it moves with; 0 is the world.
    pub body: usize,
    /// Its pose in the frame of the body.
    pub pose: Pose,
    /// Its form.
    pub form: Form,
    /// Its surface.
    pub material: Material,
    /// The index of its geom in the model, if it has one.
    pub geom: Option<usize>,
}

/// A lamp that is far away: its light comes from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lamp {
    /// Direction to the lamp, of any length.
    pub direction: [f32; 3],
    /// Color of its light.
    pub color: Color,
    /// Strength: the brightness of a white surface that faces the lamp. A lamp with strength 0 is
    /// off and takes no time.
    pub strength: f32,
    /// Whether shapes cast shadows.
    pub casts_shadows: bool,
    /// Radius of the lamp as seen from the scene, rad: shadows of a lamp without a radius are hard.
    pub radius: f32,
    /// Number of shadow rays to a lamp with a radius.
    pub shadow_rays: u32,
}

/// Light from everywhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// Brightness of a white surface that faces upwards, which the sky lights.
    pub above: Color,
    /// Brightness of a white surface that faces downwards, which the ground lights.
    pub below: Color,
}

/// Colors behind all shapes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Background {
    /// Color straight above.
    pub above: Color,
    /// Color at the horizon and below.
    pub horizon: Color,
}

/// The shapes, lamps and background that cameras see, as plain numbers: whoever changes a number
/// changes the images and nothing else. Poses of bodies are in [`Poses`].
#[derive(Clone, Debug)]
pub struct Scene {
    /// The shapes. A shape that is added here is drawn, and touches nothing.
    pub shapes: Vec<Shape>,
    /// The meshes that shapes refer to.
    pub meshes: Vec<Arc<Mesh>>,
    /// The cloths that shapes refer to, with vertices of no state in particular.
    pub cloths: Vec<Arc<Mesh>>,
    /// The lamps.
    pub lamps: Vec<Lamp>,
    /// Light from everywhere.
    pub ambient: Ambient,
    /// Colors behind all shapes.
    pub background: Background,
}

/// Where bodies and the vertices of cloths are in a state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poses {
    /// The pose of each body; the first one is the world.
    pub bodies: Vec<Pose>,
    /// The positions of the vertices of each cloth, m.
    pub cloths: Vec<Vec<[f32; 3]>>,
}

/// The segment of a pixel that shows no shape.
pub const NO_SHAPE: u16 = u16::MAX;

impl Lamp {
    /// A white lamp in front of the robot on its right, with hard shadows.
    pub const NOMINAL: Lamp = Lamp {
        direction: [0.35, -0.3, 1.0],
        color: [1.0; 3],
        strength: 0.6,
        casts_shadows: true,
        radius: 0.0,
        shadow_rays: 8,
    };

    /// A second lamp, which is off, on the other side.
    pub const SECOND: Lamp = Lamp { direction: [-0.5, 0.6, 0.8], strength: 0.0, ..Lamp::NOMINAL };
}

/// The share of the light of the ground that reaches a surface above it: the robot and the table
/// shade the ground around them.
const BOUNCE: f32 = 0.4;

impl Scene {
    /// Returns the light that falls on the ground: the brightness of a white one.
    fn ground_light(&self) -> Color {
        let lamps = self.lamps.iter().filter(|lamp| lamp.strength > 0.0);
        lamps.fold(self.ambient.above, |sum, lamp| {
            let steepness = unit(lamp.direction)[2].max(0.0);
            add(sum, scale(lamp.color, lamp.strength * steepness))
        })
    }

    /// Sets the light from below to the reflection of the ground, in its color.
    pub fn reflect(&mut self) {
        let light = self.ground_light();
        let ground = self.shapes.iter().find(|shape| matches!(shape.form, Form::Plane { .. }));
        let color = ground.map_or([0.5; 3], |ground| {
            let [a, b] = ground.material.colors;
            scale(add(a, b), 0.5)
        });
        self.ambient.below = [0, 1, 2].map(|i| BOUNCE * color[i] * light[i]);
    }

    /// Lights the background as the ground of this scene is lit in comparison with another one.
    pub(crate) fn light_background(&mut self, nominal: &Scene) {
        let light = self.ground_light();
        let usual = nominal.ground_light();
        for color in [&mut self.background.above, &mut self.background.horizon] {
            *color = [0, 1, 2].map(|i| color[i] * (light[i] / usual[i]));
        }
    }
}

impl Ambient {
    /// The nominal ambient light; [`Scene::reflect`] replaces that from below.
    pub const NOMINAL: Ambient = Ambient { above: [0.40, 0.40, 0.41], below: [0.24, 0.24, 0.23] };
}

impl Background {
    /// The nominal background, darker than robot and ground.
    pub const NOMINAL: Background = Background { above: [0.44, 0.54, 0.64], horizon: [0.60, 0.68, 0.75] };
}
