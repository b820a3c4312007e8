//! The life of a run in steps, and the content of the file after each.

use std::path::Path;

use mishandle_store::{IfExists, Result, RunFile, RunWriter, Simulation, TrialRecord, TrialStatus};

use crate::sample::{header, record, traced_record};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    Create,
    Start {
        trial: u32,
    },
    Record {
        trial: u32,
        first: u32,
        last: u32,
    },
    End {
        trial: u32,
        status: TrialStatus,
    },
    Close,
    Resume,
    /// Opens the file for reading, and reads and checks all of it.
    Read,
}

/// A campaign in two sessions.
pub fn campaign() -> Vec<Step> {
    vec![
        Step::Create,
        Step::Start { trial: 1 },
        Step::Record { trial: 1, first: 1, last: 4 },
        Step::Record { trial: 1, first: 5, last: 9 },
        Step::End { trial: 1, status: TrialStatus::Falsified },
        Step::Start { trial: 2 },
        Step::Record { trial: 2, first: 1, last: 9 },
        Step::Close,
        Step::Resume,
        Step::Record { trial: 2, first: 10, last: 14 },
        Step::End { trial: 2, status: TrialStatus::BudgetSpent },
        Step::Close,
        Step::Read,
    ]
}

/// A run with one trial, which was created and closed before, is read and continued.
pub fn continuation() -> Vec<Step> {
    vec![
        Step::Read,
        Step::Resume,
        Step::Start { trial: 2 },
        Step::Record { trial: 2, first: 1, last: 5 },
        Step::End { trial: 2, status: TrialStatus::Converged },
        Step::Close,
    ]
}

fn simulation(trial: u32, number: u32) -> Simulation {
    if number.is_multiple_of(4) { traced_record(trial, number) } else { record(trial, number) }
}

/// A writer and its file. A step that failed can be performed again.
pub struct Session<'a> {
    pub path: &'a Path,
    pub writer: Option<RunWriter>,
    /// Whether the writer syncs each commit.
    pub is_durable: bool,
}

impl Session<'_> {
    pub fn new(path: &Path, is_durable: bool) -> Session<'_> {
        Session { path, writer: None, is_durable }
    }

    pub fn perform(&mut self, step: Step) -> Result<()> {
        match step {
            Step::Create => {
                self.writer =
                    Some(self.opened(RunWriter::create(self.path, &header(), IfExists::Refuse)?)?);
                Ok(())
            }
            Step::Resume => self.writer().map(drop),
            Step::Read => Content::read(self.path).map(drop),
            Step::Close => self.writer.take().map_or(Ok(()), RunWriter::close),
            Step::Start { trial } => self.writer()?.start_trial(trial, seed(trial)),
            Step::Record { trial, first, last } => {
                let simulations: Vec<_> = (first..=last).map(|number| simulation(trial, number)).collect();
                self.writer()?.record(&simulations)
            }
            Step::End { trial, status } => self.writer()?.end_trial(trial, status),
        }
    }

    /// Returns the writer; a run without one is resumed.
    fn writer(&mut self) -> Result<&mut RunWriter> {
        let writer = match self.writer.take() {
            Some(writer) => writer,
            None => self.opened(RunWriter::resume(self.path)?)?,
        };
        Ok(self.writer.insert(writer))
    }

    fn opened(&self, mut writer: RunWriter) -> Result<RunWriter> {
        if self.is_durable {
            writer.set_durable()?;
        }
        Ok(writer)
    }
}

fn seed(trial: u32) -> u64 {
    u64::from(trial) << 40
}

/// The records of a run, ordered by number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Content {
    pub trials: Vec<TrialRecord>,
    /// Without traces.
    pub simulations: Vec<Simulation>,
    /// Trial, number and bits of each trace: traces can contain NaN, which is not equal to itself.
    pub traces: Vec<(u32, u32, Vec<Vec<u64>>)>,
}

impl Content {
    /// Returns the content after each number of steps, from `self` on. It is computed without a
    /// file.
    pub fn after_each(self, steps: &[Step]) -> Vec<Content> {
        let mut contents = vec![self];
        for step in steps {
            let mut content = contents.last().cloned().unwrap_or_default();
            match *step {
                Step::Start { trial } => content.trials.push(TrialRecord {
                    number: trial,
                    seed: seed(trial),
                    status: TrialStatus::Running,
                }),
                Step::Record { trial, first, last } => {
                    (first..=last).for_each(|number| content.add(simulation(trial, number)));
                }
                Step::End { trial, status } => {
                    content.trials.iter_mut().filter(|known| known.number == trial).for_each(|known| {
                        known.status = status;
                    });
                }
                Step::Create | Step::Close | Step::Resume | Step::Read => {}
            }
            contents.push(content);
        }
        contents
    }

    /// Reads the content of a file and checks the file.
    pub fn read(path: &Path) -> Result<Content> {
        let run = RunFile::open(path)?;
        run.check()?;
        let trials = run.trials()?.into_iter().map(|summary| summary.trial).collect();
        let mut content = Content { trials, ..Content::default() };
        content.simulations = run.simulations().collect::<Result<_>>()?;
        for (trial, number) in run.stored_traces()? {
            content.add_trace(&run.simulation(trial, number)?);
        }
        Ok(content)
    }

    fn add(&mut self, simulation: Simulation) {
        self.add_trace(&simulation);
        self.simulations.push(Simulation { trace: None, ..simulation });
    }

    fn add_trace(&mut self, simulation: &Simulation) {
        if let Some(trace) = &simulation.trace {
            let bits = |column: &Vec<f64>| column.iter().map(|value| value.to_bits()).collect();
            let bits = trace.columns.iter().map(bits).collect();
            self.traces.push((simulation.trial, simulation.number, bits));
        }
    }
}
