//! `studies reproduce`: the paper's tables from small campaigns.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use mishandle::store::{RunFile, TrialStatus};
use mishandle_studies::GENERATIONS;
use serde_json::Value;

const FALSIFICATION: &str = "target = 'point-reaching'\ncontroller = 'ppo'\n[falsify]\n\
    formula = 'always[16:300](finger_target_distance <= 0.12)'\nsearch = ['random', 'nelder-mead']\ntrials = 3\nbudget = 20\n";
const PERFORMANCE: &str = "target = 'point-reaching'\ncontroller = ['ppo', 'expert']\naction-noise = [0.0, 0.5]\n[evaluate]\nepisodes = 12\n";

/// A temporary folder to run the program in.
struct Bench(tempfile::TempDir);

impl Bench {
    fn new() -> Bench {
        Bench(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn run(&self, arguments: &str) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_studies"));
        command.arg("reproduce").args(arguments.split_whitespace()).current_dir(&self.0);
        if self.path("home").exists() {
            command.env("MISHANDLE_HOME", self.path("home"));
        }
        command.output().unwrap()
    }

    /// Runs the program, which must exit with `code`, and returns stdout.
    #[track_caller]
    fn check(&self, arguments: &str, code: i32) -> String {
        let output = self.run(arguments);
        let out = utf8(&output.stdout);
        let err = utf8(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "studies reproduce {arguments}\n{out}\n{err}");
        out
    }

    #[track_caller]
    fn json(&self, arguments: &str, code: i32) -> Value {
        serde_json::from_str(&self.check(&format!("{arguments} --json"), code)).unwrap()
    }

    /// Runs the program, which must fail with a message that contains all `parts`.
    #[track_caller]
    fn refuses(&self, arguments: &str, parts: &[&str]) {
        let output = self.run(arguments);
        let err = utf8(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "studies reproduce {arguments}\n{err}");
        assert!(output.stdout.is_empty(), "{}", utf8(&output.stdout));
        for part in parts {
            assert!(err.contains(part), "studies reproduce {arguments} does not print `{part}`:\n{err}");
        }
    }
}

fn utf8(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

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
    let printed = bench.check("falsification --plan f.toml --out runs/f", 0);
    assert!(printed.contains("Simulations to the first violation, preset paper\n\n| task |"), "{printed}");
    let found = bench.json("tables runs/f", 0);
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
    bench.check("falsification --plan s.toml --out runs/s", 0);
    let success = bench.json("tables runs/s", 0);
    let row = &rows(&success, "Falsified trials")[0];
    let shown = ["falsified", "falsified, paper", "p"].map(|name| &row[name][..]);
    assert_eq!(shown, ["0 of 2", "30 of 30", "-"]);
    let row = &rows(&success, "Simulations to the first violation")[0];
    assert_eq!(row["mean over successes, paper"], "8.57");
    // The same command resumes, and repeats nothing.
    bench.check("falsification --plan f.toml --out runs/f", 0);
    assert_eq!(bench.json("tables runs/f", 0), found);
    bench.refuses("falsification --plan p.toml --out runs/f", &["the runs of another plan"]);
}

#[test]
fn collected_results_give_the_tables_of_the_run_files() {
    let bench = bench();
    bench.check("falsification --plan f.toml --out runs/f", 0);
    bench.check("performance --plan p.toml --out runs/p", 0);
    let from_runs = bench.json("tables runs/p runs/f", 0);
    bench.check("collect runs/p runs/f --out results/2026-11-22", 0);
    assert_eq!(bench.json("tables results/2026-11-22", 0), from_runs);
    let success = &rows(&from_runs, "Success rate without noise")[0];
    let shown = ["task", "controller", "n", "SR, paper"].map(|name| &success[name][..]);
    assert_eq!(shown, ["`point-reaching`", "`ppo`", "12", "93"]);
    bench.check("tables results/2026-11-22 --pages pages", 0);
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
    bench.refuses("tables results/2026-11-22", &expected);
    bench.refuses("collect runs/f --out results/now", &["named by its date"]);
}

#[test]
fn an_incomplete_campaign_is_shown_as_such_and_not_collected() {
    let bench = bench();
    let text = std::fs::read_to_string(bench.path("f.toml")).unwrap();
    mishandle::campaign::create_campaign(&text, &bench.path("f")).unwrap();
    let table = rows(&bench.json("tables f", 0), "Falsified trials");
    assert!(table.iter().all(|row| row["falsified"] == "not run" && row["p"] == "-"), "{table:?}");
    bench.check("tables f --pages pages", 0);
    let page = std::fs::read_to_string(bench.path("pages/falsification.md")).unwrap();
    assert!(page.contains("2 of 2 runs are incomplete"), "{page}");
    bench.refuses("collect f --out 2026-11-22", &["no run is complete"]);
}

#[test]
fn a_table_collected_in_parts_is_the_table_of_the_whole_campaign() {
    let bench = bench();
    bench.check("falsification --plan f.toml --out runs/f", 0);
    bench.check("collect runs/f --out whole/2026-11-22", 0);
    // The runs of the campaign, one in each part. The other one of the first part has not started.
    let text = std::fs::read_to_string(bench.path("f.toml")).unwrap();
    for (part, finished) in [("first", "random"), ("second", "nelder-mead")] {
        let folder = bench.path(&format!("{part}/f"));
        mishandle::campaign::create_campaign(&text, &folder).unwrap();
        let file = format!("{finished}.sqlite");
        std::fs::copy(bench.path(&format!("runs/f/{file}")), folder.join(file)).unwrap();
    }
    let said = utf8(&bench.run("collect first/f --out parts/2026-11-21").stderr);
    assert!(said.contains("1 of 2 runs left out, because they are not complete"), "{said}");
    bench.check("collect parts/2026-11-21 second/f --out merged/2026-11-22", 0);
    let tables = |folder| bench.json(&format!("tables {folder}/2026-11-22"), 0);
    assert_eq!(tables("merged"), tables("whole"));
    let machine = |folder| {
        let manifest = std::fs::read_to_string(bench.path(&format!("{folder}/2026-11-22/manifest.json")));
        serde_json::from_str::<Value>(&manifest.unwrap()).unwrap()["machine"].clone()
    };
    assert_eq!(machine("merged"), machine("whole"), "one machine is listed once");
    // The same rows again add nothing; other rows of the same run are refused.
    bench.check("collect merged/2026-11-22 second/f --out twice/2026-11-22", 0);
    assert_eq!(tables("twice"), tables("whole"));
    bench.write("other.toml", &text.replace("[falsify]", "seed = 1\n[falsify]"));
    bench.check("falsification --plan other.toml --out other/f", 0);
    let different = "collect merged/2026-11-22 other/f --out different/2026-11-23";
    bench.refuses(different, &["two folders have different results of the run random of f"]);
}

/// Ships a controller of point-reaching of the repository under another name, for the program in
/// this folder.
fn ship(bench: &Bench, name: &str, original: &str) {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../controllers/point-reaching");
    let folder = bench.path("home/controllers/point-reaching");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(shipped.join(original), folder.join(name)).unwrap();
}

#[test]
fn the_generations_stand_side_by_side() {
    let bench = Bench::new();
    // `ppo-2` is a copy of `trpo`.
    for (name, original) in [("ppo", "ppo"), ("trpo", "trpo"), ("ppo-2", "trpo")] {
        ship(&bench, &format!("{name}.safetensors"), &format!("{original}.safetensors"));
    }
    let plan = "target = 'point-reaching'\ncontroller = ['ppo', 'trpo', 'ppo-2', 'expert']\n";
    let evaluation = format!("{plan}[evaluate]\nepisodes = 9\n");
    bench.write("p.toml", &evaluation);
    let searches = "search = ['random', 'nelder-mead']\ntrials = 2\nbudget = 6\n";
    let formula = "formula = 'always[16:300](finger_target_distance <= 0.12)'\n";
    bench.write("f.toml", &format!("{plan}[falsify]\n{formula}{searches}"));
    let tables = |command: &str, name: &str| {
        bench.check(&format!("{command} --plan {name}.toml --out runs/{name}"), 0);
        bench.json(&format!("tables runs/{name}"), 0)
    };
    let found = tables("performance", "p");
    let success = rows(&found, "Success rate");
    let others = rows(&found, "Danger, times and corners");
    let names = |row: &BTreeMap<String, String>| row["controller"].clone();
    assert_eq!(success.iter().map(names).collect::<Vec<_>>(), ["`ppo`", "`trpo`", "`expert`"]);
    for (table, columns) in [(&success, ["SR", "n"]), (&others, ["DBR", "failing corners"])] {
        for name in columns {
            let first = format!("{name}, first");
            let second = format!("{name}, second");
            assert_eq!(table[0][&second], table[1][&first], "ppo-2 is a copy of trpo");
            assert_eq!((&table[1][&second][..], &table[2][&second][..]), ("-", "-"));
            assert_ne!(table[2][&first], "-");
        }
    }
    assert_eq!((&success[0]["n, first"][..], &success[0]["SR, paper"][..]), ("9", "93"));
    // The p-value is that of the first generation, whose protocol is the paper's.
    bench.write("first.toml", &evaluation.replace(", 'ppo-2'", ""));
    let first = tables("performance", "first");
    assert_eq!(success[0]["p"], rows(&first, "Success rate")[0]["p"]);
    assert!(!rows(&first, "Success rate")[0].contains_key("SR, second"));
    bench.write("second.toml", &evaluation.replace("['ppo', 'trpo', 'ppo-2', 'expert']", "'ppo-2'"));
    assert_eq!(rows(&tables("performance", "second"), "Success rate")[0]["p"], "-");

    let found = tables("falsification", "f");
    let trials = rows(&found, "Falsified trials");
    let simulations = rows(&found, "Simulations to the first");
    // Two searches of three controllers; rows of a controller follow each other.
    for (table, name) in [(&trials, "falsified"), (&trials, "rate %"), (&simulations, "simulations")] {
        let first = format!("{name}, first");
        let second = format!("{name}, second");
        assert_eq!(table.len(), 6);
        for search in 0..2 {
            assert_eq!(table[search][&second], table[2 + search][&first], "ppo-2 is a copy of trpo");
            assert_eq!(table[2 + search][&second], "-");
        }
    }
    bench.check("tables runs/p runs/f --pages pages", 0);
    let page = std::fs::read_to_string(bench.path("pages/performance.md")).unwrap();
    assert!(page.contains("Commands: `mishandle run runs/p/campaign.toml`"), "{page}");
    for name in ["performance", "falsification"] {
        for ending in ["md", "html"] {
            let page = std::fs::read_to_string(bench.path(&format!("pages/{name}.{ending}"))).unwrap();
            let page = page.replace("&#39;", "'");
            let parts = GENERATIONS.iter().zip(["the paper's protocol", "another protocol"]);
            let mut parts = parts.map(|(generation, follows)| format!("{}; {follows}", generation.training));
            assert!(parts.all(|part| page.contains(&part)), "{name}.{ending}:\n{page}");
        }
    }
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
    bench.check("falsification --plan f.toml --out runs/f", 0);
    bench.check("performance --plan p.toml --out runs/p", 0);
    bench.check("collect runs/p runs/f --out results/2026-11-22", 0);
    set_commit(&bench, "results/2026-11-22", &mishandle::build::build().git_commit);
    let all = bench.json("verify results/2026-11-22 --share 1", 0);
    // Two runs of three trials; four evaluations with episodes and corners, which are 180
    // simulations with noise.
    assert_eq!((&all["agreeing"], &all["all_units"]), (&16.into(), &16.into()));
    let few = bench.json("verify results/2026-11-22 --seed 3", 0);
    let campaigns = few["units"].as_array().unwrap().iter().map(|unit| unit["campaign"].as_str().unwrap());
    assert_eq!(campaigns.collect::<Vec<_>>(), ["p", "f"], "{few}");
    let text = bench.check("verify results/2026-11-22", 0);
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
    let output = bench.run("verify results/2026-11-22 --share 1");
    let out = utf8(&output.stdout);
    let err = utf8(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{out}\n{err}");
    assert!(err.contains("1 of 16 units differ from the results"), "{err}");
    let found = bench.json("verify results/2026-11-22 --share 1", 2);
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
    bench.check("falsification --plan f.toml --out runs/f", 0);
    bench.check("collect runs/f --out results/2026-11-22", 0);
    set_commit(&bench, "results/2026-11-22", "c0ffee012345");
    let program = mishandle::build::build().git_commit;
    let refused =
        ["the digests hold at commit c0ffee012345", &format!("this program is of commit {program}")];
    bench.refuses("verify results/2026-11-22", &refused);
    let output = bench.run("verify results/2026-11-22 --any-commit");
    assert_eq!(output.status.code(), Some(0));
    assert!(utf8(&output.stderr).contains("commit c0ffee012345"));
    // A program of changed sources has no commit to name.
    let record = "verify results/2026-11-22 --any-commit --record";
    if program.ends_with("-changed") {
        bench.refuses(record, &["does not name its sources"]);
    } else {
        bench.check(record, 0);
        bench.check("verify results/2026-11-22", 0);
    }
    // Results of other physics are refused at the same commit, too.
    set_commit(&bench, "results/2026-11-22", &program);
    let path = bench.path("results/2026-11-22/manifest.json");
    let manifest = std::fs::read_to_string(&path).unwrap().replace("3.17.0", "3.16.0");
    std::fs::write(&path, manifest).unwrap();
    bench.refuses("verify results/2026-11-22", &["versions: recorded MuJoCo 3.16.0, now MuJoCo 3.17.0"]);
    bench.refuses("verify runs/f", &["has no manifest.json"]);
    bench.refuses("verify results/2026-11-22 --share 0", &["a number above 0, up to 1"]);
}
