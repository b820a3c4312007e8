//! The file of the folder for people.

use mishandle::results::{Command, Words};
use mishandle_report::CHECK_REPORTS;

use crate::layout::{CHECKS, FILES, MANIFEST, PAGES, RUNS, SIGNATURE, SUMS};
use crate::manifest::{Manifest, ManifestCheck, ManifestRun};
use crate::signature::NAMESPACE;

/// Returns the requirement that the failures of a run violate, and the names of others that have a
/// verdict of their own.
fn requirement(run: &ManifestRun) -> String {
    let is_it = |[_, formula]: &&[String; 2]| *formula == run.formula;
    let own = run.requirements.iter().find(is_it);
    let own = own.map_or(run.formula.clone(), |[name, formula]| format!("{name}: {formula}"));
    let others = run.requirements.iter().filter(|other| !is_it(other));
    let others: Vec<String> = others.map(|[name, _]| code(name)).collect();
    if others.is_empty() {
        code(&own)
    } else {
        format!("{}; on its page also {}", code(&own), others.join(", "))
    }
}

fn code(text: &str) -> String {
    format!("`{}`", text.replace(['`', '|', '\n', '\r'], " "))
}

/// Returns the text. It does not depend on a signature, which can be made later.
pub fn text(manifest: &Manifest, words: Words) -> String {
    let rows: String = manifest
        .runs
        .iter()
        .map(|run| {
            let replay = run
                .not_replayable
                .as_ref()
                .map_or("yes".to_string(), |why| format!("no: {}", why.replace(['|', '\n', '\r'], " ")));
            let state = if run.is_complete { "" } else { " (not finished)" };
            format!(
                "| [{}]({}) | {} | {}{state} | {} | {} | {replay} |\n",
                run.file,
                run.page,
                code(&run.target[1]),
                run.simulations,
                run.failures,
                requirement(run),
            )
        })
        .collect();
    let check = |check: &ManifestCheck| {
        let ManifestCheck { folder, target, verdicts, .. } = check;
        format!("| [{folder}]({folder}/{}) | {} | {verdicts} |\n", CHECK_REPORTS[0], code(target))
    };
    let checks = if manifest.checks.is_empty() {
        String::new()
    } else {
        format!(
            "\nChecks of requirements, whose runs are above:\n\n| check | target | verdicts |\n|---|---|---|\n{}",
            manifest.checks.iter().map(check).collect::<String>()
        )
    };
    let program = &manifest.program;
    let verify = words(&Command::VerifyEvidence);
    format!(
        "# Evidence of simulations\n\nThis folder holds simulations of robot controllers, with what others need to check them. \
         Mishandle {} made it\n(commit {}, {}, MuJoCo {}).\n\n| run and page | target | simulations | failures | requirement | \
         replayable |\n|---|---|--:|--:|---|---|\n{rows}{checks}\nA failure is a simulation that violates the first formula of its row.\n\n\
         ## Verify\n\nWith standard tools, which say that no file has changed, and by whose key `{SUMS}` is signed:\n\n```bash\n\
         sha256sum --check --strict --quiet {SUMS}\nssh-keygen -Y check-novalidate -n {NAMESPACE} -s {SIGNATURE} < {SUMS}\n\
         ssh-keygen -Y verify -f ALLOWED_SIGNERS -I NAME -n {NAMESPACE} -s {SIGNATURE} < {SUMS}\n```\n\n\
         ALLOWED_SIGNERS is a file of yours with a line `NAME KEY` for each key that you trust. Without `{SIGNATURE}`, the \
         folder is\nnot signed: its hashes then show accidents, but anybody can change a file and its hash.\n\n\
         With Mishandle, which also finds further files, checks the records, and simulates a random share of them again:\n\n\
         ```bash\n{verify}\n```\n\n\
         A replay agrees to the bit if the program has the version, the commit and the architecture above.\n\n\
         ## Files\n\n- `{MANIFEST}`: program, machine, plans, and the identities of targets and controllers.\n\
         - `{RUNS}`: the run files (SQLite), byte for byte. A run whose controller was a file contains its path at that time.\n\
         - `{PAGES}`: a report about each, HTML without scripts.\n\
         - `{CHECKS}`: files of requirements, with the matrix of their verdicts and counterexamples, if requirements were \
         checked.\n\
         - `{FILES}`: target files, models and controllers, if simulations need some.\n",
        program.version, program.commit, program.target, manifest.mujoco
    )
}
