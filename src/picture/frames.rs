//! Frames of filmstrips and films: the scene, and a caption with the time and the decisive
//! predicate.

use mishandle_stl::{Formula, is_violated};
use mishandle_store::SignalRecord;
use mishandle_world::{
    Caption, CaptionLayout, CaptionPart, Color, Picture, PictureModel, Quality, Renderer, Size, Stage,
    TimeBar, WorldError,
};

use crate::error::MishandleError;
use crate::inspect::{Event, Explanation, PredicateHistory};
use crate::picture::cameras::{SeenEpisode, TargetCameras};
use crate::picture::ray_renderer::RayRenderer;

/// Colors of text, secondary text, violations, satisfied samples and the window of the formula.
const INK: Color = [29, 33, 38];
const SOFT: Color = [85, 86, 90];
const FAIL: Color = [143, 58, 4];
const PASS: Color = [31, 92, 153];
const WINDOW: Color = [160, 168, 178];

/// Captions of the frames of one simulation.
#[derive(Clone, Debug)]
pub struct FrameCaptions {
    control_dt: f64,
    /// The last sample.
    last: usize,
    /// Samples with marks, and their texts.
    marks: Vec<(usize, &'static str)>,
    mark_color: Color,
    predicate: Option<CaptionPredicate>,
    /// Bar without the position.
    spans: Vec<([f64; 2], Color)>,
    marks_contacts: bool,
}

/// The decisive predicate as captions show it.
#[derive(Clone, Debug)]
struct CaptionPredicate {
    name: String,
    /// Text of the values at each sample. All have the same length.
    values: Vec<String>,
    robustness: Vec<f64>,
    /// First and last sample that the formula reads.
    window: (usize, usize),
}

impl FrameCaptions {
    /// Makes the captions of a simulation with samples 0 to `last`, `control_dt` seconds apart.
    /// Without an explanation they show the time only. `signals` gives the units, and `event` is
    /// marked.
    pub fn new(
        control_dt: f64,
        signals: &[SignalRecord],
        explanation: Option<&Explanation>,
        event: Option<&Event>,
        last: usize,
    ) -> FrameCaptions {
        let history = explanation.and_then(|explanation| explanation.history.as_ref());
        let fails = explanation.is_some_and(|explanation| is_violated(explanation.diagnosis.robustness()));
        FrameCaptions {
            control_dt,
            last,
            marks: event.map_or(Vec::new(), Event::marks),
            mark_color: if fails { FAIL } else { PASS },
            predicate: explanation.and_then(|explanation| predicate(signals, explanation)),
            spans: history.map_or(Vec::new(), |history| spans(history, last)),
            marks_contacts: false,
        }
    }

    /// Returns the captions with the largest force at a contact point. Views of the scene then have
    /// an arrow at each contact point.
    #[must_use]
    pub fn marking_contacts(self) -> FrameCaptions {
        FrameCaptions { marks_contacts: true, ..self }
    }

    /// Returns the caption of a sample with the largest force at a contact point, N, if a view
    /// shows contacts.
    fn with_contact(&self, sample: usize, force: Option<f64>) -> Caption {
        let mut caption = self.at(sample);
        let part =
            |force: f64| CaptionPart { text: format!("contact {force:>5.0} N"), color: SOFT, is_bold: false };
        caption.parts.extend(force.map(part));
        caption
    }

    /// Returns the caption of a sample.
    pub fn at(&self, sample: usize) -> Caption {
        let part = |text: String, color, is_bold| CaptionPart { text, color, is_bold };
        let seconds = |sample: usize| format!("{:.2}", sample as f64 * self.control_dt);
        let width = seconds(self.last).len();
        let mut parts = vec![part(format!("{:>width$} s", seconds(sample)), INK, true)];
        if let Some(predicate) = &self.predicate {
            let (status, color) = match predicate.robustness.get(sample) {
                Some(robustness) if is_violated(*robustness) => ("fails", FAIL),
                Some(_) => ("holds", PASS),
                None => ("     ", INK),
            };
            let is_read = (predicate.window.0..=predicate.window.1).contains(&sample);
            let color = if is_read { color } else { SOFT };
            let values = predicate.values.get(sample).cloned().unwrap_or_default();
            parts.extend([
                part(status.to_string(), color, true),
                part(predicate.name.clone(), SOFT, false),
                part(values, INK, true),
            ]);
        }
        let mark = self.marks.iter().rev().find(|(marked, _)| *marked == sample);
        let mark = mark.map(|(_, text)| (text.to_uppercase(), self.mark_color));
        let now = if self.last == 0 { 0.0 } else { sample as f64 / self.last as f64 };
        Caption { parts, mark, bar: TimeBar { now, spans: self.spans.clone() } }
    }
}

/// Returns the name and values of the decisive predicate.
fn predicate(signals: &[SignalRecord], explanation: &Explanation) -> Option<CaptionPredicate> {
    let found = explanation.diagnosis.predicate.as_ref()?;
    let history = explanation.history.as_ref()?;
    let [left, right] = &history.sides;
    let limit = |side: &str| side.parse::<f64>().is_ok();
    // A number on the left is the limit of what is on the right.
    let (name, side, limit_text, comparison) = match [limit(&found.sides[0]), limit(&found.sides[1])] {
        [false, true] => (&found.sides[0], left, &found.sides[1], found.comparison),
        [true, false] => (&found.sides[1], right, &found.sides[0], mirrored(found.comparison)),
        _ => {
            let values = left.iter().zip(right).map(|(left, right)| format!("{left:.4} and {right:.4}"));
            let values = padded(values.collect());
            return Some(CaptionPredicate {
                name: found.text.clone(),
                values,
                robustness: history.robustness.clone(),
                window: history.window,
            });
        }
    };
    let bound = match (comparison, found.is_negated) {
        ("<" | "<=", false) | (">" | ">=", true) => "max",
        (">" | ">=", false) | ("<" | "<=", true) => "min",
        ("==", false) | ("!=", true) => "required",
        _ => "forbidden",
    };
    let unit = unit(signals, name);
    let value = |value: &f64| {
        let value = format!("{value:.4}");
        let value = if value == "-0.0000" { "0.0000" } else { &value };
        format!("{value}{unit} ({bound} {limit_text})")
    };
    Some(CaptionPredicate {
        name: name.clone(),
        values: padded(side.iter().map(value).collect()),
        robustness: history.robustness.clone(),
        window: history.window,
    })
}

/// Returns a comparison whose sides are swapped.
fn mirrored(comparison: &str) -> &str {
    match comparison {
        "<" => ">",
        "<=" => ">=",
        ">" => "<",
        ">=" => "<=",
        same => same,
    }
}

/// Aligns texts to the right.
fn padded(mut texts: Vec<String>) -> Vec<String> {
    let width = texts.iter().map(|text| text.chars().count()).max().unwrap_or(0);
    texts.iter_mut().for_each(|text| *text = format!("{text:>width$}"));
    texts
}

/// Returns the unit of a term with a space before it, if all of its signals have the same one;
/// otherwise an empty text.
fn unit(signals: &[SignalRecord], term: &str) -> String {
    let Ok(formula) = Formula::parse(term) else { return String::new() };
    let of = |name: &str| signals.iter().find(|signal| signal.name == name).map(|signal| &signal.unit);
    let mut units: Vec<&String> = formula.signals().into_iter().filter_map(of).collect();
    units.dedup();
    match units.as_slice() {
        [unit] if !unit.is_empty() => format!(" {unit}"),
        _ => String::new(),
    }
}

/// Returns the window of the predicate and the violated samples in it as parts of the episode.
fn spans(history: &PredicateHistory, last: usize) -> Vec<([f64; 2], Color)> {
    let fraction = |sample: f64| (sample / last.max(1) as f64).clamp(0.0, 1.0);
    let (first, end) = history.window;
    let mut spans = vec![([fraction(first as f64), fraction(end as f64)], WINDOW)];
    for sample in &history.violated {
        let at = *sample as f64;
        spans.push(([fraction(at - 0.5), fraction(at + 0.5)], FAIL));
    }
    spans
}

/// The states of one simulation, and cameras of the target that see them.
#[derive(Debug)]
pub struct SeenStates {
    pub(crate) cameras: TargetCameras,
    pub(crate) episode: SeenEpisode,
    pub(crate) states: Vec<Vec<f64>>,
}

impl SeenStates {
    /// Returns the image, red, green and blue of each pixel, that arrives from a camera in a
    /// control step. The camera is an index of the requested names.
    ///
    /// # Panics
    /// If there is no such camera or state.
    pub fn image(&mut self, camera: usize, step: usize) -> Vec<u8> {
        self.cameras.image(&self.episode, &self.states, camera, step)
    }
}

/// The way to draw a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawing {
    /// By ray casting, for small pictures: without textures of files, and with the same bytes on
    /// every machine.
    Rays,
    /// With MuJoCo's renderer, which needs OpenGL, in this quality.
    OpenGl(Quality),
}

/// A view of a frame.
#[derive(Debug)]
enum View {
    /// The scene, by ray casting.
    Rays(Box<RayRenderer>),
    /// The scene, by MuJoCo.
    OpenGl(Box<Renderer>),
    /// The image that a camera of the target sees: its index among those of [`SeenStates`].
    Seen(usize),
}

impl View {
    fn stage(&mut self) -> Option<&mut Stage> {
        match self {
            View::Rays(renderer) => Some(&mut renderer.stage),
            View::OpenGl(renderer) => Some(renderer.stage()),
            View::Seen(_) => None,
        }
    }
}

/// Draws the frames of one simulation: the views of all cameras side by side, and below them the
/// caption.
#[derive(Debug)]
pub struct FrameRenderer {
    views: Vec<View>,
    seen: Option<SeenStates>,
    /// Width of a view and height of a frame, pixels.
    size: Size,
    /// Height of a view, pixels.
    height: usize,
    captions: Option<(FrameCaptions, CaptionLayout)>,
}

impl FrameRenderer {
    /// Makes a renderer with one view of this width for each of `cameras`, which are names from
    /// [`CAMERAS`](mishandle_world::CAMERAS), of the scene, or of `seen`: such a view has the
    /// pixels that this camera of the target saw, each as a square. `size` has the height of the
    /// whole frame. Without captions, or if the frame is too small for them, the views fill it, and
    /// no contacts are marked.
    ///
    /// # Errors
    /// If MuJoCo rejects the document, there is no such camera, or OpenGL is needed and not
    /// available.
    pub fn new(
        model: &PictureModel,
        size: Size,
        drawing: Drawing,
        cameras: &[&str],
        seen: Option<SeenStates>,
        captions: Option<FrameCaptions>,
    ) -> Result<FrameRenderer, MishandleError> {
        let seen_index = |camera: &str| seen.as_ref()?.cameras.names().position(|name| name == camera);
        let shows_scene = cameras.iter().any(|camera| seen_index(camera).is_none());
        let marks_contacts = shows_scene && captions.as_ref().is_some_and(|captions| captions.marks_contacts);
        let width = cameras.len() * size.width() as usize;
        let height = size.height() as usize;
        let captions = captions.and_then(|captions| {
            let widest = captions.with_contact(0, marks_contacts.then_some(0.0));
            Some((CaptionLayout::new(width, height, &widest)?, captions))
        });
        let captions = captions.map(|(layout, captions)| (captions, layout));
        let taken = captions.as_ref().map_or(0, |(_, layout)| layout.height() as u32);
        let scene = Size::new(size.width(), size.height() - taken).unwrap_or(size);
        let view = |camera: &&str| {
            if let Some(index) = seen_index(camera) {
                return Ok(View::Seen(index));
            }
            let mut view = match drawing {
                Drawing::Rays => View::Rays(Box::new(RayRenderer::new(model, scene, camera)?)),
                Drawing::OpenGl(quality) => {
                    View::OpenGl(Box::new(Renderer::new(model, scene, quality, camera)?))
                }
            };
            if let (Some(stage), Some(_), true) = (view.stage(), &captions, marks_contacts) {
                stage.mark_contacts();
            }
            Ok(view)
        };
        let views = cameras.iter().map(view).collect::<Result<_, MishandleError>>()?;
        Ok(FrameRenderer { views, seen, size, height: scene.height() as usize, captions })
    }

    /// Returns the width and height of a frame in pixels.
    pub fn frame_size(&self) -> (usize, usize) {
        (self.views.len() * self.size.width() as usize, self.size.height() as usize)
    }

    /// Returns whether frames have captions.
    pub fn has_captions(&self) -> bool {
        self.captions.is_some()
    }

    /// Places the cameras so that everything is in the image in all of these states.
    pub fn fit<'a>(&mut self, states: &(impl IntoIterator<Item = &'a [f64]> + Clone)) {
        for stage in self.views.iter_mut().filter_map(View::stage) {
            stage.frame(states.clone());
        }
    }

    /// Draws the frame of a sample with this state.
    ///
    /// # Errors
    /// If OpenGL fails.
    pub fn draw(&mut self, sample: usize, state: &[f64]) -> Result<Picture, WorldError> {
        let (width, height) = self.frame_size();
        let mut frame = Picture::new(width, height, [255; 3]);
        let width = self.size.width() as usize;
        for (index, view) in self.views.iter_mut().enumerate() {
            match (view, &mut self.seen) {
                (View::Rays(view), _) => frame.paste(index * width, 0, width, view.draw(state)),
                (View::OpenGl(view), _) => frame.paste(index * width, 0, width, view.draw(state)?),
                (View::Seen(camera), Some(seen)) => {
                    let image = seen.image(*camera, sample);
                    let image = Picture::enlarged(&image, seen.cameras.size(), [width, self.height]);
                    let free = [width - image.width(), self.height - image.height()];
                    frame.paste(index * width + free[0] / 2, free[1] / 2, image.width(), image.pixels());
                }
                (View::Seen(_), None) => {}
            }
        }
        if let Some((captions, layout)) = &self.captions {
            let stages = self.views.iter_mut().filter_map(View::stage);
            let contacts = stages.map(|stage| stage.largest_contact());
            let largest = contacts.reduce(f64::max).filter(|_| captions.marks_contacts);
            layout.draw(&captions.with_contact(sample, largest), &mut frame);
        }
        Ok(frame)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::sync::Arc;

    use mishandle_stl::{Clock, Formula, Trace};

    use super::*;
    use crate::inspect::explain_trace;

    /// Returns the captions of a trace with one signal `gap` in meters, sampled every 0.5 s.
    fn captions(formula: &str, values: &[f64]) -> FrameCaptions {
        let mut trace = Trace::new(Arc::from(["gap".to_owned()]));
        values.iter().for_each(|value| trace.push(&[*value]));
        let explanation =
            explain_trace(&Formula::parse(formula).unwrap(), &trace, Clock::steps(0.5)).unwrap();
        let signals = [SignalRecord { name: "gap".to_string(), unit: "m".to_string() }];
        FrameCaptions::new(0.5, &signals, Some(&explanation), explanation.event().as_ref(), values.len() - 1)
    }

    fn text(caption: &Caption) -> String {
        caption.parts.iter().map(|part| part.text.as_str()).collect::<Vec<_>>().join("|")
    }

    fn mark(caption: &Caption) -> Option<&str> {
        caption.mark.as_ref().map(|(text, _)| text.as_str())
    }

    #[test]
    fn a_caption_has_time_value_and_threshold_and_marks_the_violation() {
        let captions = captions("always[2:4](gap >= 2)", &[12.0, 1.0, 0.5, 1.5, 3.0]);
        assert_eq!(text(&captions.at(0)), "0.00 s|holds|gap|12.0000 m (min 2)");
        assert_eq!(text(&captions.at(2)), "1.00 s|fails|gap| 0.5000 m (min 2)");
        // The window is samples 2 to 4; the violation there is largest at its first sample.
        assert_eq!(mark(&captions.at(1)), None);
        assert_eq!(mark(&captions.at(2)), Some("VIOLATION"));
        assert_eq!(mark(&captions.at(3)), None);
        let spans = [([0.5, 1.0], WINDOW), ([0.375, 0.625], FAIL), ([0.625, 0.875], FAIL)];
        assert_eq!(captions.at(3).bar, TimeBar { now: 0.75, spans: spans.to_vec() });
    }

    #[test]
    fn a_violation_that_grows_has_two_marks() {
        let captions = captions("always(gap >= 2)", &[3.0, 1.0, 0.5, 1.5]);
        let marks = [0, 1, 2, 3].map(|sample| mark(&captions.at(sample)).map(str::to_string));
        let expected = [None, Some("FIRST VIOLATION"), Some("LARGEST VIOLATION"), None];
        assert_eq!(marks, expected.map(|text| text.map(str::to_string)));
    }

    #[test]
    fn the_bound_follows_the_comparison_and_its_negation() {
        let bound = |formula: &str| text(&captions(formula, &[1.0]).at(0)).replace("0.00 s|", "");
        assert_eq!(bound("gap < 4"), "holds|gap|1.0000 m (max 4)");
        assert_eq!(bound("4 < gap"), "fails|gap|1.0000 m (min 4)");
        assert_eq!(bound("not(gap < 4)"), "fails|gap|1.0000 m (min 4)");
        assert_eq!(bound("gap <= 2 * gap"), "holds|gap <= 2 * gap|1.0000 and 2.0000");
        assert_eq!(bound("2 * gap == 3"), "fails|2 * gap|2.0000 m (required 3)");
    }

    #[test]
    fn an_instant_that_satisfies_a_formula_is_marked_as_the_closest_approach() {
        let captions = captions("eventually(gap <= 1)", &[3.0, 0.5, 2.0]);
        assert_eq!(captions.at(1).mark, Some(("CLOSEST APPROACH".to_string(), PASS)));
    }
}
