//! Keys of plans on the command line: `-k KEY=VALUE`.

use mishandle::plan::{Settings, Values, keys, set};
use mishandle::store::RunFile;

use crate::bench::{Bench, text};

/// A value of each key, as text.
fn value(name: &str, allowed: &str) -> String {
    let quoted = allowed.split('"').nth(1).map(String::from);
    let number = allowed.split(' ').find(|word| word.parse::<f64>().is_ok()).map(String::from);
    match name {
        "format" => "2".to_string(),
        "compare.robustness-bounds" => "[-0.5, 0.5]".to_string(),
        "harden.searches" => "[\"portfolio\"]".to_string(),
        "harden.allow" => "[\"strict\"]".to_string(),
        "record.camera" => "[\"over\"]".to_string(),
        "record.size" => "[96, 64]".to_string(),
        "render.image-size" => "[64, 64]".to_string(),
        "regress.rate" => "0.95".to_string(),
        _ if allowed == "true or false" => "true".to_string(),
        _ if allowed.contains(" number") || allowed.contains("integer") => number.unwrap_or("1".to_string()),
        _ => quoted.unwrap_or("a".to_string()),
    }
}

#[test]
fn every_key_can_be_set() {
    for key in keys() {
        let mut table = toml::Table::new();
        let (name, text) = match key.name.as_str() {
            "axes" => ("axes.x".to_string(), "0.2:0.3".to_string()),
            "requirements" => ("requirements.near".to_string(), "always(x <= 1)".to_string()),
            "falsify.options" => ("falsify.options.xatol".to_string(), "1e-6".to_string()),
            "log.topics" => ("log.topics.arm".to_string(), "arm.csv".to_string()),
            "formula.resolution" => ("formula.resolution.limit".to_string(), "0.1".to_string()),
            "risk.distributions" => ("risk.distributions.x".to_string(), "normal:1:0.1".to_string()),
            "metamorphic.relations" => {
                ("metamorphic.relations.shift.change.x".to_string(), "+0.02".to_string())
            }
            name => (name.to_string(), value(name, key.allowed)),
        };
        set(&mut table, &name, &text, Values::One).unwrap();
        Settings::take(&mut table).unwrap();
        mishandle::Plan::from_toml(&table.to_string()).unwrap();
    }
}

#[test]
fn a_key_sets_what_a_plan_and_a_flag_set() {
    let bench = Bench::new();
    bench.write(
        "plan.toml",
        "[falsify]\nsearch = \"random\"\ntrials = 2\nbudget = 20\nearly-stopping = true\n",
    );
    let plan = |arguments: &str, file: &str| {
        bench.run(&format!("falsify toy/sphere-2d --seed 3 {arguments} --out {file}"));
        RunFile::open(bench.path(file)).unwrap().header().plan.clone()
    };
    let of_file = plan("--plan plan.toml", "file.sqlite");
    let of_flags =
        plan("--search random --trials 2 --budget 20 -k falsify.early-stopping=true", "flags.sqlite");
    let of_keys = plan(
        "-k falsify.search=random -k falsify.trials=2 -k falsify.budget=2e1 -k falsify.early-stopping=true",
        "keys.sqlite",
    );
    assert_eq!(of_file, of_flags);
    assert_eq!(of_file, of_keys);
    // A key of text takes the text as it stands, and the largest seed is a text in a plan.
    let formula = "always(distance >= 0.1)";
    let seed = u64::MAX.to_string();
    let of_text = plan(
        &format!("--plan plan.toml -k 'falsify.formula={formula}' -k falsify.fixed-seed={seed}"),
        "t.sqlite",
    );
    assert!(of_text.contains(&format!("formula = \"{formula}\"")), "{of_text}");
    assert!(of_text.contains(&format!("fixed-seed = \"{seed}\"")), "{of_text}");
}

#[test]
fn a_wrong_key_or_value_is_an_error_that_says_what_is_right() {
    let bench = Bench::new();
    for (arguments, parts) in [
        ("-k falsify.trails=3", vec!["there is no key `falsify.trails`", "did you mean `falsify.trials`?"]),
        ("-k trials=3", vec!["there is no key `trials`", "did you mean `falsify.trials`?"]),
        ("-k falsify.trials=many", vec!["`falsify.trials` is many", "an integer from 1 to 1000000"]),
        ("-k 'falsify.trials=2\nbudget = 3'", vec!["`falsify.trials` is 2"]),
        ("-k falsify.keep-going=1", vec!["`falsify.keep-going` is 1", "true or false"]),
        (
            "-k evaluate.episodes=3",
            vec!["evaluate.episodes is a key of the table evaluate", "`mishandle falsify`", "screening"],
        ),
        (
            "-k falsify.trials=3 --trials 4",
            vec!["falsify.trials is set twice", "-k falsify.trials=3", "--trials"],
        ),
        ("-k falsify.trials=3 -k falsify.trials=4", vec!["falsify.trials is set twice"]),
        ("-k falsify.trials", vec!["expected KEY=VALUE, such as falsify.early-stopping=true"]),
        ("-k falsify=3", vec!["there is no key `falsify`"]),
    ] {
        bench.refuses(&format!("falsify toy/sphere-2d {arguments}"), &parts);
    }
}

#[test]
fn an_empty_list_makes_no_grid() {
    let bench = Bench::new();
    bench.write("plan.toml", "target = \"toy/sphere-2d\"\n[falsify]\ntrials = 1\n");
    for key in ["seed", "target", "falsify.batch"] {
        bench.refuses(&format!("run plan.toml -k '{key}=[]'"), &[key, "[]", "a list of values"]);
    }
}

#[test]
fn the_help_and_the_completion_of_a_command_list_its_keys() {
    let bench = Bench::new();
    let help = bench.check("risk --help", 0);
    assert!(help.contains("risk.simulations") && help.contains("[default: 50000]"), "{help}");
    assert!(!help.contains("falsify.trials"), "{help}");
    assert!(!bench.check("risk -h", 0).contains("risk.batch"));
    let completion = text(&bench.run("completions bash").stdout);
    assert!(completion.contains("falsify.early-stopping="), "bash");
}
