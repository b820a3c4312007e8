//! The attacks of docs/reference/security.md on the command line: files that are not files, names
//! with escape sequences, planted links and planted folders.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::Command;

use crate::bench::{Bench, SMALL, text};
use mishandle::controllers::ControllerFile;
use mishandle::store::{IfExists, RunFile, RunWriter, Simulation};

/// Sets the title of the window, clears the screen, and reverses the order of the characters that
/// follow.
const HOSTILE: &str = "\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}";

/// Runs the program for at most two minutes of processor time, and returns stdout and stderr
/// together.
#[track_caller]
fn run(command: &mut Command, code: i32) -> String {
    let mut limited = Command::new("sh");
    limited
        .args(["-c", "ulimit -t 120; exec \"$@\"", "sh"])
        .arg(command.get_program())
        .args(command.get_args());
    limited.current_dir(command.get_current_dir().unwrap());
    command.get_envs().for_each(|(name, value)| {
        limited.env(name, value.unwrap());
    });
    let output = limited.output().unwrap();
    let all = text(&output.stdout) + &text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{command:?}: {all}");
    all
}

/// Checks that a terminal shows the text as it is.
#[track_caller]
fn check_printable(text: &str) {
    let hostile = |c: char| (c.is_control() && c != '\n') || c == '\u{202e}';
    assert!(!text.contains(hostile), "{text:?}");
}

/// Creates what an attacker may put in place of a file: path and message of each.
fn not_files(bench: &Bench) -> [(String, &'static str); 5] {
    let fifo = bench.path("fifo.toml");
    assert!(Command::new("mkfifo").arg(&fifo).status().unwrap().success());
    std::fs::create_dir(bench.path("folder.toml")).unwrap();
    symlink("/dev/zero", bench.path("link.toml")).unwrap();
    std::fs::File::create(bench.path("sparse.toml")).unwrap().set_len(1 << 40).unwrap();
    [
        ("/dev/zero", "expected a regular file, found a device"),
        ("./link.toml", "expected a regular file, found a device"),
        ("./fifo.toml", "expected a regular file, found a FIFO"),
        ("./folder.toml", "expected a regular file, found a directory"),
        ("./sparse.toml", "the file has 1099511627776 bytes; the limit is "),
    ]
    .map(|(path, message)| (path.to_string(), message))
}

#[test]
fn devices_pipes_folders_and_sparse_files_are_refused_at_once() {
    let bench = Bench::new();
    let train = "train point-reaching --out a.safetensors --steps 256";
    for (path, message) in not_files(&bench) {
        for arguments in [
            format!("evaluate --plan {path}"),
            format!("evaluate point-reaching --controller {path}"),
            format!("{train} --settings {path}"),
        ] {
            let printed = run(&mut bench.command(&arguments), 2);
            assert!(printed.contains(message), "{arguments}: {printed}");
        }
        // A path that ends with .json is a counterexample, any other a run file.
        let counterexample = bench.path("a.json");
        symlink(bench.path(&path), &counterexample).unwrap();
        // A folder shows its run files, whatever its name is.
        let is_folder = bench.path(&path).is_dir();
        let commands = ["replay a.json", "regress .", "show a.json"];
        for command in &commands[..if is_folder { 2 } else { 3 }] {
            let printed = run(&mut bench.command(command), 2);
            assert!(printed.contains(message), "{command} {path}: {printed}");
        }
        std::fs::remove_file(&counterexample).unwrap();
        // A path that ends with .safetensors is a controller.
        if !is_folder {
            let controller = bench.path("a.safetensors");
            symlink(bench.path(&path), &controller).unwrap();
            let printed = run(&mut bench.command("show a.safetensors"), 2);
            assert!(printed.contains(message), "controller {path}: {printed}");
            std::fs::remove_file(&controller).unwrap();
        }
        // A path that ends with .csv is a learning curve for `report`; a folder is a campaign.
        if !is_folder {
            let curve = bench.path("a.csv");
            symlink(bench.path(&path), &curve).unwrap();
            let printed = run(&mut bench.command("report a.csv --out a.html"), 2);
            assert!(printed.contains(message), "curve {path}: {printed}");
            std::fs::remove_file(&curve).unwrap();
        }
        // A checkpoint is found by its name.
        let checkpoint = bench.path("a.safetensors.checkpoint");
        symlink(bench.path(&path), &checkpoint).unwrap();
        let printed = run(&mut bench.command(&format!("{train} --resume")), 2);
        assert!(printed.contains(message), "checkpoint {path}: {printed}");
        std::fs::remove_file(&checkpoint).unwrap();
    }
}

#[test]
fn escape_sequences_in_files_names_and_arguments_do_not_reach_the_terminal() {
    let bench = Bench::new();
    let mut file = mishandle::resolve::find_controller("point-reaching/ppo").unwrap().controller().unwrap();
    let header = &mut file.header;
    header.algorithm = format!("ppo{HOSTILE}");
    header.training.command = format!("first{HOSTILE}\nsecond");
    header.training.settings = format!("# {HOSTILE}\n");
    header.training.git_commit = HOSTILE.to_string();
    let save = |file: &ControllerFile, name: &str| file.save(&bench.path(name)).unwrap();
    save(&file, "a.safetensors");
    let page = run(&mut bench.command("show ./a.safetensors"), 0);
    check_printable(&page);
    assert!(page.contains(r"\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}\nsecond"), "{page}");
    let json = run(&mut bench.command("show ./a.safetensors --json"), 0);
    check_printable(&json);
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["command"], format!("first{HOSTILE}\nsecond"));
    file.header.task = format!("cube{HOSTILE}");
    save(&file, "b.safetensors");
    let printed = run(&mut bench.command("evaluate point-reaching --controller ./b.safetensors"), 2);
    check_printable(&printed);
    assert!(printed.contains(r"trained for cube\u{1b}]0;owned"), "{printed}");

    bench.write("name.toml", "target = \"\\u001b]0;owned\\u0007\\u202e\\nerror: the disk is empty\"\n");
    bench.write("quoted.toml", &format!("target = \"a\"\nsecret {HOSTILE} = 1\n"));
    bench.write("settings.toml", &format!("\"{}\" = 1\n", r"\u001b]0;owned\u0007"));
    for arguments in [
        vec!["evaluate", "--plan", "name.toml"],
        vec!["evaluate", "--plan", "quoted.toml"],
        vec!["evaluate", "--plan", &format!("{HOSTILE}.toml")],
        vec!["train", "point-reaching", "--settings", "settings.toml"],
        vec!["replay", &format!("{HOSTILE}.sqlite")],
        vec!["report", &format!("{HOSTILE}\nerror: the disk is empty.csv"), "--out", "a.html"],
        vec!["monitor", "--formula", "x > 0", &format!("{HOSTILE}.csv")],
        vec!["monitor", "--formula", HOSTILE, "a.csv"],
        vec!["evaluate", HOSTILE, "--controller", "expert"],
        vec![HOSTILE],
        vec!["evaluate", &format!("--{HOSTILE}")],
    ] {
        let printed = run(bench.command("").args(&arguments), 2);
        check_printable(&printed);
        assert!(printed.contains("owned"), "{arguments:?}: {printed}");
        // A line break in a name cannot pose as a message of its own.
        assert!(!printed.lines().any(|line| line.starts_with("error: the disk")), "{printed}");
    }
}

#[test]
fn a_planted_lock_file_does_not_harm_the_file_that_it_points_to() {
    let bench = Bench::new();
    bench.write("small.toml", SMALL);
    bench.write("precious", "precious");
    for (link, target) in [("a.safetensors.lock", "precious"), ("b.last.safetensors.lock", "new")] {
        symlink(bench.path(target), bench.path(link)).unwrap();
    }
    for out in ["a.safetensors", "b.safetensors"] {
        let arguments = format!("train point-reaching --settings small.toml --out {out}");
        let printed = run(&mut bench.command(&arguments), 2);
        assert!(printed.contains("expected a regular file, found a symbolic link"), "{printed}");
    }
    assert_eq!(std::fs::read(bench.path("precious")).unwrap(), b"precious");
    assert!(!bench.path("new").exists() && !bench.path("a.safetensors").exists());
}

#[test]
fn folders_in_the_working_directory_do_not_replace_the_shipped_files() {
    let bench = Bench::new();
    let other = mishandle::resolve::find_controller("cube-stacking/ppo").unwrap().controller().unwrap();
    let plant = |path: &str| {
        std::fs::create_dir_all(bench.path(path).parent().unwrap()).unwrap();
        other.save(&bench.path(path)).unwrap();
    };
    let hash = |arguments: &str| bench.json(arguments, 0)["controller_hash"].clone();
    let page = || hash("show point-reaching/ppo --json");
    let evaluate = |name: &str, out: &str| {
        hash(&format!("evaluate point-reaching --controller {name} --episodes 1 --json --out {out}"))
    };
    let shipped = page();
    let used = evaluate("ppo", "before.sqlite");
    assert_eq!(shipped, used);
    assert_eq!(evaluate("point-reaching/ppo", "before-2.sqlite"), used);
    plant("controllers/point-reaching/ppo.safetensors");
    plant("point-reaching/ppo");
    plant("ppo");
    plant("ppo.safetensors");
    std::fs::create_dir_all(bench.path("controllers/training/point-reaching")).unwrap();
    bench.write("controllers/training/point-reaching/ppo.toml", "no setting = 1");
    assert_eq!((page(), evaluate("ppo", "after.sqlite")), (shipped, used.clone()));
    assert_eq!(evaluate("point-reaching/ppo", "after-2.sqlite"), used);
    bench.refuses("evaluate point-reaching --controller cube-stacking/ppo", &["trained for cube-stacking"]);
    bench.refuses("evaluate point-reaching --controller cube-stacking/expert", &["a controller of the task"]);
    bench.check("train point-reaching --dry-run", 0);
    // Its path selects the file, which is for another task.
    bench
        .refuses("evaluate point-reaching --controller ./point-reaching/ppo", &["trained for cube-stacking"]);
}

#[test]
fn a_controller_is_not_written_to_a_file_with_another_extension() {
    let bench = Bench::new();
    bench.refuses(
        "train point-reaching --out x.txt",
        &["the output file is x.txt; it must be a path that ends in .safetensors"],
    );
    bench.refuses("train point-reaching --out x --dry-run", &["the output file is x; it must be"]);
    assert!(Path::new(&bench.path("x.txt")).symlink_metadata().is_err());
}

#[test]
fn deeply_nested_and_long_plans_are_errors_within_seconds() {
    let bench = Bench::new();
    let many = |text: &str, count: usize| text.repeat(count);
    for (name, plan) in [
        ("arrays", format!("a = {}{}", many("[", 500_000), many("]", 500_000))),
        ("tables", format!("a = {}1{}", many("{a=", 200_000), many("}", 200_000))),
        ("keys", format!("{}a = 1", many("a.", 500_000))),
        ("headers", many("[a.a]\n", 150_000)),
        ("strings", format!("target = \"{}\"", many("x", 1_000_000))),
        (
            "options",
            format!(
                "target = \"toy/sphere-2d\"\n[falsify.options]\n{}",
                (0..60_000).map(|i| format!("a{i}=1\n")).collect::<String>()
            ),
        ),
        ("quotes", many("\"", 1_000_000)),
    ] {
        bench.write(&format!("{name}.toml"), &plan);
        let printed = run(&mut bench.command(&format!("falsify --plan {name}.toml")), 2);
        assert!(printed.starts_with("error: "), "{name}: {}", &printed[..200.min(printed.len())]);
    }
}

/// A run file with valid hashes can have texts of any length. None of them fills a line: a name is
/// cut, and of other texts the middle is left out.
#[test]
fn no_text_of_a_forged_run_fills_a_line() {
    /// A run file limits names, and no unit or meaning.
    const NAME: usize = 1900;
    const LONG: usize = 60_000;
    /// The longest part of a text that is shown.
    const MOST: usize = 1000;
    let bench = Bench::new();
    bench.check("falsify toy/car-following --formula 'always(gap >= 20)' --out honest.sqlite", 1);
    let honest = RunFile::open(bench.path("honest.sqlite")).unwrap();
    let rows = honest.simulations().map(|row| {
        let row = row.unwrap();
        honest.simulation(row.trial, row.number).unwrap()
    });
    let rows: Vec<Simulation> = rows.collect();
    let [name, long] = [NAME, LONG].map(|count| "Ж".repeat(count));
    let mut header = honest.header().clone();
    for axis in &mut header.axes {
        axis.name += &name;
        (axis.unit, axis.meaning) = (long.clone(), long.clone());
    }
    header.signals.iter_mut().for_each(|signal| signal.unit.clone_from(&long));
    header.components.iter_mut().for_each(|component| component.name.clone_from(&name));
    for text in [&mut header.target.name, &mut header.space, &mut header.search] {
        text.clone_from(&name);
    }
    let mut writer = RunWriter::create(bench.path("forged.sqlite"), &header, IfExists::Refuse).unwrap();
    for summary in honest.trials().unwrap() {
        let trial = summary.trial;
        writer.start_trial(trial.number, trial.seed).unwrap();
        let own = rows.iter().filter(|row| row.trial == trial.number).cloned();
        writer.record(&own.collect::<Vec<_>>()).unwrap();
        writer.end_trial(trial.number, trial.status).unwrap();
    }
    writer.close().unwrap();
    for arguments in [
        "show forged.sqlite",
        "show forged.sqlite --verbose",
        "show forged.sqlite --simulation first",
        "show forged.sqlite honest.sqlite",
        "replay forged.sqlite",
        "compare forged.sqlite honest.sqlite",
        "compare forged.sqlite honest.sqlite --exact",
        "report forged.sqlite --out page.html --markdown page.md",
        "regress --add forged.sqlite --out failure.json",
        "falsify --resume forged.sqlite",
    ] {
        let output = bench.run(arguments);
        let mut shown = text(&output.stdout) + &text(&output.stderr);
        assert!(!shown.is_empty(), "{arguments}");
        for file in ["page.html", "page.md"] {
            shown += &std::fs::read_to_string(bench.path(file)).unwrap_or_default();
        }
        let longest = shown.split(|c| c != 'Ж').map(|run| run.chars().count()).max().unwrap();
        assert!(longest <= MOST, "{arguments}: {longest} characters");
        let line = shown.lines().map(|line| line.chars().filter(|c| *c == 'Ж').count()).max().unwrap();
        assert!(line <= 3 * MOST, "{arguments}: {line} characters in a line");
    }
}
