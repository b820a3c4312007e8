//! Pictures of a scene for people, by ray casting.

use mishandle_camera::{
    Ambient, Background, Camera, Effects, Form, Lamp, Material, Optics, Output, Pose, Scene, Shape, Size,
    StateRenderer, StateShot, focal_length,
};
use mishandle_rollout::Seed;
use mishandle_world::frame::{norm, sub};
use mishandle_world::{Arrow, Geom, PictureModel, Stage};

use crate::error::MishandleError;

/// Rays per pixel.
const RAYS: u32 = 4;

/// The lamp in front of the robot, whose shadows have soft edges.
const LAMP: Lamp = Lamp { strength: 0.5, radius: 0.025, ..Lamp::NOMINAL };

/// The light beside the camera, which shows the shape of what the lamp does not reach.
const HEADLIGHT: Lamp = Lamp { strength: 0.28, casts_shadows: false, ..Lamp::NOMINAL };

const AMBIENT: Ambient = Ambient { above: [0.42; 3], below: [0.42; 3] };

/// A little darker than a page.
const SKY: Background = Background { above: [0.94, 0.96, 0.98], horizon: [0.97, 0.98, 0.99] };

/// Opacity of arrows: what is not opaque casts no shadow.
const ALMOST_OPAQUE: f32 = 0.999;

/// Radius of the tip of an arrow and half its length, radii of its shaft.
const TIP: [f32; 2] = [2.0, 3.0];

/// Draws states of one scene. A picture is a function of the state and of the states that frame it:
/// it has the same bytes with any number of threads and without OpenGL.
#[derive(Debug)]
pub(crate) struct RayRenderer {
    pub stage: Stage,
    renderer: StateRenderer,
    scene: Scene,
    /// Number of shapes of the scene without arrows.
    shapes: usize,
    size: Size,
    pixels: Vec<u8>,
}

impl RayRenderer {
    /// Makes a renderer of a scene with other lights and, if missing, a ground plane. Textures
    /// are not drawn.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, there is no such camera, or the scene or the picture is too
    /// large.
    pub fn new(
        picture: &PictureModel,
        size: mishandle_world::Size,
        camera: &str,
    ) -> Result<RayRenderer, MishandleError> {
        let model = picture.compile()?;
        let stage = Stage::new(&model, picture, size, camera)?;
        let size = Size::new(size.width() as usize, size.height() as usize)?;
        let mut scene = Scene::of_model(&model)?;
        scene.lamps = vec![LAMP, HEADLIGHT];
        (scene.ambient, scene.background) = (AMBIENT, SKY);
        let shape = |geom: &Geom| Some(Shape::of_geom(geom, Form::of_geom(geom)?));
        let sites = model.sites().into_iter().filter(|site| site.is_drawn);
        scene.shapes.extend(sites.chain(stage.ground()).filter_map(|geom| shape(&geom)));
        Ok(RayRenderer {
            stage,
            renderer: StateRenderer::new(&model),
            shapes: scene.shapes.len(),
            scene,
            size,
            pixels: vec![0; 3 * size.pixels()],
        })
    }

    /// Draws a state: three bytes per pixel (red, green, blue), rows from the top.
    ///
    /// # Panics
    /// If the state is too short.
    pub fn draw(&mut self, state: &[f64]) -> &[u8] {
        self.stage.show(state);
        self.scene.shapes.truncate(self.shapes);
        self.scene.shapes.extend(self.stage.arrows().iter().flat_map(shapes));
        let view = self.stage.viewpoint();
        let numbers = |v: [f64; 3]| v.map(|v| v as f32);
        let pose = Pose { position: numbers(view.position), axes: view.axes.map(numbers) };
        self.scene.lamps[1].direction = pose.axes[2];
        let camera = Camera {
            size: self.size,
            body: 0,
            pose,
            tilt: [0.0; 3],
            focal_length: focal_length(view.fovy_deg),
            optics: Optics { samples: RAYS, ..Optics::NOMINAL },
            effects: Effects::NOMINAL,
        };
        let scene = &self.scene;
        let camera = &camera;
        let shot = StateShot { state, before: None, scene, camera, seed: Seed(0), step: 0 };
        let mut output = Output { rgb: Some(&mut self.pixels), depth: None, segments: None };
        self.renderer.render(&shot, &mut output);
        &self.pixels
    }
}

/// Returns the shaft and the tip of an arrow.
fn shapes(arrow: &Arrow) -> [Shape; 2] {
    let way = sub(arrow.to, arrow.from);
    let length = norm(way) as f32;
    let radius = Arrow::RADIUS as f32;
    let pose = Pose::along(arrow.from.map(|v| v as f32), way.map(|v| v as f32));
    let material = Material { opacity: ALMOST_OPAQUE, emission: 1.0, ..Material::plain(Arrow::COLOR) };
    let shape = |form, height: f32| {
        let pose = Pose { position: pose.point([0.0, 0.0, height]), ..pose };
        Shape { body: 0, pose, form, material, geom: None }
    };
    let tip = (TIP[1] * radius).min(0.5 * length);
    let shaft = 0.5 * (length - tip);
    let wide = TIP[0] * radius;
    [
        shape(Form::Capsule { radius, half: shaft }, shaft),
        shape(Form::Ellipsoid { half: [wide, wide, tip] }, length - tip),
    ]
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A block of 1 kg at rest that a motor could lift.
    const SCENE: &str = r#"<mujoco><worldbody>GROUND
        <body pos="0 0 0.1"><joint name="lift" type="slide" axis="0 0 1"/>
        <geom type="box" size="0.1 0.1 0.1" mass="1" rgba="0.1 0.2 0.9 1"/></body>
        <site pos="0 0 0.22" size="0.03" rgba="0 1 0 1"/></worldbody>
        <actuator><motor joint="lift"/></actuator></mujoco>"#;

    /// Returns a renderer of the scene, and its state after some physics steps.
    fn renderer(ground: &str, steps: usize) -> (RayRenderer, Vec<f64>) {
        let picture = PictureModel::new(SCENE.replace("GROUND", ground));
        let mut state = vec![0.0; picture.compile().unwrap().state_size()];
        let mut world = picture.compile().unwrap().world();
        (0..steps).for_each(|_| world.step());
        world.read_state(&mut state);
        let size = mishandle_world::Size::new(64, 48).unwrap();
        let mut renderer = RayRenderer::new(&picture, size, "auto").unwrap();
        renderer.stage.frame([state.as_slice()]);
        (renderer, state)
    }

    /// Returns how many pixels of a picture have a color for which a function holds.
    fn count(pixels: &[u8], is_counted: impl Fn(&[u8; 3]) -> bool) -> usize {
        pixels.as_chunks::<3>().0.iter().filter(|pixel| is_counted(pixel)).count()
    }

    #[test]
    fn a_picture_shows_shapes_sites_and_a_ground_and_has_the_same_bytes_on_another_thread() {
        let draw = || {
            let (mut renderer, state) = renderer("", 0);
            renderer.draw(&state).to_vec()
        };
        let found = draw();
        assert!(count(&found, |[red, _, blue]| *blue > 100 && *red < 60) > 100, "the block is blue");
        assert!(count(&found, |[red, green, _]| *green > 100 && *red < 60) > 10, "the site is green");
        assert!(
            count(&found, |pixel| pixel.iter().all(|v| (60..250).contains(v))) > 200,
            "there is a ground"
        );
        assert_eq!(std::thread::spawn(draw).join().unwrap(), found);
    }

    #[test]
    fn arrows_mark_contacts_before_everything_else() {
        let is_red = |[red, green, _]: &[u8; 3]| *red > 200 && *green < 90;
        let (mut renderer, state) = renderer(r#"<geom type="plane" size="1 1 0.1"/>"#, 200);
        assert_eq!(count(renderer.draw(&state), is_red), 0);
        renderer.stage.mark_contacts();
        assert!(count(renderer.draw(&state), is_red) > 4);
        assert!((2.0..3.0).contains(&renderer.stage.largest_contact()), "a quarter of 9.81 N");
    }
}
