//! The paper's tables of campaigns and results.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use mishandle_paper::{CampaignResults, NamedPage, PaperError, Results, pages};
use mishandle_text::shell_quote;

use crate::show::output;

/// Reads campaigns and results.
pub fn load(folders: &[PathBuf]) -> Result<Results> {
    let mut all = Results::default();
    let mut commits = Vec::new();
    for folder in folders {
        if Results::is_in(folder) {
            let Results { date, machine, commit, campaigns } = Results::read(folder).map_err(converted)?;
            commits.push(commit);
            all.date = date;
            add_machine(&mut all.machine, &machine);
            all.campaigns.extend(campaigns);
        } else {
            let root = mishandle::shipped::home().unwrap_or_default();
            let campaign = CampaignResults::read(folder, &root).map_err(converted)?;
            commits.extend(campaign.runs.iter().map(|run| named_commit(&run.facts.commit)));
            all.campaigns.push(campaign);
        }
    }
    commits.dedup();
    all.commit = commits.pop().flatten().filter(|_| commits.is_empty());
    Ok(all)
}

/// Returns a commit if it names the sources of a program.
pub fn named_commit(commit: &str) -> Option<String> {
    (commit != "unknown" && !commit.ends_with("-changed")).then(|| commit.to_string())
}

/// Writes the pages with the tables of a campaign to a folder. Returns the names and titles of the
/// HTML pages.
pub fn write(campaign: &Path, folder: &Path) -> Result<Vec<(String, String)>> {
    let pages = pages(&load(&[campaign.to_path_buf()])?);
    write_pages(&pages, folder)?;
    Ok(pages.into_iter().map(|(name, page)| (format!("{name}.html"), page.title)).collect())
}

/// Writes each page as Markdown and as HTML. Existing pages are replaced, because they contain
/// nothing but results.
pub fn write_pages(pages: &[NamedPage], folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    for (name, page) in pages {
        for (ending, text) in [("md", page.markdown()), ("html", page.html())] {
            let path = folder.join(format!("{name}.{ending}"));
            output::write_atomically(&path, true, text.as_bytes())?;
            output::message(&format!("Page: {}", shell_quote(&path.to_string_lossy())));
        }
    }
    Ok(())
}

/// Adds a machine to a list, once.
pub fn add_machine(list: &mut String, machine: &str) {
    if list.split("; ").any(|known| known == machine) {
        return;
    }
    if !list.is_empty() {
        list.push_str("; ");
    }
    list.push_str(machine);
}

/// The hints of the program are for its own errors.
pub fn converted(error: PaperError) -> anyhow::Error {
    match error {
        PaperError::Mishandle(error) => (*error).into(),
        error => error.into(),
    }
}
