//! Axes that are random draws of the start.

use std::path::Path;

use mishandle_robots::{RobotFile, RobotPolicy};
use mishandle_rollout::{
    AxisKind, Component, Distribution, Episode, Noise, Request, Scenario, Seed, Specification, Stream, Target,
};
use mishandle_stl::Formula;

const MODEL: &str = r#"<mujoco><worldbody><body name="link">
  <joint name="hip" axis="0 1 0"/><joint name="knee" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0.5 0 0" size="0.03" mass="1"/></body></worldbody>
  <actuator><motor name="motor" joint="hip"/></actuator></mujoco>"#;

const FILE: &str = r#"
format = 1
name = "leg"
model.file = "leg.xml"
control = { period = 0.01, steps = 3 }
start = { hip = "0.5 + base + offset", knee = "1 + tremble" }
observation.angles = "qpos('.*')"
policy = { expression = "-angles[0]", action = "action" }
signals = { hip = "qpos('hip')[0]", knee = "qpos('knee')[0]" }
formulas.stays = "always(hip <= 9)"

[axes]
base = { range = [-0.1, 0.1], unit = "rad" }
offset = { kind = "noise", range = [-0.02, 0.04], unit = "rad", meaning = "offset of the hip" }
tremble = { kind = "noise", std = 0.01, unit = "rad" }
"#;

fn read(folder: &Path, file: &str) -> Result<RobotFile, String> {
    std::fs::write(folder.join("leg.xml"), MODEL).unwrap();
    std::fs::write(folder.join("leg.toml"), file).unwrap();
    RobotFile::read(&folder.join("leg.toml")).map_err(|error| error.to_string())
}

fn target(file: &str) -> Target {
    let folder = tempfile::tempdir().unwrap();
    let robot = read(folder.path(), file).unwrap();
    let RobotPolicy::Expression(policy) = robot.policy() else { panic!("the policy is an expression") };
    let component =
        Component { role: "controller".into(), name: "e".into(), hash: "h".into(), file_hash: String::new() };
    robot.target(policy.clone(), vec![component], Noise::default()).unwrap()
}

fn simulate(target: &Target, space: &str, starts: &[(Vec<Option<f64>>, u64)]) -> Vec<Episode> {
    let space = target.space(space).unwrap();
    let requirement = Formula::parse(&target.formulas[0].text).unwrap();
    let specification = Specification::from_formulas(&target.formulas, requirement).unwrap();
    let requests: Vec<Request> = starts
        .iter()
        .map(|(values, seed)| Request::new(Scenario::new(values.clone()), Seed(*seed)))
        .collect();
    target.system(&space, &specification).unwrap().rollout(&requests).unwrap()
}

/// Draws of a seed: the uniform one in rad, the normal one in units of its standard deviation.
fn draws(seed: u64) -> [f64; 2] {
    let mut normal = [0.0];
    Seed(seed).normals(Stream::Reset, 2, &mut normal);
    let share = Seed(seed).uniform(Stream::Reset, 0, 0);
    [-0.02 * (1.0 - share) + 0.04 * share, normal[0]]
}

#[test]
fn a_draw_without_a_value_is_that_of_its_seed_and_a_value_replaces_it() {
    let target = target(FILE);
    assert!(target.depends_on_seed && target.is_deterministic);
    for seed in 0..50 {
        let [offset, tremble] = draws(seed);
        let drawn = vec![
            (vec![Some(0.05), None, None], seed),
            (vec![Some(0.05), Some(offset), Some(tremble)], seed + 1000),
            (vec![Some(0.05), Some(offset), None], seed),
        ];
        let found = simulate(&target, "scenarios+noise", &drawn);
        let start = [0.5 + 0.05 + offset, 1.0 + 0.01 * tremble];
        assert_eq!([0, 1].map(|column| found[0].trace.column(column)[0]), start);
        assert_eq!(found[0].trace, found[1].trace, "an explicit draw is the draw");
        assert_eq!(found[0].trace, found[2].trace);
        let implicit = simulate(&target, "scenarios", &[(vec![Some(0.05)], seed)]);
        assert_eq!(found[0].trace, implicit[0].trace);
    }
}

#[test]
fn draws_have_a_space_of_their_own_and_are_in_no_other_one() {
    let target = target(FILE);
    let names = |space: &str| -> Vec<String> {
        target.space(space).unwrap().axes().iter().map(|axis| axis.name.clone()).collect()
    };
    assert_eq!((names("scenarios"), names("starts")), (vec!["base".to_string()], vec!["base".to_string()]));
    assert_eq!(names("noise"), ["offset", "tremble"]);
    let noise = target.space("noise").unwrap();
    let [offset, tremble] = noise.axes() else { panic!("two axes") };
    assert_eq!(
        (offset.kind, offset.nominal, offset.distribution),
        (AxisKind::Noise, None, Distribution::Uniform)
    );
    assert_eq!((offset.low, offset.high, offset.unit.as_str()), (-0.02, 0.04, "rad"));
    assert_eq!((tremble.low, tremble.high, tremble.distribution), (-4.0, 4.0, Distribution::Normal));
    assert_eq!(tremble.meaning, "random draw, in units of its standard deviation, 0.01 rad");
    let plain = FILE.replace("+ offset", "").replace("+ tremble", "");
    let plain = plain.lines().filter(|line| !line.contains("\"noise\"")).collect::<Vec<_>>().join("\n");
    assert!(!self::target(&plain).depends_on_seed);
}

#[test]
fn draws_of_many_seeds_have_their_distribution() {
    let target = target(FILE);
    let starts: Vec<_> = (0..2000).map(|seed| (vec![Some(0.0)], seed)).collect();
    let found = simulate(&target, "scenarios", &starts);
    let column = |index: usize, around: f64| -> Vec<f64> {
        found.iter().map(|episode| episode.trace.column(index)[0] - around).collect()
    };
    let moments = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / 2000.0;
        (mean, (values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / 2000.0).sqrt())
    };
    let offsets = column(0, 0.5);
    assert!(offsets.iter().all(|offset| (-0.0201..=0.0401).contains(offset)));
    let (mean, std) = moments(&offsets);
    // Five standard errors of mean and standard deviation.
    assert!((mean - 0.01).abs() < 0.002 && (std - 0.06 / 12.0_f64.sqrt()).abs() < 0.001, "{mean} {std}");
    let (mean, std) = moments(&column(1, 1.0));
    assert!(mean.abs() < 0.0012 && (std - 0.01).abs() < 0.0008, "{mean} {std}");
}

#[test]
fn a_training_episode_draws_from_its_seed_as_an_evaluated_one() {
    use mishandle_rollout::{Environment, Sample};
    let file = FILE.replace("action = \"action\" }", "action = \"action\", limit = 1 }")
        + "\n[rewards]\nr = \"1\"\n";
    let folder = tempfile::tempdir().unwrap();
    let training = read(folder.path(), &file).unwrap().training().unwrap();
    let environment = training.environment;
    assert_eq!(environment.space().axes().len(), 1);
    let mut state = vec![0.0; environment.state_size()];
    let mut observation = vec![0.0; 2];
    let mut signals = [0.0; 2];
    let mut rewards = [0.0];
    for seed in 0..5 {
        let sample = Sample { observation: &mut observation, signals: &mut signals, rewards: &mut rewards };
        environment.worker().reset(&Scenario::from([0.0]), Seed(seed), &mut state, sample);
        let [offset, tremble] = draws(seed);
        assert_eq!(signals, [0.5 + 0.0 + offset, 1.0 + 0.01 * tremble]);
    }
}

#[test]
fn mistakes_in_draws_name_their_line() {
    let folder = tempfile::tempdir().unwrap();
    for (from, to, line, part) in [
        ("std = 0.01", "std = 0", 15, "`std` above 0"),
        ("std = 0.01, ", "", 15, "needs `range`, of a uniform draw, or `std`"),
        ("std = 0.01", "std = 0.01, range = [0, 1]", 15, "needs `range`, of a uniform draw, or `std`"),
        ("std = 0.01", "std = 0.01, nominal = 0", 15, "a random draw has no nominal value"),
        ("std = 0.01", "std = 0.01, integer = true", 15, "neither whole nor logarithmic"),
        ("1 + tremble", "1 + trembl", 6, "did you mean `tremble`?"),
        ("\"-angles[0]\"", "\"-angles[0] + offset\"", 8, "a policy does not know the axis `offset`"),
    ] {
        assert!(FILE.contains(from), "{from}");
        let error =
            read(folder.path(), &FILE.replace(from, to)).err().unwrap_or_else(|| panic!("{to} is accepted"));
        assert!(error.contains(part) && error.contains(&format!("leg.toml, line {line}:")), "{to}: {error}");
    }
}
