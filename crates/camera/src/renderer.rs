//! Images of states, one after another, in buffers that stay.

use std::sync::Arc;

use mishandle_random::Seed;

use crate::camera::Camera;
use crate::develop::Developer;
use crate::frame::{Frame, Meshes, NONE, Placed};
use crate::lanes::{LANES, Lanes, Lanes3};
use crate::mesh::Mesh;
use crate::pattern;
use crate::scene::{NO_SHAPE, Poses, Scene};
use crate::shadow::Shadows;
use crate::surface::{Light, Surface, shade_all, shade_over};
use crate::vector::Pose;
use crate::view::View;

/// One image to render.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// Shapes and light.
    pub scene: &'a Scene,
    /// Where bodies and cloths are.
    pub poses: &'a Poses,
    /// Where they were at the state before, for motion blur. Without it nothing moves.
    pub before: Option<&'a Poses>,
    /// The camera.
    pub camera: &'a Camera,
    /// Seed of the noise. Two cameras of one simulation have seeds of their own.
    pub seed: Seed,
    /// Number of the image in its episode: each image has its own noise.
    pub step: u64,
}

/// Where an image goes: rows from the top, pixels from the left.
#[derive(Debug)]
pub struct Output<'a> {
    /// Red, green and blue of each pixel. Without them, nothing is lit.
    pub rgb: Option<&'a mut [u8]>,
    /// Distance along the camera's axis of the first shape, m; infinite without a shape. It is
    /// that of the center of the pixel at the state, without lens and shutter.
    pub depth: Option<&'a mut [f32]>,
    /// Index of the first shape in the scene, or [`NO_SHAPE`].
    pub segments: Option<&'a mut [u16]>,
}

/// Renders images. Its buffers grow to the largest image, and it allocates nothing after that.
#[derive(Debug, Default)]
pub struct Renderer {
    placed: Vec<Placed>,
    cloths: Cloths,
    moved: Poses,
    frame: Frame,
    surface: Surface,
    shadows: Vec<Shadows>,
    lights: Vec<Light>,
    colors: Vec<Lanes3>,
    sum: Vec<Lanes3>,
    over: Vec<(f32, u32)>,
    lens: Vec<[f32; 2]>,
    developer: Developer,
}

/// The cloths of the last scene, which are moved to each state.
#[derive(Debug, Default)]
struct Cloths {
    originals: Vec<Arc<Mesh>>,
    moved: Vec<Mesh>,
}

impl Cloths {
    fn place(&mut self, scene: &Scene, poses: &Poses) {
        let same = self.originals.len() == scene.cloths.len()
            && self.originals.iter().zip(&scene.cloths).all(|(a, b)| Arc::ptr_eq(a, b));
        if !same {
            self.originals.clone_from(&scene.cloths);
            self.moved = scene.cloths.iter().map(|cloth| (**cloth).clone()).collect();
        }
        for (cloth, vertices) in self.moved.iter_mut().zip(&poses.cloths) {
            cloth.deform(vertices);
        }
    }
}

impl Renderer {
    /// Makes a renderer.
    pub fn new() -> Renderer {
        Renderer::default()
    }

    /// Renders an image.
    ///
    /// # Panics
    /// If a slice of `out` has another length than the image has pixels, or `poses` have fewer
    /// bodies or vertices than the scene refers to.
    pub fn render(&mut self, shot: &Shot<'_>, out: &mut Output<'_>) {
        if let Some(rgb) = out.rgb.as_deref_mut() {
            self.light(shot, rgb);
        }
        if out.depth.is_some() || out.segments.is_some() {
            self.measure(shot, out);
        }
    }

    /// Renders the colors of an image.
    fn light(&mut self, shot: &Shot<'_>, rgb: &mut [u8]) {
        let camera = shot.camera;
        let optics = &shot.camera.optics;
        let samples = optics.samples.max(1);
        pattern::disk_points(samples, &mut self.lens);
        for sample in 0..samples {
            let lens = self.lens[sample as usize].map(|v| v * optics.aperture);
            let pixel = pattern::pixel_point(sample, samples);
            let ago = optics.shutter * (sample as f32 + 0.5) / samples as f32;
            self.expose(shot, pixel, lens, ago);
            if sample == 0 {
                self.sum.clone_from(&self.colors);
            } else {
                for (sum, color) in self.sum.iter_mut().zip(&self.colors) {
                    *sum = [0, 1, 2].map(|i| sum[i] + color[i]);
                }
            }
        }
        if samples > 1 {
            let share = Lanes::all(1.0 / samples as f32);
            self.sum.iter_mut().for_each(|sum| *sum = sum.map(|v| v * share));
        }
        self.developer.develop(&self.sum, self.frame.packets, camera, shot.seed, shot.step, rgb);
    }

    /// Computes the light of each pixel for one ray per pixel.
    fn expose(&mut self, shot: &Shot<'_>, pixel: [f32; 2], lens: [f32; 2], ago: f32) {
        let view = self.place(shot, pixel, lens, ago);
        let meshes = Meshes { meshes: &shot.scene.meshes, cloths: &self.cloths.moved };
        self.frame.draw(&view, &self.placed, &meshes, |own| own.is_opaque);
        self.surface.find(&view, &self.placed, &meshes, &self.frame);
        let scene = shot.scene;
        self.lights.clear();
        for lamp in scene.lamps.iter().filter(|lamp| lamp.strength > 0.0) {
            let index = self.lights.len();
            if self.shadows.len() == index {
                self.shadows.push(Shadows::default());
            }
            self.shadows[index].find(lamp, &self.placed, &meshes, &self.frame, &self.surface);
            self.lights.push(Light::new(lamp.direction, lamp.color, lamp.strength));
        }
        self.colors.resize(self.frame.depth.len(), [Lanes::ZERO; 3]);
        shade_all(
            scene,
            &self.lights,
            &view,
            &self.placed,
            &self.frame,
            &self.surface,
            &self.shadows,
            &mut self.colors,
        );
        // Shapes that are not opaque are drawn over the others, the farthest one first.
        self.over.clear();
        for (position, own) in self.placed.iter().enumerate().filter(|(_, own)| !own.is_opaque) {
            let from = crate::vector::sub(own.pose.point(own.center), view.eye);
            self.over.push((crate::vector::dot(from, view.forward), position as u32));
        }
        self.over.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, position) in &self.over {
            let own = &self.placed[*position as usize];
            shade_over(scene, &self.lights, &view, own, &meshes, &self.frame, &mut self.colors);
        }
    }

    /// Writes depth and segments.
    fn measure(&mut self, shot: &Shot<'_>, out: &mut Output<'_>) {
        let view = self.place(shot, [0.0; 2], [0.0; 2], 0.0);
        let meshes = Meshes { meshes: &shot.scene.meshes, cloths: &self.cloths.moved };
        self.frame.draw(&view, &self.placed, &meshes, |_| true);
        let width = view.width;
        let packets = self.frame.packets;
        let at = |pixel: usize| {
            let row = pixel / width;
            let column = pixel % width;
            (row * packets + column / LANES, column % LANES)
        };
        if let Some(depth) = out.depth.as_deref_mut() {
            assert_eq!(depth.len(), width * view.height, "a depth for each pixel");
            for (pixel, depth) in depth.iter_mut().enumerate() {
                let (index, lane) = at(pixel);
                *depth = self.frame.depth[index].0[lane];
            }
        }
        if let Some(segments) = out.segments.as_deref_mut() {
            assert_eq!(segments.len(), width * view.height, "a segment for each pixel");
            for (pixel, segment) in segments.iter_mut().enumerate() {
                let (index, lane) = at(pixel);
                *segment = match self.frame.shape[index][lane] {
                    NONE => NO_SHAPE,
                    position => self.placed[position as usize].shape as u16,
                };
            }
        }
    }

    /// Places all shapes and the camera. `ago` is the time before the state, as a fraction of the
    /// time since the state before.
    fn place(&mut self, shot: &Shot<'_>, pixel: [f32; 2], lens: [f32; 2], ago: f32) -> View {
        let poses = match shot.before {
            Some(before) if ago > 0.0 => {
                self.moved.between(shot.poses, before, ago);
                &self.moved
            }
            _ => shot.poses,
        };
        self.cloths.place(shot.scene, poses);
        let meshes = Meshes { meshes: &shot.scene.meshes, cloths: &self.cloths.moved };
        self.placed.clear();
        for (index, shape) in shot.scene.shapes.iter().enumerate() {
            if shape.material.opacity > 0.0 {
                self.placed.push(Placed::new(index, shape, &poses.bodies[shape.body], &meshes));
            }
        }
        View::new(shot.camera, &poses.bodies[shot.camera.body], pixel, lens)
    }
}

impl Poses {
    /// Sets the poses to those between a state and the state before.
    fn between(&mut self, now: &Poses, before: &Poses, ago: f32) {
        let mix = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|i| a[i] + ago * (b[i] - a[i]));
        self.bodies.clear();
        for (now, before) in now.bodies.iter().zip(&before.bodies) {
            let position = mix(now.position, before.position);
            let axes = [0, 1, 2].map(|i| mix(now.axes[i], before.axes[i]));
            self.bodies.push(Pose { position, axes }.straightened());
        }
        self.cloths.resize(now.cloths.len(), Vec::new());
        for (index, own) in self.cloths.iter_mut().enumerate() {
            own.clear();
            let vertices = now.cloths[index].iter().zip(&before.cloths[index]);
            own.extend(vertices.map(|(now, before)| mix(*now, *before)));
        }
    }
}
