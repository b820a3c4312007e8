//! A scenario that was simulated with two controllers, of which at least one fails: what both do,
//! why, and a picture of the same instant.

use mishandle::MishandleError;
use mishandle::inspect::ExplainedSimulation;
use mishandle::picture::ExampleSimulation;
use mishandle::stl::is_violated;
use mishandle::store::RunHeader;
use mishandle_text::instant;

use crate::html::{base64, short, text, with_code, with_unit};
use crate::pictures::{Frame, Instant, PICTURE, PictureError, instants};
use crate::replay::Replay;

/// Words for one of the two controllers.
#[derive(Clone, Copy, Debug)]
pub struct ControllerName {
    /// Name above its picture.
    pub label: &'static str,
    /// Words in a sentence.
    pub phrase: &'static str,
}

/// The simulations of two controllers in the same scenario.
#[derive(Debug)]
pub struct ControllerPair {
    names: [ControllerName; 2],
    /// The controller that fails.
    failing: usize,
    outcomes: Vec<Outcome>,
    /// The 3-D replay of the one that fails, with the other one as its ghost.
    replay: Option<Replay>,
}

/// The simulation of a controller in the scenario of a failure.
#[derive(Debug)]
struct Outcome {
    /// Why the failure or success is one; `None` if the simulation has no verdict.
    explained: Option<(RunHeader, ExplainedSimulation)>,
    /// How it ended.
    end: String,
    picture: Option<Frame>,
}

impl ControllerPair {
    /// Draws the same instant of both simulations, and records a 3-D replay if it `has_replay`.
    /// Also returns why there is no picture.
    pub fn draw(
        simulated: [ExampleSimulation; 2],
        names: [ControllerName; 2],
        failing: usize,
        has_replay: bool,
    ) -> (ControllerPair, Option<PictureError>) {
        let replay = if has_replay { replay(&simulated, names, failing) } else { Ok(None) };
        let mut outcomes = Vec::new();
        let mut states = Vec::new();
        for ExampleSimulation { episode, trajectory, explained } in simulated {
            let signals: Vec<&str> = episode.trace.names().iter().map(String::as_str).collect();
            let end = mishandle::run::end_text(episode.end, &signals);
            outcomes.push(Outcome { explained, end, picture: None });
            states.push(trajectory.states);
        }
        let last = |index: usize| states[index].len().saturating_sub(1);
        let event = |index: usize| {
            outcomes[index].explained.as_ref().and_then(|(_, found)| found.explanation.instant())
        };
        let decisive = event(failing).unwrap_or(last(failing));
        // A failure has an instant of its own, a success is shown at that of the failure.
        let sample = |index: usize| {
            let own = event(index).filter(|_| outcomes[index].fails());
            own.unwrap_or(decisive).min(last(index))
        };
        let drawn: Vec<usize> = (0..2).filter(|index| outcomes[*index].explained.is_some()).collect();
        let shown: Vec<Instant<'_>> = drawn
            .iter()
            .filter_map(|index| {
                let (header, found) = outcomes[*index].explained.as_ref()?;
                let states = states[*index].as_slice();
                let explanation = &found.explanation;
                Some(Instant {
                    header,
                    states,
                    explanation,
                    event: explanation.event(),
                    sample: sample(*index),
                })
            })
            .collect();
        let missing = match instants(&shown, PICTURE) {
            Ok(frames) => {
                drop(shown);
                for (index, frame) in drawn.into_iter().zip(frames) {
                    outcomes[index].picture = Some(frame);
                }
                None
            }
            Err(error) => Some(error),
        };
        let (replay, missing) = match replay {
            Ok(replay) => (replay, missing),
            Err(error) => (None, missing.or(Some(error.into()))),
        };
        (ControllerPair { names, failing, outcomes, replay }, missing)
    }

    /// Returns the time of a control step, s.
    pub fn control_dt(&self) -> f64 {
        let headers = self.outcomes.iter().filter_map(|outcome| outcome.explained.as_ref());
        headers.map(|(header, _)| header.control_dt).next().unwrap_or(0.0)
    }

    /// Returns the scene, and why one of the controllers fails. `id` is the name of the replay on
    /// the page; without one, pictures take its place.
    pub fn wide(&self, id: Option<&str>) -> String {
        format!("{}<ul class=\"why\">{}</ul>\n", self.scene(id), self.why())
    }

    /// Returns the replay or the pictures side by side.
    fn scene(&self, id: Option<&str>) -> String {
        let both = self.outcomes.iter().zip(self.names);
        let pictures: String = both.map(|(outcome, name)| outcome.figure(name)).collect();
        let pictures = format!("<div class=\"lead-pair\">{pictures}</div>\n");
        match self.replay.as_ref().zip(id) {
            Some((replay, id)) => replay.html(id, &pictures),
            None => pictures,
        }
    }

    /// Says why the failing controller fails, as items of a list.
    fn why(&self) -> String {
        let failing = self.outcomes.get(self.failing).and_then(|outcome| outcome.explained.as_ref());
        let Some((header, explained)) = failing else { return String::new() };
        let sentences = explained.explanation.sentences(|sample| instant(sample, header.control_dt));
        sentences.iter().map(|sentence| format!("<li>{}</li>", with_code(sentence))).collect()
    }

    /// Returns the pair as HTML, before the table of its scenario. `id` is as for
    /// [`wide`](Self::wide).
    pub fn html(&self, scenario: &str, id: Option<&str>) -> String {
        let both = || self.outcomes.iter().zip(self.names);
        let mut out = format!(
            "{}<div class=\"facts-and-trace\">\n<div>{scenario}</div>\n<div><ul class=\"why\">",
            self.scene(id)
        );
        for (outcome, name) in both() {
            out.push_str(&format!("<li><b>{}</b>: {}.</li>", name.label, outcome.words()));
        }
        let controller = self.names[self.failing].phrase;
        let why = self.why();
        out + &format!("</ul>\n<h5>Why {controller} fails</h5>\n<ul class=\"why\">{why}</ul></div>\n</div>\n")
    }
}

/// Returns the replay of the simulation that fails, with the other one as its ghost.
fn replay(
    simulated: &[ExampleSimulation; 2],
    names: [ControllerName; 2],
    failing: usize,
) -> Result<Option<Replay>, MishandleError> {
    let Some((header, _)) = &simulated[failing].explained else { return Ok(None) };
    let order = [failing, 1 - failing];
    Replay::of_pair(header, order.map(|index| names[index].label), order.map(|index| &simulated[index]))
}

impl Outcome {
    fn fails(&self) -> bool {
        self.explained.as_ref().is_some_and(|(_, found)| found.recorded.robustness.is_some_and(is_violated))
    }

    /// Returns the result in words.
    fn words(&self) -> String {
        let Some((_, explained)) = &self.explained else {
            return format!("no verdict: {}", text(&self.end));
        };
        let unit = text(&short(&explained.explanation.unit, 20));
        let robustness = explained.recorded.robustness.map_or(String::new(), |found| with_unit(found, &unit));
        let verdict = if self.fails() { "fails" } else { "succeeds" };
        format!("{verdict}, robustness {robustness}")
    }

    fn figure(&self, name: ControllerName) -> String {
        let (Some(Frame { sample, png }), Some((header, _))) = (&self.picture, &self.explained) else {
            return String::new();
        };
        let time = instant(*sample, header.control_dt);
        let verdict = if self.fails() { "fails" } else { "succeeds" };
        format!(
            "<figure class=\"frame{}\"><img src=\"data:image/png;base64,{}\" width=\"640\" height=\"480\" alt=\"The scene with \
             {}, which {verdict}, at {time}\"><figcaption><b>{}: {verdict}</b>, {time}</figcaption></figure>",
            if self.fails() { " decisive" } else { "" },
            base64(png),
            name.phrase,
            name.label,
        )
    }
}
