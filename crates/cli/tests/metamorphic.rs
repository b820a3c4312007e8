//! Relations between pairs of scenarios: plans, exit codes, and the rows of the pairs.

use crate::bench::Bench;
use serde_json::Value;

const SPHERE: &str = "target = 'toy/sphere-2d'\nseed = 7\nmetamorphic.pairs = 300\n";

/// Returns a campaign of 300 pairs in the plane with one relation.
fn sphere(holds: &str, change: &str) -> String {
    format!("{SPHERE}metamorphic.relations.r = {{ holds = '{holds}', change = {{ {change} }} }}\n")
}

/// Runs a plan of relations, whose run file is NAME.sqlite, and returns its result.
#[track_caller]
fn ask(bench: &Bench, campaign: &str, name: &str, flags: &str, code: i32) -> Value {
    bench.write("plan.toml", campaign);
    bench.json(&format!("run plan.toml --out {name}.sqlite {flags} --json"), code)
}

#[test]
fn a_broken_pair_is_two_rows_that_replay() {
    let bench = Bench::new();
    let campaign = sphere("same-verdict", "x = '+0.1', y = '+0.1'");
    let found = ask(&bench, &campaign, "c", "", 1);
    let run = "c.sqlite";
    let relation = &found["relations"][0];
    assert_eq!(relation["change"]["x"], "+0.1");
    let number = |key: &str| relation[key].as_u64().unwrap();
    assert_eq!(number("pairs") + number("out_of_bounds"), 300);
    let verdicts = &relation["verdicts"];
    let different = verdicts["worse"].as_u64().unwrap() + verdicts["better"].as_u64().unwrap();
    assert!(different > 0 && different == number("broken"));
    let worst = &relation["worst"][0];
    for case in [&worst["source"], &worst["follow_up"], &relation["smallest_change"]["follow_up"]] {
        let replay =
            format!("replay {run} --trial {} --simulation {} --json", case["trial"], case["simulation"]);
        let replayed = bench.json(&replay, 0);
        assert_eq!(replayed["robustness"], case["robustness"]);
        assert_eq!(replayed["scenario"], case["scenario"]);
        // The toy in closed form: 0.1 m away from a point.
        let at = |axis: &str| case["scenario"][axis].as_f64().unwrap();
        let rho = (at("x") - 0.3).hypot(at("y") + 0.4) - 0.1;
        assert!((rho - case["robustness"].as_f64().unwrap()).abs() < 1e-12);
    }
    let moved = |axis: &str| {
        let value = |case: &str| worst[case]["scenario"][axis].as_f64().unwrap();
        value("follow_up") - value("source")
    };
    assert!(["x", "y"].iter().all(|axis| (moved(axis) - 0.1).abs() < 1e-12));
    // The same bytes for another number of threads and another batch size, and when it is resumed.
    for (threads, batch) in [(1, 1), (2, 300)] {
        let campaign = format!("{campaign}metamorphic.batch = {batch}\n");
        let again = ask(&bench, &campaign, &format!("threads-{threads}"), &format!("--threads {threads}"), 1);
        assert_eq!(again["relations"], found["relations"]);
    }
    assert_eq!(bench.json("run --resume c.sqlite --json", 1), found);
    bench.refuses(
        &format!("evaluate --resume {run}"),
        &["a run of `metamorphic`, not of `evaluate`", "mishandle run --resume c.sqlite"],
    );
    let text = bench.check(&format!("report {run} --out run.html"), 0);
    let page = std::fs::read_to_string(bench.path("run.html")).unwrap();
    assert!(page.contains("Pairs that break r"), "{text}");
    // A follow-up case that fails is a counterexample as any other.
    let failing =
        relation["worst"].as_array().unwrap().iter().find(|pair| pair["follow_up"]["is_violated"] == true);
    let case = &failing.unwrap()["follow_up"];
    bench.check(
        &format!(
            "regress --add {run} -k regress.trial={} -k regress.simulation={} --out pair.json",
            case["trial"], case["simulation"]
        ),
        0,
    );
    assert!(bench.path("pair.json").exists());
}

#[test]
fn relations_of_a_plan_have_a_result_each() {
    let bench = Bench::new();
    let campaign = "target = 'toy/car-following'\nspace = 'dynamics+events'\n[metamorphic]\npairs = 60\n\
         [metamorphic.relations.identity]\nchange = { braking_scale = '*1' }\nholds = 'robustness-within:0'\n\
         [metamorphic.relations.no-braking]\nchange = { brake_deceleration = '=0' }\nholds = 'not-worse:0'\n\
         [metamorphic.relations.weak-brakes]\nchange = { braking_scale = '=0.25' }\nholds = 'same-verdict'\n";
    let found = ask(&bench, campaign, "c", "", 1);
    let relations = found["relations"].as_array().unwrap();
    let broken = |name: &str| {
        let relation = relations.iter().find(|relation| relation["name"] == name).unwrap();
        assert_eq!(relation["pairs"], 60);
        relation["broken"].as_u64().unwrap()
    };
    // A front car that does not brake cannot be hit, and brakes that fade let cars be hit.
    assert_eq!((broken("identity"), broken("no-braking")), (0, 0));
    assert!(broken("weak-brakes") > 0);
    let listed = bench.json("show c.sqlite c.sqlite --json", 0);
    assert_eq!(listed[0]["relations"], serde_json::json!({ "asked": 3, "broken": 1 }));
    let listed = bench.check("show c.sqlite c.sqlite", 0);
    assert!(listed.contains("broken 1 of 3 relations"), "{listed}");
    // The source cases are simulated once.
    let smallest =
        relations.iter().map(|relation| relation["smallest_change"]["simulations"].as_u64().unwrap_or(0));
    assert_eq!(found["simulations"].as_u64().unwrap(), 4 * 60 + smallest.sum::<u64>());
    // Source cases are the random scenarios of an evaluation with the same seed.
    bench
        .check("evaluate toy/car-following --space dynamics+events --episodes 60 --out evaluation.sqlite", 0);
    for simulation in [1, 60] {
        let replay = |run: &str| {
            let replayed = bench.json(&format!("replay {run} --trial 1 --simulation {simulation} --json"), 0);
            (replayed["scenario"].clone(), replayed["seed"].clone(), replayed["robustness"].clone())
        };
        assert_eq!(replay("c.sqlite"), replay("evaluation.sqlite"));
    }
}

#[test]
fn a_relation_that_holds_ends_with_0_and_nothing_tested_with_2() {
    let bench = Bench::new();
    bench.write("plan.toml", &sphere("robustness-within:0", "x = '+0'"));
    let said = bench.check("run plan.toml", 0);
    assert!(said.contains("no pair breaks a relation; that is evidence, not a proof"), "{said}");
    bench.write("plan.toml", &sphere("same-verdict", "x = '+0.1', y = '+0.1'"));
    let said = bench.check("run plan.toml", 1);
    assert!(
        said.contains("metamorphic, r: broken by ") && said.contains("of the change is enough"),
        "{said}"
    );
    for (campaign, parts) in [
        (SPHERE.to_string(), ["number of relations is 0", "[metamorphic.relations.NAME]"]),
        (
            sphere("same-verdict", ""),
            ["number of changed axes of a relation is 0 (r)", "such as change = { ball_x"],
        ),
        (sphere("same-verdict", "z = '+1'"), ["no axis `z`", "x, y"]),
        (sphere("same-verdict", "x = '+3'"), ["no follow-up case in 300 pairs", "x from -1 to 1"]),
        (sphere("same-verdict", "x = '+nan'"), ["+nan", "an offset such as +0.02"]),
        (sphere("worse", "x = '+0.1'"), ["the text `holds` of a relation is worse", "not-worse"]),
        (
            sphere("same-verdict", "x = 0.1"),
            ["`metamorphic.relations.r.change.x` is 0.1", "a text in quotes"],
        ),
        (format!("{SPHERE}metamorphic.relations.r.changes = {{}}\n"), ["line 4", "no key `changes`"]),
    ] {
        bench.write("plan.toml", &campaign);
        bench.refuses("run plan.toml", &parts);
    }
    // The first two campaigns alone wrote run files.
    assert_eq!(std::fs::read_dir(bench.path("runs")).unwrap().count(), 2);
}

#[test]
fn a_mirrored_cart_pole_does_the_same_unless_its_policy_pushes_to_one_side() {
    let bench = Bench::new();
    bench.write(
        "cartpole.xml",
        "<mujoco><option timestep='0.005'/><worldbody><body><joint name='slide' type='slide' axis='1 0 0'/>\
         <geom type='box' size='0.15 0.1 0.06' mass='1'/><body><joint name='hinge' axis='0 1 0'/>\
         <geom type='capsule' fromto='0 0 0 0 0 0.6' size='0.02' mass='0.1'/></body></body></worldbody>\
         <actuator><motor joint='slide' ctrlrange='-20 20' ctrllimited='true'/></actuator></mujoco>",
    );
    for (policy, code) in [("", 0), (" + 0.2", 1)] {
        let file = format!(
            "format = 1\nname = 'cartpole'\nmodel.file = 'cartpole.xml'\ncontrol = {{ period = 0.02, steps = 100 }}\n\
             start = {{ hinge = 'tilt' }}\nobservation = {{ angle = \"qpos('hinge')\", rate = \"qvel('hinge')\" }}\n\
             policy = {{ expression = '25 * angle + 4 * rate{policy}', action = 'action' }}\n\
             signals = {{ angle_size = {{ value = \"abs(qpos('hinge'))\", unit = 'rad' }} }}\n\
             axes = {{ tilt = {{ range = [-0.3, 0.3], unit = 'rad' }} }}\n\
             formulas = {{ upright = 'always(angle_size <= 0.5)' }}\n"
        );
        bench.write("cartpole.toml", &file);
        let campaign = "target = 'cartpole.toml'\nmetamorphic.pairs = 20\n\
                        metamorphic.relations.mirror = { change = { tilt = '*-1' }, holds = 'robustness-within:1e-9' }\n";
        let found = ask(&bench, campaign, &format!("c{code}"), "", code);
        assert_eq!(found["relations"][0]["broken_rate"]["n"], 20);
    }
}
