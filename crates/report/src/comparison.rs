//! The page of a comparison: what the second controller breaks and fixes, and where.

use crate::charts::{Area, Chart, LinkedMark, Mark, Panel, Series, Shape};
use mishandle::MishandleError;
use mishandle::evaluation::Corners;
use mishandle::inspect::{ComparedPair, compared_pairs, judgment, sameness};
use mishandle::results::{self, ComparedRun, Comparison, Estimate, Number, PairedMeans, PairedRates};
use mishandle::rollout::Axis;
use mishandle::run::{compared_without_verdict, has_random_rows, recorded_axis};
use mishandle::store::{RunFile, RunHeader};
use mishandle_text::plural;

use crate::flipped_pairs::FlippedPairs;
use crate::html::{figure, number, p_value, percent, short, table, text, visible};
use crate::map::{SIZE, axis_label};
use crate::page::Document;
use crate::ranking::Ranking;
use crate::space::{around, chart_axis, linear, value_text};
use crate::{color, section, words};

/// Largest numbers of rows in the tables of new and of fixed failures, and of commands below each.
const MAX_ROWS: usize = 150;
const MAX_COMMANDS: usize = 20;

/// Largest number of pairs, evenly spaced, that rank the axes and of which dots are chosen.
const MAX_SAMPLE: u64 = 3000;

/// Largest number of marks of each outcome in a chart, and of dots.
const MAX_MARKS: usize = 400;
const MAX_DOTS: usize = 1200;

/// Largest number of axes in a table and in the text of a mark.
const MAX_COLUMNS: usize = 6;

/// Number of axes whose pairs are shown if there are more than two.
const PAIR_AXES: usize = 3;

/// Returns the page about a comparison of these runs: one HTML file without scripts, which loads
/// nothing. `flipped` has pictures of pairs of which one fails.
///
/// # Errors
/// If a run cannot be read.
pub fn comparison_page(
    found: &Comparison,
    runs: [&RunFile; 2],
    flipped: &FlippedPairs,
) -> Result<String, MishandleError> {
    let title = format!("comparison of {}", text(&short(&found.target, 60)));
    let body = comparison_section(found, runs, flipped)?;
    Ok(Document { title: &title, up: None, body: &body }.html())
}

/// The pairs that charts show.
#[derive(Default)]
struct Shown {
    /// Evenly spaced pairs of any outcome.
    sample: Vec<ComparedPair>,
    /// The first pairs with each outcome, in its order, and the numbers of all of them.
    marks: [Vec<ComparedPair>; 4],
    counts: [u64; 4],
}

impl Shown {
    fn new(found: &Comparison, [first, second]: [&RunFile; 2]) -> Result<Shown, MishandleError> {
        let every = found.pairs.div_ceil(MAX_SAMPLE).max(1);
        let mut shown = Shown::default();
        for (index, pair) in (0_u64..).zip(compared_pairs(first, second)?) {
            let pair = pair?;
            let outcome = Outcome::of(&pair) as usize;
            shown.counts[outcome] += 1;
            if shown.marks[outcome].len() < MAX_MARKS {
                shown.marks[outcome].push(pair.clone());
            }
            if index.is_multiple_of(every) {
                shown.sample.push(pair);
            }
        }
        Ok(shown)
    }
}

/// Outcome of a pair.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    BothSucceed,
    BothFail,
    Fixed,
    New,
}

impl Outcome {
    fn of(pair: &ComparedPair) -> Outcome {
        match pair.succeeds {
            [true, true] => Outcome::BothSucceed,
            [false, false] => Outcome::BothFail,
            [false, true] => Outcome::Fixed,
            [true, false] => Outcome::New,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Outcome::BothSucceed => "both succeed",
            Outcome::BothFail => "neither succeeds",
            Outcome::Fixed => "fixed: A fails, B succeeds",
            Outcome::New => "new: A succeeds, B fails",
        }
    }
}

/// Returns the section about a comparison.
pub(crate) fn comparison_section(
    found: &Comparison,
    runs: [&RunFile; 2],
    flipped: &FlippedPairs,
) -> Result<String, MishandleError> {
    let header = runs[0].header();
    let axes: Vec<Axis> = header.axes.iter().map(recorded_axis).collect();
    let shown = Shown::new(found, runs)?;
    let ranking = ranking(&shown.sample, &axes, has_random_rows(header));
    let mut columns: Vec<usize> = (0..axes.len()).collect();
    if columns.len() > MAX_COLUMNS {
        columns = ranking.first(MAX_COLUMNS);
    }
    let view = View { shown, axes: &axes, ranking, columns };
    let target = text(&short(&found.target, 60));
    let mut out = format!(
        "<section class=\"run\">\n<h2>{target}: {}.{}</h2>\n<p class=\"requirement\"><b>A</b> is {}. <b>B</b> is {}. Both ran the \
         same scenarios with the same seeds.</p>\n<p><b>Requirement:</b> {}</p>\n<p>{}</p>\n{}{}",
        judgment(&found.success),
        compared_without_verdict(found).iter().map(|text| format!(" {text}.")).collect::<String>(),
        name(&found.first),
        name(&found.second),
        section::requirement(header),
        text(&found.verdict) + &corners_text(found),
        flipped.html(),
        tiles(found),
    );
    let mut notes: Vec<String> = Vec::new();
    notes.extend(sameness(&found.first, &found.second).map(|sentence| text(&sentence) + "."));
    if found.left_out > 0 {
        let pairs = plural(found.left_out, "pair");
        notes.push(format!("{pairs} left out: the target cannot start from the scenario."));
    }
    notes.extend(found.differences.iter().map(|what| format!("A and B also differ in {}.", text(what))));
    if !notes.is_empty() {
        let notes: String = notes.iter().map(|note| format!("<li>{note}</li>")).collect();
        out.push_str(&format!("<ul class=\"notes\">{notes}</ul>\n"));
    }
    out.push_str(&format!("<h3>Differences</h3>\n{}", differences(found)));
    out.push_str(&format!("<h3>Where they differ</h3>\n{}", view.figures()));
    let [new, fixed] = found.changes();
    let new = view.failures("New failures: A succeeds, B fails", "new", &found.new_failures, new);
    let fixed = view.failures("Fixed failures: A fails, B succeeds", "fixed", &found.fixed_failures, fixed);
    out.push_str(&format!("<h3>New failures</h3>\n{new}<h3>Fixed failures</h3>\n{fixed}"));
    Ok(out + &format!("<h3>What was compared</h3>\n{}</section>\n", facts(found, header)))
}

/// Names a run by its controller, or by its file.
fn name(run: &ComparedRun) -> String {
    let path = &run.run;
    match &run.controller {
        Some(controller) => format!(
            "the controller <code>{}</code>{} (<code>{}</code>)",
            text(&short(words::file_name(controller), 60)),
            run.guard.as_ref().map_or(String::new(), |guard| format!(", {},", text(&guard.words()))),
            text(&short(path, 80))
        ),
        None => format!("<code>{}</code>", text(&short(path, 80))),
    }
}

/// Says how many of the new and the fixed failures are at the corners, which the verdict leaves
/// out.
fn corners_text(found: &Comparison) -> String {
    let [new, fixed] = found.changes();
    match (new - found.success.first_only, fixed - found.success.second_only) {
        (0, 0) => String::new(),
        (new, fixed) => format!(
            " At the corners and the center of the initial box, which are no random sample, {} new and {fixed} fixed.",
            if new == 1 { "1 failure is".to_string() } else { format!("{new} failures are") }
        ),
    }
}

fn tiles(found: &Comparison) -> String {
    let rate = |rate: &Estimate| rate.value.map_or("–".to_string(), percent);
    let tiles = [
        (rate(&found.success.first), "of A's random simulations succeed"),
        (rate(&found.success.second), "of B's random simulations succeed"),
        (found.success.first_only.to_string(), "new failures in random simulations"),
        (found.success.second_only.to_string(), "fixed failures in random simulations"),
        (found.pairs.to_string(), "pairs of random simulations"),
    ];
    let tile = |(value, name): &(String, &str)| format!("<div><dd>{value}</dd><dt>{name}</dt></div>");
    format!("<dl class=\"tiles\">{}</dl>\n", tiles.iter().map(tile).collect::<String>())
}

/// Returns the table of the paired differences.
fn differences(found: &Comparison) -> String {
    let signed = |value: f64| if value > 0.0 { format!("+{}", number(value)) } else { number(value) };
    let points = |value: f64| signed((1e4 * value).round() / 100.0);
    let row =
        |name: &str, cells: [String; 2], difference: &Estimate, show: &dyn Fn(f64) -> String, p: f64| {
            let ends = difference.low.zip(difference.high);
            let [a, b] = cells;
            vec![
                name.to_string(),
                a,
                b,
                difference.value.map_or("–".to_string(), show),
                ends.map_or("–".to_string(), |(low, high)| format!("{} to {}", show(low), show(high))),
                difference.value.map_or("–".to_string(), |_| p_value(p)),
                difference.n.to_string(),
            ]
        };
    let mut rows = Vec::new();
    let rates = [
        ("success rate (%)", Some(&found.success)),
        ("strict success rate (%)", found.strict_success.as_ref()),
        ("careful success rate (%)", found.careful_success.as_ref()),
    ];
    for (name, rates) in rates.into_iter().filter_map(|(name, rates)| Some((name, rates?))) {
        let PairedRates { first, second, difference, p_value, .. } = rates;
        let rate = |rate: &Estimate| rate.value.map_or("–".to_string(), |value| number(1e2 * value));
        rows.push(row(name, [rate(first), rate(second)], difference, &points, *p_value));
    }
    let is_clipped = found.sequential.as_ref().is_some_and(|rule| rule.robustness_bounds.is_some());
    let robustness = if is_clipped { "robustness, clipped" } else { "robustness" };
    let means = [
        (robustness, Some(&found.robustness)),
        ("dangerous control steps", found.dangerous_steps.as_ref()),
        ("completion step, if both succeed", found.completion_step.as_ref()),
    ];
    for (name, means) in means.into_iter().filter_map(|(name, means)| Some((name, means?))) {
        let PairedMeans { first, second, difference, p_value, .. } = means;
        let mean = |value: Option<f64>| value.map_or("–".to_string(), number);
        rows.push(row(name, [mean(*first), mean(*second)], difference, &signed, *p_value));
    }
    let head = ["mean over the random simulations", "A", "B", "B − A", "95 % interval", "p-value", "pairs"];
    table("Paired differences", &head, &rows)
        + match (found.at_any_time, is_clipped) {
            (true, false) => {
                "<p class=\"notes\">A rule chose the number of pairs: all p-values and the intervals of the rates hold at any \
                 time; the intervals of the means are for a number of pairs that is fixed beforehand.</p>\n"
            }
            (true, true) => {
                "<p class=\"notes\">A rule chose the number of pairs: all p-values and the intervals of the rates and of the \
                 clipped robustness hold at any time; the intervals of the other means are for a number of pairs that is fixed \
                 beforehand.</p>\n"
            }
            (false, _) => "",
        }
        + if found.at_any_time {
            ""
        } else {
            "<p class=\"notes\">Rates: Newcombe's interval for pairs and the exact McNemar test. Means: paired bootstrap and the exact \
           sign test, which asks whether B is as often above A as below it. Tests are two-sided and not corrected for their \
           number.</p>\n"
        }
}

struct View<'a> {
    shown: Shown,
    axes: &'a [Axis],
    /// The axes by their effect on the change of the robustness.
    ranking: Ranking,
    /// The axes in tables and in texts of marks: all, or the first of the ranked ones.
    columns: Vec<usize>,
}

fn ranking(pairs: &[ComparedPair], space: &[Axis], is_random: bool) -> Ranking {
    let value = |pair: &ComparedPair, axis: usize| pair.scenario.get(axis).copied().flatten();
    let has_values = |axis: &usize| pairs.iter().any(|pair| value(pair, *axis).is_some_and(f64::is_finite));
    let axes: Vec<usize> =
        (0..space.len()).filter(|axis| !space[*axis].is_fixed() && has_values(axis)).collect();
    Ranking::new(space, &axes, pairs, is_random, value, change)
}

/// Returns the change of the robustness if it is finite.
fn change(pair: &ComparedPair) -> Option<f64> {
    let [first, second] = pair.robustness;
    Some(second? - first?).filter(|change| change.is_finite())
}

impl View<'_> {
    /// Returns the charts: robustness of A against B, and maps of the space.
    fn figures(&self) -> String {
        let legend = "<p class=\"legend\"><span><b class=\"fail\">✕</b> new failure</span> <span><b class=\"pass\">○</b> fixed \
                      failure</span> <span><b>■</b> neither succeeds</span> <span><b class=\"pass\">•</b> both succeed</span></p>\n";
        let scatter = self.scatter();
        let maps: String = self.maps().concat();
        format!(
            "<p>Each mark is a pair of simulations. Point at a mark to see the pair; a new or fixed failure leads to its row.{}</p>\n\
             {legend}<div class=\"grid\">{scatter}{maps}</div>\n",
            self.ranking().map_or(String::new(), |text| format!(" {text}"))
        )
    }

    fn scatter(&self) -> String {
        let finite = |value: Option<f64>| value.filter(|rho| rho.is_finite());
        let at = |pair: &ComparedPair| Some([finite(pair.robustness[0])?, finite(pair.robustness[1])?]);
        let shown: Vec<[f64; 2]> = self.drawn().filter_map(at).collect();
        let [low, high] = crate::space::sane(around(shown.iter().flatten().copied()));
        let mut areas = Vec::new();
        if low < 0.0 && high > 0.0 {
            areas.push(Area { x: [0.0, high], y: [low, 0.0], color: color::SHADE });
            areas.push(Area { x: [low, 0.0], y: [0.0, high], color: color::POSITIVE[0] });
        }
        let mut lines = vec![Series::new(color::LIMIT, Mark::ThinLine, [[low, low], [high, high]])];
        lines.push(Series::new(color::LIMIT, Mark::DashedLine, [[low, 0.0], [high, 0.0]]));
        lines.push(Series::new(color::LIMIT, Mark::DashedLine, [[0.0, low], [0.0, high]]));
        let axes = [linear("robustness of A", [low, high]), linear("robustness of B", [low, high])];
        let svg = self.chart(axes, areas, lines, &at, "Robustness of B against robustness of A");
        let missing = self.drawn().count() - shown.len();
        let missing = match missing {
            0 => String::new(),
            n => format!(
                " {} without two finite values {} missing.",
                plural(n as u64, "pair"),
                if n == 1 { "is" } else { "are" }
            ),
        };
        let caption = format!(
            "Above the diagonal B is better. Orange: A satisfies the requirement and B violates it; light blue: the reverse.{missing}"
        );
        figure(&svg, "Robustness of A and B.", &caption)
    }

    fn ranking(&self) -> Option<String> {
        let shown = self.ranking.shown(PAIR_AXES).len();
        (self.ranking.len() > 2)
            .then(|| self.ranking.sentence(self.axes, shown, "the change of the robustness"))
    }

    fn maps(&self) -> Vec<String> {
        let value = |pair: &ComparedPair, axis: usize| {
            pair.scenario.get(axis).copied().flatten().filter(|value| value.is_finite())
        };
        let map = |x: usize, y: usize| {
            let at = |pair: &ComparedPair| Some([value(pair, x)?, value(pair, y)?]);
            let [first, second] = [x, y].map(|axis| &self.axes[axis]);
            let what = format!("New and fixed failures over {} and {}", first.name, second.name);
            let svg = self.chart([chart_axis(first), chart_axis(second)], Vec::new(), Vec::new(), &at, &what);
            let title = format!("{} and {}.", text(&short(&first.name, 40)), text(&short(&second.name, 40)));
            figure(&svg, &title, "")
        };
        match self.ranking.shown(PAIR_AXES)[..] {
            [] => Vec::new(),
            [axis] => {
                let at = |pair: &ComparedPair| Some([value(pair, axis)?, change(pair)?]);
                let x = chart_axis(&self.axes[axis]);
                let range = around(self.drawn().filter_map(|pair| at(pair).map(|[_, y]| y)));
                let limit = Series::new(color::LIMIT, Mark::DashedLine, x.range.map(|end| [end, 0.0]));
                let what = format!("Change of the robustness over {}", self.axes[axis].name);
                let y = linear("robustness, B − A", range);
                let svg = self.chart([x, y], Vec::new(), vec![limit], &at, &what);
                vec![figure(&svg, "Change over the space.", "Above the dashed line B is better.")]
            }
            [x, y] => vec![map(x.min(y), x.max(y))],
            ref chosen => {
                let pairs = (0..chosen.len()).flat_map(|i| (i + 1..chosen.len()).map(move |j| (i, j)));
                pairs.map(|(i, j)| map(chosen[i], chosen[j])).collect()
            }
        }
    }

    fn chart(
        &self,
        [x, y]: [crate::charts::ChartAxis; 2],
        areas: Vec<Area>,
        mut series: Vec<Series>,
        at: &dyn Fn(&ComparedPair) -> Option<[f64; 2]>,
        what: &str,
    ) -> String {
        let both_succeed = self.shown.sample.iter().filter(|pair| Outcome::of(pair) == Outcome::BothSucceed);
        let dots: Vec<[f64; 2]> = both_succeed.filter_map(at).collect();
        let every = dots.len().div_ceil(MAX_DOTS).max(1);
        series.push(Series::new(color::PASS, Mark::Dot, dots.into_iter().step_by(every)));
        let mut marks = Vec::new();
        for outcome in [Outcome::BothFail, Outcome::Fixed, Outcome::New] {
            let (shape, color, list) = match outcome {
                Outcome::New => (Shape::Cross, color::FAIL, Some("new")),
                Outcome::Fixed => (Shape::Ring, color::PASS, Some("fixed")),
                _ => (Shape::Square, color::LIMIT, None),
            };
            for (index, pair) in self.shown.marks[outcome as usize].iter().enumerate() {
                let Some([x, y]) = at(pair) else { continue };
                let href = list
                    .filter(|_| index < MAX_ROWS)
                    .map_or(String::new(), |list| format!("#{}", row_id(list, pair.trial, pair.number)));
                // The Tab key stops at the first of each kind.
                let is_tab_stop = index == 0;
                marks.push(LinkedMark {
                    x,
                    y,
                    shape,
                    color,
                    href,
                    label: self.label(pair, outcome),
                    is_tab_stop,
                });
            }
        }
        let count = |outcome: Outcome| self.shown.counts[outcome as usize];
        let label = format!(
            "{what}: {} new failures, {} fixed failures, {} fail in both",
            count(Outcome::New),
            count(Outcome::Fixed),
            count(Outcome::BothFail)
        );
        let panel = Panel { title: String::new(), x, y, areas, series, marks };
        let title = String::new();
        let caption = String::new();
        let legend = Vec::new();
        let chart = Chart { title, caption, legend, columns: 1, panel_size: SIZE, panels: vec![panel] };
        chart.figure(&visible(&label))
    }

    fn label(&self, pair: &ComparedPair, outcome: Outcome) -> String {
        let value = |axis: &usize| {
            let found = pair.scenario.get(*axis).copied().flatten();
            format!("{} = {}", short(&self.axes[*axis].name, 40), value_text(&self.axes[*axis], found))
        };
        let values: Vec<String> = self.columns.iter().map(value).collect();
        let more = if self.axes.len() > MAX_COLUMNS { ", …" } else { "" };
        format!(
            "{}; trial {}, simulation {}: robustness {} in A, {} in B; {}{more}",
            outcome.words(),
            pair.trial,
            pair.number,
            robustness(pair.robustness[0]),
            robustness(pair.robustness[1]),
            values.join(", ")
        )
    }

    /// Returns the pairs of the charts: those with marks, and the dots.
    fn drawn(&self) -> impl Iterator<Item = &ComparedPair> {
        let is_dot = |pair: &&ComparedPair| Outcome::of(pair) == Outcome::BothSucceed;
        let marks = self.shown.marks[1..].iter().flatten();
        self.shown.sample.iter().filter(is_dot).chain(marks)
    }

    /// Returns a table of the first of `all` failures, with the commands that replay them.
    fn failures(&self, caption: &str, list: &str, pairs: &[results::ComparedPair], all: u64) -> String {
        if pairs.is_empty() {
            return "<p>None.</p>\n".to_string();
        }
        let mut head: Vec<String> =
            ["trial", "simulation", "robustness A", "robustness B"].map(String::from).to_vec();
        head.extend(self.columns.iter().map(|axis| axis_label(&self.axes[*axis])));
        head.push("seed".to_string());
        let head: String = head.iter().map(|cell| format!("<th scope=\"col\">{cell}</th>")).collect();
        let rho = |value: Option<Number>| robustness(value.map(|value| value.0));
        let row = |pair: &results::ComparedPair| {
            let value = |axis: &usize| {
                let found = pair.scenario.get(&self.axes[*axis].name).copied().flatten();
                format!("<td>{}</td>", text(&value_text(&self.axes[*axis], found)))
            };
            let values: String = self.columns.iter().map(value).collect();
            format!(
                "<tr id=\"{}\"><td>{}</td><td>{}</td><td>{}</td><td>{}</td>{values}<td class=\"seed\">{}</td></tr>\n",
                row_id(list, pair.trial, pair.simulation),
                pair.trial,
                pair.simulation,
                rho(pair.first_robustness),
                rho(pair.second_robustness),
                pair.seed.0
            )
        };
        let rows: String = pairs.iter().take(MAX_ROWS).map(row).collect();
        let mut notes = Vec::new();
        if all > MAX_ROWS as u64 {
            notes.push(format!(
                "The first {MAX_ROWS} of {all} are shown; the JSON document of the comparison lists {}.",
                if all > pairs.len() as u64 { "more" } else { "all" }
            ));
        }
        if self.axes.len() > self.columns.len() {
            notes.push(format!(
                "The {} axes whose rank correlation with the change of the robustness is largest are shown, of {}.",
                self.columns.len(),
                self.axes.len()
            ));
        }
        if pairs.iter().any(|pair| pair.trial == Corners::TRIAL) {
            notes.push(
                "Trial 2 has the corners and the center of the initial box, which are no random sample."
                    .to_string(),
            );
        }
        let notes = if notes.is_empty() {
            String::new()
        } else {
            format!("<p class=\"notes\">{}</p>\n", notes.join(" "))
        };
        let commands: Vec<String> = pairs.iter().take(MAX_COMMANDS).map(|pair| pair.replay.clone()).collect();
        format!(
            "<div class=\"scroll tall\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\"><table><caption>{caption} ({all})</caption>\
             <thead><tr>{head}</tr></thead>\n<tbody>{rows}</tbody></table></div>\n{notes}<details><summary>Run {} \
             again</summary><pre>{}</pre></details>\n",
            if pairs.len() > MAX_COMMANDS { format!("the first {MAX_COMMANDS}") } else { "them".to_string() },
            crate::html::lines(&commands)
        )
    }
}

fn robustness(value: Option<f64>) -> String {
    value.map_or("no verdict".to_string(), number)
}

fn row_id(list: &str, trial: u32, number: u32) -> String {
    format!("{list}-t{trial}-s{number}")
}

/// Returns the table of both runs and what they share.
fn facts(found: &Comparison, header: &RunHeader) -> String {
    let code = |value: &str| format!("<code>{}</code>", text(value));
    let optional = |value: &Option<String>| value.as_deref().map_or("–".to_string(), code);
    let a = &found.first;
    let b = &found.second;
    let hash = |hash: &str| code(&short(hash, 20));
    let optional_hash = |value: &Option<String>| value.as_deref().map_or("–".to_string(), hash);
    let row = |name: &str, a: String, b: String| vec![name.to_string(), a, b];
    let path = |run: &ComparedRun| code(&run.run);
    let guard =
        |run: &ComparedRun| run.guard.as_ref().map_or("–".to_string(), |guard| text(&guard.words()));
    let rows = [
        row("run file", path(a), path(b)),
        row("controller", optional(&a.controller), optional(&b.controller)),
        row("hash of the controller", optional_hash(&a.controller_hash), optional_hash(&b.controller_hash)),
        row("guard", guard(a), guard(b)),
        row("hash of the target", hash(&a.target_hash), hash(&b.target_hash)),
        row("commit", code(&a.commit), code(&b.commit)),
    ];
    let shared = [
        ("formula", code(&found.formula)),
        ("space", code(&header.space)),
        ("seed", header.seed.to_string()),
    ];
    let fact = |(name, value): &(&str, String)| format!("<div><dt>{name}</dt><dd>{value}</dd></div>\n");
    format!(
        "{}<dl class=\"facts\">{}</dl>\n",
        table("Both runs", &["", "A", "B"], &rows),
        shared.iter().map(fact).collect::<String>()
    )
}
