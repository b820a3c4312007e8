//! A 3-D replay in a page: recorded states as inert data, and the one script that draws them.

use sha2::{Digest, Sha256};

mod collect;
mod moved;
mod pack;
mod recorder;
mod scene;
mod simplify;

pub use collect::Recording;
pub use moved::Mover;

use crate::html::base64;

/// Largest size of the states of a page, bytes.
const MAX_BYTES: usize = 15_000_000;

/// The script: the same bytes in every page.
pub const SCRIPT: &str = concat!(
    "\"use strict\";\n(() => {\n",
    include_str!("math.js"),
    include_str!("data.js"),
    include_str!("shapes.js"),
    include_str!("draw.js"),
    include_str!("camera.js"),
    include_str!("plots.js"),
    include_str!("page.js"),
    "})();\n"
);

/// Style of the elements that the script makes.
pub const STYLE: &str = include_str!("replay.css");

/// Start of the element of a replay.
pub const START: &str = "<div class=\"replay\"";

/// A replay of simulations of a run.
#[derive(Clone, Debug)]
pub struct Replay {
    /// The scene, and each simulation, compressed.
    blocks: Vec<Vec<u8>>,
}

impl Replay {
    /// Returns the replay as HTML. `id` is its name on the page: marks and links of a run with this
    /// name open its simulations. `pictures` stand there on paper, without scripts, and where the
    /// browser draws nothing in 3-D. The replay has nothing of the run but digits of base64.
    pub fn html(&self, id: &str, pictures: &str) -> String {
        let blocks: String =
            self.blocks.iter().map(|block| format!("<template>{}</template>\n", base64(block))).collect();
        format!(
            "{START} id=\"{id}-replay\" data-run=\"{id}\">\n{blocks}<noscript><p>The 3-D replay needs \
             scripts.</p></noscript></div>\n<div class=\"replay-instead\">{pictures}</div>\n"
        )
    }
}

/// Returns the source of scripts in the content security policy of a page with a replay: the hash
/// of the script.
pub fn script_source() -> String {
    format!("'sha256-{}'", base64(&Sha256::digest(SCRIPT)))
}
