//! Isaac Lab's IO descriptor: the YAML file that `export_IO_descriptors` writes.

use crate::error::RobotError;
use crate::init::facts::{ActionKind, PartFacts, PolicyFacts, Tool, check_length, wrong};
use crate::init::yaml::{self, Yaml};

/// Returns the facts of an IO descriptor.
///
/// # Errors
/// If the text is not such a file, or two lists have different lengths.
pub fn isaac_facts(text: &str, source: &str) -> Result<PolicyFacts, RobotError> {
    let file = yaml::parse(text).map_err(|message| wrong(source, message))?;
    let actions = file.get("actions").map(Yaml::list).unwrap_or_default();
    let observations = file.get("observations").ok_or_else(|| {
        wrong(source, "there is no key `observations`; expected an IO descriptor of Isaac Lab")
    })?;
    let mut facts = PolicyFacts { source: source.to_string(), tool: Tool::Isaac, ..PolicyFacts::default() };
    read_actions(actions, &mut facts)?;
    read_robot(&file, &mut facts)?;
    let group = observations.get("policy").or_else(|| match observations {
        Yaml::Map(groups) => groups.first().map(|(_, group)| &**group),
        _ => None,
    });
    for term in group.map(Yaml::list).unwrap_or_default() {
        facts.parts.push(part(term));
    }
    let number = |key: &str| file.get("scene").and_then(|scene| scene.get(key)).and_then(Yaml::number);
    facts.period = number("dt");
    facts.timestep = number("physics_dt");
    Ok(facts)
}

/// Reads the actions. Several terms of the same kind follow each other.
fn read_actions(actions: &[std::rc::Rc<Yaml>], facts: &mut PolicyFacts) -> Result<(), RobotError> {
    let mut offsets = Vec::new();
    for action in actions {
        let kind = action.get("full_path").and_then(Yaml::text).unwrap_or_default();
        let kind = kind.rsplit('.').next().unwrap_or_default();
        let found = match kind {
            "JointPositionAction" => ActionKind::Position,
            "JointEffortAction" => ActionKind::Effort,
            _ => ActionKind::Unknown,
        };
        if found == ActionKind::Unknown || (facts.action != ActionKind::Unknown && facts.action != found) {
            facts.remarks.push(format!("actions of the kind `{kind}` must be written by hand"));
        }
        facts.action = found;
        let joints = action.get("joint_names").and_then(Yaml::texts).unwrap_or_default();
        let spread = |key: &str, default: f64| -> Result<Vec<f64>, RobotError> {
            let Some(value) = action.get(key) else { return Ok(vec![default; joints.len()]) };
            let not_numbers =
                || wrong(&facts.source, format!("`{key}` of an action is not a list of numbers"));
            match value.numbers().ok_or_else(not_numbers)?.as_slice() {
                [one] => Ok(vec![*one; joints.len()]),
                several => {
                    check_length(&facts.source, key, several.len(), joints.len())?;
                    Ok(several.to_vec())
                }
            }
        };
        let scale = spread("scale", 1.0)?;
        let offset = spread("offset", 0.0)?;
        if action.get("clip").is_some() {
            facts.remarks.push("the clipping of the actions must be written by hand".to_string());
        }
        if let Some(joint) = joints.iter().find(|joint| facts.joints.contains(joint)) {
            let message =
                format!("the joint `{joint}` has two actions; a target file must combine them by hand");
            return Err(wrong(&facts.source, message));
        }
        facts.scale.extend(scale);
        offsets.extend(offset);
        facts.joints.extend(joints);
    }
    facts.offset = (!offsets.is_empty()).then_some(offsets);
    Ok(())
}

/// Reads the facts of the first articulation.
fn read_robot(file: &Yaml, facts: &mut PolicyFacts) -> Result<(), RobotError> {
    let Some(Yaml::Map(robots)) = file.get("articulations") else { return Ok(()) };
    if robots.len() > 1 {
        let names: Vec<&str> = robots.iter().map(|(name, _)| name.as_str()).collect();
        facts.remarks.push(format!("the scene has several robots: {}", names.join(", ")));
    }
    let Some((_, robot)) = robots.iter().find(|(name, _)| name == "robot").or(robots.first()) else {
        return Ok(());
    };
    let joints = robot.get("joint_names").and_then(Yaml::texts).unwrap_or_default();
    let source = facts.source.clone();
    let numbers = |key: &str| -> Result<Option<Vec<f64>>, RobotError> {
        let Some(value) = robot.get(key) else { return Ok(None) };
        let values =
            value.numbers().ok_or_else(|| wrong(&source, format!("`{key}` is not a list of numbers")))?;
        check_length(&source, key, values.len(), joints.len())?;
        if values.iter().all(|value| value.is_finite()) {
            Ok(Some(values))
        } else {
            Err(wrong(&source, format!("`{key}` has a number that is not finite")))
        }
    };
    if let Some(default) = numbers("default_joint_pos")? {
        facts.default = joints.iter().cloned().zip(default).collect();
    }
    if let Some(armature) = numbers("default_joint_armature")? {
        facts.armature = joints.iter().cloned().zip(armature).collect();
    }
    if let (Some(stiffness), Some(damping)) =
        (numbers("default_joint_stiffness")?, numbers("default_joint_damping")?)
    {
        let own = |values: &[f64]| -> Vec<f64> {
            let value =
                |name: &String| joints.iter().position(|known| known == name).map(|index| values[index]);
            facts.joints.iter().filter_map(value).collect()
        };
        let stiffness = own(&stiffness);
        let damping = own(&damping);
        // Explicit actuator models, such as networks, leave the gains of the simulator at 0.
        let is_known = stiffness.len() == facts.joints.len() && stiffness.iter().any(|kp| *kp > 0.0);
        facts.gains = is_known.then_some([stiffness, damping]);
    }
    facts.observed_joints = joints;
    Ok(())
}

fn part(term: &Yaml) -> PartFacts {
    let name = term.get("name").and_then(Yaml::text).unwrap_or("unnamed").to_string();
    let own = term.get("overloads");
    let own = |key: &str| own.and_then(|own| own.get(key));
    let shape = term.get("shape").and_then(Yaml::numbers).unwrap_or_default();
    let clip = own("clip").map(|clip| clip.numbers().and_then(|clip| <[f64; 2]>::try_from(clip).ok()));
    let scale = own("scale").map(Yaml::numbers);
    let history = own("history_length").map(Yaml::number);
    let modifiers = term.get("extras").and_then(|extras| extras.get("modifiers"));
    let is_moved = term.get("joint_vel_offsets").and_then(Yaml::numbers);
    let is_moved = is_moved.is_some_and(|offsets| offsets.iter().any(|offset| *offset != 0.0));
    PartFacts {
        is_unclear: matches!(clip, Some(None))
            || matches!(scale, Some(None))
            || matches!(history, Some(None))
            || modifiers.is_some_and(|modifiers| *modifiers != Yaml::List(Vec::new()))
            || is_moved,
        size: (!shape.is_empty()).then(|| shape.iter().product::<f64>() as usize),
        scale: scale.flatten().unwrap_or_default(),
        clip: clip.flatten(),
        history: history.flatten().unwrap_or(0.0) as usize,
        joints: term.get("joint_names").and_then(Yaml::texts).unwrap_or_default(),
        is_relative: Some(term.get("joint_pos_offsets").is_some() || name.ends_with("_rel")),
        name,
    }
}
