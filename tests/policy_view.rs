//! The images that a policy saw in a simulation, and the pixels on which its action depends.

#![cfg(feature = "onnx")]

use std::path::Path;

use crate::graph::{Of, bytes, integer, node, node_with, value, weights};
use mishandle::picture::{CameraSettings, policy_views, simulate_states};
use mishandle::plan::EvaluatePlan;
use mishandle::rollout::{Image, Request, Scenario, Seed};
use mishandle::{Plan, ResolvedPlan};

/// Sides of the image, and the pixels that the policy reads: a part of the patch in the fourth
/// column and the sixth row of 8 x 8 patches of 2 x 2 pixels.
const SIDE: usize = 16;
const READ: [(usize, usize); 2] = [(6, 10), (7, 11)];

/// Weight of red in each action.
const WEIGHTS: [f32; 9] = [0.5, -0.25, 0.0, 0.125, 0.0, 0.0, 0.25, 0.0, 0.0];

/// Writes a policy of point-reaching whose action is the red of two pixels, with a weight for each
/// action.
fn write_policy(path: &Path) {
    let mut kernel = vec![0.0; 3 * SIDE * SIDE];
    READ.iter().for_each(|(x, y)| kernel[y * SIDE + x] = 1.0);
    let side = SIDE as i64;
    let parts = [
        value(11, "i", &[1, 3, side, side]),
        weights("k", &[1, 3, side, side], &kernel),
        weights("m", &[1, 9], &WEIGHTS),
        node_with("Conv", &["i", "k"], &["c"], &[("kernel_shape", Of::Numbers(vec![side, side]))]),
        node("Flatten", &["c"], &["f"]),
        node("Gemm", &["f", "m"], &["a"]),
        value(12, "a", &[1, 9]),
    ];
    let model = [integer(1, 8), bytes(7, &parts.concat()), bytes(8, &integer(2, 13))].concat();
    std::fs::write(path, model).unwrap();
    let side_file = r#"{"task": "point-reaching", "images": [["i", "over"]]}"#;
    std::fs::write(format!("{}.json", path.display()), side_file).unwrap();
}

fn resolved(folder: &Path, space: &str) -> ResolvedPlan {
    let path = folder.join("seeing.onnx");
    write_policy(&path);
    let plan = Plan {
        evaluate: Some(EvaluatePlan::default()),
        space: space.to_string(),
        ..Plan::new("point-reaching", path.to_str().unwrap())
    };
    ResolvedPlan::new(&plan).unwrap()
}

/// The scenario in the middle of the starts with the dimmest lamp.
fn dim(resolved: &ResolvedPlan) -> Request {
    let axes = resolved.space.axes();
    let value = |axis: &mishandle::rollout::Axis| match axis.name.as_str() {
        "lamp_strength" => Some(axis.low),
        _ => axis.nominal,
    };
    Request::new(Scenario::new(axes.iter().map(value).collect()), Seed(5))
}

#[test]
fn the_images_are_those_that_the_cameras_of_the_task_draw() {
    let folder = tempfile::tempdir().unwrap();
    let resolved = resolved(folder.path(), "starts+light-3");
    let request = dim(&resolved);
    let (view, nominal) = policy_views(&resolved, &request).unwrap().unwrap();
    let nominal = nominal.unwrap();
    assert_eq!(view.images, [Image { camera: "over".to_string(), width: SIDE, height: SIDE }]);
    let usual = Request { scenario: resolved.space.nominal(), ..request.clone() };
    let [mut dim_light, mut usual_light] = [0u64; 2];
    for (view, request, light) in [(&view, &request, &mut dim_light), (&nominal, &usual, &mut usual_light)] {
        let (episode, trajectory) = simulate_states(&resolved, request).unwrap();
        assert_eq!(view.episode.robustness(), episode.robustness());
        assert_eq!(view.steps(), episode.steps);
        let settings = CameraSettings { names: vec!["over".to_string()], size: [SIDE as u16; 2] };
        let space = &resolved.space;
        let mut cameras = mishandle::picture::TargetCameras::new("point-reaching", space, &settings).unwrap();
        let states = &trajectory.states;
        let seen = cameras.start(states, &request.scenario, request.seed).unwrap().unwrap();
        for step in [0, 1, view.steps() - 1] {
            let drawn = cameras.image(&seen, states, 0, step);
            assert_eq!(view.image(0, step), drawn, "step {step}");
            *light += drawn.iter().map(|byte| u64::from(*byte)).sum::<u64>();
        }
    }
    assert!(dim_light < usual_light, "the dim lamp is in the images: {dim_light}, {usual_light}");
}

#[test]
fn only_the_patch_that_the_policy_reads_changes_its_action_by_what_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let resolved = resolved(folder.path(), "starts");
    let (view, nominal) = policy_views(&resolved, &dim(&resolved)).unwrap().unwrap();
    assert!(nominal.is_none(), "nothing but starts is varied");
    let found = view.occlusion(3).unwrap();
    let image = view.image(0, 3);
    let red = |x: usize, y: usize| f64::from(image[3 * (y * SIDE + x)]);
    let mean = (image.iter().step_by(3).map(|red| f64::from(*red)).sum::<f64>() / 256.0).round();
    let norm = WEIGHTS.iter().map(|w| f64::from(*w).powi(2)).sum::<f64>().sqrt();
    // No action is beyond its limit: the largest weight is 0.5, and both reds are at most 1.
    let read = READ.map(|(x, y)| red(x, y) / 255.0);
    let near = |a: f64, b: f64| (a - b).abs() < 1e-5;
    assert!(near(found.action, norm * (read[0] + read[1])), "{found:?}");
    assert_eq!(found.images[0].patches, [8, 8]);
    for (patch, change) in found.images[0].changes.iter().enumerate() {
        let expected =
            if patch == 5 * 8 + 3 { norm * (read[0] + read[1] - 2.0 * mean / 255.0).abs() } else { 0.0 };
        assert!(near(*change, expected), "patch {patch}: {change}, {expected}");
        assert!(patch != 43 || *change > 1e-3, "the test shows nothing");
    }
    assert!(view.occlusion(view.steps()).is_none(), "no action follows the last sample");
}

#[test]
fn a_controller_that_sees_nothing_has_no_view() {
    let plan = Plan { evaluate: Some(EvaluatePlan::default()), ..Plan::new("point-reaching", "expert") };
    let resolved = ResolvedPlan::new(&plan).unwrap();
    let request = Request::new(resolved.space.nominal(), Seed(1));
    assert!(policy_views(&resolved, &request).unwrap().is_none());
}
