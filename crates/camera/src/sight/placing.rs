//! Where distractors stand: on what is there, apart from everything else, and in view.

use crate::camera::{Camera, Size};
use crate::form::Form;
use crate::frame::{LocalRays, Meshes, Placed};
use crate::lanes::{LANES, along};
use crate::renderer::{Output, Renderer, Shot};
use crate::scene::{Poses, Scene, Shape};
use crate::sight::distractor::Distractor;
use crate::sight::part::Part;
use crate::vector::Pose;
use crate::view::View as Rays;
use mishandle_random::Seed;

/// Side of the image in which the share of a distractor is measured, pixels.
const SIDE: usize = 64;

/// Height up to which distractors stand on a box, m: on tables and blocks, not on a door.
const HIGHEST: f32 = 0.6;

/// Free space around a distractor at the start, m.
const CLEARANCE: f32 = 0.03;

/// Range of x and y of the places, m, and their distance.
const REGION: [f32; 2] = [-2.4, 2.4];
const STEP: f32 = 0.08;

/// Half the height of the smallest and the largest distractor, m, and the factor between sizes.
const SIZES: [f32; 2] = [0.03, 0.45];
const LARGER: f32 = 1.12;

/// The bounds of a shape in the world, m.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f32; 3],
    high: [f32; 3],
}

/// The scene at the start of a simulation, which distractors fill one after the other.
pub(crate) struct Placing {
    rays: Rays,
    /// The distance of the first shape at each pixel.
    depth: Vec<f32>,
    /// Pixels that show a distractor.
    is_taken: Vec<bool>,
    /// All shapes but planes.
    solid: Vec<Bounds>,
    /// Boxes on which a distractor can stand.
    tables: Vec<Bounds>,
}

impl Placing {
    /// Looks at a scene with these parts through its first camera.
    pub fn new(scene: &Scene, parts: &[Part], camera: &Camera, start: &Poses) -> Placing {
        let size = Size::square(SIDE as u16);
        let camera = Camera { size, ..camera.clone() };
        let mut depth = vec![0.0; size.pixels()];
        let shot = Shot { scene, poses: start, before: None, camera: &camera, seed: Seed(0), step: 0 };
        let mut output = Output { rgb: None, depth: Some(&mut depth), segments: None };
        Renderer::new().render(&shot, &mut output);
        let of_shape = |shape: &Shape| Bounds::of_shape(shape, scene, start);
        let is_solid = |shape: &&Shape| !matches!(shape.form, Form::Plane { .. });
        let is_table = |(shape, part): &(&Shape, &Part)| {
            matches!(shape.form, Form::Box { .. }) && **part == Part::Support
        };
        let boxes = scene.shapes.iter().zip(parts).filter(is_table);
        Placing {
            rays: Rays::new(&camera, &start.bodies[camera.body], [0.0; 2], [0.0; 2]),
            is_taken: vec![false; depth.len()],
            depth,
            solid: scene.shapes.iter().filter(is_solid).map(of_shape).collect(),
            tables: boxes.map(|(shape, _)| of_shape(shape)).filter(|own| own.high[2] <= HIGHEST).collect(),
        }
    }

    /// Returns the distractor as a shape at the nearest free place where it has its share of the
    /// image; `None` without one.
    pub fn put(&mut self, distractor: &Distractor) -> Option<Shape> {
        let [x, y] = distractor.requested;
        let mut places: Vec<(f32, [f32; 2])> = grid(REGION)
            .flat_map(|a| grid(REGION).map(move |b| [a, b]))
            .map(|[a, b]| ((a - x) * (a - x) + (b - y) * (b - y), [a, b]))
            .collect();
        places.sort_by(|a, b| a.0.total_cmp(&b.0));
        let shape = places.into_iter().find_map(|(_, place)| self.at(distractor, place))?;
        for pixel in self.covered(&shape)? {
            self.is_taken[pixel] = true;
        }
        let half = shape.form.half();
        self.solid.push(Bounds::around(shape.pose.position, half));
        Some(shape)
    }

    /// Returns the smallest distractor with its share of the image at a place, if there is one.
    fn at(&self, distractor: &Distractor, place: [f32; 2]) -> Option<Shape> {
        let pixels = (distractor.share * (SIDE * SIDE) as f32).ceil() as usize;
        let mut size = SIZES[0];
        while size <= SIZES[1] {
            let form = distractor.form(size);
            let half = form.half();
            let ground = self.ground(place, half)?;
            let position = [place[0], place[1], ground + half[2]];
            let pose = Pose { position, ..Pose::IDENTITY };
            let shape = Shape { body: 0, pose, form, material: distractor.material(), geom: None };
            if !self.is_free(position, half) {
                return None;
            }
            if self.covered(&shape)?.len() >= pixels {
                return Some(shape);
            }
            size *= LARGER;
        }
        None
    }

    /// Returns the height of what is below all of a distractor, m; `None` at an edge.
    fn ground(&self, [x, y]: [f32; 2], half: [f32; 3]) -> Option<f32> {
        let top = |x: f32, y: f32| {
            let is_below = |own: &&Bounds| {
                (own.low[0]..=own.high[0]).contains(&x) && (own.low[1]..=own.high[1]).contains(&y)
            };
            self.tables.iter().filter(is_below).map(|own| own.high[2]).fold(0.0, f32::max)
        };
        let middle = top(x, y);
        let is_same = |[a, b]: [f32; 2]| top(x + a * half[0], y + b * half[1]) == middle;
        [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]].into_iter().all(is_same).then_some(middle)
    }

    fn is_free(&self, position: [f32; 3], half: [f32; 3]) -> bool {
        let Bounds { low, high } = Bounds::around(position, half);
        !self.solid.iter().any(|own| {
            let is_near = |i: usize| low[i] - CLEARANCE < own.high[i] && own.low[i] < high[i] + CLEARANCE;
            // It may stand on a surface.
            is_near(0) && is_near(1) && low[2] + 1e-4 < own.high[2] && own.low[2] < high[2] + CLEARANCE
        })
    }

    /// Returns the pixels that show a shape of the world; `None` if it hides another distractor, or
    /// is not in the image.
    fn covered(&self, shape: &Shape) -> Option<Vec<usize>> {
        let meshes = Meshes { meshes: &[], cloths: &[] };
        let own = Placed::new(0, shape, &Pose::IDENTITY, &meshes);
        let bounds = self.rays.bounds(&own.pose, own.center, own.half)?;
        let rays = LocalRays::new(&self.rays, &own.pose);
        let mut found = Vec::new();
        for row in bounds.rows[0]..=bounds.rows[1] {
            let start = rays.row(self.rays.v(row));
            for packet in bounds.columns[0] / LANES..=bounds.columns[1] / LANES {
                let t = own.enter(&meshes, 0.0, rays.origin, along(start, self.rays.u(packet), rays.right));
                for (lane, t) in t.0.iter().enumerate() {
                    let pixel = row * SIDE + packet * LANES + lane;
                    if *t >= self.depth[pixel] {
                        continue;
                    }
                    if self.is_taken[pixel] {
                        return None;
                    }
                    found.push(pixel);
                }
            }
        }
        Some(found)
    }
}

impl Bounds {
    fn around(middle: [f32; 3], half: [f32; 3]) -> Bounds {
        Bounds { low: [0, 1, 2].map(|i| middle[i] - half[i]), high: [0, 1, 2].map(|i| middle[i] + half[i]) }
    }

    fn of_shape(shape: &Shape, scene: &Scene, start: &Poses) -> Bounds {
        if let Form::Cloth(index) = shape.form {
            let vertices = &start.cloths[index];
            let least = |i: usize| vertices.iter().map(|v| v[i]).fold(f32::INFINITY, f32::min);
            let most = |i: usize| vertices.iter().map(|v| v[i]).fold(f32::NEG_INFINITY, f32::max);
            return Bounds { low: [0, 1, 2].map(least), high: [0, 1, 2].map(most) };
        }
        let meshes = Meshes { meshes: &scene.meshes, cloths: &[] };
        let own = Placed::new(0, shape, &start.bodies[shape.body], &meshes);
        let reach = |i: usize| (0..3).map(|k| (own.pose.axes[k][i] * own.half[k]).abs()).sum::<f32>();
        Bounds::around(own.pose.point(own.center), [0, 1, 2].map(reach))
    }
}

fn grid([low, high]: [f32; 2]) -> impl Iterator<Item = f32> {
    (0..=((high - low) / STEP) as usize).map(move |index| low + STEP * index as f32)
}
