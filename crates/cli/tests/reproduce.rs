//! `mishandle reproduce`: the paper's tables from small campaigns.

use crate::bench;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::bench::Bench;
use mishandle::shipped::GENERATIONS;
use mishandle::store::{RunFile, TrialStatus};
use serde_json::Value;

const FALSIFICATION: &str = "target = 'point-reaching'\ncontroller = 'ppo'\n[falsify]\n\
    formula = 'always[16:300](finger_target_distance <= 0.12)'\nsearch = ['random', 'nelder-mead']\ntrials = 3\nbudget = 20\n";
const PERFORMANCE: &str = "target = 'point-reaching'\ncontroller = ['ppo', 'expert']\naction-noise = [0.0, 0.5]\n[evaluate]\nepisodes = 12\n";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("f.toml", FALSIFICATION);
    bench.write("p.toml", PERFORMANCE);
    bench
}

/// Returns the rows of the table with this caption, each with its cells by column.
#[track_caller]
fn rows(document: &Value, caption: &str) -> Vec<BTreeMap<String, String>> {
    let pages = document["pages"].as_array().unwrap();
    let mut tables = pages.iter().flat_map(|page| page["tables"].as_array().unwrap());
    let table = tables.find(|table| table["caption"].as_str().unwrap().starts_with(caption)).unwrap();
    let columns: Vec<String> = serde_json::from_value(table["columns"].clone()).unwrap();
    let rows: Vec<Vec<String>> = serde_json::from_value(table["rows"].clone()).unwrap();
    rows.into_iter().map(|row| columns.iter().cloned().zip(row).collect()).collect()
}

#[test]
fn a_table_of_falsification_matches_a_count_of_the_rows() {
    let bench = bench();
    let found = bench.json("reproduce falsification --plan f.toml --out runs/f --json", 0);
    let table = rows(&found, "Falsified trials");
    let simulations = rows(&found, "Simulations to the first violation");
    for ((row, simulations), search) in table.iter().zip(&simulations).zip(["random", "nelder-mead"]) {
        assert!(row["task"].contains("always[16:300]"), "{row:?}");
        let run = RunFile::open(bench.path(&format!("runs/f/{search}.sqlite"))).unwrap();
        let trials = run.trials().unwrap();
        let falsified = trials.iter().filter(|trial| trial.trial.status == TrialStatus::Falsified);
        let counts: Vec<u64> = falsified.clone().map(|trial| trial.counts.simulations).collect();
        assert_eq!(row["falsified"], format!("{} of 3", counts.len()));
        assert!(row["search"].contains(search) && simulations["search"] == row["search"], "{row:?}");
        // Trials without a violation count as the budget of 20.
        let restricted = (counts.iter().sum::<u64>() + 20 * (3 - counts.len() as u64)) as f64 / 3.0;
        let shown = &simulations["restricted mean"];
        assert!(shown.starts_with(&format!("{restricted:.1}")), "{shown}, not {restricted}");
        let early = trials.iter().filter(|trial| trial.trial.status == TrialStatus::Converged).count();
        assert_eq!(
            (&simulations["ended early"], &simulations["simulations"]),
            (&early.to_string(), &run.counts().unwrap().simulations.to_string())
        );
    }
    // The paper's values are for another formula. Those for its formula are shown, but not tested
    // against another budget.
    assert_eq!((&table[0]["falsified, paper"][..], &table[0]["p"][..]), ("-", "-"));
    bench.write(
        "s.toml",
        "target = 'point-reaching'\ncontroller = 'ppo'\n[falsify]\nsearch = 'random'\ntrials = 2\nbudget = 3\n",
    );
    let success = bench.json("reproduce falsification --plan s.toml --out runs/s --json", 0);
    let row = &rows(&success, "Falsified trials")[0];
    let shown = ["falsified", "falsified, paper", "p"].map(|name| &row[name][..]);
    assert_eq!(shown, ["0 of 2", "30 of 30", "-"]);
    let row = &rows(&success, "Simulations to the first violation")[0];
    assert_eq!(row["mean over successes, paper"], "8.57");
    // The same command resumes, and repeats nothing.
    assert_eq!(bench.json("reproduce falsification --plan f.toml --out runs/f --json", 0), found);
    bench.refuses("reproduce falsification --plan p.toml --out runs/f", &["the runs of another plan"]);
}

#[test]
fn collected_results_give_the_tables_of_the_run_files() {
    let bench = bench();
    bench.check("reproduce falsification --plan f.toml --out runs/f", 0);
    bench.check("reproduce performance --plan p.toml --out runs/p", 0);
    let from_runs = bench.json("reproduce tables runs/p runs/f --json", 0);
    bench.check("reproduce collect runs/p runs/f --out results/2026-11-22", 0);
    assert_eq!(bench.json("reproduce tables results/2026-11-22 --json", 0), from_runs);
    let success = &rows(&from_runs, "Success rate without noise")[0];
    let shown = ["task", "controller", "n", "SR, paper"].map(|name| &success[name][..]);
    assert_eq!(shown, ["`point-reaching`", "`ppo`", "12", "93"]);
    bench.check("reproduce tables results/2026-11-22 --pages pages", 0);
    for name in ["performance.md", "performance.html", "falsification.md", "falsification.html"] {
        let page = std::fs::read_to_string(bench.path(&format!("pages/{name}"))).unwrap();
        assert!(page.contains("point-reaching") && page.contains("2026-11-22"), "{name}");
    }
    let html = std::fs::read_to_string(bench.path("pages/falsification.html")).unwrap();
    let needs = ["http:", "https:", "<script", "src=", "@import"];
    assert!(needs.iter().all(|part| !html.contains(part)), "the page needs the network");
    // A missing unit is found.
    let path = bench.path("results/2026-11-22/f/random.csv");
    let units = std::fs::read_to_string(&path).unwrap();
    std::fs::write(&path, units.replacen("\n1,1,", "\n1,2,", 1)).unwrap();
    let expected = ["random.csv", "line 2: expected simulation 1 of trial 1, found 2"];
    bench.refuses("reproduce tables results/2026-11-22", &expected);
    bench.refuses("reproduce collect runs/f --out results/now", &["named by its date"]);
}

#[test]
fn an_incomplete_campaign_is_shown_as_such_and_not_collected() {
    let bench = bench();
    let text = std::fs::read_to_string(bench.path("f.toml")).unwrap();
    mishandle::campaign::create_campaign(&text, &bench.path("f")).unwrap();
    let table = rows(&bench.json("reproduce tables f --json", 0), "Falsified trials");
    assert!(table.iter().all(|row| row["falsified"] == "not run" && row["p"] == "-"), "{table:?}");
    bench.check("reproduce tables f --pages pages", 0);
    let page = std::fs::read_to_string(bench.path("pages/falsification.md")).unwrap();
    assert!(page.contains("2 of 2 runs are incomplete"), "{page}");
    bench.refuses("reproduce collect f --out 2026-11-22", &["no run is complete"]);
}

#[test]
fn a_table_collected_in_parts_is_the_table_of_the_whole_campaign() {
    let bench = bench();
    bench.check("reproduce falsification --plan f.toml --out runs/f", 0);
    bench.check("reproduce collect runs/f --out whole/2026-11-22", 0);
    // The runs of the campaign, one in each part. The other one of the first part has not started.
    let text = std::fs::read_to_string(bench.path("f.toml")).unwrap();
    for (part, finished) in [("first", "random"), ("second", "nelder-mead")] {
        let folder = bench.path(&format!("{part}/f"));
        mishandle::campaign::create_campaign(&text, &folder).unwrap();
        let file = format!("{finished}.sqlite");
        std::fs::copy(bench.path(&format!("runs/f/{file}")), folder.join(file)).unwrap();
    }
    let said = bench::text(&bench.run("reproduce collect first/f --out parts/2026-11-21").stderr);
    assert!(said.contains("1 of 2 runs left out, because they are not complete"), "{said}");
    bench.check("reproduce collect parts/2026-11-21 second/f --out merged/2026-11-22", 0);
    let tables = |folder| bench.json(&format!("reproduce tables {folder}/2026-11-22 --json"), 0);
    assert_eq!(tables("merged"), tables("whole"));
    let machine = |folder| {
        let manifest = std::fs::read_to_string(bench.path(&format!("{folder}/2026-11-22/manifest.json")));
        serde_json::from_str::<Value>(&manifest.unwrap()).unwrap()["machine"].clone()
    };
    assert_eq!(machine("merged"), machine("whole"), "one machine is listed once");
    // The same rows again add nothing; other rows of the same run are refused.
    bench.check("reproduce collect merged/2026-11-22 second/f --out twice/2026-11-22", 0);
    assert_eq!(tables("twice"), tables("whole"));
    bench.write("other.toml", &text.replace("[falsify]", "seed = 1\n[falsify]"));
    bench.check("reproduce falsification --plan other.toml --out other/f", 0);
    let different = "reproduce collect merged/2026-11-22 other/f --out different/2026-11-23";
    bench.refuses(different, &["two folders have different results of the run random of f"]);
}

/// A folder of shipped files for the program, with the controllers of point-reaching that a test
/// names.
struct Home(PathBuf);

impl Home {
    fn new(bench: &Bench) -> Home {
        let home = Home(bench.path("home"));
        std::fs::create_dir_all(home.0.join("controllers/point-reaching")).unwrap();
        home
    }

    /// Ships the controller of this name of the repository as `name`.
    fn ship(&self, name: &str, original: &str) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../controllers/point-reaching");
        let path = self.0.join(format!("controllers/point-reaching/{name}.safetensors"));
        std::fs::copy(folder.join(format!("{original}.safetensors")), path).unwrap();
    }

    /// Runs the program, which must exit with `code`, and returns stdout and stderr.
    #[track_caller]
    fn check(&self, bench: &Bench, arguments: &str, code: i32) -> (String, String) {
        let output = bench.command(arguments).env("MISHANDLE_HOME", &self.0).output().unwrap();
        let (out, err) = (bench::text(&output.stdout), bench::text(&output.stderr));
        assert_eq!(output.status.code(), Some(code), "mishandle {arguments}\n{out}\n{err}");
        (out, err)
    }

    #[track_caller]
    fn json(&self, bench: &Bench, arguments: &str) -> Value {
        serde_json::from_str(&self.check(bench, arguments, 0).0).unwrap()
    }
}

/// Two generations, of which the second has no `trpo-2`, and `ppo-2` is a copy of `trpo`.
fn two_generations() -> (Bench, Home) {
    let bench = Bench::new();
    let home = Home::new(&bench);
    for (name, original) in [("ppo", "ppo"), ("trpo", "trpo"), ("ppo-2", "trpo")] {
        home.ship(name, original);
    }
    let both = "target = 'point-reaching'\ncontroller = ['ppo', 'trpo', 'ppo-2', 'trpo-2', 'expert']\n";
    bench.write("p.toml", &format!("{both}[evaluate]\nepisodes = 9\n"));
    let searches = "search = ['random', 'nelder-mead']\ntrials = 2\nbudget = 6\n";
    let formula = "formula = 'always[16:300](finger_target_distance <= 0.12)'\n";
    bench.write("f.toml", &format!("{both}[falsify]\n{formula}{searches}"));
    (bench, home)
}

#[test]
fn the_generations_stand_side_by_side_and_a_missing_controller_is_not_trained() {
    let (bench, home) = two_generations();
    let flags = "reproduce performance --plan p.toml --out runs/p --json";
    let (out, err) = home.check(&bench, flags, 0);
    assert!(
        err.contains("1 run left out, because no controller is shipped for: point-reaching/trpo-2"),
        "{err}"
    );
    let found: Value = serde_json::from_str(&out).unwrap();
    let (success, others) = (rows(&found, "Success rate"), rows(&found, "Danger, times and corners"));
    let names = |row: &BTreeMap<String, String>| row["controller"].clone();
    assert_eq!(success.iter().map(names).collect::<Vec<_>>(), ["`ppo`", "`trpo`", "`expert`"]);
    for (table, columns) in [(&success, ["SR", "n"]), (&others, ["DBR", "failing corners"])] {
        for name in columns {
            let (first, second) = (format!("{name}, first"), format!("{name}, second"));
            assert_eq!(table[0][&second], table[1][&first], "ppo-2 is a copy of trpo");
            assert_eq!((&table[1][&second][..], &table[2][&second][..]), ("not trained", "-"));
            assert_ne!(table[2][&first], "-");
        }
    }
    assert_eq!((&success[0]["n, first"][..], &success[0]["SR, paper"][..]), ("9", "93"));
    // The p-value is that of the first generation, whose protocol is the paper's.
    let only = std::fs::read_to_string(bench.path("p.toml")).unwrap().replace(", 'ppo-2', 'trpo-2'", "");
    bench.write("first.toml", &only);
    let first = home.json(&bench, "reproduce performance --plan first.toml --out runs/first --json");
    assert_eq!(success[0]["p"], rows(&first, "Success rate")[0]["p"]);
    assert!(!rows(&first, "Success rate")[0].contains_key("SR, second"));
    let second = only.replace("['ppo', 'trpo', 'expert']", "'ppo-2'");
    bench.write("second.toml", &second);
    let second = home.json(&bench, "reproduce performance --plan second.toml --out runs/second --json");
    assert_eq!(rows(&second, "Success rate")[0]["p"], "-");

    let flags = "reproduce falsification --plan f.toml --out runs/f --json";
    let found = home.json(&bench, flags);
    let (trials, simulations) = (rows(&found, "Falsified trials"), rows(&found, "Simulations to the first"));
    // Two searches of three controllers; rows of a controller follow each other.
    for (table, name) in [(&trials, "falsified"), (&trials, "rate %"), (&simulations, "simulations")] {
        let (first, second) = (format!("{name}, first"), format!("{name}, second"));
        assert_eq!(table.len(), 6);
        for search in 0..2 {
            assert_eq!(table[search][&second], table[2 + search][&first], "ppo-2 is a copy of trpo");
            assert_eq!(table[2 + search][&second], "not trained");
        }
    }
    home.check(&bench, "reproduce tables runs/p runs/f --pages pages", 0);
    let page = std::fs::read_to_string(bench.path("pages/performance.md")).unwrap();
    assert!(
        page.contains("Commands: `mishandle reproduce performance --plan runs/p/campaign.toml`"),
        "{page}"
    );
    for name in ["performance", "falsification"] {
        for ending in ["md", "html"] {
            let page = std::fs::read_to_string(bench.path(&format!("pages/{name}.{ending}"))).unwrap();
            let page = page.replace("&#39;", "'");
            let parts = GENERATIONS.iter().zip(["the paper's protocol", "another protocol"]);
            let mut parts = parts.map(|(generation, follows)| format!("{}; {follows}", generation.training));
            assert!(parts.all(|part| page.contains(&part)), "{name}.{ending}:\n{page}");
            assert!(page.contains("not trained"), "{name}.{ending}:\n{page}");
        }
    }
}

#[test]
fn a_controller_that_was_trained_later_is_added_to_the_same_campaign() {
    let (bench, home) = two_generations();
    let flags = "reproduce performance --plan p.toml --out runs/p --json";
    let before = home.json(&bench, flags);
    assert_eq!(home.json(&bench, flags), before, "the same command resumes");
    home.check(&bench, "reproduce collect runs/p --out results/2026-11-22", 0);
    assert_eq!(home.json(&bench, "reproduce tables results/2026-11-22 --json"), before);
    // Other commands pass over the run, and a folder that lost a run file is still an error.
    home.check(&bench, "campaign --resume runs/p", 0);
    let lost = bench.path("runs/p/ppo.sqlite");
    std::fs::rename(&lost, bench.path("ppo.sqlite")).unwrap();
    let (_, err) = home.check(&bench, flags, 2);
    assert!(err.contains("ppo.sqlite"), "{err}");
    std::fs::rename(bench.path("ppo.sqlite"), lost).unwrap();

    home.ship("trpo-2", "ppo");
    let (out, err) = home.check(&bench, flags, 0);
    assert!(!err.contains("left out"), "{err}");
    assert!(!bench.path("runs/p/trpo-2.untrained").exists());
    let after = rows(&serde_json::from_str(&out).unwrap(), "Success rate");
    assert_eq!(after[1]["SR, second"], after[0]["SR, first"], "trpo-2 is a copy of ppo");
    // Results of both parts are one table: a result stands for the run that was left out.
    home.check(&bench, "reproduce collect results/2026-11-22 runs/p --out results/2026-11-23", 0);
    let merged = home.json(&bench, "reproduce tables results/2026-11-23 --json");
    assert_eq!(rows(&merged, "Success rate"), after);
}

#[test]
fn names_that_no_generation_has_and_plans_without_any_controller_are_errors() {
    let (bench, home) = two_generations();
    let refuses = |arguments: &str, parts: &[&str]| {
        let (_, err) = home.check(&bench, arguments, 2);
        assert!(parts.iter().all(|part| err.contains(part)), "{err}");
    };
    let plan = |controllers: &str| {
        bench
            .write("x.toml", &format!("target = 'point-reaching'\ncontroller = {controllers}\n[evaluate]\n"));
    };
    let known = "choose from: ppo, ppo-2, trpo, expert";
    for (controllers, unknown) in [("['ppo', 'ppo-3']", "ppo-3"), ("['trpo-2', 'sac-2']", "trpo-2")] {
        plan(controllers);
        refuses("reproduce performance --plan x.toml", &[&format!("no controller `{unknown}`"), known]);
        assert!(!bench.path("runs/performance").exists());
    }
    // A campaign has the runs that it names.
    refuses("campaign p.toml --out runs/c", &["no controller `trpo-2`", known]);
}

/// Returns the manifest of results, with another commit.
fn set_commit(bench: &Bench, folder: &str, commit: &str) {
    let path = bench.path(&format!("{folder}/manifest.json"));
    let mut manifest: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    manifest["commit"] = commit.into();
    std::fs::write(path, manifest.to_string()).unwrap();
}

#[test]
fn verify_agrees_with_the_runs_and_finds_a_changed_digest() {
    let bench = bench();
    bench.check("reproduce falsification --plan f.toml --out runs/f", 0);
    bench.check("reproduce performance --plan p.toml --out runs/p", 0);
    bench.check("reproduce collect runs/p runs/f --out results/2026-11-22", 0);
    set_commit(&bench, "results/2026-11-22", &mishandle::build::build().git_commit);
    let all = bench.json("reproduce verify results/2026-11-22 --share 1 --json", 0);
    // Two runs of three trials; four evaluations with episodes and corners, which are 180
    // simulations with noise.
    assert_eq!((&all["agreeing"], &all["all_units"]), (&16.into(), &16.into()));
    let few = bench.json("reproduce verify results/2026-11-22 --seed 3 --json", 0);
    let campaigns = few["units"].as_array().unwrap().iter().map(|unit| unit["campaign"].as_str().unwrap());
    assert_eq!(campaigns.collect::<Vec<_>>(), ["p", "f"], "{few}");
    let text = bench.check("reproduce verify results/2026-11-22", 0);
    assert!(
        text.contains("2 of 2 units (")
            && text.contains("agree to the bit. Seed 0 chose them from 16 units."),
        "{text}"
    );

    let path = bench.path("results/2026-11-22/f/nelder-mead.csv");
    let units = std::fs::read_to_string(&path).unwrap();
    let digest = units.lines().nth(2).unwrap().rsplit(',').next().unwrap();
    let other = digest.chars().rev().collect::<String>();
    std::fs::write(&path, units.replace(digest, &other)).unwrap();
    let output = bench.run("reproduce verify results/2026-11-22 --share 1");
    let (out, err) = (bench::text(&output.stdout), bench::text(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{out}\n{err}");
    assert!(err.contains("1 of 16 units differ from the results"), "{err}");
    let found = bench.json("reproduce verify results/2026-11-22 --share 1 --json", 2);
    let differing: Vec<&Value> =
        found["units"].as_array().unwrap().iter().filter(|unit| unit["agrees"] == false).collect();
    assert_eq!(differing.len(), 1);
    assert_eq!((&differing[0]["run"], &differing[0]["trial"]), (&"nelder-mead".into(), &2.into()));
    let difference = format!("SHA-256: recorded {other}, now {digest}");
    assert_eq!(differing[0]["differences"], serde_json::json!([difference]));
}

#[test]
fn verify_refuses_another_commit_and_names_it() {
    let bench = bench();
    bench.check("reproduce falsification --plan f.toml --out runs/f", 0);
    bench.check("reproduce collect runs/f --out results/2026-11-22", 0);
    set_commit(&bench, "results/2026-11-22", "c0ffee012345");
    let program = mishandle::build::build().git_commit;
    let refused =
        ["the digests hold at commit c0ffee012345", &format!("this program is of commit {program}")];
    bench.refuses("reproduce verify results/2026-11-22", &refused);
    let output = bench.run("reproduce verify results/2026-11-22 --any-commit");
    assert_eq!(output.status.code(), Some(0));
    assert!(bench::text(&output.stderr).contains("commit c0ffee012345"));
    // A program of changed sources has no commit to name.
    let record = "reproduce verify results/2026-11-22 --any-commit --record";
    match program.ends_with("-changed") {
        true => bench.refuses(record, &["does not name its sources"]),
        false => {
            bench.check(record, 0);
            bench.check("reproduce verify results/2026-11-22", 0);
        }
    }
    // Results of other physics are refused at the same commit, too.
    set_commit(&bench, "results/2026-11-22", &program);
    let path = bench.path("results/2026-11-22/manifest.json");
    let manifest = std::fs::read_to_string(&path).unwrap().replace("3.17.0", "3.16.0");
    std::fs::write(&path, manifest).unwrap();
    bench.refuses(
        "reproduce verify results/2026-11-22",
        &["versions: recorded MuJoCo 3.16.0, now MuJoCo 3.17.0"],
    );
    bench.refuses("reproduce verify runs/f", &["has no manifest.json"]);
    bench.refuses("reproduce verify results/2026-11-22 --share 0", &["a number above 0, up to 1"]);
}

#[test]
fn jobs_change_no_row_and_a_campaign_has_the_same_pages() {
    let bench = Bench::new();
    bench.write("grid.toml", "target = 'toy/sphere-2d'\nseed = [1, 2, 3]\n[falsify]\nsearch = ['random', 'nelder-mead']\ntrials = 2\nbudget = 30\n");
    bench.check("campaign grid.toml --out one", 1);
    bench.check("campaign grid.toml --out three --jobs 3 --pages pages", 1);
    for name in ["1_random", "2_random", "3_nelder-mead"] {
        let digest = |folder| {
            RunFile::open(bench.path(&format!("{folder}/{name}.sqlite"))).unwrap().content_digest().unwrap()
        };
        assert_eq!(digest("one"), digest("three"), "{name}");
    }
    assert!(std::fs::read_to_string(bench.path("pages/falsification.md")).unwrap().contains("toy/sphere-2d"));
}

#[test]
fn the_starts_of_the_papers_row_are_the_first_ones_of_a_longer_evaluation() {
    let bench = Bench::new();
    let rows = |episodes: u32| {
        let flags = "evaluate point-reaching --controller expert --action-noise 0.5 --seed 0";
        bench.check(&format!("{flags} --episodes {episodes} --out {episodes}.sqlite"), 0);
        let run = RunFile::open(bench.path(&format!("{episodes}.sqlite"))).unwrap();
        let rows = run.trial_simulations(1).map(|row| row.unwrap());
        rows.map(|row| (row.number, row.seed, row.scenario, row.robustness)).collect::<Vec<_>>()
    };
    let (short, long) = (rows(5), rows(25));
    assert_eq!((short.len(), long.len()), (5, 25));
    assert_eq!(short[..], long[..5]);
}
