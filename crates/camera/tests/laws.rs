//! Laws of images: forms, threads, batches, effects and noise.

use crate::states::expert_states;
use mishandle_camera::{
    Camera, Form, Material, Mesh, NO_SHAPE, Optics, Output, Pose, PoseReader, Poses, Renderer, Scene, Shape,
    Shot, Size, StateShot, Studio,
};
use mishandle_random::Seed;
use mishandle_tasks::sight::view;
use mishandle_tasks::task;
use mishandle_world::Model;

fn size(side: usize) -> Size {
    Size::new(side, side).unwrap()
}

/// Returns an empty scene of one body, the world, and its poses.
fn empty() -> (Scene, Poses) {
    let scene = Scene::of_model(&Model::from_xml("<mujoco/>").unwrap()).unwrap();
    (scene, Poses { bodies: vec![Pose::IDENTITY], cloths: Vec::new() })
}

/// Returns a shape that is turned, so that its axes are not those of the camera.
fn shape(form: Form) -> Shape {
    let pose = Pose::new([0.1, -0.2, 0.5], [0.8, 0.0, 0.6, 0.0]);
    Shape { body: 0, pose, form, material: Material::plain([0.8, 0.5, 0.2]), geom: None }
}

fn camera(side: usize) -> Camera {
    Camera::looking(size(side), 0, [[1.3, 0.9, 1.2], [0.1, -0.2, 0.5], [0.0, 0.0, 1.0]], 1.2)
}

struct Images {
    rgb: Vec<u8>,
    depth: Vec<f32>,
    segments: Vec<u16>,
}

fn render(scene: &Scene, poses: &Poses, before: Option<&Poses>, camera: &Camera, step: u64) -> Images {
    let pixels = camera.size.pixels();
    let mut images = Images { rgb: vec![0; 3 * pixels], depth: vec![0.0; pixels], segments: vec![0; pixels] };
    let shot = Shot { scene, poses, before, camera, seed: Seed(11), step };
    let Images { rgb, depth, segments } = &mut images;
    Renderer::new()
        .render(&shot, &mut Output { rgb: Some(rgb), depth: Some(depth), segments: Some(segments) });
    images
}

#[test]
fn a_mesh_of_a_box_is_the_box() {
    let half = [0.2, 0.3, 0.1];
    let corner = |index: u32| [0, 1, 2].map(|i| if index >> i & 1 == 0 { -half[i] } else { half[i] });
    let faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    let (mut scene, poses) = empty();
    scene.meshes.push(std::sync::Arc::new(Mesh::new((0..8).map(corner).collect(), triangles)));
    let image = |form: Form| {
        let mut scene = scene.clone();
        let floor = Shape { form: Form::Plane { half: [f32::INFINITY; 2] }, ..shape(form) };
        let floor = Shape { pose: Pose::IDENTITY, ..floor };
        scene.shapes.extend([shape(form), floor]);
        render(&scene, &poses, None, &camera(96), 0)
    };
    let own = image(Form::Box { half });
    let mesh = image(Form::Mesh(0));
    assert!(own.segments.iter().filter(|segment| **segment == 0).count() > 800);
    // Rounding may move the edge of the box or of its shadow by a pixel that it just meets.
    let other = own.segments.iter().zip(&mesh.segments).filter(|(a, b)| a != b).count();
    assert!(other <= 2, "{other} pixels show another shape");
    let far = own.depth.iter().zip(&mesh.depth).filter(|(a, b)| (*a - *b).abs() > 1e-5).count();
    assert!(far <= other, "{far} pixels have another depth");
    let unlike = own.rgb.iter().zip(&mesh.rgb).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(unlike <= 3 * (other + 4), "{unlike} bytes differ");
}

#[test]
fn every_pixel_shows_one_shape_or_none() {
    let own = task("ball-pushing").unwrap();
    let (model, states) = expert_states(own, 0.5);
    let scene = Scene::of_model(&model).unwrap();
    let mut reader = PoseReader::new(&model);
    let mut poses = Poses::default();
    reader.read(&states[40], &mut poses);
    for camera in view(own, size(64)).unwrap().1.cameras {
        let whole = render(&scene, &poses, None, &camera, 0);
        let count = |images: &Images, index: usize| {
            images.segments.iter().filter(|segment| usize::from(**segment) == index).count()
        };
        let shapes: usize = (0..scene.shapes.len()).map(|index| count(&whole, index)).sum();
        assert_eq!(shapes + count(&whole, usize::from(NO_SHAPE)), 64 * 64);
        // Without the other shapes, a shape is visible at these pixels and at more.
        for index in 0..scene.shapes.len() {
            let mut alone = scene.clone();
            alone.shapes = vec![scene.shapes[index].clone()];
            let alone = render(&alone, &poses, None, &camera, 0);
            let pairs = whole.segments.iter().zip(&alone.segments);
            assert!(pairs.clone().all(|(all, one)| usize::from(*all) != index || *one == 0));
        }
    }
}

#[test]
fn images_do_not_depend_on_threads_or_on_other_images() {
    for name in ["ball-catching", "cloth-placing"] {
        let own = task(name).unwrap();
        let (model, states) = expert_states(own, 0.5);
        let scene = Scene::of_model(&model).unwrap();
        let mut cameras = view(own, size(40)).unwrap().1.cameras;
        cameras[0].effects.read_noise = 0.05;
        cameras[1].optics = Optics { samples: 3, aperture: 0.004, focus: 0.2, shutter: 0.5 };
        let shots: Vec<StateShot<'_>> = (1..40)
            .map(|step| StateShot {
                state: &states[7 * step],
                before: Some(&states[7 * step - 1]),
                scene: &scene,
                camera: &cameras[step % 2],
                seed: Seed(step as u64 % 3),
                step: step as u64,
            })
            .collect();
        let images = |threads: usize, batch: usize| -> Vec<Vec<u8>> {
            let mut images = vec![vec![0; 3 * 40 * 40]; shots.len()];
            let mut studio = Studio::new(&model, threads);
            for (shots, images) in shots.chunks(batch).zip(images.chunks_mut(batch)) {
                let output = |rgb| Output { rgb: Some(rgb), depth: None, segments: None };
                let mut outputs: Vec<Output<'_>> =
                    images.iter_mut().map(|image| output(&mut image[..])).collect();
                studio.render(shots, &mut outputs);
            }
            images
        };
        let one = images(1, 1);
        assert!(one[0] != one[2], "the images show different states");
        assert_eq!(one, images(1, 39));
        assert_eq!(one, images(5, 39));
        assert_eq!(one, images(3, 10));
    }
}

/// Returns the first camera and the scene of a task, and the poses of a state and of the state
/// before.
fn scene_of(name: &str) -> (Camera, Scene, Poses, Poses) {
    let own = task(name).unwrap();
    let (model, states) = expert_states(own, 0.5);
    let mut reader = PoseReader::new(&model);
    let mut now = Poses::default();
    let mut before = Poses::default();
    reader.read(&states[20], &mut now);
    reader.read(&states[19], &mut before);
    let scene = Scene::of_model(&model).unwrap();
    (view(own, size(64)).unwrap().1.cameras.swap_remove(0), scene, now, before)
}

#[test]
fn nominal_effects_change_no_bit_and_others_do() {
    let (camera, scene, poses, before) = scene_of("cube-stacking");
    let nominal = render(&scene, &poses, None, &camera, 0).rgb;
    // Places of effects without a strength, and lenses without a radius.
    let mut same = camera.clone();
    same.effects.patch.center = [0.2, 0.7];
    same.effects.patch.size = [0.5, 0.0];
    same.effects.dead_rows.first = 0.1;
    same.optics.focus = 0.0;
    assert_eq!(render(&scene, &poses, Some(&before), &same, 5).rgb, nominal);
    let mut off = scene.clone();
    off.lamps[1].direction = [0.0, 1.0, 0.2];
    off.lamps[0].shadow_rays = 64;
    assert_eq!(render(&off, &poses, None, &camera, 0).rgb, nominal);
    off.lamps.truncate(1);
    assert_eq!(render(&off, &poses, None, &camera, 0).rgb, nominal);

    type Set = fn(&mut Camera);
    let effects: [(&str, Set); 12] = [
        ("vignette", |camera| camera.effects.vignette = 0.5),
        ("blur", |camera| camera.effects.blur = 0.8),
        ("patch", |camera| camera.effects.patch.size = [0.1, 0.2]),
        ("exposure", |camera| camera.effects.exposure = 1.3),
        ("cast", |camera| camera.effects.color_cast = [1.0, 0.9, 0.8]),
        ("read noise", |camera| camera.effects.read_noise = 0.02),
        ("shot noise", |camera| camera.effects.shot_noise = 0.02),
        ("dead rows", |camera| camera.effects.dead_rows.share = 0.1),
        ("compression", |camera| camera.effects.compression = 1.0),
        ("tilt", |camera| camera.tilt = [0.0, 0.05, 0.0]),
        ("aperture", |camera| (camera.optics.samples, camera.optics.aperture) = (8, 0.02)),
        ("shutter", |camera| (camera.optics.samples, camera.optics.shutter) = (8, 1.0)),
    ];
    for (name, set) in effects {
        let mut changed = camera.clone();
        set(&mut changed);
        let images = render(&scene, &poses, Some(&before), &changed, 0);
        assert!(images.rgb != nominal, "{name} changes the image");
    }
}

/// Several rays per pixel without lens and shutter are the same whether there is a state before.
#[test]
fn what_does_not_move_is_not_blurred_by_motion() {
    let (camera, scene, poses, before) = scene_of("ball-catching");
    let mut camera = Camera { size: size(48), ..camera };
    camera.optics.samples = 4;
    let sharp = render(&scene, &poses, None, &camera, 0).rgb;
    assert_eq!(render(&scene, &poses, Some(&before), &camera, 0).rgb, sharp, "the shutter takes no time");
    camera.optics.shutter = 1.0;
    assert_eq!(render(&scene, &poses, None, &camera, 0).rgb, sharp, "there is no state before");
    let moved = render(&scene, &poses, Some(&before), &camera, 0).rgb;
    assert!(moved != sharp);
}

#[test]
fn a_soft_shadow_of_a_lamp_without_a_radius_is_hard() {
    let (camera, mut scene, poses, _) = scene_of("door-opening");
    let mut image = |radius: f32| {
        scene.lamps[0].radius = radius;
        render(&scene, &poses, None, &camera, 0).rgb
    };
    let hard = image(0.0);
    let tiny = image(1e-6);
    let soft = image(0.1);
    // A tiny lamp casts the same shadows, up to pixels at their edges.
    let differ = |other: &[u8]| hard.iter().zip(other).filter(|(a, b)| a.abs_diff(**b) > 1).count();
    assert!(differ(&tiny) <= 12, "{}", differ(&tiny));
    assert!(differ(&soft) > 300, "{}", differ(&soft));
}

#[test]
fn sensor_noise_has_the_stated_mean_and_variance_and_its_own_stream() {
    let (scene, poses) = empty();
    let mut scene = scene;
    scene.background.above = [0.5, 0.5, 0.5];
    scene.background.horizon = [0.5, 0.5, 0.5];
    let mut camera = camera(128);
    camera.effects.read_noise = 0.06;
    camera.effects.shot_noise = 0.08;
    let image = |camera: &Camera, step| render(&scene, &poses, None, camera, step).rgb;
    let noisy = image(&camera, 0);
    let n = noisy.len() as f64;
    let mean = noisy.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let variance = noisy.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
    // Half of the shot noise's variance at half brightness; rounding to bytes adds 1 / 12.
    let expected = 255.0 * 255.0 * (0.06_f64.powi(2) + 0.5 * 0.08_f64.powi(2)) + 1.0 / 12.0;
    assert!((mean - 127.5).abs() < 5.0 * (expected / n).sqrt(), "{mean}");
    assert!((variance / expected - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{variance}, {expected}");
    assert_eq!(noisy, image(&camera, 0));
    assert!(noisy != image(&camera, 1));
    camera.effects.read_noise = 0.0;
    camera.effects.shot_noise = 0.0;
    assert!(image(&camera, 0).iter().all(|v| *v == 128), "half of white is byte 128");
}

#[test]
fn a_blur_keeps_the_mean_and_has_the_stated_width() {
    let (mut scene, poses) = empty();
    scene.background.above = [0.0; 3];
    scene.background.horizon = [0.0; 3];
    let dot = |deviation: f32| {
        let mut camera = camera(65);
        camera.effects.blur = deviation;
        // A bright dot of a pixel in the middle, by a patch that is in front of the blur.
        camera.effects.patch.size = [1.0 / 65.0; 2];
        camera.effects.patch.color = [80.0; 3];
        // The exposure makes the sum of the bytes a measure of the light.
        camera.effects.exposure = 0.5 / 16.0;
        render(&scene, &poses, None, &camera, 0).rgb
    };
    for deviation in [1.5_f32, 2.5] {
        let image = dot(deviation);
        let mut sum = 0.0;
        let mut spread = 0.0;
        for (pixel, rgb) in image.chunks(3).enumerate() {
            let x = (pixel % 65) as f64 - 32.0;
            sum += f64::from(rgb[0]);
            spread += f64::from(rgb[0]) * x * x;
        }
        let variance = f64::from(deviation * deviation);
        assert!((sum / (255.0 * 2.5) - 1.0).abs() < 0.05, "{sum}");
        assert!((spread / sum / variance - 1.0).abs() < 0.1, "{} for {variance}", spread / sum);
    }
}

#[test]
fn a_camera_of_a_model_is_where_the_model_says() {
    let xml = r#"<mujoco><worldbody><body pos="1 2 3" euler="0 0 90">
        <camera name="eye" pos=".1 .2 .3" xyaxes="0 1 0  -.6 0 .8" fovy="90"/></body></worldbody></mujoco>"#;
    let model = Model::from_xml(xml).unwrap();
    let index = model.find(mishandle_world::ElementKind::Camera, "eye").unwrap();
    let camera = Camera::of_model(&model.camera_at(index), size(32));
    // It looks along the cross product of its y and x.
    let same = Camera::looking(size(32), 1, [[0.1, 0.2, 0.3], [-0.7, 0.2, -0.3], [0.0, 0.0, 1.0]], 0.5);
    let near = |a: [f32; 3], b: [f32; 3]| (0..3).all(|i| (a[i] - b[i]).abs() < 1e-6);
    assert_eq!((camera.body, camera.size), (same.body, same.size));
    assert!((camera.focal_length - 0.5).abs() < 1e-6);
    assert!(near(camera.pose.position, same.pose.position));
    assert!((0..3).all(|i| near(camera.pose.axes[i], same.pose.axes[i])), "{:?}", camera.pose);
}

#[test]
fn the_edge_of_the_image_may_be_anywhere() {
    let (camera, scene, poses, _) = scene_of("point-reaching");
    for (width, height) in [(1, 1), (7, 3), (3, 41), (65, 64)] {
        let camera = Camera { size: Size::new(width, height).unwrap(), ..camera.clone() };
        let images = render(&scene, &poses, None, &camera, 0);
        assert_eq!(images.rgb.len(), 3 * width * height);
    }
    assert!(Size::new(0, 4).is_err() && Size::new(4, 2000).is_err());
    let message = Size::new(64, 2000).map_err(|error| error.to_string());
    assert_eq!(message, Err("an image of 64 x 2000 pixels: each side must be from 1 to 1024".to_string()));
}
