//! Numbers, names and instants as text: one format for messages, tables and pages.
//!
//! It knows no type of the other crates. What a result means is said where the result is shown.

mod ends;
mod instant;
mod integer;
mod invisible;
mod number;
mod path;
mod shell_quote;
mod short;
mod xml;

pub use ends::first_and_last_line;
pub use instant::{instant, sample_time};
pub use integer::parse_integer;
pub use invisible::{is_invisible, visible};
pub use number::{
    decimal, measured, number_text, p_value_phrase, p_value_text, plural, probability_text, short_number,
};
pub use path::{path_text, shell_path};
pub use shell_quote::shell_quote;
pub use short::{short, short_unit, without_middle};
pub use xml::xml_text;
