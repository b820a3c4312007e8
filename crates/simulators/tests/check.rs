//! The check of the protocol: a simulator that keeps it passes, and one that breaks a rule fails at
//! that rule.

use crate::tank::folder;
use mishandle_results::ProtocolCheck;
use mishandle_simulators::{check, program};

fn checked(changes: &str) -> ProtocolCheck {
    let folder = folder(changes);
    check(program("python3 sim.py", folder.path().to_path_buf()).expect("a command"), None)
}

#[test]
fn simulators_that_keep_the_protocol_pass_in_both_modes() {
    for changes in [
        "",
        "HELLO['mode'] = 'step'",
        "HELLO['policy'] = POLICY",
        "HELLO['seeded'] = True\nimport random\n\
         def simulate(q): return {'trace': {'level': [random.Random(q['seed']).random()] * 6, 'inflow': [0] * 6}}",
        "HELLO['deterministic'] = False\nimport random\n\
         def simulate(q): return {'trace': {'level': [random.random()] * 6, 'inflow': [0] * 6}}",
        // It rejects a scenario in the way that the protocol has for it.
        "def simulate(q): return {'trace': trace(q)} if q['scenario']['level'] < 8 else {'end': 'invalid'}",
    ] {
        let found = checked(changes);
        assert!(found.passed, "{changes}: {:?}", found.checks);
        assert_eq!(found.name.as_deref(), Some("tank"));
        assert!(found.start_seconds > Some(0.0) && found.simulation_seconds > Some(0.0));
        assert_eq!(found.step_seconds.is_some(), changes.contains("step") || changes.contains("POLICY"));
    }
}

#[test]
fn each_broken_rule_fails_its_check_with_a_way_out() {
    let stateful = "count = 0\ndef simulate(q):\n    global count\n    count += 1\n    ";
    for (changes, failing, advice) in [
        ("sys.exit(1)".to_string(), "hello", "ended"),
        ("HELLO['formulas'] = []".to_string(), "hello", "give one with each question"),
        ("HELLO['control_dt'] = 1e308".to_string(), "hello", "an episode of"),
        ("def simulate(q): return {'error': 'no'}".to_string(), "nominal", "the error `no`"),
        (
            "def simulate(q): return {'trace': {'level': [0, None, 0, 0, 0, 0], 'inflow': [0] * 6}}".to_string(),
            "nominal",
            "null at sample 1",
        ),
        (
            "def simulate(q): return {'trace': trace(q)} if q['scenario']['level'] < 8 else 1 / 0".to_string(),
            "corners",
            "level = 8: ",
        ),
        (
            format!("{stateful}return {{'trace': {{'level': [count] * 6, 'inflow': [0] * 6}}}}"),
            "repeat",
            "deterministic",
        ),
        (
            "def simulate(q):\n    global before\n    found = {'trace': {'level': [globals().get('before', 1)] * 6, 'inflow': [0] * 6}}\n    \
             before = q['scenario']['level']\n    return found"
                .to_string(),
            "order",
            "initialize all of the state",
        ),
        (
            "def simulate(q): return {'trace': {'level': [float(q['seed'])] * 6, 'inflow': [0] * 6}}".to_string(),
            "seeds",
            "`\"seeded\": true`",
        ),
        ("HELLO['seeded'] = True".to_string(), "seeds", "`\"seeded\": false`"),
        (
            "old = answer\ndef answer(q): return old(q) if q['type'] in ('hello', 'simulate') else 1 / 0".to_string(),
            "unknown",
            "unknown type",
        ),
        (
            "old = answer\ndef answer(q): return old(q) if q['type'] in ('hello', 'simulate') else {}".to_string(),
            "unknown",
            "unknown type",
        ),
        ("HELLO['version'] = str(os.getpid())".to_string(), "process", "otherwise"),
        (
            "def simulate(q): return {'trace': {'level': [os.getpid()] * 6, 'inflow': [0] * 6}}".to_string(),
            "process",
            "a second process",
        ),
        (
            // Prints while it waits for the next question.
            "import threading\ntimer = threading.Timer(0, lambda: 0)\nold = answer\n\
             def answer(q):\n    timer.cancel()\n    return old(q)\n\
             def write(q, a):\n    global timer\n    print(json.dumps({'id': q['id'], **a}), flush=True)\n    \
             timer = threading.Timer(0.05, lambda: print('done', flush=True))\n    timer.start()"
                .to_string(),
            "output",
            "standard error",
        ),
        (
            "import atexit\natexit.register(lambda: time.sleep(5))".to_string(),
            "end",
            "end the loop",
        ),
    ] {
        let found = checked(&changes);
        let check = found.checks.iter().find(|check| check.check == failing);
        let check = check.unwrap_or_else(|| panic!("{changes}: no check {failing} in {:?}", found.checks));
        assert!(!found.passed && !check.passed, "{changes}: {:?}", found.checks);
        assert!(check.finding.contains(advice), "{changes}: {}", check.finding);
        assert!(!check.finding.contains('\n'), "{}", check.finding);
    }
}
