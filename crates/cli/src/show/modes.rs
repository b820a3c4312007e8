//! Failure modes, as text.

use mishandle::results::{AxisFacts, FailureMode};
use mishandle::verdict::axis_value;
use mishandle_text::{decimal, instant, plural};

use super::{escape, output, physics, scenario};

/// Number of axes in the text that describes the region of a mode.
const REGION_AXES: usize = 4;

/// The failure modes of a run.
pub struct Modes<'a> {
    pub modes: Vec<&'a FailureMode>,
    pub failures: u64,
    pub not_grouped: u64,
    pub axes: &'a [AxisFacts],
    pub control_dt: f64,
}

impl Modes<'_> {
    /// Describes the modes: their number, a table, and their regions.
    pub fn text(&self) -> String {
        let Modes { modes, failures, not_grouped, .. } = self;
        let mut parts =
            vec![format!("{} in {}", plural(*failures, "failure"), plural(modes.len(), "failure mode"))];
        if !modes.is_empty() {
            parts.push(output::table(&self.table()));
            let lines = modes.iter().map(|mode| format!("mode {}: {}", mode.mode, self.region(mode)));
            parts.push(lines.collect::<Vec<_>>().join("\n"));
        }
        if *not_grouped > 0 {
            parts.push(format!(
                "{} in no mode: without a recorded trace, or above the limit of grouped failures",
                plural(*not_grouped, "failure")
            ));
        }
        parts.join("\n\n")
    }

    fn table(&self) -> Vec<Vec<String>> {
        let mut columns = vec![
            "mode",
            "failures",
            "decisive predicate",
            "final at",
            "representative",
            "robustness",
            "distance from nominal",
        ];
        let has_physics = self.modes.iter().any(|mode| mode.physics.is_some());
        columns.extend(has_physics.then_some("physics"));
        let time = |sample: u64| instant(sample as usize, self.control_dt);
        let row = |mode: &&FailureMode| {
            let [first, last] = mode.samples;
            let times =
                if first == last { time(first) } else { format!("{} to {}", time(first), time(last)) };
            let predicate = if mode.predicate.is_empty() { "none" } else { &mode.predicate };
            let mut row = vec![
                mode.mode.to_string(),
                mode.failures.to_string(),
                predicate.to_string(),
                times,
                format!("trial {}, simulation {}", mode.trial, mode.simulation),
                decimal(mode.robustness.0, 4),
                format!("{:.0} % of the widths", 100.0 * mode.distance_from_nominal),
            ];
            row.extend(has_physics.then(|| physics::word(mode.physics.as_ref()).to_string()));
            row
        };
        let columns = columns.into_iter().map(String::from).collect();
        std::iter::once(columns).chain(self.modes.iter().map(row)).collect()
    }

    /// Describes the ranges of a mode on the axes that matter, the narrowest first.
    fn region(&self, mode: &FailureMode) -> String {
        if mode.axes.is_empty() {
            return "no axis distinguishes these failures from the other simulations".to_string();
        }
        let range = |name: &String| {
            let axis = self.axes.iter().find(|axis| axis.name == *name)?;
            Some((axis, (*mode.region.get(name)?)?))
        };
        let mut ranges: Vec<(&AxisFacts, [f64; 2])> = mode.axes.iter().filter_map(range).collect();
        let width = |(axis, [low, high]): &(&AxisFacts, [f64; 2])| (high - low) / (axis.high - axis.low);
        // Stable, so axes of equal width stay in the order of the space.
        ranges.sort_by(|a, b| width(a).total_cmp(&width(b)));
        let more = ranges.len().saturating_sub(REGION_AXES);
        let shown = ranges.iter().take(REGION_AXES).map(|(axis, [low, high])| {
            let value = |value: &f64| scenario::value_text(axis, Some(*value));
            let range = if low == high { value(low) } else { format!("{} to {}", value(low), value(high)) };
            axis_value(&escape::name(&axis.name), &range, &escape::name(&axis.unit))
        });
        let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
        shown.collect::<Vec<_>>().join(", ") + &rest
    }
}
