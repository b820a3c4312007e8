//! Pictures and charts of the counterexamples of a check, which are simulated again.

use std::path::Path;

use mishandle::counterexample::{Counterexample, CounterexampleReplay};
use mishandle::picture::ExampleSimulation;
use mishandle::resolve::is_python;
use mishandle::results::{Check, CheckCell};
use mishandle::rollout::Request;
use mishandle::store::RunHeader;
use mishandle::{Compared, MishandleError, ResolvedPlan};

use crate::html::{text, with_code};
use crate::pictures::{self, MAX_STRIPS, MustEnd, PictureError};
use crate::replay::Replay;
use crate::{modes, trace};

/// The figures of the counterexamples of a check. The default has none.
#[derive(Debug, Default)]
pub struct CheckFigures {
    /// Requirement and controller of a cell, with its figures as HTML.
    cells: Vec<([String; 2], String)>,
}

impl CheckFigures {
    /// Simulates the counterexamples again and draws them, in 3-D if they `have_replays`. A cell
    /// whose counterexample cannot be drawn says why; systems in Python have no figures.
    pub fn draw(found: &Check, have_replays: bool, must_end: MustEnd<'_>) -> CheckFigures {
        let mut cells = Vec::new();
        let mut strips = 0;
        if is_python(&found.target_kind) {
            return CheckFigures { cells };
        }
        for cell in &found.cells {
            let Some(file) = cell.counterexample.as_ref().and_then(|violation| violation.file.as_deref())
            else {
                continue;
            };
            let html = if must_end() {
                Err(PictureError::Interrupted)
            } else {
                draw(cell, Path::new(file), have_replays, &mut strips, must_end)
            };
            let html = html.unwrap_or_else(|error| note(&error));
            cells.push(([cell.requirement.clone(), cell.controller.clone()], html));
        }
        CheckFigures { cells }
    }

    /// Returns the figures of a cell as HTML.
    pub(super) fn html(&self, cell: &CheckCell) -> &str {
        let is_own = |key: &[String; 2]| *key == [cell.requirement.as_str(), &cell.controller];
        self.cells.iter().find(|(key, _)| is_own(key)).map_or("", |(_, html)| html)
    }
}

fn draw(
    cell: &CheckCell,
    file: &Path,
    has_replay: bool,
    strips: &mut usize,
    must_end: MustEnd<'_>,
) -> Result<String, PictureError> {
    let (counterexample, resolved) = resolve(cell, file)?;
    let replay = counterexample.replay(&resolved)?;
    if !replay.differences.is_empty() {
        return Err(MishandleError::differs(Compared::Plan, replay.differences).into());
    }
    let CounterexampleReplay { header, explained, .. } = &replay;
    let time = |sample: usize| mishandle_text::instant(sample, header.control_dt);
    let sentences = explained.explanation.sentences(time);
    let why: String = sentences.iter().map(|line| format!("<li>{}</li>", with_code(line))).collect();
    let mut out = format!("<ul class=\"why\">{why}</ul>\n");
    if mishandle::resolve::has_scene(&header.target.kind) && *strips < MAX_STRIPS {
        *strips += 1;
        let request = counterexample.request(&resolved.space)?;
        match pictures::of_replay(&resolved, &request, &replay, must_end) {
            Ok(pictures) => {
                let frames = modes::frames(header, &pictures, explained);
                let found = if has_replay { replayed(&resolved, &request, header)? } else { None };
                out += &found.map_or(frames.clone(), |replay| replay.html(&format!("q{strips}"), &frames));
            }
            Err(error) => out += &note(&error),
        }
    }
    let charts: String = trace::figures(header, explained, None, 0).concat();
    Ok(out + &format!("<div class=\"grid\">{charts}</div>\n"))
}

/// Returns the replay of a counterexample, with the nominal simulation of its seed as ghost.
fn replayed(
    resolved: &ResolvedPlan,
    request: &Request,
    header: &RunHeader,
) -> Result<Option<Replay>, MishandleError> {
    let nominal = Request::new(resolved.space.nominal(), request.seed);
    let [failing, nominal] = [request, &nominal].map(|request| ExampleSimulation::new(resolved, request));
    Replay::of_pair(header, ["counterexample", "nominal"], [&failing?, &nominal?])
}

/// Looks up the target of a counterexample, whose controller can be a file elsewhere.
fn resolve(cell: &CheckCell, file: &Path) -> Result<(Counterexample, ResolvedPlan), MishandleError> {
    let counterexample = Counterexample::read(file)?;
    let is_file = counterexample.plan.controller.starts_with("./");
    let moved = is_file.then_some(cell.controller.as_str());
    let resolved = counterexample.resolve(file.parent().unwrap_or(Path::new("")), moved)?;
    Ok((counterexample, resolved))
}

fn note(error: &PictureError) -> String {
    format!("<p class=\"notes\">There is no picture: {}.</p>\n", text(&error.to_string()))
}
