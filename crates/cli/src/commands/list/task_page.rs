//! Description of one task, generated from its definition and its notes.

use anyhow::Result;
use mishandle::stl::{Clock, EvaluationTime, Formula};
use mishandle::tasks::{
    CONTROL_DT, Definition, EPISODE_STEPS, GripperMode, JOINT_NAMES, MANNER, Note, Preset, Quantity, Reward,
    TARGET_STEP, Topic,
};

use crate::show::output::{folded, indented, table_in, wrapped};

/// Indentation of the lines of a section, in columns.
const INDENT: usize = 2;

/// Returns the description in lines of at most `columns` characters. Words longer than a line are
/// not broken.
pub fn page(definition: &Definition, notes: &[Note], preset: Preset, columns: usize) -> Result<String> {
    let mut sections = vec![wrapped(&format!("{}: {}", definition.name, definition.summary), columns)];
    if let Some(base) = definition.variant_of {
        let text = format!("A variant of {base} outside the benchmark. It uses the controllers of {base}.");
        sections.push(wrapped(&text, columns));
    }
    let width = columns.saturating_sub(INDENT);
    sections.extend([
        section("Picture", &picture(definition)),
        section("Scene", &scene(definition, width)),
        section("Formulas", &formulas(definition, preset, width)?),
        section("Initial box (bounds in task presets paper and code)", &initial_box(definition, width)),
        section("Signals", &table_in(&quantities(definition.signals), width)),
        section(
            "Signals of the manner (computed if a formula reads one of them)",
            &table_in(&quantities(MANNER), width),
        ),
        section(
            &format!("Observation ({} numbers, clipped to ±5)", definition.layout().observation_size()),
            &table_in(&numbered(&definition.whole_observation()), width),
        ),
        section(
            "Further parts of the observation (for controllers whose layout names them, in this order)",
            &table_in(&quantities(&definition.further_observation()), width),
        ),
        section("Actions (9 numbers in [-1, 1], at 60 Hz)", &actions(definition, width)),
    ]);
    for (title, reward) in [("Original reward", Reward::Original), ("Shaped reward", Reward::Shaped)] {
        sections
            .push(section(&format!("{title} (sum of)"), &table_in(&terms(definition.reward(reward)), width)));
    }
    let text = |title, text: &str| section(title, &wrapped(text, width));
    sections.push(text("A training episode ends early when", definition.termination));
    sections.push(text("Timing", &timing(definition)));
    if definition.start_noise > 0.0 {
        sections.push(text("Initial state noise", &start_noise(definition)));
    }
    sections.push(text("Scene: differences from the original", definition.differences));
    sections.extend(Topic::ALL.into_iter().filter_map(|topic| about(topic, notes, width)));
    sections.push(text("Controllers", &mishandle::shipped::shipped_controllers(definition).join(", ")));
    Ok(sections.join("\n\n"))
}

/// Returns the section with the notes on a topic; `None` without notes.
fn about(topic: Topic, notes: &[Note], width: usize) -> Option<String> {
    let lines: Vec<String> =
        notes.iter().filter(|note| note.topic == topic).map(|note| entry(note, width)).collect();
    (!lines.is_empty()).then(|| section(topic.title(), &lines.join("\n")))
}

fn entry(note: &Note, width: usize) -> String {
    let rows: Vec<Vec<String>> =
        note.cells.iter().map(|(name, text)| [*name, *text].map(String::from).to_vec()).collect();
    let scope = if note.is_shared { " (every task)" } else { "" };
    let cells = table_in(&rows, width.saturating_sub(INDENT));
    format!("{}{scope}\n  {}", note.subject, indented(&cells, INDENT))
}

fn section(title: &str, lines: &str) -> String {
    let indented: Vec<String> =
        lines.lines().map(|line| format!("  {line}").trim_end().to_string()).collect();
    format!("{title}\n{}", indented.join("\n"))
}

fn picture(definition: &Definition) -> String {
    let name = definition.name;
    let command = format!("mishandle render {name} --out {name}.png");
    match mishandle::shipped::picture_path(name) {
        Some(path) => format!("{}\n{command}", path.display()),
        None => command,
    }
}

fn scene(definition: &Definition, width: usize) -> String {
    let joints = JOINT_NAMES.iter().zip(definition.start).map(|(name, q)| format!("{name} {q}"));
    let start = format!("Initial joint positions (rad, m): {}.", joints.collect::<Vec<_>>().join(", "));
    format!(
        "{}\n{}\n{}",
        wrapped("The robot's base is the origin; x points forward, y to its left, z up.", width),
        wrapped(definition.scene_description, width),
        wrapped(&start, width)
    )
}

/// The formulas of a task: name, time at which they are evaluated, and meaning.
const ROLES: [(&str, EvaluationTime, &str); 5] = [
    ("success", EvaluationTime::Start, "the episode is successful"),
    ("strict", EvaluationTime::Start, "the episode is successful under a stricter formula than the paper's"),
    (
        "careful",
        EvaluationTime::Start,
        "the episode is strictly successful, in a manner that an operator of the robot would accept",
    ),
    (
        "safe",
        EvaluationTime::Any,
        "the control step is safe; the dangerous behavior rate is the fraction of unsafe steps",
    ),
    ("completion", EvaluationTime::Any, "the task is completed at the first control step where this holds"),
];

fn formulas(definition: &Definition, preset: Preset, width: usize) -> Result<String> {
    let texts = |preset| {
        let formulas = definition.formulas(preset);
        let named = formulas.named();
        ROLES.map(|(role, ..)| named.iter().find(|known| known.name == role).map(|found| found.text.clone()))
    };
    let [shown, other] = match preset {
        Preset::Paper => [Preset::Paper, Preset::Code],
        Preset::Code => [Preset::Code, Preset::Paper],
    };
    let mut lines = vec![format!(
        "Task preset {}. Bounds without a unit count control steps of 1/60 s. A satisfied formula has positive \
         robustness.",
        name(shown)
    )];
    for (((role, moment, meaning), text), other_text) in ROLES.into_iter().zip(texts(shown)).zip(texts(other))
    {
        let Some(text) = text else { continue };
        let formula = Formula::parse(&text)?;
        let unit = |signal: &str| {
            let mut known = definition.signals.iter().chain(MANNER);
            known.find(|known| known.name == signal).map_or("", |known| known.unit)
        };
        lines.push(format!("\n{role}: {meaning}"));
        lines.push(format!("  {text}"));
        lines.push(format!("  {}", formula.symbols()));
        lines.extend(
            formula.explain(&Clock::steps(CONTROL_DT), moment, unit)?.iter().map(|line| format!("  {line}")),
        );
        if let Some(other_text) = other_text.filter(|other| *other != text) {
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

/// Lists quantities with their indices in the vector.
fn numbered(list: &[Quantity]) -> Vec<Vec<String>> {
    let mut next = 0;
    let index_range = |size: usize| {
        let first = next;
        next += size;
        if size == 1 { first.to_string() } else { format!("{first}-{}", next - 1) }
    };
    let indices: Vec<String> = list.iter().map(|quantity| quantity.size).map(index_range).collect();
    indices.into_iter().zip(quantities(list)).map(|(indices, rest)| [vec![indices], rest].concat()).collect()
}

fn actions(definition: &Definition, width: usize) -> String {
    let fingers = match definition.grip {
        GripperMode::Fixed(opening) => format!("no effect: each finger is held at {opening} m"),
        GripperMode::Scene(rule) => rule.to_string(),
    };
    let arm = format!("change of the arm's joint targets per control step; 1 is {TARGET_STEP} rad");
    table_in(&[vec!["0-6".to_string(), arm], vec!["7-8".to_string(), fingers]], width)
}

fn timing(definition: &Definition) -> String {
    format!(
        "An episode has {EPISODE_STEPS} control steps of 1/60 s, {} s in total, with {} physics steps per control \
         step. The observation contains joint velocities multiplied by {}.",
        (EPISODE_STEPS as f64 * CONTROL_DT).round(),
        definition.n_substeps,
        definition.velocity_scale
    )
}

fn start_noise(definition: &Definition) -> String {
    format!(
        "Each arm joint starts with a random offset of up to {} rad, drawn from the simulation's random seed.",
        definition.start_noise
    )
}
