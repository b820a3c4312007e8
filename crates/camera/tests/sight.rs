//! Laws of images that others took: effects, and faults of their cameras.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

use mishandle_camera::Size;
use mishandle_camera::sight::{ImageFeed, Sight};
use mishandle_rollout::{Axis, AxisValues, Scenario, Seed, Space};

const STEPS: usize = 30;

fn sight() -> (Sight, Space) {
    let sight = Sight::of_images(vec!["left".to_string(), "right".to_string()], 0.1, STEPS);
    let axes = sight.axes().cloned().collect();
    (sight, Space::new("images", axes).unwrap())
}

/// Returns a scenario with some axes at values, which are numbers or names.
fn scenario(space: &Space, values: &[(&str, &str)]) -> Scenario {
    let number = |axis: &Axis, text: &str| match &axis.values {
        AxisValues::Categorical(names) => names.iter().position(|name| name == text).unwrap() as f64,
        _ => text.parse().unwrap(),
    };
    let value = |axis: &Axis| {
        let given = values.iter().find(|(name, _)| *name == axis.name);
        given.map_or(axis.nominal, |(_, text)| Some(number(axis, text)))
    };
    Scenario::new(space.axes().iter().map(value).collect())
}

/// Returns the images of both cameras in each step, whose pixels are the number of the step, with
/// 100 added for the second camera.
fn seen(values: &[(&str, &str)], sizes: [[usize; 2]; 2], seed: u64) -> Vec<[Vec<u8>; 2]> {
    let (sight, space) = sight();
    let scenario = scenario(&space, values);
    let sizes = sizes.map(|[width, height]| Size::new(width, height).unwrap());
    let mut feed = ImageFeed::new(&sight, &sizes, &space, &scenario, Seed(seed)).unwrap();
    let image = |step: usize, camera: usize| vec![(step + 100 * camera) as u8; 3 * sizes[camera].pixels()];
    let step = |step: usize| {
        let [mut left, mut right] = [0, 1].map(|camera| image(step, camera));
        feed.next(step, &mut [&mut left, &mut right]);
        [left, right]
    };
    (0..STEPS).map(step).collect()
}

const SAME: [[usize; 2]; 2] = [[6, 4], [6, 4]];

#[test]
fn axes_are_those_of_images_and_faults_and_nominal_images_keep_their_bytes() {
    let (sight, _) = sight();
    let spaces: Vec<String> = sight.spaces().unwrap().iter().map(|space| space.name().to_string()).collect();
    let expected = ["occlusion", "image"].map(|factor| (1..=5).map(move |level| format!("{factor}-{level}")));
    let expected = expected.into_iter().flatten().chain(["faults-camera".to_string()]);
    assert_eq!(spaces, expected.collect::<Vec<_>>());
    // Lens and shutter need the scene.
    let kinds = sight.axes().find(|axis| axis.name == "corruption").unwrap();
    assert_eq!(kinds.levels(), Some(11));
    assert!(sight.random_axes().any(|own| own == "corruption"));
    for (step, [left, right]) in seen(&[], SAME, 1).iter().enumerate() {
        assert!(left.iter().all(|byte| usize::from(*byte) == step));
        assert!(right.iter().all(|byte| usize::from(*byte) == 100 + step));
    }
}

#[test]
fn a_late_image_has_the_noise_with_which_it_was_taken() {
    let noise = [("corruption", "gaussian-noise"), ("corruption_severity", "1")];
    let prompt = seen(&noise, SAME, 1);
    let late = seen(&[&noise[..], &[("camera_delay", "3")]].concat(), SAME, 1);
    for step in 3..STEPS {
        assert_eq!(late[step], prompt[step - 3]);
    }
    assert_ne!(prompt[4][0].iter().map(|byte| byte + 100).collect::<Vec<_>>(), prompt[4][1]);
    assert_ne!(prompt, seen(&noise, SAME, 2));
}

#[test]
fn cameras_exchange_images_of_the_same_size_only() {
    let swap = [
        ("camera_fault", "swap"),
        ("camera_fault_channel", "left"),
        ("camera_fault_onset", "1"),
        ("camera_fault_duration", "1"),
    ];
    let exchanged = seen(&swap, SAME, 1);
    assert_eq!([exchanged[12][0][0], exchanged[12][1][0]], [112, 12]);
    assert_eq!([exchanged[25][0][0], exchanged[25][1][0]], [25, 125]);
    // As many pixels in another shape are another size.
    assert_eq!(seen(&swap, [[6, 4], [4, 6]], 1)[12], seen(&[], [[6, 4], [4, 6]], 1)[12]);
}

#[test]
fn a_patch_is_on_every_camera_and_grows() {
    let plain = seen(&[], SAME, 1);
    let changed = |size: &str| {
        let patched = seen(&[("occlusion_size", size)], SAME, 1);
        [0, 1].map(|camera| patched[5][camera].iter().zip(&plain[5][camera]).filter(|(a, b)| a != b).count())
    };
    // Of 6 x 4 pixels, half of each side.
    assert_eq!(changed("0.5"), [3 * 6; 2]);
    assert!(changed("0.25")[0] < changed("0.5")[0]);
}
