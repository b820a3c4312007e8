//! Success rates over the values of axes: a table with intervals, and heat maps of pairs.

use mishandle::evaluation::Estimate;
use mishandle::results::{AxisRate, AxisRates, PairRate, ValueRange};
use mishandle_text::{p_value_phrase, plural};

use crate::html::{number, percent, short, text};

/// Number of axes that are shown at once if no rate differs, and largest number that can be opened.
const FIRST: usize = 3;
const MAX_AXES: usize = 60;

/// Largest number of heat maps.
const MAX_PAIRS: usize = 3;

/// Returns the rates as HTML.
pub fn section(rates: &AxisRates, source: &str) -> String {
    let differing = rates.axes.iter().filter(|axis| differs(axis)).count();
    let mut out = format!("<p>{}</p>\n", text(&sentence(rates, source)));
    let shown = if differing > 0 { differing } else { FIRST }.min(rates.axes.len());
    let (first, rest) = rates.axes.split_at(shown);
    let rest = &rest[..rest.len().min(MAX_AXES)];
    let scale = Scale::new(&rates.axes);
    out.push_str(&axes_table(first, rates.success_rate, &scale));
    if !rest.is_empty() {
        out.push_str(&format!(
            "<details><summary>{}</summary>\n{}</details>\n",
            match rest.len() {
                1 => "1 more axis".to_string(),
                n => format!("{n} more axes"),
            },
            axes_table(rest, rates.success_rate, &scale)
        ));
    }
    out.push_str(&pairs(rates));
    out
}

/// Returns in a sentence or two what the rates say.
pub fn sentence(rates: &AxisRates, source: &str) -> String {
    let differing = rates.differing().count();
    let all =
        format!("Of {source}, {} succeed{}.", rate(rates.success_rate), interval_text(rates.success_rate));
    let found = match differing {
        0 => "No part of the range of an axis differs measurably from the rest of it".to_string(),
        _ => format!(
            "{} of the {} {} from the rest of the axis",
            plural(differing as u64, "part"),
            if rates.axes.len() == 1 { "axis".to_string() } else { format!("{} axes", rates.axes.len()) },
            if differing == 1 { "differs" } else { "differ" },
        ),
    };
    format!("{all} {found} (exact test of Fisher, Holm's correction for all parts of all axes, 5 %).")
}

fn differs(axis: &AxisRate) -> bool {
    axis.bins.iter().any(|bin| bin.differs)
}

/// The part of the rates that bars show.
struct Scale {
    low: f64,
}

impl Scale {
    fn new(axes: &[AxisRate]) -> Scale {
        let bounds = axes.iter().flat_map(|axis| &axis.bins).filter_map(|bin| bin.success_rate.low);
        // A multiple of 10 %, at most 90 %.
        Scale { low: (bounds.fold(0.9, f64::min) * 10.0).floor() / 10.0 }
    }

    /// Returns the place of a rate, in percent of the width.
    fn at(&self, rate: f64) -> f64 {
        100.0 * ((rate - self.low) / (1.0 - self.low)).clamp(0.0, 1.0)
    }

    fn bar(&self, found: Estimate, all: Estimate) -> String {
        let (Some(value), Some(low), Some(high)) = (found.value, found.low, found.high) else {
            return String::new();
        };
        let all =
            all.value.map_or(String::new(), |all| format!("<s style=\"left:{:.1}%\"></s>", self.at(all)));
        format!(
            "<span class=\"interval\">{all}<i style=\"left:{:.1}%;width:{:.1}%\"></i><b style=\"left:{:.1}%\"></b></span>",
            self.at(low),
            self.at(high) - self.at(low),
            self.at(value)
        )
    }
}

fn axes_table(axes: &[AxisRate], all: Estimate, scale: &Scale) -> String {
    let mut rows = String::new();
    for axis in axes {
        for (index, bin) in axis.bins.iter().enumerate() {
            let name = match index {
                0 => {
                    format!(
                        "<th scope=\"rowgroup\" rowspan=\"{}\">{}</th>",
                        axis.bins.len(),
                        text(&axis_label(axis))
                    )
                }
                _ => String::new(),
            };
            let is_below = bin.success_rate.value < axis.success_rate.value;
            let class = match (bin.differs, is_below) {
                (false, _) => "",
                (true, true) => " class=\"lower\"",
                (true, false) => " class=\"higher\"",
            };
            let mark = match (bin.differs, is_below) {
                (false, _) => "",
                (true, true) => " <b class=\"fail\">▼</b>",
                (true, false) => " <b class=\"pass\">▲</b>",
            };
            rows.push_str(&format!(
                "<tr{class}>{name}<td>{}</td><td class=\"n\">{}{mark}</td><td>{}</td><td>{}</td><td class=\"n\">{}</td></tr>\n",
                text(&range_text(&bin.values)),
                rate(bin.success_rate),
                scale.bar(bin.success_rate, all),
                interval(bin.success_rate),
                bin.success_rate.n
            ));
        }
    }
    let caption = "Success rate over the range of each axis; ▼ and ▲ differ from the rest of the axis";
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\"><table class=\"rates\"><caption>{caption}</caption>\
         <thead><tr><th scope=\"col\">axis</th><th scope=\"col\">values</th><th scope=\"col\" class=\"n\">success rate</th>\
         <th scope=\"col\">{} to 100 %</th><th scope=\"col\">95 % interval</th><th scope=\"col\" class=\"n\">simulations</th></tr></thead>\n\
         <tbody>{rows}</tbody></table></div>\n",
        percent(scale.low)
    )
}

/// Returns the heat maps of the pairs that interact most.
fn pairs(rates: &AxisRates) -> String {
    if rates.pairs_tested == 0 {
        return String::new();
    }
    let mut out = format!("<h4>Pairs of axes</h4>\n<p>{}</p>\n", text(&pairs_sentence(rates)));
    // A map of rates that differ by chance would mislead.
    let shown: Vec<&PairRate> = rates.pairs.iter().filter(|pair| pair.interacts()).take(MAX_PAIRS).collect();
    if shown.is_empty() {
        return out;
    }
    out.push_str(
        "<p class=\"notes\">Interaction: the share of the variance of success that both axes explain together beyond the sum of \
         their separate effects, without what chance explains (second-order Sobol index over the cells). A cell has its success \
         rate and below it the 95 % interval; point at it to see its values and its number of simulations. Orange is below the \
         rate of all simulations, blue above it.</p>\n",
    );
    out.push_str("<div class=\"heats\">");
    shown.into_iter().for_each(|pair| out.push_str(&heat_map(pair, rates)));
    out + "</div>\n"
}

/// Says which pairs interact.
pub fn pairs_sentence(rates: &AxisRates) -> String {
    let count = rates.pairs.iter().filter(|pair| pair.interacts()).count();
    let tested = plural(rates.pairs_tested, "pair");
    match count {
        0 => {
            format!("Of {tested} of axes, none interacts measurably (5 %, Holm's correction for all pairs).")
        }
        n => format!(
            "Of {tested} of axes, {}{n} {} (5 %, Holm's correction for all pairs): the effects of both do not add up.",
            if n == rates.pairs.len() && (n as u64) < rates.pairs_tested { "at least " } else { "" },
            if n == 1 { "interacts" } else { "interact" }
        ),
    }
}

fn heat_map(pair: &PairRate, rates: &AxisRates) -> String {
    let unit = |index: usize| {
        let axis = rates.axes.iter().find(|axis| axis.axis == pair.axes[index]);
        axis.map_or(pair.axes[index].clone(), axis_label)
    };
    let [rows, columns] = [0, 1].map(|index| text(&unit(index)));
    let all = rates.success_rate.value.unwrap_or_default();
    let head: String =
        pair.bins[1].iter().map(|bin| format!("<th scope=\"col\">{}</th>", text(&range_text(bin)))).collect();
    let body: String = pair.bins[0]
        .iter()
        .zip(&pair.cells)
        .map(|(row, cells)| {
            let cells: String = cells
                .iter()
                .zip(&pair.bins[1])
                .map(|(cell, column)| {
                    let title = format!(
                        "{}: {}, {}: {}; {}{}, {}",
                        pair.axes[0],
                        range_text(row),
                        pair.axes[1],
                        range_text(column),
                        rate(*cell),
                        interval_text(*cell),
                        plural(cell.n, "simulation")
                    );
                    format!(
                        "<td{} title=\"{}\">{}<small>{}</small></td>",
                        cell.value.map_or(String::new(), |value| format!(" class=\"{}\"", shade(value, all))),
                        text(&title),
                        rate(*cell),
                        interval(*cell)
                    )
                })
                .collect();
            format!("<tr><th scope=\"row\">{}</th>{cells}</tr>\n", text(&range_text(row)))
        })
        .collect();
    let caption = format!(
        "{rows} (rows) and {columns} (columns): interaction {}, {}",
        percent(pair.interaction),
        text(&p_value_phrase(pair.p_value))
    );
    format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{caption}\"><table class=\"heat\"><caption>{caption}</caption>\
         <thead><tr><td></td>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>\n"
    )
}

/// Returns the class of a rate: four shades below the rate of all simulations and four above it.
fn shade(value: f64, all: f64) -> String {
    let (name, share) = if value < all {
        ("below", (all - value) / all)
    } else if all >= 1.0 {
        ("above", 1.0)
    } else {
        ("above", (value - all) / (1.0 - all))
    };
    format!("{name}{}", ((4.0 * share) as usize).min(3))
}

/// Formats a rate.
pub fn rate(found: Estimate) -> String {
    found.value.map_or("–".to_string(), percent)
}

/// Formats the interval of a rate.
pub fn interval(found: Estimate) -> String {
    match (found.low, found.high) {
        (Some(low), Some(high)) => format!("{} to {}", percent(low), percent(high)),
        _ => "–".to_string(),
    }
}

fn interval_text(found: Estimate) -> String {
    match found.low.and(found.high) {
        Some(_) => format!(" (95 % interval {})", interval(found)),
        None => String::new(),
    }
}

/// Returns the name of an axis with its unit.
pub fn axis_label(axis: &AxisRate) -> String {
    match axis.unit.as_str() {
        "" => short(&axis.axis, 40),
        unit => format!("{} ({})", short(&axis.axis, 40), short(unit, 14)),
    }
}

/// Formats a part of the range of an axis.
pub fn range_text(values: &ValueRange) -> String {
    match &values.name {
        Some(name) => short(name, 40),
        None if values.low == values.high => number(values.low),
        None => format!("{} to {}", number(values.low), number(values.high)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_orange_below_the_rate_of_all_simulations_and_blue_above_it() {
        for (value, all, expected) in [
            (0.0, 0.9, "below3"),
            (0.89, 0.9, "below0"),
            (0.9, 0.9, "above0"),
            (1.0, 0.9, "above3"),
            (1.0, 1.0, "above3"),
            (0.0, 0.0, "above0"),
        ] {
            assert_eq!(shade(value, all), expected, "{value} of {all}");
        }
    }

    #[test]
    fn a_range_is_a_name_a_number_or_two_numbers() {
        let range = |low, high| ValueRange { low, high, name: None };
        assert_eq!(range_text(&range(-0.5, 0.25)), "−0.5 to 0.25");
        assert_eq!(range_text(&range(3.0, 3.0)), "3");
        assert_eq!(range_text(&ValueRange { name: Some("ice".to_string()), ..range(0.0, 0.0) }), "ice");
    }
}
