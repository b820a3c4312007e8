/// Quantity, range and ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub struct ChartAxis {
    /// Quantity and unit.
    pub label: String,
    /// Ends of the axis; above 0 on a logarithmic scale.
    pub range: [f64; 2],
    /// Spacing of the numbers.
    pub scale: Scale,
    /// Positions with their labels.
    pub ticks: Vec<(f64, String)>,
}

/// Spacing of an axis's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences have equal lengths.
    Linear,
    /// Equal ratios have equal lengths.
    Logarithmic,
    /// Linear, and the ticks are names, which are drawn at an angle.
    Category,
}

/// Most ticks that an axis chooses by itself.
const MOST_TICKS: f64 = 6.0;

impl ChartAxis {
    /// Returns a logarithmic axis.
    pub fn logarithmic(label: &str, range: [f64; 2], ticks: Vec<(f64, String)>) -> ChartAxis {
        ChartAxis { label: label.to_string(), range, scale: Scale::Logarithmic, ticks }
    }

    /// Returns a linear axis with ticks at multiples of 1, 2 or 5 times a power of ten.
    pub fn linear(label: &str, range: [f64; 2]) -> ChartAxis {
        let [low, high] = range;
        let least = (high - low) / MOST_TICKS;
        let power = 10.0_f64.powf(least.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|first| first * power).into_iter().find(|step| *step >= least);
        let step = step.unwrap_or(10.0 * power);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let ticks = ((low / step).ceil() as i64..=(high / step).floor() as i64)
            .map(|i| (i as f64 * step, format!("{:.decimals$}", i as f64 * step)))
            .collect();
        ChartAxis { label: label.to_string(), range, scale: Scale::Linear, ticks }
    }

    /// Returns an axis of shares from 0 to 1, whose ticks are in percent.
    pub fn percent(label: &str) -> ChartAxis {
        let ticks = [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| (share, format!("{:.0}", 100.0 * share)));
        ChartAxis { label: label.to_string(), range: [0.0, 1.0], scale: Scale::Linear, ticks: ticks.to_vec() }
    }

    /// Returns an axis with one name at each of x = 0, 1, 2, ….
    pub fn categories(label: &str, names: &[String]) -> ChartAxis {
        let ticks = names.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect();
        let range = [-0.5, names.len() as f64 - 0.5];
        ChartAxis { label: label.to_string(), range, scale: Scale::Category, ticks }
    }

    /// Returns the position on a linear scale.
    pub(crate) fn place(&self, value: f64) -> f64 {
        if self.scale == Scale::Logarithmic { value.ln() } else { value }
    }

    /// Returns the label of the tick at a position on the linear scale.
    pub(crate) fn tick_label(&self, place: f64) -> String {
        let distance = |(value, _): &&(f64, String)| (self.place(*value) - place).abs();
        let nearest = self.ticks.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.map_or(String::new(), |(_, label)| label.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(range: [f64; 2], expected: &[&str]) {
        let labels: Vec<String> =
            ChartAxis::linear("", range).ticks.into_iter().map(|(_, label)| label).collect();
        assert_eq!(labels, expected, "{range:?}");
    }

    #[test]
    fn linear_ticks_are_round_and_inside_the_range() {
        check([0.0, 1.0], &["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        check([-37.0, 102.0], &["0", "50", "100"]);
        check([0.0, 100_000.0], &["0", "20000", "40000", "60000", "80000", "100000"]);
    }

    #[test]
    fn the_label_of_a_logarithmic_tick_is_found_by_its_place() {
        let ticks = vec![(10.0, "10".to_string()), (100.0, "100".to_string())];
        let axis = ChartAxis::logarithmic("", [1.0, 1000.0], ticks);
        assert_eq!(axis.tick_label(axis.place(100.0)), "100");
    }
}
