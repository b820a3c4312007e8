//! The data of a replay: a scene, and simulations with their states.

use mishandle::MishandleError;
use mishandle::inspect::{Explanation, unit};
use mishandle::picture::ExampleSimulation;
use mishandle::resolve::recorded_picture;
use mishandle::rollout::Episode;
use mishandle::stl::{Clock, Formula, Monitor};
use mishandle::store::RunHeader;
use mishandle_text::instant;
use serde_json::{Value, json};

use super::Replay;
use super::pack::block;
use super::scene::SceneReader;
use crate::html::{number, short};
use crate::predicate_chart::predicates;
use crate::trace::spans;

/// Largest numbers of predicates and of signals with a chart.
const PREDICATES: usize = 6;
const SIGNALS: usize = 18;

/// Number of states that frame the first view.
const FRAMING: usize = 6;

/// Role of the simulation that is shown over or beside the others.
pub const GHOST: &str = "ghost";

/// A simulation of a replay.
#[derive(Clone, Copy)]
pub struct Entry<'a> {
    pub role: &'a str,
    pub title: &'a str,
    /// Trial and number of the row whose links lead to it.
    pub row: Option<(u32, u32)>,
    pub filmed: Filmed<'a>,
}

/// An episode with its states, and why it fails.
#[derive(Clone, Copy)]
pub struct Filmed<'a> {
    pub episode: &'a Episode,
    pub states: &'a [Vec<f64>],
    pub explanation: Option<&'a Explanation>,
}

impl<'a> From<&'a ExampleSimulation> for Filmed<'a> {
    fn from(simulated: &'a ExampleSimulation) -> Filmed<'a> {
        let ExampleSimulation { episode, trajectory, explained } = simulated;
        let explanation = explained.as_ref().map(|(_, explained)| &explained.explanation);
        Filmed { episode, states: &trajectory.states, explanation }
    }
}

/// Collects the data of a replay.
pub struct Recorder<'a> {
    header: &'a RunHeader,
    reader: SceneReader,
    predicates: Vec<String>,
    signals: Vec<(String, String)>,
    /// Head and bytes of the scene, once there is a simulation.
    scene: Option<(Value, Vec<u8>)>,
    blocks: Vec<Vec<u8>>,
    facts: Vec<Value>,
    /// Size of the simulations in the page, bytes.
    size: usize,
}

impl<'a> Recorder<'a> {
    /// Begins a replay of simulations with this header.
    pub fn new(reader: SceneReader, header: &'a RunHeader) -> Recorder<'a> {
        let formula = Formula::parse(&header.formula).ok();
        let mut predicates = formula.as_ref().map_or(Vec::new(), predicates);
        predicates.truncate(PREDICATES);
        Recorder {
            header,
            reader,
            predicates,
            signals: signals(header, formula.as_ref()),
            scene: None,
            blocks: vec![Vec::new()],
            facts: Vec::new(),
            size: 0,
        }
    }

    /// Returns the number of simulations.
    pub fn len(&self) -> usize {
        self.facts.len()
    }

    /// Adds a simulation unless all together are then larger than `limit`. The first one, which the
    /// page opens, frames the first view.
    pub fn add(&mut self, entry: Entry<'_>, limit: usize) -> bool {
        if self.scene.is_none() {
            self.scene = Some(self.reader.data(&framing(entry.filmed)));
        }
        let Recorder { header, reader, predicates, signals, .. } = self;
        let data = encoded(reader, header, entry.filmed, predicates, signals);
        self.size += 4 * data.len().div_ceil(3);
        if self.size > limit {
            return false;
        }
        self.blocks.push(data);
        self.facts.push(fact(self.header, &entry));
        true
    }

    /// Returns the replay with facts about all simulations; `None` without one.
    pub fn finish(mut self, facts: Value) -> Option<Replay> {
        let (mut head, bytes) = self.scene?;
        let named = |name: &str, unit: &str| json!({ "name": short(name, 80), "unit": short(unit, 20) });
        head["dt"] = json!(self.header.control_dt);
        head["predicates"] =
            self.predicates.iter().map(|text| named(text, &unit(self.header, text))).collect();
        head["signals"] = self.signals.iter().map(|(name, unit)| named(name, unit)).collect();
        head["simulations"] = json!(self.facts);
        if let (Value::Object(head), Value::Object(facts)) = (&mut head, facts) {
            head.extend(facts);
        }
        self.blocks[0] = block(&head, &bytes);
        Some(Replay { blocks: self.blocks })
    }
}

impl Replay {
    /// Returns the replay of a simulation with another one, the ghost, each with its title.
    /// `header` belongs to the first.
    ///
    /// # Errors
    /// If MuJoCo rejects the model.
    pub fn of_pair(
        header: &RunHeader,
        titles: [&str; 2],
        simulations: [&ExampleSimulation; 2],
    ) -> Result<Option<Replay>, MishandleError> {
        let mut recorder = Recorder::new(SceneReader::new(&recorded_picture(header)?)?, header);
        for ((role, title), simulation) in ["minimal", GHOST].into_iter().zip(titles).zip(simulations) {
            recorder.add(Entry { role, title, row: None, filmed: simulation.into() }, usize::MAX);
        }
        let nothing: [(); 0] = [];
        Ok(recorder.finish(json!({ "ghost": titles[1], "failures": 0, "missing": 0, "sweep": nothing })))
    }
}

/// Returns states that the first view shows: those until nothing can satisfy the requirement. What
/// falls flies far after that.
fn framing(filmed: Filmed<'_>) -> Vec<&[f64]> {
    let Filmed { episode, states, explanation } = filmed;
    let explanation = explanation.filter(|_| episode.is_violated());
    let decided = explanation.and_then(|explanation| explanation.decided);
    let end = decided.map_or(states.len(), |sample| (sample + 1).min(states.len()));
    let states = &states[..end];
    states.iter().step_by((end / FRAMING).max(1)).chain(states.last()).map(Vec::as_slice).collect()
}

/// Returns the signals that have a chart, with their units. Signals of the formula come first.
fn signals(header: &RunHeader, formula: Option<&Formula>) -> Vec<(String, String)> {
    let read = formula
        .map_or(Vec::new(), |formula| formula.signals().into_iter().map(ToString::to_string).collect());
    let mut signals: Vec<(String, String)> =
        header.signals.iter().map(|signal| (signal.name.clone(), signal.unit.clone())).collect();
    signals.sort_by_key(|(name, _)| !read.contains(name));
    signals.truncate(SIGNALS);
    signals
}

/// Returns what the page says about a simulation.
fn fact(header: &RunHeader, entry: &Entry<'_>) -> Value {
    let Filmed { episode, explanation, .. } = entry.filmed;
    let robustness = episode.robustness();
    let decided = explanation.and_then(|explanation| explanation.decided);
    let note = match (episode.is_violated(), robustness, decided) {
        (true, Some(rho), Some(sample)) => {
            format!("fails: lost from {} on, robustness {}", instant(sample, header.control_dt), number(rho))
        }
        (true, Some(rho), None) => format!("fails, robustness {}", number(rho)),
        (false, Some(rho), _) => format!("passes, robustness {}", number(rho)),
        _ => "no verdict".to_string(),
    };
    json!({
        "role": entry.role,
        "title": entry.title,
        "note": note,
        "isViolated": episode.is_violated(),
        "row": entry.row.map(|(trial, number)| [trial, number]),
    })
}

/// Returns the block of a simulation.
fn encoded(
    reader: &mut SceneReader,
    header: &RunHeader,
    filmed: Filmed<'_>,
    predicates: &[String],
    signals: &[(String, String)],
) -> Vec<u8> {
    let Filmed { episode, states, explanation } = filmed;
    let mut columns = reader.motion(states);
    let integers = columns.end();
    let mut bytes = columns.bytes;
    let trace = &episode.trace;
    let mut series = |values: Option<&[f64]>| {
        let value =
            |sample| values.and_then(|values| values.get(sample)).map_or(f32::NAN, |value| *value as f32);
        bytes.extend((0..trace.len()).flat_map(|sample| value(sample).to_le_bytes()));
    };
    for text in predicates {
        let formula = Formula::parse(text).ok();
        let monitor = formula
            .and_then(|formula| Monitor::new(&formula, trace.names(), Clock::steps(header.control_dt)).ok());
        match monitor {
            Some(mut monitor) => series(monitor.robustness_signal(trace).ok()),
            None => series(None),
        }
    }
    signals.iter().for_each(|(name, _)| series(trace.signal(name)));
    let violated = explanation.filter(|_| episode.is_violated());
    let history = violated.and_then(|explanation| explanation.history.as_ref());
    let head = json!({
        "samples": states.len(),
        "values": trace.len(),
        "integers": integers,
        "decided": violated.and_then(|explanation| explanation.decided),
        "window": history.map(|history| [history.window.0, history.window.1]),
        "violated": history.map_or(Vec::new(), |history| spans(&history.violated)),
    });
    block(&head, &bytes)
}
