use std::fmt::Write as _;

/// A mark on top of a chart that shows a text when the pointer is on it, and that can be a link.
#[derive(Clone, Debug, PartialEq)]
pub struct LinkedMark {
    /// Horizontal position, in the unit of the axis.
    pub x: f64,
    /// Vertical position, in the unit of the axis.
    pub y: f64,
    /// Shape of the mark.
    pub shape: Shape,
    /// The color, as `#rrggbb`.
    pub color: &'static str,
    /// Address of the link, such as `#row-7`; empty for none.
    pub href: String,
    /// Text of the tooltip, and of the link for screen readers.
    pub label: String,
    /// Whether the Tab key stops at the link.
    pub is_tab_stop: bool,
}

/// Shape of a mark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A circle around the position.
    Ring,
    /// A diagonal cross.
    Cross,
    /// A filled square.
    Square,
    /// A filled diamond.
    Diamond,
}

impl LinkedMark {
    /// Appends the mark as SVG, with its position in pixels.
    pub(crate) fn write(&self, x: i32, y: i32, svg: &mut String) {
        let color = self.color.to_uppercase();
        let (d, fill) = match self.shape {
            Shape::Ring => ("m-3 0a3 3 0 1 0 6 0a3 3 0 1 0 -6 0", "none"),
            Shape::Cross => ("m-4 -4l8 8m0 -8l-8 8", "none"),
            Shape::Square => ("m-3 -3h6v6h-6z", color.as_str()),
            Shape::Diamond => ("m0 -7l7 7l-7 7l-7 -7z", color.as_str()),
        };
        let tab = if self.is_tab_stop { "" } else { " tabindex=\"-1\"" };
        let link = match self.href.as_str() {
            "" => "<g>".to_string(),
            href => format!("<a href=\"{}\"{tab}>", escaped(href)),
        };
        let end = if self.href.is_empty() { "</g>" } else { "</a>" };
        // The transparent circle makes thin marks easy to hit.
        let _ = writeln!(
            svg,
            "{link}<title>{}</title><circle cx=\"{x}\" cy=\"{y}\" r=\"7\" fill=\"transparent\"/><path d=\"M{x} {y}{d}\" \
             fill=\"{fill}\" stroke=\"{color}\" stroke-width=\"2\"/>{end}",
            escaped(&self.label),
        );
    }
}

/// Escapes text for XML.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '&' => out.push_str("&amp;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::charts::{Area, Chart, ChartAxis, Mark, Panel, Series};

    fn chart(marks: Vec<LinkedMark>) -> Chart {
        let panel = Panel {
            title: String::new(),
            x: ChartAxis::linear("x", [0.0, 10.0]),
            y: ChartAxis::linear("<y>", [0.0, 1.0]),
            areas: vec![Area { x: [0.0, 5.0], y: [0.0, 1.0], color: "#fbd9b5" }],
            series: vec![Series::new("#1f5c99", Mark::Step, [[0.0, 1.0], [5.0, 0.5]])],
            marks,
        };
        let title = String::new();
        let caption = String::new();
        let legend = Vec::new();
        Chart { title, caption, legend, columns: 1, panel_size: [400, 300], panels: vec![panel] }
    }

    fn mark(x: f64, href: &str) -> LinkedMark {
        let label = "a <b> & \"c\"".to_string();
        let href = href.to_string();
        LinkedMark { x, y: 0.5, shape: Shape::Cross, color: "#8f3a04", href, label, is_tab_stop: false }
    }

    #[test]
    fn a_mark_is_a_link_with_a_tooltip_at_its_place() {
        let svg = chart(vec![mark(0.0, "#row-1"), mark(10.0, ""), mark(f64::NAN, "#no")]).figure("<all>");
        assert!(svg.starts_with(
            "<svg class=\"chart\" viewBox=\"0 0 400 300\" width=\"400\" height=\"300\" role=\"group\""
        ));
        assert!(svg.contains("aria-label=\"&lt;all&gt;\"") && svg.contains("&lt;y&gt;"), "{svg}");
        assert!(
            svg.contains("<a href=\"#row-1\" tabindex=\"-1\"><title>a &lt;b&gt; &amp; &quot;c&quot;</title>"),
            "{svg}"
        );
        assert!(svg.contains("<g><title>") && !svg.contains("#no"), "{svg}");
        // The left mark is where the area begins, and the right mark is twice as far from there as
        // its end.
        let after = |text: &str, key: &str| -> f64 {
            let rest = text.split_once(key).unwrap().1;
            rest.split(['"', ' ']).next().unwrap().parse().unwrap()
        };
        let area = svg.split("<rect").find(|tag| tag.contains("#FBD9B5")).unwrap();
        let left = after(area, " x=\"");
        let width = after(area, "width=\"");
        let place = |link: &str| after(svg.split_once(link).unwrap().1, "cx=\"");
        assert!((place("#row-1") - left).abs() <= 1.0, "{svg}");
        assert!((place("<g>") - (left + 2.0 * width)).abs() <= 2.0, "{svg}");
    }

    #[test]
    fn a_chart_without_marks_is_an_image() {
        assert!(chart(Vec::new()).figure("x").contains("role=\"img\""));
    }
}
