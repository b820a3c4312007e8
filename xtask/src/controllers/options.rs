//! What is typed after `cargo xtask controllers`.

use std::path::PathBuf;
use std::thread::available_parallelism;

use anyhow::{Context, Result, bail};

use super::plan::Training;

/// What may be typed.
pub const USAGE: &str = "\
cargo xtask controllers [OPTIONS]

Trains and measures what is missing or out of date, then makes the tables and curves again.
Ctrl-C saves; the same command goes on.

  --list                      only say how each training stands, and why
  --import FOLDER             take in finished trainings (TASK-ALGORITHM-sN.safetensors and .csv)
  --measure                   measure again, train nothing
  --tables                    only make the tables and pictures again
  --only TASK[/ALGORITHM]     nothing else of the plan
  --seeds N...                only these seeds; 0 is the shipped one
  --jobs N                    how many side by side, a thread each [default: all cores]
  --adopt                     a controller whose task has changed counts as trained on the present one
  --program FILE              use this mishandle instead of building it";

/// What to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// Train and measure what is missing or out of date.
    Train,
    /// Say how each training stands.
    List,
    /// Say what may be typed.
    Help,
    /// Take in trainings made elsewhere.
    Import(PathBuf),
    /// Measure again what is chosen, train nothing.
    Measure,
    /// Make tables and pictures of what was measured, nothing else.
    Tables,
}

/// What to do, with what of the plan, and how.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    pub action: Action,
    /// `TASK` or `TASK/CONTROLLER`.
    only: Option<String>,
    seeds: Option<Vec<u64>>,
    /// How many trainings run side by side.
    pub jobs: usize,
    /// Whether a controller counts whose task has changed since.
    pub adopt: bool,
    /// The program; without, it is built.
    pub program: Option<PathBuf>,
}

impl Options {
    /// # Errors
    /// If there is a word too many, or one that is not known.
    pub fn parse(arguments: &[String]) -> Result<Options> {
        let mut options = Options {
            action: Action::Train,
            only: None,
            seeds: None,
            jobs: available_parallelism().map_or(1, usize::from),
            adopt: false,
            program: None,
        };
        let mut words = arguments.iter().map(String::as_str).peekable();
        while let Some(word) = words.next() {
            let mut value = || words.next().with_context(|| format!("`{word}` needs a value"));
            match word {
                "--help" | "-h" => options.act(Action::Help)?,
                "--list" => options.act(Action::List)?,
                "--measure" => options.act(Action::Measure)?,
                "--tables" => options.act(Action::Tables)?,
                "--import" => {
                    let folder = value()?.into();
                    options.act(Action::Import(folder))?;
                }
                "--only" => options.only = Some(value()?.to_string()),
                "--jobs" => options.jobs = number(word, value()?)?.max(1) as usize,
                "--adopt" => options.adopt = true,
                "--program" => options.program = Some(value()?.into()),
                "--seeds" => {
                    let mut seeds = vec![number(word, value()?)?];
                    while let Some(more) = words.next_if(|word| !word.starts_with('-')) {
                        seeds.push(number(word, more)?);
                    }
                    options.seeds = Some(seeds);
                }
                _ => bail!("`controllers` does not know `{word}`; `--help` lists what it knows"),
            }
        }
        Ok(options)
    }

    fn act(&mut self, action: Action) -> Result<()> {
        if self.action != Action::Train {
            bail!("one of --list, --import, --measure and --tables can be done at a time");
        }
        self.action = action;
        Ok(())
    }

    /// Whether this training was asked for.
    pub fn chooses(&self, training: &Training) -> bool {
        self.seeds.as_ref().is_none_or(|seeds| seeds.contains(&training.seed))
            && self.chooses_controller(&training.task, &training.algorithm)
    }

    /// Whether the expert of a task was asked for.
    pub fn chooses_expert(&self, task: &str) -> bool {
        self.seeds.is_none() && self.chooses_controller(task, "expert")
    }

    fn chooses_controller(&self, task: &str, controller: &str) -> bool {
        self.only.as_ref().is_none_or(|only| *only == task || *only == format!("{task}/{controller}"))
    }
}

fn number(flag: &str, text: &str) -> Result<u64> {
    text.parse().with_context(|| format!("`{flag} {text}`: it has to be a whole number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Options> {
        Options::parse(&line.split_whitespace().map(String::from).collect::<Vec<_>>())
    }

    fn training(task: &str, algorithm: &str, seed: u64) -> Training {
        Training { task: task.to_string(), algorithm: algorithm.to_string(), seed }
    }

    #[test]
    fn trainings_are_chosen_by_task_algorithm_and_seed() {
        let options = parse("--seeds 0 2 --only ball-pushing/sac --jobs 3").unwrap();
        assert_eq!((options.jobs, &options.action), (3, &Action::Train));
        assert!(options.chooses(&training("ball-pushing", "sac", 2)));
        for (task, algorithm, seed) in
            [("ball-pushing", "sac", 1), ("ball-pushing", "td3", 0), ("ball-catching", "sac", 0)]
        {
            assert!(!options.chooses(&training(task, algorithm, seed)), "{task} {algorithm} {seed}");
        }
        assert!(parse("").unwrap().chooses(&training("ball-pushing", "ppo", 4)));
        assert!(parse("--only ball-pushing").unwrap().chooses_expert("ball-pushing"));
        assert!(!parse("--only ball-pushing/ppo").unwrap().chooses_expert("ball-pushing"));
    }

    #[test]
    fn mistakes_are_told() {
        for (line, told) in [
            ("--olny ppo", "does not know `--olny`"),
            ("--jobs two", "it has to be a whole number"),
            ("--only", "`--only` needs a value"),
            ("--list --measure", "at a time"),
        ] {
            let error = parse(line).unwrap_err().to_string();
            assert!(error.contains(told), "{line}: {error}");
        }
    }
}
