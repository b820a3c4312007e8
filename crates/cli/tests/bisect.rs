//! `mishandle regress --first-bad`: the first checkpoint that fails.

use crate::bench;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;

use crate::bench::{Bench, SMALL};

/// Makes `good.safetensors`, which is shipped, and `bad.safetensors`, which hardly trained.
fn bench() -> Bench {
    let bench = Bench::new();
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/../../controllers/point-reaching/ppo.safetensors");
    std::fs::copy(shipped, bench.path("good.safetensors")).unwrap();
    bench.write("small.toml", SMALL);
    bench.check("train point-reaching --algorithm ppo --settings small.toml --out bad.safetensors", 0);
    bench
}

/// Writes ten checkpoints of which the first `good` are good.
fn checkpoints(bench: &Bench, good: u32) {
    std::fs::create_dir_all(bench.path("steps")).unwrap();
    for step in 1..=10 {
        let source = bench.path(if step <= good { "good.safetensors" } else { "bad.safetensors" });
        std::fs::copy(source, bench.path(&format!("steps/step-{step}.safetensors"))).unwrap();
    }
}

const RATE: &str = "--rate 0.9 -k target=point-reaching -k evaluate.episodes=400";

#[test]
fn the_first_bad_checkpoint_is_found_by_a_rate_and_by_a_counterexample() {
    let bench = bench();
    checkpoints(&bench, 7);
    let found = bench.json(&format!("regress --first-bad steps {RATE} --json"), 0);
    assert_eq!(
        (&found["last_good"], &found["first_bad"]),
        (&"step-7.safetensors".into(), &"step-8.safetensors".into())
    );
    // Both ends, and at most ceil(log2 9) between them.
    assert!(found["tested"].as_array().unwrap().len() <= 6, "{found}");
    // A bad controller is decided long before the maximum.
    let last = found["tested"].as_array().unwrap().last().unwrap();
    assert!(bench.path(last["run"].as_str().unwrap()).exists(), "{last}");
    assert!(last["simulations"].as_u64().unwrap() < 200, "{last}");
    assert!(last["success_rate"]["high"].as_f64().unwrap() < 0.9, "{last}");
    // A second time, nothing is simulated: a finished test has the same result.
    let text = bench.check(&format!("regress --first-bad steps {RATE}"), 0);
    assert!(text.contains("step-8.safetensors is the first that fails"), "{text}");
    assert_eq!(bench.json(&format!("regress --first-bad steps {RATE} --json"), 0), found);
    bench.check("report runs/bisect -k report.simulations=false --out rate.html", 0);
    let page = std::fs::read_to_string(bench.path("rate.html")).unwrap();
    // All candidates, the comparison of the two neighbors, and their runs.
    for part in
        ["step-1.safetensors: passes", ": not tested", "Paired differences", "id=\"r2\"", "--rate 0.9"]
    {
        assert!(page.contains(part), "{part}: {page}");
    }
    let all = bench.json(&format!("regress --first-bad steps {RATE} -k regress.every=true --json"), 0);
    assert_eq!((&all["is_monotone"], &all["first_bad"]), (&true.into(), &found["first_bad"]));
    assert_eq!(all["tested"].as_array().unwrap().len(), 10);

    bench.check(
        "falsify point-reaching --controller bad.safetensors --trials 1 --budget 20 --out run.sqlite",
        1,
    );
    bench.check("regress --add run.sqlite --out failure.json", 0);
    let found = bench.json("regress failure.json --first-bad steps --json", 0);
    assert_eq!(found["first_bad"], "step-8.safetensors", "{found}");
    assert_eq!(found["tested"].as_array().unwrap().last().unwrap()["violated"][0], "failure.json", "{found}");
    bench.check("report runs/bisect --out counterexample.html", 0);
    let page = std::fs::read_to_string(bench.path("counterexample.html")).unwrap();
    for part in ["<b>First failing</b>: fails", "mishandle regress", "regress failure.json --first-bad steps"]
    {
        assert!(page.contains(part), "{part}: {page}");
    }
}

/// A pole that falls, or that its motor pushes: it fails as soon as the signal is not tiny.
fn pole(scale: &str) -> String {
    format!(
        r#"
        format = 1
        name = "pole"
        model.file = "pole.xml"
        control = {{ period = 0.02, steps = 20 }}
        start = {{ hinge = "tilt" }}
        axes.tilt = {{ range = [0.05, 0.1], unit = "rad" }}
        observation.state = "[*qpos('hinge'), *qvel('hinge')]"
        policy = {{ action = "action", limit = 1 }}
        signals.speed = "{scale} * abs(qvel('hinge')[0])"
        rewards.still = "1 - speed"
        formulas.still = "always(speed <= 0.02)"
    "#
    )
}

const MODEL: &str = r#"<mujoco><worldbody><body><joint name="hinge" axis="0 1 0" damping="0"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.6" size="0.02"/></body></worldbody>
    <actuator><motor joint="hinge"/></actuator></mujoco>"#;

#[test]
fn a_test_is_repeated_when_a_file_of_its_target_has_changed() {
    let bench = Bench::new();
    bench.write("pole.xml", MODEL);
    bench.write("pole.toml", &pole("1"));
    bench.write("s.toml", "rollout_steps = 8\nminibatch_size = 8\nepisodes.environments = 4\n");
    std::fs::create_dir(bench.path("steps")).unwrap();
    bench.check("train pole.toml --settings s.toml --steps 64 --out steps/1.safetensors", 0);
    std::fs::copy(bench.path("steps/1.safetensors"), bench.path("steps/2.safetensors")).unwrap();
    let falsify = "falsify pole.toml --controller steps/1.safetensors --trials 1 --budget 5 --out run.sqlite";
    bench.check(falsify, 1);
    bench.check("regress --add run.sqlite --out suite/failure.json", 0);
    let result = |question: &str| {
        let found = bench.json(&format!("regress --first-bad steps {question} --json"), 1);
        found["tested"][0]["result"].as_str().unwrap().to_string()
    };
    // The folder of a counterexample has the files of its target.
    for (question, folder) in
        [("suite", "suite/"), ("--rate 0.5 -k target=pole.toml -k evaluate.episodes=50", "")]
    {
        assert_eq!([result(question), result(question)], ["fails", "fails"]);
        bench.write(&format!("{folder}pole.toml"), &pole("0.0001"));
        assert_eq!(result(question), "passes", "{question}");
        bench.write(&format!("{folder}pole.toml"), &pole("1"));
        bench.write(&format!("{folder}pole.xml"), &MODEL.replace("damping=\"0\"", "damping=\"1e6\""));
        assert_eq!(result(question), "passes", "{question}");
        bench.write(&format!("{folder}pole.xml"), MODEL);
        assert_eq!(result(question), "fails", "{question}");
    }
}

#[test]
fn an_undecided_candidate_has_its_reason_each_time() {
    let bench = bench();
    checkpoints(&bench, 2);
    bench.write("steps/step-2.safetensors", "not a controller");
    for step in 4..=9 {
        std::fs::remove_file(bench.path(&format!("steps/step-{step}.safetensors"))).unwrap();
    }
    bench.check(
        "falsify point-reaching --controller bad.safetensors --trials 1 --budget 20 --out r.sqlite",
        1,
    );
    bench.check("regress --add r.sqlite --out failure.json", 0);
    for question in [
        RATE,
        "failure.json",
        // Five simulations do not decide.
        "--rate 0.9 -k target=point-reaching -k evaluate.episodes=5",
    ] {
        let ask = format!("regress --first-bad steps {question} -k regress.every=true --json");
        // An undecided candidate before the first failing one may fail, too.
        let found = bench.json(&ask, 1);
        assert_eq!(found["found"], false);
        assert_eq!(bench.json(&ask, 1), found);
        let undecided = |candidate: &&serde_json::Value| candidate["result"] == "undecided";
        let tested = found["tested"].as_array().unwrap();
        for candidate in tested.iter().filter(undecided) {
            assert!(candidate["reason"].as_str().is_some_and(|reason| !reason.is_empty()), "{candidate}");
        }
        assert!(tested.iter().any(|candidate| undecided(&candidate)), "{found}");
    }
}

#[test]
fn the_folder_of_something_else_stays_as_it_is() {
    let bench = bench();
    checkpoints(&bench, 1);
    for (folder, file) in [("mine", "notes.txt"), ("failures", "a.json")] {
        std::fs::create_dir(bench.path(folder)).unwrap();
        bench.write(&format!("{folder}/{file}"), "keep");
    }
    let said = "notes.txt` and is not the folder of a bisection";
    bench.refuses(&format!("regress --first-bad steps {RATE} --out mine"), &[said]);
    bench.refuses(
        "regress failures --first-bad steps --out failures",
        &["a.json` and is not the folder of a bisection"],
    );
    assert_eq!(std::fs::read_dir(bench.path("mine")).unwrap().count(), 1);
}

#[test]
fn ends_that_do_not_bracket_and_wrong_arguments_are_reported() {
    let bench = bench();
    checkpoints(&bench, 10);
    let text = bench.check(&format!("regress --first-bad steps {RATE}"), 1);
    let said = "nothing to bisect: the last candidate, step-10.safetensors, passes instead of failing";
    assert!(text.contains(said), "{text}");
    bench.refuses(
        "regress --first-bad missing --rate 0.9 -k target=point-reaching",
        &["missing cannot be read"],
    );
    bench.refuses("regress --first-bad . --rate 0.9", &["-k target=TARGET"]);
    bench.refuses("regress --first-bad steps", &["regressions cannot be read"]);
    bench.refuses("regress --rate 0.9 -k target=point-reaching", &["--first-bad <DIR>"]);
    bench.refuses("regress --first-bad good.safetensors --rate 0.9 -k target=point-reaching", &["is a file"]);
    bench.refuses("regress a --first-bad steps -k evaluate.episodes=5", &["evaluate.episodes", "--rate"]);
    bench.refuses(
        "regress a --first-bad steps --rate 0.9 -k target=point-reaching",
        &["leave out --rate or the folder"],
    );
    bench.refuses("regress --first-bad steps --rate 0.9 -k target=nothing", &["nothing"]);
    bench.refuses("regress --first-bad steps --rate 1.5 -k target=point-reaching", &["1.5"]);
    std::fs::create_dir(bench.path("empty")).unwrap();
    bench.refuses(
        "regress --first-bad empty --rate 0.9 -k target=point-reaching",
        &["0 controllers", "at least 2"],
    );
}

#[test]
fn the_script_of_the_guide_finds_the_first_bad_commit() {
    let bench = bench();
    bench.check(
        "falsify point-reaching --controller bad.safetensors --trials 1 --budget 20 --out run.sqlite",
        1,
    );
    bench.check("regress --add run.sqlite --out failures/failure.json", 0);
    let guide = include_str!("../../../docs/guide/compare.md");
    let (_, script) = guide.split_once("```sh\n#!/bin/sh\n").unwrap();
    bench.write("test.sh", script.split_once("```").unwrap().0);
    std::fs::create_dir_all(bench.path("bin")).unwrap();
    std::fs::create_dir(bench.path("repository")).unwrap();
    let git = |program: &Path, arguments: &[&str]| {
        let _ = std::fs::remove_file(bench.path("bin/mishandle"));
        std::os::unix::fs::symlink(program, bench.path("bin/mishandle")).unwrap();
        let path = format!("{}:{}", bench.path("bin").display(), std::env::var("PATH").unwrap());
        let mut command = Command::new("git");
        command.arg("-C").arg(bench.path("repository")).env("PATH", path);
        command.args(["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]);
        let output = command.args(arguments).output().unwrap();
        (output.status.success(), bench::text(&output.stdout) + &bench::text(&output.stderr))
    };
    let program = Path::new(env!("CARGO_BIN_EXE_mishandle"));
    let run = |arguments: &[&str]| {
        let (is_success, said) = git(program, arguments);
        assert!(is_success, "{said}");
        said
    };
    run(&["init", "-q"]);
    bench.write("broken.safetensors", "not a controller");
    for (index, name) in ["good", "broken", "good", "bad", "bad"].into_iter().enumerate() {
        let controller = bench.path("repository/policy.safetensors");
        std::fs::copy(bench.path(&format!("{name}.safetensors")), controller).unwrap();
        bench.write("repository/note.txt", &index.to_string());
        run(&["add", "-A"]);
        run(&["commit", "-q", "-m", &format!("{index} is {name}")]);
    }
    run(&["bisect", "start", "HEAD", "HEAD~4"]);
    let said = run(&["bisect", "run", "sh", "../test.sh"]);
    assert!(said.contains("is the first bad commit") && said.contains("3 is bad"), "{said}");
    // A commit that cannot be tested is skipped, and Ctrl-C ends the search.
    for (code, part) in [(2, "only 'skip'ped commits"), (130, "exit code 130")] {
        bench.write("stub", &format!("#!/bin/sh\nexit {code}\n"));
        let stub = bench.path("stub");
        std::fs::set_permissions(&stub, std::fs::Permissions::from_mode(0o755)).unwrap();
        run(&["bisect", "reset"]);
        run(&["bisect", "start", "HEAD", "HEAD~4"]);
        let (is_success, said) = git(&stub, &["bisect", "run", "sh", "../test.sh"]);
        assert!(!is_success && said.contains(part), "{said}");
    }
}
