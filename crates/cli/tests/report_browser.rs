//! Opens reports in headless Chromium: both themes, wide and narrow. Without Chromium, the test
//! says so and ends.
//!
//! The screenshots are in `target/tmp/report`, to look at.

use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use crate::bench::Bench;
use mishandle::store::{
    AxisRecord, ComponentRecord, IfExists, RunFile, RunWriter, SignalRecord, Simulation, TargetRecord,
};
use serde_json::{Value, json};

/// Names under which Chromium is installed.
const NAMES: [&str; 4] = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"];

/// A window of a browser.
pub trait Window {
    /// Opens a file in a window of this size, and returns what went wrong on the way.
    fn open(&mut self, path: &Path, size: [u32; 2], theme: &str) -> Vec<String>;

    /// Evaluates a script, and returns its value.
    fn evaluate(&mut self, script: &str) -> Value;

    /// Evaluates a script that returns a promise, and returns its value.
    fn wait(&mut self, script: &str) -> Value;

    /// Takes a picture of the whole page.
    fn screenshot(&mut self, file: &Path);
}

/// Writes the bytes that a text stands for.
pub fn write_base64(text: &str, file: &Path) {
    let mut decoder = Command::new("base64");
    decoder.arg("-d").stdin(Stdio::piped()).stdout(File::create(file).unwrap());
    let mut decoder = decoder.spawn().unwrap();
    decoder.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    decoder.wait().unwrap();
}

/// Chromium, controlled over a pair of pipes.
pub struct Browser {
    child: Child,
    commands: File,
    answers: BufReader<File>,
    session: Option<String>,
    last_id: u64,
    /// Everything that the browser reported besides answers.
    events: Vec<Value>,
}

impl Browser {
    /// Starts Chromium; `None` if it is not installed.
    fn start(bench: &Bench) -> Option<Browser> {
        let is_installed = |name: &&&str| {
            Command::new(name).arg("--version").output().is_ok_and(|output| output.status.success())
        };
        let name = NAMES.iter().find(is_installed)?;
        let commands = bench.path("commands");
        let answers = bench.path("answers");
        assert!(Command::new("mkfifo").args([&commands, &answers]).status().unwrap().success());
        // The browser reads commands from descriptor 3 and writes answers to descriptor 4.
        // `timeout` ends one that hangs.
        let script = "exec timeout 1200 \"$0\" --headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars \
             --no-first-run --disable-dev-shm-usage --user-data-dir=\"$3\" --remote-debugging-pipe 3<\"$1\" 4>\"$2\"";
        let child = Command::new("sh")
            .args(["-c", script, name])
            .args([&commands, &answers, &bench.path("profile")])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let commands = File::options().write(true).open(commands).unwrap();
        let answers = BufReader::new(File::open(answers).unwrap());
        let mut browser = Browser { child, commands, answers, session: None, last_id: 0, events: Vec::new() };
        let target = browser.call("Target.createTarget", json!({ "url": "about:blank" }));
        let session =
            browser.call("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = session["sessionId"].as_str().map(String::from);
        for domain in ["Page", "Runtime", "Log", "Network"] {
            browser.call(&format!("{domain}.enable"), json!({}));
        }
        Some(browser)
    }

    fn call(&mut self, method: &str, params: impl Into<Value>) -> Value {
        self.last_id += 1;
        let params: Value = params.into();
        let mut message = json!({ "id": self.last_id, "method": method, "params": params });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        self.commands.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let answer = self.next();
            if answer["id"] == self.last_id {
                assert!(answer["error"].is_null(), "{method}: {answer}");
                return answer["result"].clone();
            }
            self.events.push(answer);
        }
    }

    fn next(&mut self) -> Value {
        let mut bytes = Vec::new();
        self.answers.read_until(0, &mut bytes).unwrap();
        assert_eq!(bytes.pop(), Some(0), "the browser ended");
        serde_json::from_slice(&bytes).unwrap()
    }
}

impl Window for Browser {
    fn evaluate(&mut self, script: &str) -> Value {
        let result =
            self.call("Runtime.evaluate", json!({ "expression": script, "returnByValue": true }))["result"]
                .clone();
        result["value"].clone()
    }

    fn wait(&mut self, script: &str) -> Value {
        let how = json!({ "expression": script, "returnByValue": true, "awaitPromise": true });
        self.call("Runtime.evaluate", how)["result"]["value"].clone()
    }

    fn open(&mut self, path: &Path, [width, height]: [u32; 2], theme: &str) -> Vec<String> {
        self.call(
            "Emulation.setDeviceMetricsOverride",
            json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false }),
        );
        let features = json!([{ "name": "prefers-color-scheme", "value": theme }]);
        self.call("Emulation.setEmulatedMedia", json!({ "features": features }));
        self.events.clear();
        let url = format!("file://{}", path.display());
        self.call("Page.navigate", json!({ "url": url }));
        while !self.events.iter().any(|event| event["method"] == "Page.loadEventFired") {
            let event = self.next();
            self.events.push(event);
        }
        let problem = |event: &Value| {
            let params = &event["params"];
            match event["method"].as_str().unwrap_or_default() {
                "Runtime.consoleAPICalled" | "Runtime.exceptionThrown" | "Log.entryAdded" => {
                    Some(event.to_string())
                }
                "Network.requestWillBeSent" => {
                    let request = params["request"]["url"].as_str().unwrap();
                    let is_own = request == url || request.starts_with("data:");
                    (!is_own).then(|| format!("request for {request}"))
                }
                _ => None,
            }
        };
        self.events.iter().filter_map(problem).collect()
    }

    fn screenshot(&mut self, file: &Path) {
        let shot =
            self.call("Page.captureScreenshot", json!({ "captureBeyondViewport": true, "format": "png" }));
        write_base64(shot["data"].as_str().unwrap(), file);
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A script that returns facts about the open page.
const FACTS: &str = "(() => {
    for (const part of document.querySelectorAll('details')) part.open = true;
    const luminance = color => { const [r, g, b] = color.match(/[0-9.]+/g).map(Number); return (r + g + b) / 765 };
    const style = (element, property) => getComputedStyle(element).getPropertyValue(property);
    const charts = [...document.querySelectorAll('svg.chart')];
    const ids = [...document.querySelectorAll('[id]')].map(element => element.id);
    const hrefs = [...document.querySelectorAll('a')].map(a => a.getAttribute('href'));
    return {
        charts: charts.length,
        small: charts.filter(chart => chart.getBoundingClientRect().width < 200).length,
        unlabeled: charts.filter(chart => !chart.getAttribute('aria-label')).length,
        marks: document.querySelectorAll('svg.chart a title').length,
        images: document.images.length,
        broken: [...document.images].filter(image => !image.complete || !image.naturalWidth || !image.alt).length,
        overflow: document.documentElement.scrollWidth - document.documentElement.clientWidth,
        background: luminance(style(document.body, 'background-color')),
        ink: luminance(style(document.body, 'color')),
        chart: charts.length ? luminance(style(charts[0].querySelector('rect'), 'fill')) : null,
        scripts: document.scripts.length,
        repeated: ids.length - new Set(ids).size,
        dead: hrefs.filter(href => href.startsWith('#') && !document.getElementById(href.slice(1))).length,
        files: hrefs.filter(href => !href.startsWith('#')),
        heading: document.querySelector('h2').textContent,
    };
})()";

/// Starts the browser and makes the folder of the screenshots. Says so if there is no browser.
pub fn start(bench: &Bench) -> Option<(Browser, PathBuf)> {
    let Some(browser) = Browser::start(bench) else {
        eprintln!("skipped: there is no Chromium; install it with `apt install chromium`");
        return None;
    };
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("report");
    std::fs::create_dir_all(&folder).unwrap();
    Some((browser, folder))
}

/// Checks a page with at least two charts.
#[track_caller]
fn check(browser: &mut Browser, folder: &Path, page: &Path, has_marks: bool) -> Value {
    check_page(browser, folder, page, 2, has_marks)
}

/// Checks a page with at least `charts` charts in both themes at two widths, and on paper.
#[track_caller]
fn check_page(browser: &mut Browser, folder: &Path, page: &Path, charts: u32, has_marks: bool) -> Value {
    let name = page.file_stem().unwrap().to_string_lossy().into_owned();
    let mut facts = Value::Null;
    for (theme, width) in [("light", 1200), ("dark", 1200), ("light", 375), ("dark", 375)] {
        let what = format!("{name}, {theme}, {width} px");
        let problems = browser.open(page, [width, 900], theme);
        assert!(problems.is_empty(), "{what}: {problems:?}");
        facts = browser.evaluate(FACTS);
        let fact = |key: &str| facts[key].as_f64().unwrap_or(f64::NAN);
        assert!(fact("charts") >= f64::from(charts), "{what}: {facts}");
        for file in facts["files"].as_array().unwrap() {
            let linked = page.parent().unwrap().join(file.as_str().unwrap());
            assert!(linked.is_file(), "{what}: {file} does not exist");
        }
        for key in ["small", "unlabeled", "broken", "overflow", "scripts", "repeated", "dead"] {
            assert_eq!(fact(key), 0.0, "{what}: {key}: {facts}");
        }
        let is_dark = fact("background") < 0.5;
        assert_eq!(is_dark, theme == "dark", "{what}: {facts}");
        assert!((fact("background") - fact("ink")).abs() > 0.6, "{what}: {facts}");
        assert!(charts == 0 || (fact("chart") < 0.5) == is_dark, "{what}: {facts}");
        assert!(!has_marks || fact("marks") > 0.0, "{what}: {facts}");
        browser.screenshot(&folder.join(format!("{name}-{theme}-{width}.png")));
    }
    // The box switches the theme.
    browser.evaluate("document.getElementById('theme').click()");
    let switched = browser.evaluate(FACTS);
    assert!(switched["background"].as_f64() > Some(0.9), "{name}: {switched}");
    // Paper is always light.
    for theme in ["light", "dark"] {
        let features = json!([{ "name": "prefers-color-scheme", "value": theme }]);
        browser.call("Emulation.setEmulatedMedia", json!({ "media": "print", "features": features }));
        let size = json!({ "width": 720, "height": 1000, "deviceScaleFactor": 1, "mobile": false });
        browser.call("Emulation.setDeviceMetricsOverride", size);
        let printed = browser.evaluate(FACTS);
        assert!(printed["background"].as_f64() > Some(0.9), "{name}, print, {theme}: {printed}");
        assert_eq!(printed["overflow"], 0, "{name}, print: {printed}");
    }
    browser.screenshot(&folder.join(format!("{name}-print.png")));
    browser.call("Emulation.setEmulatedMedia", json!({ "media": "" }));
    facts
}

/// Writes a run of a target that this program cannot build, as Python does, with hostile names.
fn foreign_run(bench: &Bench, source: &str, name: &str) {
    let source = RunFile::open(bench.path(source)).unwrap();
    let mut header = source.header().clone();
    let hostile = "<script>document.title='owned'</script>\"'&";
    header.target = TargetRecord {
        kind: "python".into(),
        name: hostile.into(),
        hash: hostile.into(),
        is_deterministic: false,
    };
    header.components = vec![ComponentRecord {
        role: "controller".into(),
        name: format!("x/{hostile}"),
        hash: hostile.into(),
        file_hash: String::new(),
    }];
    header.space = hostile.to_string();
    header.search = hostile.to_string();
    let axis = |axis: &AxisRecord| AxisRecord {
        name: format!("{}<img src=x onerror=alert(1)>", axis.name),
        unit: "<b>m".into(),
        meaning: hostile.into(),
        kind: hostile.into(),
        ..axis.clone()
    };
    header.axes = header.axes.iter().map(axis).collect();
    header.signals = header
        .signals
        .iter()
        .map(|signal| SignalRecord { name: signal.name.clone(), unit: "</svg><script>1</script>".into() })
        .collect();
    let mut writer = RunWriter::create(bench.path(name), &header, IfExists::Refuse).unwrap();
    for trial in source.trials().unwrap() {
        writer.start_trial(trial.trial.number, trial.trial.seed).unwrap();
        for simulation in source.trial_simulations(trial.trial.number) {
            let Simulation { trial, number, .. } = simulation.unwrap();
            writer.record(&[source.simulation(trial, number).unwrap()]).unwrap();
        }
        writer.end_trial(trial.trial.number, trial.trial.status).unwrap();
    }
    writer.close().unwrap();
}

#[test]
fn reports_are_readable_in_both_themes_and_on_a_phone() {
    let bench = Bench::new();
    let Some((mut browser, folder)) = start(&bench) else { return };
    bench.check("falsify toy/sphere-2d --trials 12 --budget 60 --seed 1 --out sphere.sqlite", 1);
    bench.check("falsify toy/car-following --space events+dynamics --trials 10 --out car.sqlite", 1);
    bench.check("falsify toy/noisy --trials 5 --budget 100 --seed 1 --out noisy.sqlite", 1);
    bench.check("falsify toy/needle --trials 3 --budget 20 --seed 1 --out needle.sqlite", 0);
    bench.check("evaluate toy/sphere-2d --episodes 300 --out rates.sqlite", 0);
    foreign_run(&bench, "car.sqlite", "foreign.sqlite");
    for name in ["sphere", "car", "noisy", "needle", "rates", "foreign"] {
        bench.check(&format!("report {name}.sqlite --out {name}.html"), 0);
        check(&mut browser, &folder, &bench.path(&format!("{name}.html")), name != "needle");
    }
    bench.check("report sphere.sqlite foreign.sqlite rates.sqlite --out all.html", 0);
    let facts = check(&mut browser, &folder, &bench.path("all.html"), true);
    assert_eq!(facts["heading"], "Overview");
}

#[test]
fn pages_of_comparisons_and_campaigns_are_readable() {
    let bench = Bench::new();
    let Some((mut browser, folder)) = start(&bench) else { return };
    let evaluate = "evaluate point-reaching --controller expert --seed 3 --episodes 30";
    bench.check(&format!("{evaluate} --out good.sqlite"), 0);
    bench.check(&format!("{evaluate} --action-noise 1.2 --out worse.sqlite"), 0);
    bench.check("compare good.sqlite worse.sqlite --out worse.html", 1);
    // Robustness, and three maps of pairs of axes.
    check_page(&mut browser, &folder, &bench.path("worse.html"), 4, true);
    bench.check("compare good.sqlite good.sqlite --out same.html", 0);
    check_page(&mut browser, &folder, &bench.path("same.html"), 4, false);
    let plan = "target = \"toy/sphere-2d\"\nseed = [1, 2]\n[falsify]\ntrials = 6\nbudget = 40\n[evaluate]\nepisodes = 30\n";
    std::fs::write(bench.path("plan.toml"), plan).unwrap();
    bench.check("run plan.toml --out spheres", 1);
    bench.check("report spheres --out pages -k report.simulations=false", 0);
    for (name, charts, has_marks) in [
        ("index", 0, false),
        ("statistics", 2, false),
        ("runs/1_falsify", 2, true),
        ("runs/2_evaluate", 2, true),
    ] {
        check_page(&mut browser, &folder, &bench.path(&format!("pages/{name}.html")), charts, has_marks);
    }
}

#[test]
fn reports_of_all_tasks_have_charts_and_pictures() {
    let bench = Bench::new();
    let Some((mut browser, folder)) = start(&bench) else { return };
    let tasks = bench.json("list tasks --json", 0);
    for task in tasks["tasks"].as_array().unwrap() {
        let name = task["name"].as_str().unwrap();
        let signal = task["signals"][0].as_str().unwrap();
        // Every simulation violates it.
        let formula = format!("always[0:20]({signal} <= -1000)");
        let flags = format!("--controller ppo --formula '{formula}' --trials 1 --budget 1");
        bench.check(&format!("falsify {name} {flags} --out {name}.sqlite"), 1);
        bench.check(&format!("report {name}.sqlite -k report.probes=4 --out {name}.html"), 0);
        let facts = check(&mut browser, &folder, &bench.path(&format!("{name}.html")), true);
        assert!(facts["images"].as_u64() > Some(0), "{name}: {facts}");
    }
}
