//! The pairs of links that are excluded from collisions because they cannot meet do not meet.

use mishandle_world::{Model, PANDA};

const BODIES: [&str; 11] = [
    "link0",
    "link1",
    "link2",
    "link3",
    "link4",
    "link5",
    "link6",
    "link7",
    "hand",
    "left_finger",
    "right_finger",
];
const JOINTS: [&str; 7] = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7"];
const SAMPLES: u32 = 40_000;

/// Pairs without this comment in the model overlap by construction.
const CANNOT_MEET: &str = "<!-- These pairs are at least 4 cm apart within the joint limits. -->";

fn exclude(pair: [&str; 2]) -> String {
    format!("<exclude body1=\"{}\" body2=\"{}\"/>", pair[0], pair[1])
}

fn pairs() -> Vec<[&'static str; 2]> {
    let from = |first: usize| BODIES[first + 1..].iter().map(move |second| [BODIES[first], *second]);
    (0..BODIES.len()).flat_map(from).collect()
}

/// Returns the robot with larger collision shapes: `growth` on each side, m.
fn grown(growth: f64) -> String {
    let grow = |line: &str| match (line.contains("class=\"panda_collision"), line.split_once(" size=\"")) {
        (true, Some((before, size))) => {
            let (size, after) = size.split_once('"').unwrap();
            let sizes: Vec<String> = (size.split(' '))
                .map(|number| (number.parse::<f64>().unwrap() + growth).to_string())
                .collect();
            format!("{before} size=\"{}\"{after}", sizes.join(" "))
        }
        _ => line.to_string(),
    };
    PANDA.lines().map(|line| grow(line) + "\n").collect()
}

/// Returns the deepest overlap, m, in random configurations within the joint limits if only these
/// pairs of bodies collide and the shapes are larger.
fn deepest_overlap(colliding: &[[&str; 2]], growth: f64) -> f64 {
    let document = grown(growth);
    let (before, _) = document.split_once("<contact>").unwrap();
    let (_, after) = document.split_once("</contact>").unwrap();
    let excludes: String =
        pairs().into_iter().filter(|pair| !colliding.contains(pair)).map(exclude).collect();
    let model = Model::from_xml(&format!("{before}<contact>{excludes}</contact>{after}")).unwrap();
    let joints = JOINTS.map(|name| model.joint(name).unwrap());
    let mut world = model.world();
    let mut deepest = 0.0_f64;
    // Multiples of irrational numbers fill the box of the joints evenly.
    let steps = [2.0_f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0].map(f64::sqrt);
    for sample in 0..SAMPLES {
        world.reset();
        for (joint, step) in joints.iter().zip(steps) {
            let share = (f64::from(sample) * step).fract();
            world.qpos_mut()[joint.qpos] = joint.low + (joint.high - joint.low) * share;
        }
        // The contacts are those at the start of the step.
        world.step();
        deepest = deepest.max(world.penetration());
    }
    deepest
}

#[test]
fn pairs_that_are_excluded_because_they_cannot_meet_stay_4_cm_apart() {
    let (_, after) = PANDA.split_once(CANNOT_MEET).unwrap();
    let (listed, _) = after.split_once("</contact>").unwrap();
    let apart: Vec<[&str; 2]> = pairs().into_iter().filter(|pair| listed.contains(&exclude(*pair))).collect();
    assert_eq!(apart.len(), listed.matches("<exclude").count(), "a pair is misspelled");
    assert_eq!(deepest_overlap(&apart, 0.02), 0.0);
    // The method sees pairs that do meet.
    assert!(deepest_overlap(&[["link0", "link5"]], 0.0) > 0.01);
    assert!(deepest_overlap(&[["link1", "link4"]], 0.02) > 0.0);
}
