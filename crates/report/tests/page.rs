//! The page of an untrusted run file: its numbers, and hostile names.

use std::path::Path;

use mishandle::results::Hardening;
use mishandle::store::{
    AxisRecord, BuildRecord, ComponentRecord, FormulaRecord, IfExists, RunFile, RunHeader, RunKind,
    RunWriter, SignalRecord, Simulation, SimulationEnd, StoredTrace, TargetRecord, TrialStatus,
};
use mishandle_report::{HardeningSummary, RunReport, campaign_page, markdown, page};

const HOSTILE: &str = "<script>alert(1)</script><img src=x onerror=alert(2)>\"'&\u{202e}\u{1b}";

/// Returns a header in which every text that can be hostile is.
fn header(axes: usize, text: &str) -> RunHeader {
    let axis = |index: usize| AxisRecord {
        name: format!("axis{index}{text}"),
        unit: text.into(),
        kind: text.into(),
        low: 0.0,
        high: 1.0,
        nominal: Some(0.5),
        values: if index == 1 { format!("categorical: {text}, b") } else { "continuous".into() },
        meaning: text.into(),
    };
    RunHeader {
        kind: RunKind::Falsify,
        build: BuildRecord {
            program_version: text.into(),
            git_commit: text.into(),
            ..BuildRecord::default()
        },
        versions: vec![(text.into(), text.into())],
        plan: text.into(),
        target: TargetRecord {
            kind: "python".into(),
            name: format!("car{text}"),
            hash: text.into(),
            is_deterministic: false,
        },
        components: vec![ComponentRecord {
            role: "controller".into(),
            name: format!("mine{text}"),
            hash: text.into(),
            file_hash: text.into(),
        }],
        space: text.into(),
        formula: "always(gap >= 2)".into(),
        formulas: vec![FormulaRecord { name: text.into(), text: text.into() }],
        search: text.into(),
        seed: 1,
        control_dt: 0.1,
        episode_steps: 4,
        signals: vec![SignalRecord { name: "gap".into(), unit: text.into() }],
        axes: (0..axes).map(axis).collect(),
        verdicts: vec!["success".into()],
        preflight: vec![],
    }
}

/// Writes trials that end with these simulations; `true` is a failure.
fn write(path: &Path, header: &RunHeader, trials: &[(u32, bool)]) {
    let mut writer = RunWriter::create(path, header, IfExists::Refuse).unwrap();
    for (number, (simulations, fails)) in (1..).zip(trials) {
        writer.start_trial(number, 7).unwrap();
        for simulation in 1..=*simulations {
            let is_failure = *fails && simulation == *simulations;
            let gap = if is_failure { 1.5 } else { 2.25 };
            let at = f64::from(simulation % 10) / 10.0;
            let scenario =
                (0..header.axes.len()).map(|axis| Some(if axis == 1 { 0.0 } else { at })).collect();
            let trace = is_failure.then(|| StoredTrace { columns: vec![vec![3.0, 2.5, 2.0, gap, 1.75]] });
            writer
                .record(&[Simulation {
                    trial: number,
                    number: simulation,
                    seed: u64::MAX,
                    unit_point: vec![],
                    scenario,
                    robustness: Some(gap - 2.0),
                    robustness_low: Some(gap - 2.0),
                    robustness_high: Some(gap - 2.0),
                    stop_threshold: None,
                    end: SimulationEnd::Completed,
                    steps: 4,
                    verdicts: vec![Some(gap - 2.0)],
                    reason: String::new(),
                    trace_digest: None,
                    trace,
                }])
                .unwrap();
        }
        let status = if *fails { TrialStatus::Falsified } else { TrialStatus::BudgetSpent };
        writer.end_trial(number, status).unwrap();
    }
    writer.close().unwrap();
}

/// The plan of a falsification of four trials.
const PLAN: &str = "target = \"toy/sphere-2d\"\n[falsify]\ntrials = 4\nbudget = 3\n";

fn html(axes: usize, text: &str, plan: &str, trials: &[(u32, bool)]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    write(&path, &RunHeader { plan: plan.into(), ..header(axes, text) }, trials);
    let run = RunFile::open(&path).unwrap();
    let mut report = RunReport::load(&run, &format!("runs/{text}.sqlite"), None, crate::data).unwrap();
    report.add_note(format!("note {text}"));
    page(&[report])
}

#[test]
fn the_numbers_are_those_of_the_run() {
    // Failures after 1 and 2 simulations, ends without a failure after 2 and 3: survival 3/4, then
    // 3/4 * 2/3 = 1/2.
    let html = html(2, "", PLAN, &[(1, true), (2, true), (2, false), (3, false)]);
    for part in [
        "<h2>car with controller mine fails at 0.30 s with axis0 = 0.2 (nominal 0.5)",
        "From step 3 (0.30 s) on, nothing can satisfy the requirement: <code>gap</code> is 1.5, the limit 2.",
        "<p>car with controller mine violates its requirement in 2 of 4 trials. The first failure comes after a median of 2 \
         simulations.",
        "Share of trials without a failure: 50 % after 3 simulations",
        "<b>Requirement:</b> <span class=\"words\">at every step of the trace: gap is at least 2</span>",
        "robustness −0.5",
        "gap is 1.5000, the threshold 2.0000. The trace violates it by 0.5000.",
        "It fails at 2 of 5 samples in its window, from step 3 (0.30 s) to step 4 (0.40 s).",
        "The target is not deterministic",
    ] {
        assert!(html.contains(part), "{part} is not in\n{html}");
    }
}

#[test]
fn hostile_names_are_text() {
    for (axes, plan) in (1..=5).flat_map(|axes| [(axes, PLAN), (axes, HOSTILE)]) {
        let html = html(axes, HOSTILE, plan, &[(1, true), (3, true), (3, false)]);
        for part in ["<script", "<img", "onerror=alert(2)>\"", "\u{202e}", "\u{1b}"] {
            assert!(!html.contains(part), "{axes} axes: {part}");
        }
        assert!(html.contains("&lt;script&gt;alert(1)"));
        assert!(html.contains("default-src 'none'; style-src 'unsafe-inline'; img-src data:"));
        // Every link leads to an element of the page.
        for link in html.split("href=\"").skip(1) {
            let target = link.split('"').next().unwrap().strip_prefix('#').unwrap();
            assert!(html.contains(&format!("id=\"{target}\"")), "{target}");
        }
    }
}

/// Rates need an evaluation, whose plan this program reads.
#[test]
fn hostile_names_are_text_in_tables_of_rates_and_in_markdown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let plan = "target = \"toy/sphere-2d\"\n[evaluate]\nepisodes = 300\n";
    let header = RunHeader { kind: RunKind::Evaluate, plan: plan.into(), ..header(3, HOSTILE) };
    write(&path, &header, &[(300, true)]);
    let report = RunReport::load(&RunFile::open(&path).unwrap(), "run.sqlite", None, crate::data).unwrap();
    let html = page(std::slice::from_ref(&report));
    let text = markdown(&[report]);
    assert!(html.contains("Which axes matter</h3>"), "{html}");
    assert!(text.contains("### Success over the range of the axes"), "{text}");
    for part in ["<script", "<img", "\u{202e}", "\u{1b}"] {
        assert!(!html.contains(part) && !text.contains(part), "{part}\n{text}");
    }
}

#[test]
fn a_run_without_simulations_has_a_page() {
    let html = html(2, "", PLAN, &[]);
    assert!(html.contains("No trial of car with controller mine has started."));
}

#[test]
fn the_index_of_a_campaign_has_its_hardenings_and_escapes_their_texts() {
    let found = Hardening {
        after: Some("b.safetensors".to_string()),
        worse: vec![HOSTILE.to_string()],
        verdict: HOSTILE.to_string(),
        ..Hardening::default()
    };
    let summary = |name: &str, found| HardeningSummary {
        name: name.to_string(),
        href: format!("runs/{name}.html"),
        found,
    };
    let html = campaign_page("c", &[], &[summary("open", None), summary(HOSTILE, Some(found))], None);
    for part in ["1 of 2 hardenings accepted a controller.", "Not finished: 1 of 2 runs.", "not finished"] {
        assert!(html.contains(part), "{part}: {html}");
    }
    assert!(!html.contains("runs/open.html"), "a hardening that is not finished has no page");
    assert!(!html.contains("<script") && !html.contains("<img"), "{html}");
}

/// Anybody can write a run file with valid hashes and long texts. None fills the page: a name is
/// cut, and of other texts the middle is left out.
#[test]
fn a_page_cuts_long_texts() {
    /// A run file limits names, and no unit or meaning.
    const NAME: usize = 1900;
    const LONG: usize = 60_000;
    let of = |axes: usize, name: &str, long: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.sqlite");
        let mut header = RunHeader { plan: PLAN.into(), ..header(axes, name) };
        for axis in &mut header.axes {
            (axis.unit, axis.meaning) = (long.into(), long.into());
        }
        header.signals.iter_mut().for_each(|signal| signal.unit = long.into());
        write(&path, &header, &[(1, true), (3, true), (3, false)]);
        let run = RunFile::open(&path).unwrap();
        page(&[RunReport::load(&run, "run.sqlite", None, crate::data).unwrap()])
    };
    for axes in [1, 2, 4] {
        let [ordinary, cut] = [of(axes, "Ж", "Ж"), of(axes, &"Ж".repeat(NAME), &"Ж".repeat(LONG))];
        let longest = cut.split(|c| c != 'Ж').map(|run| run.chars().count()).max().unwrap();
        assert!(longest <= 1000, "{axes} axes: {longest}");
        let [ordinary, cut] = [&ordinary, &cut].map(|page| page.matches('Ж').count());
        assert!(cut < ordinary + 10_000, "{axes} axes: {cut} characters instead of {ordinary}");
    }
}
