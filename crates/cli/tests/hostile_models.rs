//! Models of target files that would end the program, or keep it busy without end.

use crate::bench::Bench;

const TARGET: &str = r#"
format = 1
name = "arm"
model.file = "arm.xml"
control = { period = 0.01, steps = 10 }
start = { hinge = "angle" }
observation = { angle = "qpos('hinge')" }
policy = { expression = "-angle", action = "action" }
signals = { angle = { value = "qpos('hinge')[0]", unit = "rad" } }
axes = { angle = { range = [-0.1, 0.2], unit = "rad" } }
formulas = { near = "always(angle <= 1)" }
"#;

/// Returns a bench with a target file whose model has these elements.
fn bench(elements: &str) -> Bench {
    let bench = Bench::new();
    bench.write("arm.toml", TARGET);
    bench.write(
        "arm.xml",
        &format!(
            "<mujoco>{elements}<worldbody><body><joint name=\"hinge\" axis=\"0 1 0\"/><geom size=\"0.1\" pos=\"0 0 -0.4\"/>\
             </body></worldbody><actuator><motor joint=\"hinge\"/></actuator></mujoco>"
        ),
    );
    bench
}

#[test]
fn a_model_that_ends_mujoco_is_an_error_of_the_file() {
    let crash = "arm.xml: a child process tried the model, and it cannot be used: MuJoCo crashes with signal";
    for (elements, message) in [
        // Sizes that MuJoCo allocates before it checks them.
        ("<size nuser_geom=\"2000000000\"/>", crash),
        ("<asset><hfield name=\"h\" nrow=\"100000\" ncol=\"100000\" size=\"1 1 1 1\"/></asset>", crash),
        ("<size nuserdata=\"2000000000\"/>", "Could not allocate memory"),
        ("<size memory=\"3G\"/>", "it has 3072 MiB of memory for contacts"),
    ] {
        bench(elements).refuses("evaluate arm.toml --episodes 2", &[message]);
    }
}

#[test]
fn a_time_step_without_end_is_an_error() {
    for timestep in ["0", "1e-12"] {
        let bench = bench(&format!("<option timestep=\"{timestep}\"/>"));
        bench
            .refuses("evaluate arm.toml --episodes 2", &["arm.toml, line 5", "from 1 to 10000 are possible"]);
    }
}

#[test]
fn an_arena_without_space_for_a_step_is_enlarged() {
    bench("<size memory=\"12K\"/>").check("evaluate arm.toml --episodes 2", 0);
}

#[test]
fn the_child_answers_nobody_without_a_model() {
    let bench = bench("");
    let output = bench.command("__try_model").stdin(std::process::Stdio::null()).output().unwrap();
    assert_eq!((output.status.code(), output.stdout.as_slice()), (Some(2), &b""[..]));
}

#[test]
fn the_suite_of_a_target_file_runs_where_it_was_exported() {
    let bench = bench("");
    // The start is beyond the limit for some angles.
    bench.write("arm.toml", &TARGET.replace("angle <= 1)", "angle <= 0.15)"));
    bench.check("falsify arm.toml --trials 1 --budget 50 --out run.sqlite", 1);
    bench.check("regress suite --add run.sqlite -k regress.all=true -k regress.minimize=true", 0);
    for file in ["arm.toml", "arm.xml"] {
        let copied = std::fs::read(bench.path("suite").join(file)).unwrap();
        assert_eq!(copied, std::fs::read(bench.path(file)).unwrap());
    }
    std::fs::create_dir(bench.path("elsewhere")).unwrap();
    for file in ["arm.toml", "arm.xml"] {
        std::fs::rename(bench.path(file), bench.path("elsewhere").join(file)).unwrap();
    }
    let tests = bench.json("regress suite --json", 1);
    assert_eq!((&tests["fails"], &tests["errors"]), (&1.into(), &0.into()));
    bench.refuses("replay run.sqlite", &["pass -k engine.target=FILE if its folder was moved"]);
    bench.check("replay run.sqlite -k engine.target=elsewhere/arm.toml", 0);
    bench.check("show run.sqlite --simulation first -k engine.target=elsewhere/arm.toml", 1);
    bench.check("falsify --resume run.sqlite -k engine.target=elsewhere/arm.toml", 1);
}

#[test]
fn a_target_file_without_policy_is_described() {
    let bench = bench("");
    bench.write("arm.toml", &TARGET.replace("expression = \"-angle\", ", "actions = 1, "));
    let page = bench.check("list arm.toml", 0);
    assert!(page.starts_with("arm (robot)\n") && page.contains("always(angle <= 1)"), "{page}");
    bench.refuses("evaluate arm.toml --episodes 2", &["--controller FILE"]);
}

#[test]
fn an_edit_opens_no_file_outside_the_folder_of_the_model() {
    let bench = bench("");
    for path in ["/etc/passwd", "../../etc/passwd.stl", "../passwd.stl"] {
        let add =
            format!("\n[[model.add]]\nparent = \"asset\"\nxml = '<mesh name=\"m\" file=\"{path}\"/>'\n");
        let text = format!(
            "{}\n[model]\nfile = \"arm.xml\"\n{add}",
            TARGET.replace("model.file = \"arm.xml\"\n", "")
        );
        bench.write("edited.toml", &text);
        bench.refuses("list edited.toml", &[&format!("`{path}` is outside the folder of the model")]);
    }
}
