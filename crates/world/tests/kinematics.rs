//! The robot's kinematics compared with Franka's Denavit-Hartenberg parameters, computed with 4x4
//! matrices.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use mishandle_world::{Arm, Joint, Model, PANDA, World};

/// Maps a frame's coordinates to base coordinates.
type Transform = [[f64; 4]; 4];

/// Craig's convention, one row per joint: a (m), alpha (rad), d (m). Row i is Rx(alpha) Tx(a) Rz(q)
/// Tz(d).
const DENAVIT_HARTENBERG: [[f64; 3]; 7] = [
    [0.0, 0.0, 0.333],
    [0.0, -FRAC_PI_2, 0.0],
    [0.0, FRAC_PI_2, 0.316],
    [0.0825, FRAC_PI_2, 0.0],
    [-0.0825, -FRAC_PI_2, 0.384],
    [0.0, FRAC_PI_2, 0.0],
    [0.088, FRAC_PI_2, 0.0],
];

const JOINTS: [&str; 9] =
    ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "joint7", "finger_joint1", "finger_joint2"];

fn about_x(angle: f64, a: f64) -> Transform {
    let (s, c) = angle.sin_cos();
    [[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, 0.0], [0.0, 0.0, 0.0, 1.0]]
}

fn about_z(angle: f64, d: f64) -> Transform {
    let (s, c) = angle.sin_cos();
    [[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, d], [0.0, 0.0, 0.0, 1.0]]
}

fn shift(y: f64, z: f64) -> Transform {
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]
}

fn product(a: &Transform, b: &Transform) -> Transform {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns the frames of links 1 to 7, hand, left finger, right finger and TCP, in the base frame.
fn frames(q: &[f64; 9]) -> Vec<(&'static str, Transform)> {
    const LINKS: [&str; 7] = ["link1", "link2", "link3", "link4", "link5", "link6", "link7"];
    let mut frame = shift(0.0, 0.0);
    let mut all = Vec::new();
    for ((name, [a, alpha, d]), q) in LINKS.iter().zip(DENAVIT_HARTENBERG).zip(q) {
        frame = product(&product(&frame, &about_x(alpha, a)), &about_z(*q, d));
        all.push((*name, frame));
    }
    let hand = product(&frame, &about_z(-FRAC_PI_4, 0.107));
    all.push(("hand", hand));
    all.push(("left_finger", product(&hand, &shift(q[7], 0.0584))));
    all.push(("right_finger", product(&hand, &shift(-q[8], 0.0584))));
    all.push(("grasp", product(&hand, &shift(0.0, 0.1034))));
    all
}

/// Rotation matrix of the unit quaternion (w, x, y, z).
fn rotation([w, x, y, z]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Numbers in [0, 1): the top bits of a multiplicative congruential generator.
fn uniform(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1u64 << 53) as f64
}

fn random_vector(joints: &[Joint; 9], state: &mut u64) -> [f64; 9] {
    joints.map(|joint| joint.low + (joint.high - joint.low) * uniform(state))
}

fn panda() -> (World, [Joint; 9]) {
    let model = Model::from_xml(PANDA).unwrap();
    (model.world(), JOINTS.map(|name| model.joint(name).unwrap()))
}

fn close(got: f64, expected: f64, tolerance: f64, what: &str) {
    assert!((got - expected).abs() <= tolerance, "{what}: got {got}, expected {expected}");
}

#[test]
fn every_frame_agrees_with_the_denavit_hartenberg_parameters() {
    let (mut world, joints) = panda();
    let mut state = 1;
    for _ in 0..1000 {
        let q = random_vector(&joints, &mut state);
        world.qpos_mut().copy_from_slice(&q);
        world.refresh();
        for (name, expected) in frames(&q) {
            let rows = world.rows();
            let (position, matrix) = match world.model().body(name) {
                Ok(body) => (rows.position(body), rotation(rows.quaternion(body))),
                Err(_) => {
                    let site = world.model().site(name).unwrap();
                    let flat = rows.site_rotation(site);
                    (
                        rows.site_position(site),
                        std::array::from_fn(|i| std::array::from_fn(|j| flat[3 * i + j])),
                    )
                }
            };
            for i in 0..3 {
                close(position[i], expected[i][3], 1e-9, name);
                for j in 0..3 {
                    close(matrix[i][j], expected[i][j], 1e-9, name);
                }
            }
        }
    }
}

/// Checks one of the four initial configurations of the tasks: arm, finger opening, and the
/// positions of hand, left finger and TCP, m.
#[track_caller]
fn check_start(arm: [f64; 7], finger: f64, expected: [[f64; 3]; 3]) {
    let (mut world, _) = panda();
    world.qpos_mut()[..7].copy_from_slice(&arm);
    world.qpos_mut()[7..].fill(finger);
    world.refresh();
    let model = world.model();
    let rows = world.rows();
    let got = [
        rows.position(model.body("hand").unwrap()),
        rows.site_position(model.site("left_finger").unwrap()),
        rows.site_position(model.site("grasp").unwrap()),
    ];
    for (got, expected) in got.iter().flatten().zip(expected.iter().flatten()) {
        // The expected values are rounded to four digits.
        close(*got, *expected, 1e-4, &format!("{arm:?}"));
    }
}

#[test]
fn initial_configurations_agree_with_published_kinematics() {
    check_start(
        [0.0, -0.872, 0.0, -2.0, 0.0, 2.618, 0.785],
        0.01,
        [[0.2365, 0.0, 0.9176], [0.2947, -0.01, 0.9129], [0.3396, 0.0, 0.9093]],
    );
    check_start(
        [0.0, 0.0, 0.0, -0.0698, 0.0, 0.0, 0.0],
        0.015,
        [[0.1073, 0.0, 0.9249], [0.1138, -0.0106, 0.8659], [0.1001, 0.0, 0.8218]],
    );
    check_start(
        [1.157, -1.066, -0.155, -2.239, -1.841, 1.003, 0.469],
        0.035,
        [[0.2162, -0.0142, 0.8003], [0.2409, -0.0710, 0.8287], [0.2613, -0.1066, 0.7892]],
    );
    check_start(
        [0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.5],
        0.0001,
        [[0.449, 0.0, 0.8189], [0.4491, -0.0001, 0.7605], [0.449, 0.0, 0.7155]],
    );
}

#[test]
fn the_jacobian_agrees_with_the_denavit_hartenberg_frames() {
    let (world, joints) = panda();
    let mut arm = Arm::new(world.model(), &JOINTS[..7], "grasp").unwrap();
    let mut state = 2;
    let mut jacobian = [0.0; 6 * 7];
    for _ in 0..1000 {
        let q = random_vector(&joints, &mut state);
        arm.set(&q[..7]);
        arm.jacobian(&mut jacobian);
        let frames = frames(&q);
        let (_, tcp) = frames[frames.len() - 1];
        for (j, (name, frame)) in frames[..7].iter().enumerate() {
            // A revolute joint rotates about its frame's z axis: angular part z, linear part z x
            // (tcp - origin).
            let z = [frame[0][2], frame[1][2], frame[2][2]];
            let r: [f64; 3] = std::array::from_fn(|i| tcp[i][3] - frame[i][3]);
            let linear = [z[1] * r[2] - z[2] * r[1], z[2] * r[0] - z[0] * r[2], z[0] * r[1] - z[1] * r[0]];
            for i in 0..3 {
                close(jacobian[7 * i + j], linear[i], 1e-9, name);
                close(jacobian[7 * (3 + i) + j], z[i], 1e-9, name);
            }
        }
    }
}

#[test]
fn the_jacobian_is_the_derivative_of_the_position() {
    let (world, joints) = panda();
    let mut arm = Arm::new(world.model(), &JOINTS, "left_finger").unwrap();
    let mut state = 3;
    let mut jacobian = [0.0; 6 * 9];
    let step = 1e-5;
    for _ in 0..100 {
        let q = random_vector(&joints, &mut state);
        arm.set(&q);
        arm.jacobian(&mut jacobian);
        for j in 0..9 {
            let mut at = |delta: f64| {
                let mut moved = q;
                moved[j] += delta;
                arm.set(&moved);
                arm.position()
            };
            let ahead = at(step);
            let behind = at(-step);
            for i in 0..3 {
                // The error of central differences is step^2 / 6 times a third derivative of at
                // most the arm's reach, 1.3 m.
                close((ahead[i] - behind[i]) / (2.0 * step), jacobian[9 * i + j], 1e-9, JOINTS[j]);
            }
        }
    }
}

#[test]
fn a_twist_equals_the_jacobian_times_the_joint_velocities() {
    let (mut world, joints) = panda();
    let mut arm = Arm::new(world.model(), &JOINTS, "right_finger").unwrap();
    let finger = world.model().body("right_finger").unwrap();
    let mut state = 4;
    let mut jacobian = [0.0; 6 * 9];
    for _ in 0..100 {
        let q = random_vector(&joints, &mut state);
        let velocity: [f64; 9] = std::array::from_fn(|_| 2.0 * uniform(&mut state) - 1.0);
        world.qpos_mut().copy_from_slice(&q);
        world.qvel_mut().copy_from_slice(&velocity);
        world.refresh();
        arm.set(&q);
        arm.jacobian(&mut jacobian);
        let (linear, angular) = world.rows().twist(finger);
        for (row, got) in jacobian.chunks(9).zip(linear.into_iter().chain(angular)) {
            let expected: f64 = row.iter().zip(&velocity).map(|(j, v)| j * v).sum();
            close(got, expected, 1e-9, "right_finger");
        }
    }
}
