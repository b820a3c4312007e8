//! `mishandle report`: the page about runs.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::{Bench, text};

fn page(bench: &Bench, name: &str) -> String {
    std::fs::read_to_string(bench.path(name)).unwrap()
}

#[test]
fn a_page_has_the_verdict_the_modes_and_their_patches() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --trials 12 --budget 60 --seed 1 --out run.sqlite", 1);
    bench.check("report run.sqlite --out a.html", 0);
    let html = page(&bench, "a.html");
    for part in [
        "<h2>toy/sphere-2d violates its requirement in 6 of 12 trials.",
        "median of 57 simulations",
        "Mode 1: <code>distance &gt;= 0.1</code>",
        "95 % interval",
        "Corners",
        "mishandle replay run.sqlite --trial 10 --simulation 47",
    ] {
        assert!(html.contains(part), "{part} is not in the page");
    }
    bench.refuses("report run.sqlite --out a.html", &["a.html exists already", "--force"]);
    bench.check("report run.sqlite --out a.html --force --threads 1", 0);
    assert_eq!(page(&bench, "a.html"), html, "the same run has the same page");
    bench.check("report run.sqlite --out b.html --no-simulations", 0);
    let html = page(&bench, "b.html");
    assert!(html.contains("--no-simulations was given") && !html.contains("of the space</b>"));
}

#[test]
fn several_runs_share_a_page() {
    let bench = Bench::new();
    bench.check("falsify toy/car-following --space events+dynamics --trials 2 --seed 1 --out a.sqlite", 1);
    bench.check("evaluate toy/sphere-2d --episodes 20 --out b.sqlite", 0);
    let output = bench.run("report a.sqlite b.sqlite --out page.html");
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("wrote page.html"), "{}", text(&output.stderr));
    let html = page(&bench, "page.html");
    for part in [
        "<h2>Overview</h2>",
        "href=\"#r2\"",
        "id=\"r2\"",
        "<h2>toy/car-following violates",
        "random scenarios",
    ] {
        assert!(html.contains(part), "{part} is not in the page");
    }
    bench.refuses(
        "report a.sqlite missing.sqlite --out other.html",
        &["error: cannot open a run: the file does not exist: "],
    );
    assert!(!bench.path("other.html").exists());
}

/// The page leaves out simulations, but not in its numbers.
#[test]
fn a_large_evaluation_counts_all_simulations_and_corners() {
    let bench = Bench::new();
    let seed = "evaluate toy/car-following --space starts+events --episodes 5000 --seed 2";
    bench.check(&format!("{seed} --out run.sqlite"), 0);
    bench.check("report run.sqlite --no-simulations --out page.html", 0);
    let html = page(&bench, "page.html");
    assert!(html.contains("Distribution of the robustness of 5000 simulations"));
    assert!(html.contains("of the 4 corners of the initial box"));
    assert!(html.len() < 4_000_000, "{} bytes", html.len());
}
