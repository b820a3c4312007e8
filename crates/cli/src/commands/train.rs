use anyhow::Result;

use crate::Outcome;
use crate::args;

pub fn run(_command: &args::Train) -> Result<Outcome> {
    anyhow::bail!("not yet")
}
