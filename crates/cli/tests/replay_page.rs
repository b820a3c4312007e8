//! Opens pages with a 3-D replay in Chromium, and the long tests also in Firefox; both draw them
//! without a graphics card. The tests say which browser is missing. The screenshots are in
//! `target/tmp/report`.

#![expect(clippy::print_stdout, reason = "times and shares are measured, not asserted")]

use std::path::PathBuf;
use std::time::Instant;

use crate::bench::{Bench, text};
use crate::cart_pole;
use crate::firefox::Firefox;
use crate::report_browser::{Window, start};
use crate::run::SETTINGS;
use mishandle::camera::{
    Camera, Effects, Form, NO_SHAPE, Optics, Output, Pose, Scene, Shape, Size, StateRenderer, StateShot,
    focal_length,
};
use mishandle::picture::{RecordedScene, recorded_scene};
use mishandle::resolve::Moved;
use mishandle::rollout::Seed;
use mishandle::world::{CAMERAS, ElementKind, Stage};
use serde_json::{Value, json};

/// Width and height of the pictures that are compared.
const PICTURE: [usize; 2] = [200, 150];

/// Share of the pixels that two ways of drawing may see differently: those at edges.
const EDGES: f64 = 0.005;

/// A script that returns the replay once it shows its first simulation.
const READY: &str = "document.querySelector('.replay').replay.ready.then(() => true)";

/// Records one simulation of a target and returns its page with a replay.
fn page(bench: &Bench, target: &str, name: &str) -> PathBuf {
    let falsify =
        format!("falsify {target} --search random --trials 1 --budget 1 --seed 5 --out {name}.sqlite");
    let output = bench.run(&falsify);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{falsify}\n{}", text(&output.stderr));
    let mut replay = bench.command(&format!("replay {name}.sqlite --trial 1 --simulation 1 --open"));
    let output = replay.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    bench.path(&format!("{name}-t1-s1.html"))
}

/// Opens a page and waits until it shows its first simulation.
fn open(browser: &mut dyn Window, page: &std::path::Path, size: [u32; 2], theme: &str) {
    let problems = browser.open(page, size, theme);
    assert!(problems.is_empty(), "{}: {problems:?}", page.display());
    assert_eq!(browser.wait(READY), true, "{}", page.display());
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
#[ignore = "long"]
fn poses_and_shapes_of_the_page_are_those_of_mujoco_and_of_the_ray_caster() {
    let bench = Bench::new();
    let chromium = start(&bench).map(|(browser, _)| Box::new(browser) as Box<dyn Window>);
    let firefox = Firefox::start(&bench).map(|browser| Box::new(browser) as Box<dyn Window>);
    let named = [("chromium", chromium), ("firefox", firefox)].into_iter();
    let mut browsers: Vec<(&str, Box<dyn Window>)> =
        named.filter_map(|(name, browser)| Some((name, browser?))).collect();
    if browsers.is_empty() {
        return;
    }
    let tasks = bench.json("list tasks --json", 0);
    for task in tasks["tasks"].as_array().unwrap() {
        let name = task["name"].as_str().unwrap();
        let page = page(&bench, &format!("{name} --controller expert"), name);
        let size = std::fs::metadata(&page).unwrap().len() / 1000;
        let path = bench.path(&format!("{name}.sqlite"));
        let scene = recorded_scene(&path, Some(1), Some(1), Moved::default(), false).unwrap();
        let last = scene.episodes[0].states.len() - 1;
        for (program, browser) in &mut browsers {
            let started = Instant::now();
            open(&mut **browser, &page, [1200, 900], "light");
            println!("{name}, {program}: loaded in {:.2} s, {size} kB", started.elapsed().as_secs_f64());
            for sample in [0, last / 4, last / 2, 3 * last / 4, last] {
                check_poses(&mut |script| browser.evaluate(script), &scene, name, sample);
            }
            for sample in [0, last / 2] {
                check_picture(&mut **browser, &scene, name, sample);
            }
            browser.screenshot(&screenshots().join(format!("replay-{name}-{program}.png")));
        }
    }
}

/// Returns the folder of the screenshots.
fn screenshots() -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("report");
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Compares the poses of all bodies, and the vertices of cloths, with MuJoCo's.
fn check_poses(evaluate: &mut dyn FnMut(&str) -> Value, scene: &RecordedScene, task: &str, sample: usize) {
    let script = format!(
        "(() => {{ const {{ scene, main }} = document.querySelector('.replay').replay;
        return {{ poses: scene.bodies.map((name, body) => ({{ name, ...main.pose(body, {sample}) }})),
        cloths: scene.cloths.map(({{ vertices }}, i) => Array.from(main.vertices[i].subarray(3 * {sample} * vertices,
        3 * ({sample} + 1) * vertices))) }} }})()"
    );
    let found = evaluate(&script);
    let model = scene.model.compile().unwrap();
    let mut world = model.world();
    world.set_state(&scene.episodes[0].states[sample]);
    world.refresh();
    let poses = found["poses"].as_array().unwrap();
    assert!(poses.len() > 8, "{task}: {found}");
    for pose in poses {
        let name = pose["name"].as_str().unwrap();
        let body = model.body(name).unwrap();
        let distance = distance(&numbers(&pose["p"]), &world.rows().position(body));
        assert!(distance < 1e-4, "{task}, {name}, sample {sample}: {distance} m");
        let q = numbers(&pose["q"]);
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let truth = world.rows().quaternion(body);
        let same = q.iter().zip(truth).map(|(a, b)| a * b).sum::<f64>().abs() / length;
        let angle = 2.0 * same.min(1.0).acos();
        assert!(angle < 1e-3, "{task}, {name}, sample {sample}: {angle} rad");
    }
    let cloths = found["cloths"].as_array().unwrap();
    let surfaces = model.surfaces();
    assert_eq!(cloths.len(), surfaces.len());
    for (cloth, surface) in cloths.iter().zip(&surfaces) {
        let vertices = numbers(cloth);
        assert_eq!(vertices.len(), 3 * surface.vertices.len());
        for (index, vertex) in vertices.chunks(3).enumerate() {
            let distance = distance(vertex, &surface.vertex(&world, index));
            assert!(distance < 1e-4, "{task}, vertex {index}: {distance} m");
        }
    }
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Compares which body is at each pixel with the picture of our own ray caster from the same place.
fn check_picture(browser: &mut dyn Window, scene: &RecordedScene, task: &str, sample: usize) {
    let [width, height] = PICTURE;
    let script = format!(
        "(() => {{ const {{ replay }} = document.querySelector('.replay'); const {{ bodies, cloths }} = replay.scene;
        const {{ eye, axes, fovy }} = replay.orbit.view(1); const names = [...bodies, ...cloths.map(() => 'cloth')];
        return {{ eye, axes, fovy, names, bodies: replay.identities({width}, {height}, {sample}) }} }})()"
    );
    let found = browser.evaluate(&script);
    let state = &scene.episodes[0].states[sample];
    let model = scene.model.compile().unwrap();
    let mut shapes = Scene::of_model(&model).unwrap();
    let size = mishandle::world::Size::new(width as u32, height as u32).unwrap();
    let stage = Stage::new(&model, &scene.model, size, CAMERAS[0]).unwrap();
    let sites = model.sites().into_iter().filter(|site| site.is_drawn);
    let others = sites.chain(stage.ground());
    shapes.shapes.extend(others.filter_map(|geom| Some(Shape::of_geom(&geom, Form::of_geom(&geom)?))));
    let single = |value: &Value| -> [f32; 3] {
        let numbers = numbers(value);
        [0, 1, 2].map(|i| numbers[i] as f32)
    };
    let camera = Camera {
        size: Size::new(width, height).unwrap(),
        body: 0,
        pose: Pose { position: single(&found["eye"]), axes: [0, 1, 2].map(|i| single(&found["axes"][i])) },
        tilt: [0.0; 3],
        focal_length: focal_length(found["fovy"].as_f64().unwrap().to_degrees()),
        optics: Optics::NOMINAL,
        effects: Effects::NOMINAL,
    };
    let mut segments = vec![0; width * height];
    let shot = StateShot { state, before: None, scene: &shapes, camera: &camera, seed: Seed(0), step: 0 };
    let mut output = Output { rgb: None, depth: None, segments: Some(&mut segments) };
    StateRenderer::new(&model).render(&shot, &mut output);
    let bodies = model.names(ElementKind::Body);
    let drawn = numbers(&found["bodies"]);
    let mut differences = 0;
    let mut seen = Vec::new();
    for (pixel, segment) in segments.iter().enumerate() {
        // WebGL's first row is the lowest one.
        let own = drawn[(height - 1 - pixel / width) * width + pixel % width];
        let own = if own < 0.0 { None } else { found["names"][own as usize].as_str() };
        let shape = (*segment != NO_SHAPE).then(|| &shapes.shapes[usize::from(*segment)]);
        let truth = shape.map(|shape| match shape.form {
            Form::Cloth(_) => "cloth",
            _ => bodies[shape.body].as_str(),
        });
        differences += usize::from(own != truth);
        if !seen.contains(&truth) {
            seen.push(truth);
        }
    }
    assert!(seen.len() > 5, "{task}: the picture shows {seen:?}");
    let share = differences as f64 / segments.len() as f64;
    println!("{task}, sample {sample}: {:.2} % of the pixels show another body", 100.0 * share);
    assert!(share < EDGES, "{task}, sample {sample}: {differences} of {} pixels differ", segments.len());
}

/// A script that presses a key on the picture.
fn press(browser: &mut dyn Window, key: &str, has_shift: bool) {
    let event = json!({ "key": key, "shiftKey": has_shift, "bubbles": true, "cancelable": true });
    browser.evaluate(&format!(
        "document.querySelector('.replay canvas').dispatchEvent(new KeyboardEvent('keydown', {event}))"
    ));
}

/// A script that returns where the time is: by the replay, in the time line, and in the charts.
const TIMES: &str = "(() => { const { replay } = document.querySelector('.replay'); return {
    time: replay.time, last: replay.last, line: Number(replay.line.area.getAttribute('aria-valuenow')),
    places: [...document.querySelectorAll('.replay-cursor')].map(cursor => parseFloat(cursor.style.left)),
    titles: replay.plots.map(plot => plot.figure.querySelector('span').textContent),
    values: replay.plots.map(plot => plot.values[0].textContent), yaw: replay.orbit.yaw, isPlaying: replay.isPlaying } })()";

#[test]
fn one_cursor_is_in_all_charts_and_keys_and_pointer_move_it() {
    let bench = Bench::new();
    let Some((mut browser, _)) = start(&bench) else { return };
    check_time(&bench, &mut browser);
}

/// Checks that the time is the same everywhere, and that keys and pointer move it.
fn check_time(bench: &Bench, browser: &mut dyn Window) {
    let page = page(bench, "ball-balancing --controller ppo --space delay", "delay");
    open(browser, &page, [1200, 900], "light");
    let scene =
        recorded_scene(&bench.path("delay.sqlite"), Some(1), Some(1), Moved::default(), false).unwrap();
    let trace = &scene.episodes[0].episode.trace;
    let agree = |found: &Value, sample: f64| {
        assert_eq!((found["time"].as_f64(), found["line"].as_f64()), (Some(sample), Some(sample)), "{found}");
        let place = 100.0 * sample / found["last"].as_f64().unwrap();
        let places = numbers(&found["places"]);
        assert!(places.len() > 3 && places.iter().all(|left| (left - place).abs() < 1e-3), "{found}");
        let titles = found["titles"].as_array().unwrap();
        let mut compared = 0;
        for (title, shown) in titles.iter().zip(found["values"].as_array().unwrap()) {
            let Some(values) = trace.signal(title.as_str().unwrap()) else { continue };
            let shown = shown.as_str().unwrap().replace('−', "-");
            let shown: f64 = shown.split(' ').next().unwrap().parse().unwrap();
            let value = values[sample as usize];
            assert!((shown - value).abs() <= 1e-3 * value.abs() + 1e-6, "{title}: {shown}, {value}");
            compared += 1;
        }
        assert!(compared > 2, "{found}");
    };
    press(browser, "Home", false);
    agree(&browser.evaluate(TIMES), 0.0);
    for _ in 0..3 {
        press(browser, "ArrowRight", false);
    }
    press(browser, "ArrowLeft", false);
    agree(&browser.evaluate(TIMES), 2.0);
    press(browser, "End", false);
    let end = browser.evaluate(TIMES);
    agree(&end, end["last"].as_f64().unwrap());
    press(browser, "ArrowLeft", true);
    assert_ne!(browser.evaluate(TIMES)["yaw"], end["yaw"]);
    browser.evaluate(
        "(() => { const area = document.querySelector('.replay-plot'); area.setPointerCapture = () => {};
        const { left, width, top } = area.getBoundingClientRect();
        area.dispatchEvent(new PointerEvent('pointerdown', { clientX: left + width / 2, clientY: top + 5, bubbles: true })) })()",
    );
    agree(&browser.evaluate(TIMES), end["last"].as_f64().unwrap() / 2.0);
    press(browser, " ", false);
    assert_eq!(browser.evaluate(TIMES)["isPlaying"], true);
    press(browser, " ", false);
    assert_eq!(browser.evaluate(TIMES)["isPlaying"], false);
}

/// A script that returns the controls that overlap, and by how much the page is too wide.
const OVERLAPS: &str = "(() => { const parts = [...document.querySelectorAll('.replay button, .replay select, .replay label, \
    .replay-view, .replay-line, .replay-plot, .replay figcaption, .replay-head > *, .replay-sweep input, .replay-sweep span, \
    .replay summary, .replay-keys')].filter(part => part.getClientRects().length);
    const box = part => part.getBoundingClientRect();
    const overlap = (a, b) => Math.min(box(a).right, box(b).right) - Math.max(box(a).left, box(b).left) > 1 &&
        Math.min(box(a).bottom, box(b).bottom) - Math.max(box(a).top, box(b).top) > 1;
    const name = part => part.className + part.tagName + part.textContent.slice(0, 30);
    const isOver = part => part.scrollWidth > part.clientWidth + 1 && getComputedStyle(part).overflow === 'visible';
    return { count: parts.length, wide: document.documentElement.scrollWidth - document.documentElement.clientWidth,
    over: parts.filter(part => part.tagName === 'BUTTON' && isOver(part)).map(name),
    pairs: parts.flatMap((a, i) => parts.slice(i + 1).filter(b => !a.contains(b) && !b.contains(a) && overlap(a, b))
    .map(b => name(a) + ' and ' + name(b))) } })()";

#[test]
fn a_report_with_a_replay_fits_on_a_phone_in_both_themes_and_its_marks_open_simulations() {
    let bench = Bench::new();
    let Some((mut browser, _)) = start(&bench) else { return };
    check_layout(&bench, &mut browser, "chromium");
}

/// Checks a page at two widths in both themes, its marks and its slider.
fn check_layout(bench: &Bench, browser: &mut dyn Window, program: &str) {
    let falsify =
        "falsify ball-balancing --controller ppo --space delay --trials 3 --seed 1 --out run.sqlite";
    bench.check(falsify, 1);
    bench.check("report run.sqlite --interactive --out run.html -k report.probes=0", 0);
    let page = bench.path("run.html");
    for (theme, width) in [("light", 1200), ("dark", 1200), ("light", 390), ("dark", 390)] {
        open(browser, &page, [width, 900], theme);
        let found = browser.evaluate(OVERLAPS);
        let what = format!("{theme}, {width} px: {found}");
        assert!(found["count"].as_u64() > Some(15), "{what}");
        assert_eq!(
            (&found["wide"], &found["pairs"], &found["over"]),
            (&json!(0), &json!([]), &json!([])),
            "{what}"
        );
        browser.screenshot(&screenshots().join(format!("replay-{theme}-{width}-{program}.png")));
    }
    let rows = "document.querySelector('.replay').replay.scene.simulations.map(simulation => simulation.row)";
    let rows = browser.evaluate(rows);
    let place = rows.as_array().unwrap().iter().rposition(|row| !row.is_null()).unwrap();
    let (trial, number) = (&rows[place][0], &rows[place][1]);
    let clicked = browser.evaluate(&format!(
        "(() => {{ const mark = document.querySelector('a[href=\"#r1-t{trial}-s{number}\"]');
        mark.dispatchEvent(new MouseEvent('click', {{ bubbles: true, cancelable: true }}));
        return document.querySelector('.replay').replay.index }})()"
    ));
    let known = rows.as_array().unwrap().iter().position(|row| row == &rows[place]);
    assert_eq!(clicked.as_u64().map(|index| index as usize), known);
    // The slider goes over values of the axis that causes the failure: the verdict flips.
    let flips = browser.evaluate(
        "(() => { const { sweep, simulations } = document.querySelector('.replay').replay.scene;
        const fails = sweep.map(({ simulation }) => simulations[simulation].isViolated);
        return [fails.length, fails[0], fails.at(-1)] })()",
    );
    assert!(flips[0].as_u64() > Some(2), "{flips}");
    assert_eq!((&flips[1], &flips[2]), (&json!(false), &json!(true)));
}

#[test]
#[ignore = "long"]
fn firefox_has_the_same_cursor_keys_and_layout() {
    let bench = Bench::new();
    let Some(mut browser) = Firefox::start(&bench) else { return };
    check_time(&bench, &mut browser);
    check_layout(&bench, &mut browser, "firefox");
}

#[test]
fn hostile_names_stay_data_and_every_page_has_the_same_script() {
    let bench = Bench::new();
    let hostile = "</template></script><img src=x onerror=document.title='owned'>";
    let unit = format!("unit = \"{hostile}\"");
    cart_pole::write(&bench.path(""), |text| text.replace("unit = \"rad\"", &unit));
    let model =
        cart_pole::MODEL.replace("name=\"cart\"", &format!("name=\"{}\"", hostile.replace('<', "&lt;")));
    bench.write("cartpole.xml", &model);
    bench.write("settings.toml", SETTINGS);
    bench.check("train cartpole.toml --settings settings.toml --steps 512 --out start.safetensors", 0);
    let own = page(&bench, "cartpole.toml --controller ./start.safetensors", "hostile");
    let other = page(&bench, "point-reaching --controller expert", "other");
    let [html, plain] = [&own, &other].map(|page| std::fs::read_to_string(page).unwrap());
    assert!(!html.contains("<img") && html.matches("<script").count() == 1);
    let script =
        |html: &str| html.split("<script>").nth(1).unwrap().split("</script>").next().unwrap().to_string();
    let policy = |html: &str| {
        html.split("Content-Security-Policy\" content=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .to_string()
    };
    assert_eq!(script(&html), script(&plain));
    assert_eq!(policy(&html), policy(&plain));
    assert!(
        policy(&html)
            .starts_with("default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-")
    );
    let Some((mut browser, _)) = start(&bench) else { return };
    open(&mut browser, &own, [1200, 900], "light");
    let found = browser.evaluate(
        "({ title: document.title, images: document.images.length, bodies: document.querySelector('.replay').replay.scene.bodies })",
    );
    let title = "Mishandle: cartpole with controller start";
    assert_eq!((&found["title"], &found["images"]), (&json!(title), &json!(0)), "{found}");
    assert!(found["bodies"].as_array().unwrap().contains(&json!(hostile)), "{found}");
}
