//! Relations between pairs of scenarios: flags, plans, exit codes, and the rows of the pairs.

use crate::bench::Bench;

const SPHERE: &str = "metamorphic toy/sphere-2d --seed 7 --pairs 300";

#[test]
fn a_broken_pair_is_two_rows_that_replay() {
    let bench = Bench::new();
    let command = format!("{SPHERE} --change x=+0.1 --change y=+0.1");
    let found = bench.json(&format!("{command} --out run.sqlite --json"), 1);
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
            format!("replay run.sqlite --trial {} --simulation {} --json", case["trial"], case["simulation"]);
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
    for flags in ["--threads 1 --batch 1", "--threads 2 --batch 300"] {
        let again = bench.json(&format!("{command} {flags} --out again.sqlite --json"), 1);
        assert_eq!(again["relations"], found["relations"]);
        std::fs::remove_file(bench.path("again.sqlite")).unwrap();
    }
    assert_eq!(bench.json("metamorphic --resume run.sqlite --json", 1), found);
    let text = bench.check("report run.sqlite --out run.html", 0);
    let page = std::fs::read_to_string(bench.path("run.html")).unwrap();
    assert!(page.contains("Pairs that break change"), "{text}");
    // A follow-up case that fails is a counterexample as any other.
    let failing =
        relation["worst"].as_array().unwrap().iter().find(|pair| pair["follow_up"]["is_violated"] == true);
    let case = &failing.unwrap()["follow_up"];
    bench.check(
        &format!(
            "counterexamples export run.sqlite --trial {} --simulation {} --out pair.json",
            case["trial"], case["simulation"]
        ),
        0,
    );
    assert!(bench.path("pair.json").exists());
}

#[test]
fn relations_of_a_plan_have_a_result_each() {
    let bench = Bench::new();
    bench.write(
        "plan.toml",
        "target = 'toy/car-following'\nspace = 'dynamics+events'\n[metamorphic]\npairs = 60\n\
         [metamorphic.relations.identity]\nchange = { braking_scale = '*1' }\nholds = 'robustness-within:0'\n\
         [metamorphic.relations.no-braking]\nchange = { brake_deceleration = '=0' }\nholds = 'not-worse:0'\n\
         [metamorphic.relations.weak-brakes]\nchange = { braking_scale = '=0.25' }\nholds = 'same-verdict'\n",
    );
    let found = bench.json("metamorphic --plan plan.toml --json --out run.sqlite", 1);
    let relations = found["relations"].as_array().unwrap();
    let broken = |name: &str| {
        let relation = relations.iter().find(|relation| relation["name"] == name).unwrap();
        assert_eq!(relation["pairs"], 60);
        relation["broken"].as_u64().unwrap()
    };
    // A front car that does not brake cannot be hit, and brakes that fade let cars be hit.
    assert_eq!((broken("identity"), broken("no-braking")), (0, 0));
    assert!(broken("weak-brakes") > 0);
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
        assert_eq!(replay("run.sqlite"), replay("evaluation.sqlite"));
    }
}

#[test]
fn a_relation_that_holds_ends_with_0_and_nothing_tested_with_2() {
    let bench = Bench::new();
    let said = bench.check(&format!("{SPHERE} --change x=+0 --holds robustness-within:0"), 0);
    assert!(said.contains("no pair breaks a relation; that is evidence, not a proof"), "{said}");
    bench.refuses(SPHERE, &["there is no relation", "--change NAME=CHANGE"]);
    bench.refuses(&format!("{SPHERE} --change z=+1"), &["no axis `z`", "x, y"]);
    bench.refuses(&format!("{SPHERE} --change x=+3"), &["no follow-up case in 300 pairs", "x from -1 to 1"]);
    bench.refuses(&format!("{SPHERE} --change x=+nan"), &["+nan", "an offset such as +0.02"]);
    bench.refuses(&format!("{SPHERE} --change x=+0.1 --holds worse"), &["worse", "not-worse"]);
    bench.refuses(&format!("{SPHERE} --change x=+0.1 --change x=+0.2"), &["the axis x has two changes"]);
    bench.write("plan.toml", "[metamorphic.relations.r]\nchanges = { x = '+1' }\n");
    bench.refuses(&format!("{SPHERE} --plan plan.toml"), &["line 2", "no key `changes`", "change, holds"]);
    // The first command alone wrote a run file.
    assert_eq!(std::fs::read_dir(bench.path("runs")).unwrap().count(), 1);
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
        let command =
            "metamorphic cartpole.toml --change tilt=*-1 --holds robustness-within:1e-9 --pairs 20 --json";
        let found = bench.json(command, code);
        assert_eq!(found["relations"][0]["broken_rate"]["n"], 20);
    }
}
