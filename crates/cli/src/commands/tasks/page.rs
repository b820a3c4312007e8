//! One task, explained to a person. All of it is made from what the task states as data.

use anyhow::Result;
use mishandle::stl::{Clock, EvaluationTime, Formula};
use mishandle::tasks::{
    CONTROL_DT, Definition, EPISODE_STEPS, GripperMode, JOINT_NAMES, Preset, Quantity, Reward, TARGET_STEP,
};

use crate::output::{folded, table_in, wrapped};

/// What holds for every task.
const COMMON_DIFFERENCES: &str = "Of the robot's own parts only the hand and the fingers are tested against the four lowest \
    links; where nothing else is said, no part of it meets the ground.";

/// Columns before the lines of a section.
const INDENT: usize = 2;

/// The page, in lines of at most `columns` where its words allow it.
pub fn page(definition: &Definition, preset: Preset, columns: usize) -> Result<String> {
    let mut sections = vec![wrapped(&format!("{}: {}", definition.name, definition.summary), columns)];
    if let Some(base) = definition.variant_of {
        let text = format!(
            "A variant of {base}, none of the benchmark's tasks; it takes the controllers of {base}."
        );
        sections.push(wrapped(&text, columns));
    }
    let width = columns.saturating_sub(INDENT);
    sections.extend([
        section("Picture", &picture(definition)),
        section("Scene", &scene(definition, width)),
        section("Formulas", &formulas(definition, preset, width)?),
        section("Initial box (bounds under task presets paper and code)", &initial_box(definition, width)),
        section("Signals", &table_in(&quantities(definition.signals), width)),
        section(
            &format!("Observation ({} numbers, clipped to ±5)", definition.layout().observation_size()),
            &table_in(&numbered(&definition.whole_observation()), width),
        ),
        section("Actions (9 numbers in [-1, 1], 60 times a second)", &actions(definition, width)),
    ]);
    for (title, reward) in [("Original reward", Reward::Original), ("Shaped reward", Reward::Shaped)] {
        sections.push(section(
            &format!("{title}, the sum of"),
            &table_in(&terms(definition.reward(reward)), width),
        ));
    }
    let text = |title, text: &str| section(title, &wrapped(text, width));
    sections.push(text("A training episode ends early when", definition.termination));
    sections.push(text("Clock", &clock(definition)));
    if definition.start_noise > 0.0 {
        sections.push(text("Start noise", &start_noise(definition)));
    }
    sections.push(text(
        "Differences from the original",
        &format!("{} {COMMON_DIFFERENCES}", definition.differences),
    ));
    sections.push(text("Controllers", &mishandle::shipped_controllers(definition).join(", ")));
    Ok(sections.join("\n\n"))
}

fn section(title: &str, lines: &str) -> String {
    let indented: Vec<String> =
        lines.lines().map(|line| format!("  {line}").trim_end().to_string()).collect();
    format!("{title}\n{}", indented.join("\n"))
}

fn picture(definition: &Definition) -> String {
    let name = definition.name;
    let command = format!("mishandle render {name} --out {name}.png");
    match mishandle::picture_path(name) {
        Some(path) => format!("{}\n{command}", path.display()),
        None => command,
    }
}

fn scene(definition: &Definition, width: usize) -> String {
    let joints = JOINT_NAMES.iter().zip(definition.start).map(|(name, q)| format!("{name} {q}"));
    let start = format!("The robot starts at {} (rad, m).", joints.collect::<Vec<_>>().join(", "));
    format!(
        "{}\n{}\n{}",
        wrapped("The robot's base is the origin; x points forward, y to its left, z up.", width),
        wrapped(definition.scene_description, width),
        wrapped(&start, width)
    )
}

/// What the four formulas of a task are for.
const ROLES: [(&str, EvaluationTime, &str); 4] = [
    ("success", EvaluationTime::Start, "the task was done"),
    ("strict", EvaluationTime::Start, "the task was done well (ours, not the paper's)"),
    (
        "safe",
        EvaluationTime::Any,
        "a control step is not dangerous; dangerous behavior rate: the share of those that are",
    ),
    ("completion", EvaluationTime::Any, "the task is completed at the first control step where this holds"),
];

fn formulas(definition: &Definition, preset: Preset, width: usize) -> Result<String> {
    let texts = |preset| {
        let formulas = definition.formulas(preset);
        [formulas.success, formulas.strict, formulas.safe, formulas.completion]
    };
    let [shown, other] = match preset {
        Preset::Paper => [Preset::Paper, Preset::Code],
        Preset::Code => [Preset::Code, Preset::Paper],
    };
    let mut lines = vec![format!(
        "Under task preset {}. Bounds without a unit count control steps of 1/60 s. What is met has a positive robustness.",
        name(shown)
    )];
    for (((role, moment, meaning), text), other_text) in ROLES.into_iter().zip(texts(shown)).zip(texts(other))
    {
        let formula = Formula::parse(text)?;
        let unit = |signal: &str| {
            definition.signals.iter().find(|known| known.name == signal).map_or("", |known| known.unit)
        };
        lines.push(format!("\n{role}: {meaning}"));
        lines.push(format!("  {text}"));
        lines.push(format!("  {}", formula.symbols()));
        lines.extend(
            formula.explain(&Clock::steps(CONTROL_DT), moment, unit)?.iter().map(|line| format!("  {line}")),
        );
        if other_text != text {
            lines.push(format!("  task preset {}: {other_text}", name(other)));
        }
    }
    let lines = lines.iter().flat_map(|text| text.split('\n')).map(|line| folded(line, width));
    Ok(lines.collect::<Vec<_>>().join("\n"))
}

fn name(preset: Preset) -> &'static str {
    match preset {
        Preset::Paper => "paper",
        Preset::Code => "code",
    }
}

fn initial_box(definition: &Definition, width: usize) -> String {
    let mut rows = vec![["axis", "paper", "code", "unit", "sets"].map(String::from).to_vec()];
    for axis in definition.initial_box {
        let bounds = |[low, high]: [f64; 2]| format!("[{low}, {high}]");
        let text = [bounds(axis.paper), bounds(axis.code)];
        rows.push([axis.name, &text[0], &text[1], axis.unit, axis.meaning].map(String::from).to_vec());
    }
    table_in(&rows, width)
}

fn quantities(list: &[Quantity]) -> Vec<Vec<String>> {
    list.iter()
        .map(|quantity| [quantity.name, quantity.unit, quantity.meaning].map(String::from).to_vec())
        .collect()
}

fn terms(list: &[Quantity]) -> Vec<Vec<String>> {
    list.iter().map(|term| [term.name, term.meaning].map(String::from).to_vec()).collect()
}

/// Quantities with their places in a row of numbers.
fn numbered(list: &[Quantity]) -> Vec<Vec<String>> {
    let mut next = 0;
    let place = |size: usize| {
        let first = next;
        next += size;
        if size == 1 { first.to_string() } else { format!("{first}-{}", next - 1) }
    };
    let places: Vec<String> = list.iter().map(|quantity| quantity.size).map(place).collect();
    places.into_iter().zip(quantities(list)).map(|(place, rest)| [vec![place], rest].concat()).collect()
}

fn actions(definition: &Definition, width: usize) -> String {
    let fingers = match definition.grip {
        GripperMode::Fixed(opening) => format!("no effect: the fingers are held at {opening} m each"),
        GripperMode::Scene(rule) => rule.to_string(),
    };
    let arm = format!("joint targets of the arm, moved by {TARGET_STEP} rad at 1");
    table_in(&[vec!["0-6".to_string(), arm], vec!["7-8".to_string(), fingers]], width)
}

fn clock(definition: &Definition) -> String {
    format!(
        "{EPISODE_STEPS} control steps of 1/60 s, {} s in all; {} physics steps in each. Joint velocities are \
         multiplied by {} in the observation.",
        (EPISODE_STEPS as f64 * CONTROL_DT).round(),
        definition.n_substeps,
        definition.velocity_scale
    )
}

fn start_noise(definition: &Definition) -> String {
    format!(
        "Each joint of the arm starts up to {} rad off, drawn with the simulation's seed.",
        definition.start_noise
    )
}
