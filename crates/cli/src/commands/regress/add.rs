use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use mishandle::Plan;
use mishandle::counterexample::{Chosen, Counterexample, Preparation};
use mishandle::falsification::PhysicsChecks;
use mishandle::files::NewFolders;
use mishandle::plan::{RegressSettings, Settings};
use mishandle::store::RunFile;
use mishandle_text::plural;

use super::Arguments;
use crate::exit_status::ExitStatus;
use crate::run::{self, path_kind};
use crate::show::progress::Bar;
use crate::show::{escape, exports, output};

/// Writes counterexamples of a run.
pub fn run(command: &Arguments, run: &Path) -> Result<ExitStatus> {
    let Settings { engine, regress, .. } = command.settings()?;
    if let Some(out) = &command.out {
        ensure!(
            path_kind::is_counterexample(out),
            "--out is {}; it must end with .json, by which `replay` recognizes a counterexample",
            out.display()
        );
        ensure!(
            !regress.all && command.folder.is_none(),
            "--out is one file: leave it out to write into a FOLDER, which regress.all needs"
        );
    }
    // One file is beside others.
    let folder = match &command.out {
        Some(out) => out.parent().unwrap_or(Path::new("")),
        None => command.folder(),
    };
    let file = run::read(run, engine.skip_check)?;
    let mut chosen = choose(&regress, &file, folder)?;
    if let (Some(out), [only]) = (&command.out, &mut chosen[..]) {
        only.path.clone_from(out);
    }
    // The files of a target are copied, so they must equal the run's.
    let has_files = mishandle::resolve::has_files(&Plan::from_toml(&file.header().plan)?.target);
    let has_physics = mishandle::resolve::has_scene(&file.header().target.kind);
    let resolved = if regress.minimize || has_physics || has_files || engine.target.is_some() {
        Some(mishandle::resolve::recorded_plan(file.header(), engine.moved())?)
    } else {
        None
    };
    if let Some(resolved) = &resolved {
        run::report_build_differences("made", &mishandle::replay::build_differences(file.header(), resolved));
    }
    // Before the simulations of a minimization.
    let inputs = [Some(run), engine.controller.as_deref().map(Path::new)];
    for Chosen { path, .. } in &chosen {
        output::refuse_inputs(path, "--out", inputs.into_iter().flatten())?;
        ensure!(
            command.force || path.symlink_metadata().is_err(),
            "{} exists already; name another file with --out, or overwrite it with --force",
            path.display()
        );
    }
    let minimize = regress.minimize.then_some(u64::from(regress.budget));
    let prepared = resolved.as_ref().filter(|_| regress.minimize || has_physics);
    let preparation = prepared.map(|resolved| Preparation { resolved, minimize });
    let bar = Bar::new(0, "simulations");
    if preparation.is_some() {
        run::stop_on_signals(&bar)?;
    }
    let checks = if has_physics { announce_checks(chosen.len() as u64, minimize) } else { 0 };
    bar.set_length(minimize.unwrap_or(0) + checks);
    let found = mishandle::counterexample::export(&file, chosen, preparation, |done| {
        bar.set_position(done);
        run::control_flow()
    })?;
    bar.clear();
    if found.is_interrupted && (regress.all || !regress.minimize) {
        let why = if regress.all {
            "no file is written, because a part of a suite would look complete"
        } else {
            "no file is written, because its physics was not checked"
        };
        run::report_loss(found.simulations, why);
        return Ok(ExitStatus::Interrupted);
    }
    let copied = match &resolved {
        Some(resolved) => mishandle::portable::copy_target(&resolved.plan, folder)?,
        None => Vec::new(),
    };
    write_all(folder, command.force, &found.files)?;
    if command.json {
        output::json(&found.result)?;
    } else {
        output::line(&exports::text(&found.result))?;
    }
    for path in &copied {
        output::message(&format!("wrote {}, a file of the target", escape::name(&path.to_string_lossy())));
    }
    // Otherwise the controller is among these files.
    let first = found.files.first().filter(|_| !has_files);
    let controller = first.map(|(_, counterexample)| &counterexample.plan.controller);
    if let Some(name) = controller.and_then(|controller| controller.strip_prefix("./")) {
        output::message(&format!(
            "the controller is not shipped: copy {} to the folder of the counterexamples, or give --controller FILE",
            escape::name(name)
        ));
    }
    // The only counterexample; a suite is not written then.
    if found.is_interrupted {
        run::report_loss(
            found.simulations,
            "the scenario so far is written, which fails, but can be nearer to nominal",
        );
        return Ok(ExitStatus::Interrupted);
    }
    Ok(ExitStatus::Done)
}

/// Announces the simulations that check the physics of this number of counterexamples. Returns the
/// largest number for each. A minimized one can go back through as many failures as simulations.
fn announce_checks(counterexamples: u64, minimize: Option<u64>) -> u64 {
    let each = minimize.map_or(PhysicsChecks::most(1), PhysicsChecks::most_to_go_back);
    output::message(&format!(
        "checking the physics of {} with at most {}",
        plural(counterexamples, "counterexample"),
        plural(each * counterexamples, "simulation")
    ));
    each
}

/// Writes the files when all are known: an interruption never leaves a part of a suite, which would
/// look complete.
fn write_all(folder: &Path, force: bool, files: &[(PathBuf, Counterexample)]) -> Result<()> {
    // Removes them again if nothing is written.
    let mut folders = NewFolders::default();
    if !folder.as_os_str().is_empty() {
        folders.create(folder).with_context(|| format!("cannot create the folder {}", folder.display()))?;
    }
    let mut complete = Vec::new();
    for (path, counterexample) in files {
        let mut file = output::create(path, force)?;
        file.write_all(counterexample.to_json().as_bytes())
            .with_context(|| format!("cannot write {}", path.display()))?;
        complete.push((path, file));
    }
    for (path, file) in complete {
        file.persist().with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Returns the counterexamples that the keys select, each with its file in the folder.
fn choose(regress: &RegressSettings, file: &RunFile, folder: &Path) -> Result<Vec<Chosen>> {
    if let Some(simulation) = regress.simulation {
        ensure!(!regress.all, "regress.simulation selects one simulation: leave out regress.all");
        let trial = regress.trial.unwrap_or(1);
        let stem = file.path().file_stem().unwrap_or_default().to_string_lossy();
        let path = folder.join(format!("{stem}-trial-{trial}-simulation-{simulation}.json"));
        return Ok(vec![Chosen { path, mode: None, trial, simulation }]);
    }
    ensure!(regress.trial.is_none(), "regress.trial needs regress.simulation, the number in the trial");
    let mut chosen = mishandle::counterexample::representatives(file, folder)?;
    let run = file.path().display();
    if chosen.is_empty() {
        bail!("{run} has no counterexample with a recorded trace");
    }
    if regress.all {
        return Ok(chosen);
    }
    let mode = regress.mode as usize;
    if mode > chosen.len() {
        bail!("there is no failure mode {mode}; {run} has {}", plural(chosen.len(), "failure mode"));
    }
    Ok(vec![chosen.swap_remove(mode - 1)])
}
