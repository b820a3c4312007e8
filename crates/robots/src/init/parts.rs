//! Parts of observations whose names are in use.

use crate::init::facts::{PartFacts, Tool};

/// An expression for a part of an observation.
pub(crate) struct KnownPart {
    pub expression: String,
    pub unit: &'static str,
    pub size: usize,
}

/// The words that expressions for parts refer to.
pub(crate) struct Words<'a> {
    /// The body that moves freely.
    pub base: Option<&'a str>,
    pub tool: Tool,
    /// The site at which mjlab measures the velocity of the base.
    pub site: Option<&'a str>,
    /// A group of joints, its default positions and its size.
    pub joints: &'a str,
    pub default: &'a str,
    pub joint_count: usize,
    pub action_count: usize,
}

/// The axes of a command of velocities, in the order in which policies see them.
pub(crate) const COMMANDS: [&str; 3] = ["command_x", "command_y", "command_yaw"];

/// Returns the expression of a part with a known name.
pub(crate) fn known(part: &PartFacts, words: &Words<'_>) -> Option<KnownPart> {
    let of_base = |function: fn(&str) -> String| words.base.map(function);
    let joints = words.joints;
    let (expression, unit, size) = match part.name.as_str() {
        "base_lin_vel" | "root_lin_vel_b" | "base_linear_velocity" => {
            let body = words.base?;
            (format!("body_frame('{body}', {})", velocity(body, words)), "m/s", 3)
        }
        "base_ang_vel" | "root_ang_vel_b" | "base_angular_velocity" | "gyro" => {
            (of_base(|body| format!("body_frame('{body}', body_angvel('{body}'))"))?, "rad/s", 3)
        }
        "root_lin_vel_w" => (velocity(words.base?, words), "m/s", 3),
        "root_ang_vel_w" => (of_base(|body| format!("body_angvel('{body}')"))?, "rad/s", 3),
        "projected_gravity" | "gravity" => {
            (of_base(|body| format!("body_frame('{body}', [0, 0, -1])"))?, "", 3)
        }
        "base_pos_z" | "base_height" => (of_base(|body| format!("body_pos('{body}')[2]"))?, "m", 1),
        "root_quat_w" => (of_base(|body| format!("body_quat('{body}')"))?, "", 4),
        "joint_pos_rel" => (relative(words), "rad", words.joint_count),
        "joint_pos" | "joint_positions" | "dof_pos" => match part.is_relative {
            Some(true) => (relative(words), "rad", words.joint_count),
            Some(false) => (format!("qpos({joints})"), "rad", words.joint_count),
            None => return None,
        },
        "joint_vel" | "joint_vel_rel" | "joint_velocities" | "dof_vel" => {
            (format!("qvel({joints})"), "rad/s", words.joint_count)
        }
        "actions" | "last_action" | "last_actions" | "previous_actions" | "prev_actions" => {
            ("action".to_string(), "", words.action_count)
        }
        "command" | "commands" | "generated_commands" | "velocity_commands" => {
            (format!("[{}]", COMMANDS.join(", ")), "", COMMANDS.len())
        }
        _ => return None,
    };
    let is_own_size = part.size.is_none_or(|found| found == size);
    let has_factors = part.scale.len() <= 1 || part.scale.len() == size;
    (is_own_size && has_factors && part.history <= 1 && !part.is_unclear).then_some(KnownPart {
        expression,
        unit,
        size,
    })
}

/// Returns the velocity of the base in world axes at the point where the tool of the policy
/// measures it.
fn velocity(body: &str, words: &Words<'_>) -> String {
    let point = match (words.tool, words.site) {
        // Isaac Lab's `root_lin_vel` is that of the center of mass.
        (Tool::Isaac, _) => format!("body_com('{body}')"),
        (Tool::Mjlab, Some(site)) => format!("site_pos('{site}')"),
        _ => return format!("body_vel('{body}')"),
    };
    format!("body_vel('{body}') + cross(body_angvel('{body}'), {point} - body_pos('{body}'))")
}

fn relative(words: &Words<'_>) -> String {
    format!("qpos({}) - {}", words.joints, words.default)
}

/// Returns an expression with the clipping and the factors of a part, in the order of the tools.
pub(crate) fn scaled(part: &PartFacts, expression: &str) -> String {
    let clipped = match part.clip {
        Some([low, high]) if low.is_finite() && high.is_finite() => {
            format!("clip({expression}, {low}, {high})")
        }
        Some([low, _]) if low.is_finite() => format!("max({expression}, {low})"),
        Some([_, high]) if high.is_finite() => format!("min({expression}, {high})"),
        _ => expression.to_string(),
    };
    match part.scale.as_slice() {
        [] => clipped,
        [one] => format!("{one} * ({clipped})"),
        several => {
            let factors: Vec<String> = several.iter().map(ToString::to_string).collect();
            format!("[{}] * ({clipped})", factors.join(", "))
        }
    }
}
