//! `mishandle campaign`: a grid of runs in a folder.

#![allow(clippy::unwrap_used)]

mod bench;

use bench::Bench;
use mishandle::store::RunFile;
use serde_json::Value;

const CAMPAIGN: &str = "target = 'toy/sphere-2d'\nseed = [1, 2]\n[falsify]\nsearch = ['random', 'nelder-mead']\ntrials = 2\n\
                        budget = 30\n[evaluate]\nepisodes = 20\n";

fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("campaign.toml", CAMPAIGN);
    bench
}

#[test]
fn the_runs_of_a_campaign_have_the_rows_of_single_runs() {
    let bench = bench();
    let printed = bench.check("campaign campaign.toml --out runs/all", 1);
    let single = "falsify toy/sphere-2d --seed 2 --search nelder-mead --trials 2 --budget 30 --no-isolate --out single.sqlite";
    bench.check(single, 1);
    let digest = |path| RunFile::open(bench.path(path)).unwrap().content_digest().unwrap();
    assert_eq!(digest("runs/all/2_nelder-mead_falsify.sqlite"), digest("single.sqlite"));
    let rows = |kind| printed.lines().filter(|line| line.contains(kind)).count();
    assert_eq!((rows("_falsify"), rows("_evaluate")), (4, 2), "{printed}");
}

#[test]
fn a_resumed_campaign_prints_the_same_results_and_needs_all_its_files() {
    let bench = bench();
    let whole = bench.check("campaign campaign.toml --out all --json", 1);
    assert_eq!(bench.check("campaign --resume all --json", 1), whole);
    let document: Value = serde_json::from_str(&whole).unwrap();
    assert_eq!(document["is_complete"], true);
    assert_eq!(document["runs"].as_array().unwrap().len(), 6);
    let path = bench.path("all/2_evaluate.sqlite");
    std::fs::copy(bench.path("all/1_evaluate.sqlite"), &path).unwrap();
    bench.refuses(
        "campaign --resume all",
        &["2_evaluate.sqlite is not the run file", "the run file was replaced"],
    );
    std::fs::remove_file(&path).unwrap();
    std::os::unix::fs::symlink(bench.path("all/1_evaluate.sqlite"), &path).unwrap();
    bench.refuses("campaign --resume all", &["it is a symbolic link"]);
    std::fs::remove_file(&path).unwrap();
    bench.refuses("campaign --resume all", &["is not the folder of a campaign", "2_evaluate.sqlite"]);
    // A link to any file of the user, whose content must not be printed.
    bench.write("secret", "password: hunter2");
    std::fs::remove_file(bench.path("all/campaign.toml")).unwrap();
    std::os::unix::fs::symlink(bench.path("secret"), bench.path("all/campaign.toml")).unwrap();
    bench.refuses(
        "campaign --resume all",
        &["campaign.toml: expected a regular file, but it is a symbolic link"],
    );
    assert!(!String::from_utf8_lossy(&bench.run("campaign --resume all").stderr).contains("hunter2"));
}

#[test]
fn mistakes_are_reported_before_the_folder_is_created() {
    let bench = bench();
    for (campaign, message) in [
        ("target = ['toy/sphere-2d', 'toy/sfere']\n[falsify]\n", "there is no target `toy/sfere`"),
        ("target = 'toy/sphere-2d'\n[falsify]\nformula = ['success', 'succes']\n", "`succes`"),
        ("target = 'toy/sphere-2d'\n[falsify]\nserch = 'random'\n", "did you mean `falsify.search`?"),
        ("target = 'toy/sphere-2d'\n", "[falsify]"),
    ] {
        bench.write("wrong.toml", campaign);
        bench.refuses("campaign wrong.toml --out wrong", &["wrong.toml", message]);
        assert!(!bench.path("wrong").exists());
    }
    bench.refuses("campaign missing.toml", &["missing.toml"]);
    bench.refuses("campaign --resume .", &["is not the folder of a campaign"]);
    bench.check("campaign campaign.toml --out all", 1);
    bench.refuses("campaign campaign.toml --out all", &["all exists already", "--resume"]);
}
