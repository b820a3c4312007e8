//! `mishandle bisect`: the first checkpoint or revision that fails.

#![allow(clippy::unwrap_used)]

mod bench;

use std::process::Command;

use bench::{Bench, SMALL};

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

const RATE: &str = "--target point-reaching --rate 0.9 --episodes 400";

#[test]
fn the_first_bad_checkpoint_is_found_by_a_rate_and_by_a_counterexample() {
    let bench = bench();
    checkpoints(&bench, 7);
    let found = bench.json(&format!("bisect steps {RATE} --json"), 0);
    assert_eq!(
        (&found["last_good"], &found["first_bad"]),
        (&"step-7.safetensors".into(), &"step-8.safetensors".into())
    );
    // Both ends, and at most ceil(log2 9) between them.
    assert!(found["tested"].as_array().unwrap().len() <= 6, "{found}");
    // A bad controller is decided long before the maximum.
    let last = found["tested"].as_array().unwrap().last().unwrap();
    assert!(last["simulations"].as_u64().unwrap() < 200, "{last}");
    assert!(last["success_rate"]["high"].as_f64().unwrap() < 0.9, "{last}");
    // A second time, nothing is simulated: a finished test has the same result.
    let text = bench.check(&format!("bisect steps {RATE}"), 0);
    assert!(text.contains("step-8.safetensors is the first that fails"), "{text}");
    let all = bench.json(&format!("bisect steps {RATE} --all --json"), 0);
    assert_eq!((&all["is_monotone"], &all["first_bad"]), (&true.into(), &found["first_bad"]));
    assert_eq!(all["tested"].as_array().unwrap().len(), 10);

    bench.check(
        "falsify point-reaching --controller bad.safetensors --trials 1 --budget 20 --out run.sqlite",
        1,
    );
    bench.check("counterexamples export run.sqlite --out failure.json", 0);
    let found = bench.json("bisect steps --counterexamples failure.json --json", 0);
    assert_eq!(found["first_bad"], "step-8.safetensors", "{found}");
}

#[test]
fn ends_that_do_not_bracket_and_wrong_arguments_are_reported() {
    let bench = bench();
    checkpoints(&bench, 10);
    let text = bench.check(&format!("bisect steps {RATE}"), 1);
    assert!(text.contains("nothing to bisect: the first candidate, step-1.safetensors, passes"), "{text}");
    bench.refuses("bisect missing --target point-reaching --rate 0.9", &["missing cannot be read"]);
    bench.refuses("bisect . --rate 0.9", &["--target"]);
    bench.refuses("bisect steps", &["--rate"]);
    bench.refuses("bisect steps --target nothing --rate 0.9", &["nothing"]);
    bench.refuses("bisect steps --target point-reaching --rate 1.5", &["1.5"]);
    std::fs::create_dir(bench.path("empty")).unwrap();
    bench.refuses("bisect empty --target point-reaching --rate 0.9", &["0 controllers", "at least 2"]);
}

#[test]
fn the_first_bad_revision_is_found_without_touching_the_working_tree() {
    let bench = bench();
    std::fs::create_dir(bench.path("repository")).unwrap();
    let git = |arguments: &[&str]| {
        let mut command = Command::new("git");
        command.arg("-C").arg(bench.path("repository"));
        command.args(["-c", "user.name=a", "-c", "user.email=a@example.org", "-c", "commit.gpgsign=false"]);
        let output = command.args(arguments).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        bench::text(&output.stdout).trim().to_string()
    };
    git(&["init", "-q"]);
    let mut revisions = Vec::new();
    for (index, name) in ["good", "good", "bad", "bad"].into_iter().enumerate() {
        std::fs::copy(
            bench.path(&format!("{name}.safetensors")),
            bench.path("repository/policy.safetensors"),
        )
        .unwrap();
        // A commit that does not change the controller is not a candidate.
        bench.write("repository/note.txt", &index.to_string());
        git(&["add", "-A"]);
        git(&["commit", "-q", "-m", name]);
        revisions.push(git(&["rev-parse", "HEAD"]));
    }
    bench.write("repository/policy.safetensors", "changed, not committed");
    let before = git(&["status", "--porcelain"]);
    let found = bench.json(&format!("bisect --git repository/policy.safetensors {RATE} --json"), 0);
    assert_eq!((found["candidates"].as_u64(), &found["first_bad"]), (Some(2), &revisions[2][..12].into()));
    assert_eq!(git(&["status", "--porcelain"]), before);
    assert_eq!(
        std::fs::read_to_string(bench.path("repository/policy.safetensors")).unwrap(),
        "changed, not committed"
    );
    bench.refuses(
        &format!("bisect --git repository/policy.safetensors --bad nothing {RATE}"),
        &["no revision nothing"],
    );
    bench.refuses(
        &format!("bisect --git repository/policy.safetensors --bad=--output=x {RATE}"),
        &["no revision --output=x"],
    );
}
