//! Where the cameras of a task are.

/// The names of the cameras of all tasks.
pub const CAMERA_NAMES: [&str; 2] = ["over", "wrist"];

/// The direction to the lamp of a task that states no other one, for a vertical part of 1: in front
/// of the robot on its right, as the camera over the table.
pub const LAMP: [f64; 3] = [0.35, -0.3, 1.0];

/// The place of a camera. Points and directions are in the frame of its body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraPlace {
    /// Name.
    pub name: &'static str,
    /// Name of the body that it moves with; `None` is the world.
    pub body: Option<&'static str>,
    /// Position, m.
    pub from: [f64; 3],
    /// The point in the center of the image, m.
    pub to: [f64; 3],
    /// A direction that is nearly up in images.
    pub up: [f64; 3],
    /// Focal length, image heights.
    pub focal_length: f64,
}

impl CameraPlace {
    /// The camera of a task that states no other one: in front of the robot on its right. It sees
    /// all that the arm reaches.
    pub const OVER: CameraPlace = CameraPlace::over([1.65, -0.75, 1.25], [0.38, 0.0, 0.47], 1.15);

    /// The camera at the wrist: above the hand, with both fingertips at the lower edge.
    pub const WRIST: CameraPlace = CameraPlace {
        name: CAMERA_NAMES[1],
        body: Some("hand"),
        from: [0.075, 0.0, 0.035],
        to: [0.025, 0.0, 0.16],
        up: [1.0, 0.0, 0.0],
        focal_length: 0.65,
    };

    /// Returns a camera over the table.
    pub const fn over(from: [f64; 3], to: [f64; 3], focal_length: f64) -> CameraPlace {
        CameraPlace { name: CAMERA_NAMES[0], body: None, from, to, up: [0.0, 0.0, 1.0], focal_length }
    }
}
