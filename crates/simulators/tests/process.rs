//! Programs that answer, and programs that misbehave.

use std::ops::ControlFlow;
use std::process::Stdio;
use std::time::{Duration, Instant};

use mishandle_simulators::process::{Failure, Job, Peer, Program};

const LIMIT: Duration = Duration::from_secs(20);

fn go_on() -> ControlFlow<()> {
    ControlFlow::Continue(())
}

fn shell(script: &str) -> Peer {
    let words = ["sh", "-c", script].map(String::from).to_vec();
    Peer::start(&Program { words, folder: "/".into() }).expect("the shell starts")
}

fn error(script: &str, limit: Duration) -> Failure {
    shell(script).ask("question", limit).expect_err("the script does not answer")
}

#[test]
fn an_answer_is_the_line_after_its_question() {
    let mut peer = shell(r#"while read -r line; do echo "$line!"; done"#);
    for question in ["1", "", "a longer one", "µ"] {
        assert_eq!(peer.ask(question, LIMIT).expect("an answer"), format!("{question}!"));
    }
}

#[test]
fn an_answer_in_pieces_is_one_line() {
    let script = "read -r line; printf 'o'; sleep 0.1; printf 'ne'; sleep 0.1; echo; cat";
    assert_eq!(shell(script).ask("question", LIMIT).expect("an answer"), "one");
}

#[test]
fn a_question_longer_than_the_pipe_arrives() {
    let mut peer = shell("while read -r line; do echo ${#line}; done");
    let long = "x".repeat(1 << 20);
    assert_eq!(peer.ask(&long, LIMIT).expect("an answer"), (1 << 20).to_string());
}

#[test]
fn a_late_answer_is_not_read() {
    let mut peer = shell("read -r line; sleep 0.5; echo late; cat");
    assert!(matches!(peer.ask("1", Duration::from_millis(50)), Err(Failure::TimedOut { .. })));
    std::thread::sleep(Duration::from_millis(600));
    assert!(matches!(peer.ask("2", LIMIT), Err(Failure::Ended { .. })));
}

#[test]
fn a_second_answer_is_not_taken_for_the_next_one() {
    let mut peer = shell("while read -r line; do echo $line; echo again; done");
    assert_eq!(peer.ask("1", LIMIT).expect("an answer"), "1");
    std::thread::sleep(Duration::from_millis(200));
    assert!(matches!(peer.ask("2", LIMIT), Err(Failure::Malformed { .. })));
}

#[test]
fn each_failure_says_what_happened() {
    let start = Peer::start(&Program { words: vec!["no-such-program".into()], folder: "/".into() });
    assert!(start.err().expect("an error").to_string().contains("cannot start `no-such-program`"));
    let ended = error("echo because >&2; exit 3", LIMIT).to_string();
    assert!(ended.contains("ended before its answer") && ended.contains("because"), "{ended}");
    let late = error("sleep 60", Duration::from_millis(50)).to_string();
    assert!(late.contains("within 0.05 s"), "{late}");
    let bytes = error(r"read -r line; printf '\377\n'; cat", LIMIT).to_string();
    assert!(bytes.contains("not UTF-8"), "{bytes}");
    // It does not read, so that the pipe is full.
    let full = shell("sleep 60").ask(&"x".repeat(1 << 20), Duration::from_millis(100));
    assert!(matches!(full, Err(Failure::TimedOut { .. })));
}

#[test]
fn a_program_that_writes_many_errors_does_not_wait() {
    let script = "read -r line; head -c 10000000 /dev/zero | tr '\\0' 'x' >&2; echo done; cat";
    assert_eq!(shell(script).ask("question", LIMIT).expect("an answer"), "done");
}

#[test]
fn no_program_outlives_its_owner() {
    // The shell and its child ignore the end of their input.
    let mut peer = shell("read -r line; sleep 1000 & echo $!; wait");
    let child = peer.ask("question", LIMIT).expect("the number of a process");
    let is_running = || std::path::Path::new("/proc").join(&child).join("cwd").read_link().is_ok();
    assert!(is_running());
    drop(peer);
    let end = Instant::now() + 60 * LIMIT;
    while is_running() {
        assert!(Instant::now() < end, "process {child} is still running");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn no_program_outlives_a_killed_owner() {
    // The owner is this test in a process of its own, which starts a program that never ends.
    const OWNER: &str = "MISHANDLE_TEST_OWNER";
    if std::env::var_os(OWNER).is_some() {
        let mut peer = shell("read -r line; trap '' TERM HUP; echo $$; sleep 1000");
        println!("program {}", peer.ask("question", LIMIT).expect("the number of a process"));
        std::thread::sleep(LIMIT);
        return;
    }
    let mut owner = std::process::Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "process::no_program_outlives_a_killed_owner", "--nocapture"])
        .env(OWNER, "1")
        .stdout(Stdio::piped())
        .spawn()
        .expect("the owner starts");
    let output = std::io::BufReader::new(owner.stdout.take().expect("its output"));
    let line = std::io::BufRead::lines(output).map_while(Result::ok).find(|line| line.contains("program "));
    let program =
        line.as_deref().and_then(|line| line.split("program ").nth(1)).expect("a number").to_string();
    let is_running = || std::path::Path::new("/proc").join(&program).join("cwd").read_link().is_ok();
    assert!(is_running());
    owner.kill().expect("the owner is killed");
    owner.wait().expect("the end of the owner");
    let end = Instant::now() + 60 * LIMIT;
    while is_running() {
        assert!(Instant::now() < end, "process {program} is still running");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn a_program_that_reads_its_input_to_the_end_can_finish() {
    let file = std::env::temp_dir().join(format!("mishandle-process-{}", std::process::id()));
    let script = format!("read -r line; echo $line; cat; echo saved > {}", file.display());
    shell(&script).ask("question", LIMIT).expect("an answer");
    let saved = std::fs::read_to_string(&file);
    let _ = std::fs::remove_file(&file);
    assert_eq!(saved.expect("the file"), "saved\n");
}

#[test]
fn a_program_gets_its_whole_input_at_once() {
    let input = vec![b'x'; 1 << 24];
    let output = shell("wc -c; echo because >&2; exit 3").finish(&input, LIMIT, go_on).expect("an output");
    assert_eq!((output.code, output.stdout.trim()), (Some(3), "16777216"));
    assert_eq!(output.stderr, "because\n");
    // Its status counts, even if it reads nothing.
    assert!(shell("exit 0").finish(&input, LIMIT, go_on).expect("an output").code == Some(0));
}

#[test]
fn a_wait_for_a_program_ends_soon_after_an_interruption() {
    // The first waits with its input, the second with its output, the third with its end.
    for script in ["sleep 60", "cat > /dev/null; sleep 60", "exec <&- >&-; sleep 60"] {
        let mut questions = 0;
        let watch = || {
            questions += 1;
            if questions > 3 { ControlFlow::Break(()) } else { go_on() }
        };
        let start = Instant::now();
        let found = shell(script).finish(&[b'x'; 1 << 20], 10 * LIMIT, watch);
        assert!(matches!(found, Err(Failure::Interrupted)), "{script}: {found:?}");
        assert!(start.elapsed() < LIMIT, "{script}");
    }
}

#[test]
fn a_program_that_does_not_finish_is_ended() {
    let short = Duration::from_millis(100);
    for script in ["sleep 60", "cat > /dev/null; sleep 60", "exec <&- >&-; sleep 60"] {
        let found = shell(script).finish(&[b'x'; 1 << 20], short, go_on);
        assert!(matches!(found, Err(Failure::TimedOut { .. })), "{script}");
    }
    let found = shell("head -c 2000000 /dev/zero").finish(b"", LIMIT, go_on);
    assert!(matches!(found, Err(Failure::Malformed { .. })));
    assert!(matches!(shell(r"printf '\377'").finish(b"", LIMIT, go_on), Err(Failure::Malformed { .. })));
}

#[test]
fn a_working_folder_that_vanished_is_named() {
    let folder = std::env::temp_dir().join(format!("mishandle-gone-{}", std::process::id()));
    let words = ["sh", "-c", "cat"].map(String::from).to_vec();
    let error =
        Peer::start(&Program { words, folder: folder.clone() }).err().expect("no program").to_string();
    assert_eq!(error, format!("cannot start `sh`: its working folder {} does not exist", folder.display()));
}

#[test]
fn a_job_ends_with_its_status_or_with_its_owner() {
    let start = |script: &str| {
        let words = ["sh", "-c", script].map(String::from).to_vec();
        let streams = [Stdio::null(), Stdio::null(), Stdio::null()];
        Job::start(&Program { words, folder: "/".into() }, streams).expect("the shell starts")
    };
    let job = start("exit 3");
    assert!(job.wait(LIMIT));
    assert_eq!(job.status().expect("a status").code(), Some(3));
    // It may save something before it ends.
    let file = |name: &str| std::env::temp_dir().join(format!("mishandle-job-{name}-{}", std::process::id()));
    let [begins, saved] = ["begins", "saved"].map(file);
    let script = format!(
        "trap 'touch {}; exit' TERM; touch {}; while :; do sleep 0.02; done",
        saved.display(),
        begins.display()
    );
    let job = start(&script);
    while !begins.exists() {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!job.wait(Duration::from_millis(50)), "it runs");
    job.stop(LIMIT);
    std::fs::remove_file(&begins).expect("it began");
    std::fs::remove_file(&saved).expect("it saved something");
    // It and its children end at last.
    let ends = file("ends");
    let job = start(&format!("trap '' TERM; sleep 1000 & wait; sleep 1000; touch {}", ends.display()));
    job.stop(Duration::from_millis(100));
    assert!(!ends.exists());
}
