//! `mishandle show` of several runs, and `mishandle export`.

use crate::bench::Bench;

#[test]
fn runs_are_listed_with_their_contents_and_damaged_files_with_the_reason() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("runs/grid")).unwrap();
    bench.check(
        "falsify toy/sphere-2d --seed 2 --search nelder-mead --trials 2 --budget 30 --out runs/a.sqlite",
        1,
    );
    bench.check("evaluate toy/sphere-2d --episodes 7 --out runs/grid/b.sqlite", 0);
    bench.write("runs/grid/c.sqlite", "not a database, although it has the extension of a run file");
    bench.write("runs/notes.txt", "");
    let listed = bench.json("show --json", 0);
    let listed = listed.as_array().unwrap();
    let paths: Vec<&str> = listed.iter().map(|run| run["run"].as_str().unwrap()).collect();
    assert_eq!(paths, ["runs/a.sqlite", "runs/grid/b.sqlite", "runs/grid/c.sqlite"]);
    assert_eq!(
        (&listed[0]["kind"], &listed[0]["trials"], &listed[0]["search"]),
        (&"falsify".into(), &2.into(), &"nelder-mead".into())
    );
    assert_eq!(listed[0]["failures"], listed[0]["falsified_trials"]);
    assert_eq!((&listed[1]["kind"], &listed[1]["is_complete"]), (&"evaluate".into(), &true.into()));
    assert!(listed[1]["simulations"].as_u64().unwrap() > 7, "with the corners: {}", listed[1]);
    assert!(listed[2]["error"].is_string(), "{}", listed[2]);
    let text = bench.check("show", 0);
    for part in ["runs/a.sqlite", "nelder-mead", "of 2", "not readable"] {
        assert!(text.contains(part), "{part} is not in\n{text}");
    }
    bench.refuses("show missing", &["there is no run file or folder missing"]);
}

#[test]
fn exports_have_one_row_per_simulation_and_never_overwrite() {
    let bench = Bench::new();
    bench.check("evaluate toy/noisy --episodes 7 --out run.sqlite", 0);
    bench.check("export run.sqlite --out rows.csv", 0);
    bench.check("export run.sqlite --out rows.parquet", 0);
    let rows = std::fs::read_to_string(bench.path("rows.csv")).unwrap().lines().count() - 1;
    let simulations = bench.json("show . --json", 0)[0]["simulations"].as_u64().unwrap();
    assert_eq!(rows as u64, simulations);
    let bytes = std::fs::read(bench.path("rows.parquet")).unwrap();
    assert!(bytes.starts_with(b"PAR1") && bytes.ends_with(b"PAR1"));
    bench.refuses("export run.sqlite --out rows.csv", &["rows.csv exists already", "--force"]);
    bench.check("export run.sqlite --out rows.csv --force", 0);
    bench.refuses("export run.sqlite --out rows.txt", &["rows.txt", ".csv or .parquet"]);
}

#[test]
fn an_output_never_replaces_an_input_or_a_run_file() {
    let bench = Bench::new();
    // A run file may have any name.
    bench.check("evaluate toy/noisy --episodes 7 --out a.csv", 0);
    bench.check("evaluate toy/noisy --episodes 7 --out b.png", 0);
    std::fs::hard_link(bench.path("a.csv"), bench.path("linked.csv")).unwrap();
    let bytes = std::fs::read(bench.path("a.csv")).unwrap();
    for command in [
        "export a.csv --out a.csv --force",
        "export a.csv --out linked.csv --force",
        "report a.csv -k report.simulations=false --out a.csv --force",
        "render b.png --out b.png --force",
    ] {
        bench.refuses(command, &["the same file as the input"]);
    }
    bench.refuses("render point-reaching --out b.png --force", &["b.png is a run file"]);
    bench.refuses("report b.png -k report.simulations=false --out a.csv --force", &["a.csv is a run file"]);
    assert_eq!(std::fs::read(bench.path("a.csv")).unwrap(), bytes);
    bench.check("show a.csv b.png", 0);
}

#[test]
fn the_folder_of_a_new_run_is_created_and_removed_after_an_error() {
    let bench = Bench::new();
    bench.check("evaluate toy/noisy --episodes 2 --out new/folder/a.sqlite", 0);
    bench.check("show new/folder", 0);
    bench.refuses("evaluate toy/noisi --episodes 2 --out other/a.sqlite", &["toy/noisi"]);
    assert!(!bench.path("other").exists());
    bench.write("file", "");
    bench.refuses("evaluate toy/noisy --episodes 2 --out file/a.sqlite", &["cannot write", "file"]);
}
