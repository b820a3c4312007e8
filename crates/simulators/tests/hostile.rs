//! Simulators that do what none should: no answer is a verdict on another question, and the next
//! simulation has a process that works.

use std::time::{Duration, Instant};

use crate::tank::{controlled, folder, levels, simulator, tank};
use mishandle_rollout::{Episode, EpisodeEnd, RolloutError, Target};

/// Simulates one after the other, so that the order of the questions is known.
fn in_order(target: &Target, starts: &[f64]) -> Vec<Episode> {
    starts.iter().map(|level| levels(target, &[*level]).expect("an episode").remove(0)).collect()
}

/// Simulates a level of 2, at which the simulator misbehaves, between levels of 1 and 3, at which
/// it does not. Returns the end and the reason of the simulation in the middle.
#[track_caller]
fn misbehaving(changes: &str) -> (EpisodeEnd, String) {
    let folder = folder(changes);
    let found = in_order(&tank(folder.path(), 3.0), &[1.0, 2.0, 3.0, 3.0]);
    for (index, level) in [(0, 1.0), (2, 3.0), (3, 3.0)] {
        let Episode { end, trace, reason, .. } = &found[index];
        assert_eq!(*end, EpisodeEnd::Completed, "{reason}");
        assert_eq!(trace.column(0), [level; 6]);
    }
    assert_eq!(found[1].robustness(), None);
    (found[1].end, found[1].reason.clone())
}

const CRASHED: EpisodeEnd = EpisodeEnd::Crashed { step: 0 };
const TIMED_OUT: EpisodeEnd = EpisodeEnd::TimedOut { step: 0 };

/// Lines of a script that replace the answer to a level of 2.
fn instead(lines: &str) -> String {
    let lines = lines.replace('\n', "\n        ");
    format!(
        "def write(q, a):\n    if q['type'] == 'simulate' and q['scenario']['level'] == 2:\n        {lines}\n    else:\n        \
         print(json.dumps({{'id': q['id'], **a}}), flush=True)\n"
    )
}

#[test]
fn a_crash_is_a_crash_with_its_standard_error() {
    let (end, reason) = misbehaving(&instead("raise RuntimeError('the valve is stuck')"));
    assert_eq!(end, CRASHED);
    assert!(reason.contains("RuntimeError: the valve is stuck"), "{reason}");
    let (end, _) = misbehaving(&instead("os.kill(os.getpid(), signal.SIGSEGV)"));
    assert_eq!(end, CRASHED);
}

#[test]
fn silence_is_a_timeout_also_with_sigterm_ignored_and_the_output_closed_by_a_child() {
    let (end, reason) = misbehaving(&instead("time.sleep(60)"));
    assert_eq!(end, TIMED_OUT);
    assert!(reason.contains("within 3 s"), "{reason}");
    let (end, _) = misbehaving(&instead("signal.signal(signal.SIGTERM, signal.SIG_IGN)\nwhile True: pass"));
    assert_eq!(end, TIMED_OUT);
    // The child keeps the pipe open, so that its end is not seen.
    let (end, _) = misbehaving(&instead("subprocess.Popen(['sleep', '60'])\nos._exit(1)"));
    assert_eq!(end, TIMED_OUT);
}

#[test]
fn a_closed_output_is_a_crash() {
    let (end, _) = misbehaving(&instead("os.close(1)\ntime.sleep(60)"));
    assert_eq!(end, CRASHED);
}

#[test]
fn a_second_answer_ends_the_next_simulation_and_is_not_its_answer() {
    let folder = folder(&instead(
        "line = json.dumps({'id': q['id'], **a})\nnext = json.dumps({'id': q['id'] + 1, **a})\n\
         print(line + '\\n' + next, flush=True)",
    ));
    let target = tank(folder.path(), 5.0);
    let found = in_order(&target, &[2.0, 3.0, 3.0]);
    let ends: Vec<EpisodeEnd> = found.iter().map(|episode| episode.end).collect();
    assert_eq!(ends, [EpisodeEnd::Completed, CRASHED, EpisodeEnd::Completed]);
    assert!(found[1].reason.contains("question"), "{}", found[1].reason);
    assert_eq!(found[2].trace.column(0), [3.0; 6]);
}

#[test]
fn malformed_answers_are_crashes_that_say_what_is_wrong() {
    for (lines, expected) in [
        ("print('ready', flush=True)", "`ready`"),
        ("print(json.dumps({'id': 1, **a}), flush=True)", "the id 1 instead of"),
        ("sys.stdout.buffer.write(b'\\xff\\xfe\\n'); sys.stdout.flush()", "not UTF-8"),
        ("print('[' * 100000 + ']' * 100000, flush=True)", "expected an object"),
        (
            "print('{\"id\":%d,\"trace\":' % q['id'] + '{\"level\":' + '[' * 100000, flush=True)",
            "invalid type: sequence",
        ),
        ("a['trace']['level'][2] = float('nan')\nprint(json.dumps({'id': q['id'], **a}), flush=True)", "NaN"),
        ("a['trace']['level'] *= 100000\nprint(json.dumps({'id': q['id'], **a}), flush=True)", "more than 6"),
        ("a['trace'].pop('level')\nprint(json.dumps({'id': q['id'], **a}), flush=True)", "lacks the signal"),
    ] {
        let (end, reason) = misbehaving(&instead(lines));
        assert_eq!(end, CRASHED, "{lines}");
        assert!(reason.contains(expected) && reason.len() <= 2000, "{lines}: {reason}");
    }
}

#[test]
fn a_hundred_megabytes_are_read_up_to_the_first_number_too_many() {
    let lines = "sys.stdout.write('{\"id\":%d,\"trace\":{\"level\":[' % q['id'])\n\
                 for _ in range(100): sys.stdout.write('0.5,' * 262144)\n\
                 sys.stdout.write('0],\"inflow\":[0]}}\\n'); sys.stdout.flush()";
    let folder = folder(&instead(lines));
    let found = in_order(&tank(folder.path(), 60.0), &[2.0, 3.0]);
    assert_eq!(found[0].end, CRASHED);
    assert!(found[0].reason.contains("more than 6 numbers"), "{}", found[0].reason);
    assert_eq!(found[1].end, EpisodeEnd::Completed);
}

#[test]
fn another_description_at_a_restart_ends_the_run() {
    let folder = folder(
        "HELLO['version'] = str(len(os.listdir('.')))\nopen('started', 'a').close()\n\
         def simulate(q): os._exit(1)",
    );
    let target = tank(folder.path(), 5.0);
    let found = levels(&target, &[1.0]).expect("an episode");
    assert_eq!(found[0].end, CRASHED);
    let error = levels(&target, &[1.0]).expect_err("another description");
    assert!(matches!(&error, RolloutError::System(text) if text.contains("otherwise")), "{error}");
}

#[test]
fn a_program_that_no_longer_starts_crashes_each_simulation() {
    let folder = folder("def simulate(q): os._exit(1)");
    let target = tank(folder.path(), 5.0);
    assert_eq!(in_order(&target, &[1.0])[0].end, CRASHED);
    std::fs::remove_file(folder.path().join("sim.py")).expect("the script");
    let found = in_order(&target, &[1.0, 2.0]);
    assert!(found.iter().all(|episode| episode.end == CRASHED));
    assert!(found[0].reason.contains("No such file"), "{}", found[0].reason);
}

#[test]
fn wrong_descriptions_are_errors_before_the_first_simulation() {
    for (changes, expected) in [
        ("HELLO['steps'] = 10**9", "control steps"),
        ("HELLO['steps'] = -1", "invalid value"),
        ("HELLO['protocol'] = 2", "this program speaks 1"),
        ("HELLO['nane'] = 'tank'", "unknown field `nane`"),
        ("del HELLO['name']", "missing field `name`"),
        ("HELLO['control_dt'] = 0", "positive"),
        ("HELLO['signals'] = []", "no signals"),
        ("HELLO['signals'] *= 2", "two signals"),
        ("HELLO['axes'] *= 2", "two axes have this name"),
        ("HELLO['axes'][0]['low'] = 9", "whose `low` 9 is above its `high` 8"),
        ("HELLO['axes'][0]['kind'] = 'initial'", "must be start, model"),
        ("HELLO['axes'][0]['values'] = ['a', 'a']", "names and bounds"),
        ("HELLO['spaces'] = {'starts': ['depth']}", "the name of no axis"),
        ("HELLO['formulas'][0]['text'] = 'always(depth <= 1)'", "`low`"),
        ("HELLO['formulas'][0]['text'] = 'always[0:99](level <= 1)'", "`low`"),
        ("HELLO['formulas'][0]['name'] = 'safe'", "temporal operator"),
        ("HELLO['policy'] = POLICY; HELLO['mode'] = 'trace'", "policies in the mode `step`"),
        ("HELLO.update(mode='step', policy={**POLICY, 'action': []})", "0 numbers"),
        ("POLICY['observation'][0]['range'] = [1, 1]; HELLO['policy'] = POLICY", "the range of `level`"),
        ("HELLO['name'] = 'a\\nb'", "visible characters"),
        ("HELLO['time_limit'] = -1", "time limit"),
        ("HELLO['name'] = 'x' * 5000000", "bytes"),
        ("def write(q, a): print('{\"spaces\":{\"a\":' + '[' * 100000, flush=True)", "recursion limit"),
        ("HELLO = {'error': 'no license'}", "no license"),
        ("def answer(q): return {}", "missing field"),
        ("def write(q, a): print('hello', flush=True)", "`hello`"),
        ("sys.exit('no module named fmpy')", "no module named fmpy"),
    ] {
        let folder = folder(changes);
        let error = simulator(folder.path(), 5.0).expect_err(changes);
        let text = match std::error::Error::source(&error) {
            Some(source) => format!("{error}: {source}"),
            None => error.to_string(),
        };
        assert!(text.contains(expected), "{changes}: {text}");
        assert!(text.len() < 4000, "{changes}");
    }
}

#[test]
fn a_step_that_fails_names_its_control_step() {
    let folder = folder(
        "HELLO['mode'] = 'step'\nold = answer\ncount = 0\n\
         def answer(q):\n    global count\n    count = count + 1 if q['type'] == 'step' else 0\n    \
         if q['type'] == 'step' and count == 3 and level == 2: return {'error': 'dry'}\n    \
         if q['type'] == 'step' and count == 2 and level == 3: os._exit(3)\n    return old(q)",
    );
    let found = in_order(&tank(folder.path(), 5.0), &[1.0, 2.0, 3.0, 1.0]);
    let ends: Vec<EpisodeEnd> = found.iter().map(|episode| episode.end).collect();
    let expected = [
        EpisodeEnd::Completed,
        EpisodeEnd::Crashed { step: 3 },
        EpisodeEnd::Crashed { step: 2 },
        EpisodeEnd::Completed,
    ];
    assert_eq!(ends, expected);
    assert_eq!(found[1].reason, "dry");
}

#[test]
fn a_wrong_size_of_an_observation_is_a_crash() {
    let folder = folder(
        "HELLO['policy'] = POLICY\nold = answer\n\
         def answer(q):\n    a = old(q)\n    if q['type'] == 'reset': a['observation'] = [1, 2]\n    return a",
    );
    let found = levels(&controlled(folder.path(), "action = 0"), &[1.0]).expect("an episode");
    assert_eq!(found[0].end, CRASHED);
    assert!(found[0].reason.contains("a list of more than 1 numbers"), "{}", found[0].reason);
}

#[test]
fn the_processes_end_with_the_target() {
    let folder = folder("open('pid', 'w').write(str(os.getpid()))");
    let target = tank(folder.path(), 5.0);
    levels(&target, &[1.0]).expect("an episode");
    let pid = std::fs::read_to_string(folder.path().join("pid")).expect("a number");
    let path = format!("/proc/{pid}");
    assert!(std::path::Path::new(&path).exists());
    drop(target);
    let start = Instant::now();
    while std::path::Path::new(&path).exists() && start.elapsed() < Duration::from_secs(600) {
        std::thread::sleep(Duration::from_millis(10));
    }
    assert!(!std::path::Path::new(&path).exists());
}
