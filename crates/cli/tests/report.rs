//! `mishandle report`: the page about runs.

use crate::bench::{Bench, text};

fn page(bench: &Bench, name: &str) -> String {
    std::fs::read_to_string(bench.path(name)).unwrap()
}

#[test]
fn a_page_has_the_verdict_the_modes_and_their_patches() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --search random --trials 12 --budget 60 --seed 1 --out run.sqlite", 1);
    bench.check("report run.sqlite --out a.html", 0);
    let html = page(&bench, "a.html");
    for part in [
        "<h2>toy/sphere-2d fails at 0.00 s with ",
        "<p>toy/sphere-2d violates its requirement in 6 of 12 trials.",
        "median of 57 simulations",
        "<h4>1: with ",
        "<code>distance &gt;= 0.1</code> is violated",
        "95 % interval",
        "Corners",
        "mishandle replay run.sqlite --trial ",
    ] {
        assert!(html.contains(part), "{part} is not in the page");
    }
    bench.refuses("report run.sqlite --out a.html", &["a.html exists already", "--force"]);
    bench.check("report run.sqlite --out a.html --force --threads 1", 0);
    assert_eq!(page(&bench, "a.html"), html, "the same run has the same page");
    bench.check("report run.sqlite --out b.html -k report.simulations=false", 0);
    let html = page(&bench, "b.html");
    assert!(
        html.contains("not requested (report.simulations = false)") && !html.contains("of the space</b>")
    );
}

#[test]
fn several_runs_share_a_page() {
    let bench = Bench::new();
    bench.check("falsify toy/car-following --space events+dynamics --trials 2 --seed 1 --out a.sqlite", 1);
    bench.check("evaluate toy/sphere-2d --episodes 20 --out b.sqlite", 0);
    let output = bench.run("report a.sqlite b.sqlite --out page.html");
    assert!(output.status.success(), "{}", text(&output.stderr));
    for said in ["page of a.sqlite: at most ", " simulations\n", "wrote page.html"] {
        assert!(text(&output.stderr).contains(said), "{said}: {}", text(&output.stderr));
    }
    assert!(!bench.path("a.sqlite.report").exists(), "what took a moment is not kept");
    let html = page(&bench, "page.html");
    for part in [
        "<h2>Overview</h2>",
        "href=\"#r2\"",
        "id=\"r2\"",
        "<h2>toy/car-following fails at ",
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

#[test]
fn a_campaign_has_an_index_and_a_page_for_each_run() {
    let bench = Bench::new();
    let plan = "target = \"toy/sphere-2d\"\nseed = [1, 2]\n[falsify]\nsearch = \"random\"\ntrials = 6\nbudget = 40\n[evaluate]\nepisodes = 30\n";
    std::fs::write(bench.path("plan.toml"), plan).unwrap();
    bench.check("run plan.toml --out spheres", 1);
    bench.check("report spheres --out first -k report.simulations=false", 0);
    bench.check("report spheres --out second -k report.probes=8", 0);
    let falsified = |seed: u32| {
        let run =
            mishandle::store::RunFile::open(bench.path(&format!("spheres/{seed}_falsify.sqlite"))).unwrap();
        let is_falsified = |status| status == mishandle::store::TrialStatus::Falsified;
        run.trials().unwrap().iter().filter(|trial| is_falsified(trial.trial.status)).count()
    };
    let counts = [falsified(1), falsified(2)];
    assert!(counts[0] != counts[1], "the order of the runs must be visible: {counts:?}");
    for pages in ["first", "second"] {
        let index = page(&bench, &format!("{pages}/index.html"));
        // The matrix above the table has the links, too.
        let index = index.split("Runs, the most failures first").last().unwrap();
        let place = |seed: usize| {
            let row = format!("href=\"runs/{seed}_falsify.html\"");
            let start = index.find(&row).unwrap();
            let count = format!("{} of 6 trials falsified", counts[seed - 1]);
            assert!(index[start..].split("</tr>").next().unwrap().contains(&count), "{count}");
            start
        };
        assert_eq!(place(1) < place(2), counts[0] > counts[1], "the most failures come first");
        assert!(page(&bench, &format!("{pages}/index.html")).contains("href=\"statistics.html\""));
        for name in ["statistics.html", "statistics.md", "runs/2_evaluate.html"] {
            assert!(bench.path(&format!("{pages}/{name}")).is_file(), "{pages}/{name}");
        }
        // One survival curve for each seed ends at the share of trials without a failure.
        let tables = page(&bench, &format!("{pages}/statistics.html"));
        assert_eq!(tables.matches("<svg class=\"chart\"").count(), 2);
        for falsified in counts {
            let share = (100.0 * (6 - falsified) as f64 / 6.0).round();
            let label = format!("aria-label=\"Share of trials without a failure: random: {share} % after");
            assert!(tables.contains(&label), "{label}");
        }
        let markdown = page(&bench, &format!("{pages}/statistics.md"));
        assert!(!markdown.contains("Survival"));
        for (seed, falsified) in (1..).zip(counts) {
            let row = format!(", seed {seed} | - | `random` | {falsified} of 6 |");
            assert!(markdown.contains(&row), "{row}:\n{markdown}");
        }
        let run = page(&bench, &format!("{pages}/runs/1_falsify.html"));
        assert!(run.contains("href=\"../index.html\"") && run.contains("toy/sphere-2d"));
        assert_eq!(run.contains("they were not requested"), pages == "first");
    }
    bench.refuses("report spheres --out second", &["second/index.html exists already", "--force"]);
    bench.refuses("report spheres spheres/1_falsify.sqlite --out x", &["spheres is a folder"]);
    bench.refuses("report first --out x", &["campaign.toml"]);
}

/// The rates of the page are those that the evaluation prints.
#[test]
fn the_page_of_an_evaluation_has_its_rates() {
    let bench = Bench::new();
    let flags = "ball-balancing --controller ddpg --action-noise 1.0 --episodes 100";
    let found = bench.json(&format!("evaluate {flags} --out run.sqlite --json"), 0);
    bench.check("report run.sqlite -k report.simulations=false --out page.html", 0);
    let html = page(&bench, "page.html");
    for (key, row) in [
        ("success_rate", "success rate"),
        ("strict_success_rate", "strict success rate"),
        ("dangerous_behavior_rate", "dangerous control steps"),
    ] {
        let share = 100.0 * found[key]["value"].as_f64().unwrap();
        assert!((1.0..100.0).contains(&share), "the rate must be visible: {key}: {share}");
        let shown = if share >= 10.0 { format!("{share:.0} %") } else { format!("{share:.1} %") };
        let cells = format!("<td>{row}</td><td>{shown}</td>");
        assert!(html.contains(&cells), "{cells}");
    }
}

/// The page leaves out simulations, but not in its numbers.
#[test]
fn a_large_evaluation_counts_all_simulations_and_corners() {
    let bench = Bench::new();
    let seed = "evaluate toy/car-following --space starts+events --episodes 5000 --seed 2";
    bench.check(&format!("{seed} --out run.sqlite"), 0);
    bench.check("report run.sqlite -k report.simulations=false --out page.html", 0);
    let html = page(&bench, "page.html");
    assert!(html.contains("Distribution of the robustness of 5000 simulations"));
    assert!(html.contains("of the 4 corners of the initial box"));
    assert!(html.len() < 4_000_000, "{} bytes", html.len());
}

#[test]
fn the_verdict_counts_only_simulations_with_one() {
    let bench = Bench::new();
    // 0/0: no simulation has a robustness.
    let plan = "target = 'toy/sphere-2d'\n[evaluate]\nepisodes = 9\n[falsify]\nformula = '1 / (distance - distance) >= 0'\n";
    bench.write("plan.toml", plan);
    bench.run("evaluate --plan plan.toml --out run.sqlite");
    assert!(bench.path("run.sqlite").exists());
    bench.check("report run.sqlite -k report.simulations=false --out page.html", 0);
    let html = page(&bench, "page.html");
    assert!(
        html.contains("<h2>toy/sphere-2d meets") || html.contains("has a verdict"),
        "the headline is missing"
    );
    // An interrupted run says so, and does not take a corner for the center.
    bench.check("evaluate toy/sphere-2d --episodes 20 --out cut.sqlite", 0);
    let connection = rusqlite::Connection::open(bench.path("cut.sqlite")).unwrap();
    connection.execute("DELETE FROM simulation WHERE trial = 2 AND number > 2", ()).unwrap();
    connection.execute("DELETE FROM simulation WHERE trial = 1 AND number > 15", ()).unwrap();
    drop(connection);
    bench.check("report cut.sqlite -k engine.skip-check=true -k report.simulations=false --out cut.html", 0);
    let html = page(&bench, "cut.html");
    for part in [
        "The run is not finished",
        "15 of 20 random scenarios",
        "of the 2 corners",
        "its center was not simulated",
    ] {
        assert!(html.contains(part), "{part} is not in the page");
    }
}

#[test]
fn a_random_search_counts_its_failures_and_a_target_that_always_fails_is_named() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --search random --trials 12 --budget 60 --seed 1 --out run.sqlite", 1);
    bench.check("report run.sqlite -k report.simulations=false --out a.html", 0);
    let run = mishandle::store::RunFile::open(bench.path("run.sqlite")).unwrap();
    let counts = run.counts().unwrap();
    let sentence =
        format!("Of the {} random simulations of this run, {} fail", counts.simulations, counts.falsified);
    assert!(page(&bench, "a.html").contains(&sentence), "{sentence}");
    bench.check("falsify toy/sphere-2d --formula 'distance >= 9' --trials 3 --out all.sqlite", 1);
    bench.check("report all.sqlite -k report.simulations=false --out b.html", 0);
    assert!(page(&bench, "b.html").contains("All 3 simulations fail."));
}

/// A car ahead that brakes harder is a harder scenario; at 0 m/s² it does not brake at all.
#[test]
fn an_evaluation_has_success_over_the_range_of_each_axis() {
    let bench = Bench::new();
    let found = bench.json(
        "evaluate toy/car-following --space events+dynamics --episodes 600 --seed 1 --out run.sqlite --json",
        0,
    );
    let rates = &found["axis_rates"];
    assert_eq!(rates["success_rate"], found["success_rate"]);
    let axes = rates["axes"].as_array().unwrap();
    let braking = axes.iter().find(|axis| axis["axis"] == "brake_deceleration").unwrap();
    let bins = braking["bins"].as_array().unwrap();
    let counted: u64 = bins.iter().map(|bin| bin["success_rate"]["n"].as_u64().unwrap()).sum();
    assert_eq!((bins.len(), counted), (10, 600));
    let value = |bin: &serde_json::Value| bin["success_rate"]["value"].as_f64().unwrap();
    assert!(value(&bins[0]) == 1.0 && value(&bins[9]) < 0.5, "{bins:?}");
    assert!(bins[0]["differs"] == true && bins[9]["differs"] == true, "{bins:?}");
    // Braking harder and for longer multiplies into a distance.
    let pair = &rates["pairs"][0];
    let mut names: Vec<&str> =
        pair["axes"].as_array().unwrap().iter().filter_map(|name| name.as_str()).collect();
    names.sort_unstable();
    assert_eq!(names, ["brake_deceleration", "brake_duration"]);
    assert!(pair["p_value"].as_f64().unwrap() < 0.001, "{pair}");

    bench.check("report run.sqlite --markdown run.md", 0);
    let markdown = page(&bench, "run.md");
    for part in [
        "## toy/car-following violates its requirement in ",
        "| success rate | ",
        "### Success over the range of the axes",
        "| brake_deceleration (m/s²) | 0 to 0.8 | **100 %** |",
        "brake_deceleration (columns)",
    ] {
        assert!(markdown.contains(part), "{part} is not in\n{markdown}");
    }
    bench.check("report run.sqlite -k report.simulations=false --out run.html", 0);
    let html = page(&bench, "run.html");
    assert!(html.contains("Which axes matter</h3>") && html.contains("<table class=\"heat\">"), "{html}");
    bench.refuses("report run.sqlite --markdown run.md", &["run.md exists already", "--force"]);
    bench.refuses("report run.sqlite --markdown x.md --out x.md", &["the same file x.md"]);
    bench.refuses("report . --markdown x.md", &["--markdown writes about run files"]);
    bench.refuses("report run.sqlite", &["--out"]);
}

#[test]
fn points_that_a_search_chose_have_no_rates() {
    let bench = Bench::new();
    bench.check("falsify toy/sphere-2d --search cma-es --trials 3 --budget 60 --seed 1 --out run.sqlite", 1);
    bench.check("report run.sqlite -k report.simulations=false --out run.html", 0);
    assert!(!page(&bench, "run.html").contains("Which axes matter"));
    bench.check("report run.sqlite -k report.sensitivity=200 -k report.probes=0 --out measured.html", 0);
    let html = page(&bench, "measured.html");
    assert!(
        html.contains("Of 200 random scenarios, ") && html.contains("Total effects of the axes"),
        "{html}"
    );
}
