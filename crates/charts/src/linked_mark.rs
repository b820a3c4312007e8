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
    /// A filled diamond.
    Diamond,
}

impl LinkedMark {
    /// Appends the mark as SVG, with its position in pixels.
    pub(crate) fn write(&self, (x, y): (i32, i32), svg: &mut String) {
        let color = self.color.to_uppercase();
        let (d, fill) = match self.shape {
            Shape::Ring => ("m-3 0a3 3 0 1 0 6 0a3 3 0 1 0 -6 0", "none"),
            Shape::Cross => ("m-4 -4l8 8m0 -8l-8 8", "none"),
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
