//! Remedies of errors, as data. The command line and the Python package word it.

/// The name of a setting: `table.key`, as a plan spells it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Key(&'static str);

macro_rules! keys {
    ($($constant:ident = $name:literal,)*) => {
        impl Key {
            $(
                #[doc = concat!("`", $name, "`.")]
                pub const $constant: Key = Key($name);
            )*

            /// All keys that a remedy can name.
            pub const ALL: &'static [Key] = &[$(Key::$constant),*];
        }
    };
}

keys! {
    ACTION_NOISE = "action-noise",
    ALGORITHM_SETTINGS = "train.settings",
    ANY_BUILD = "engine.any-build",
    AXES = "axes",
    BUDGET = "falsify.budget",
    COMMAND = "command",
    CONTROLLER = "controller",
    CURVE = "train.csv",
    EVENTS = "train.tensorboard",
    FORCE = "force",
    FORMULA = "falsify.formula",
    GUARD = "guard",
    MOVED_CONTROLLER = "engine.controller",
    MOVED_TARGET = "engine.target",
    OUT = "out",
    RATE = "evaluate.rate",
    RECORD_FORMAT = "record.format",
    RECORD_SUCCESSFUL = "record.successful",
    RELABEL = "record.relabel",
    RESUME = "resume",
    REWARD = "train.reward",
    SPACE = "space",
    TRAINER = "harden.trainer",
    LOG_TIME = "log.time",
    LOG_TIME_UNIT = "log.time-unit",
    LOG_UTC_OFFSET = "log.utc-offset",
    LOG_PERIOD = "log.period",
    LOG_RESAMPLE = "log.resample",
    LOG_DENSE = "log.dense",
    LOG_MISSING = "log.missing",
    LOG_DUPLICATES = "log.duplicates",
    LOG_SORT = "log.sort",
    LOG_TOPICS = "log.topics",
    LOG_DELIMITER = "log.delimiter",
    LOG_DECIMAL = "log.decimal",
    LOG_UNIT = "log.unit",
    LOG_STRICT_HORIZON = "log.strict-horizon",
    LATENESS = "monitor.lateness",
    NORMALIZER = "import.normalizer",
    ACTIVATION = "import.activation",
    OUTPUT_ACTIVATION = "import.output-activation",
    PARAMETER = "formula.parameter",
    RESOLUTION = "formula.resolution",
}

impl Key {
    /// Returns the name with the table.
    pub fn name(self) -> &'static str {
        self.0
    }

    /// Returns the name without the table.
    pub fn word(self) -> &'static str {
        self.0.rsplit_once('.').map_or(self.0, |(_, word)| word)
    }
}

/// The value that a setting should have.
#[derive(Clone, Debug, PartialEq)]
pub enum Choice {
    /// True.
    On,
    /// One of these words.
    OneOf(&'static [&'static str]),
    /// This text.
    Text(String),
    /// This number.
    Number(f64),
    /// A value that only the user knows, such as `SECONDS`.
    Shape(&'static str),
    /// A range of numbers.
    Range([f64; 2]),
    /// A value for this name, of a setting that has several.
    Of(String, Box<Choice>),
}

impl Choice {
    /// A column of a log.
    pub const COLUMN: Choice = Choice::Shape("COLUMN");
    /// A path.
    pub const FILE: Choice = Choice::Shape("FILE");
    /// A duration.
    pub const SECONDS: Choice = Choice::Shape("SECONDS");
}

/// Something else to ask.
#[derive(Clone, Debug, PartialEq)]
pub enum Command {
    /// Ask a question about the same system with some other settings.
    Again {
        /// Name of the question.
        question: &'static str,
        /// The target.
        target: String,
        /// Settings that stay.
        kept: Vec<(Key, Choice)>,
        /// Settings that change.
        changed: Vec<(Key, Choice)>,
    },
    /// Compare two runs, or these ones.
    Compare(Option<[String; 2]>),
    /// Explain a recorded simulation.
    Explain(Recorded),
    /// Draw a recorded simulation.
    Render(Recorded),
    /// Simulate the counterexamples of a folder with a controller.
    Regress {
        /// The folder.
        suite: String,
        /// The controller.
        controller: String,
        /// A controller for comparison.
        baseline: Option<String>,
    },
    /// Search for failures of a policy of Stable-Baselines3 in an environment of Gymnasium, in
    /// Python.
    Gymnasium {
        /// Name of the environment, if it is known.
        environment: Option<String>,
        /// File of the policy, if it is known.
        policy: Option<String>,
    },
    /// Monitor a formula on a log.
    Monitor {
        /// The log.
        log: String,
    },
    /// Write a first target file for this model.
    Init {
        /// The model.
        model: String,
    },
    /// Replay the file of a counterexample.
    ReplayFile {
        /// The file.
        file: String,
        /// Present paths of its files.
        moved: Vec<(Key, String)>,
    },
    /// Verify the present folder of evidence.
    VerifyEvidence,
    /// Resume both runs of a comparison that stops by itself.
    ResumeComparison {
        /// Whether its system is Python code.
        is_python: bool,
    },
    /// Resume an evaluation.
    ResumeEvaluation {
        /// The run file.
        run: String,
        /// Whether its system is Python code.
        is_python: bool,
    },
    /// Search a target for all failures.
    Falsify {
        /// The target.
        target: String,
    },
    /// Train a controller on its failures.
    Harden {
        /// The target.
        target: String,
        /// Controller and space.
        settings: Vec<(Key, Choice)>,
    },
    /// Import the policy of another tool.
    Import,
    /// Keep the failure of a run that is nearest to nominal as a regression test.
    Keep {
        /// The run file.
        run: String,
    },
    /// List the things of a word, such as `targets`, or describe what has this name.
    List {
        /// Word or name.
        what: String,
        /// Whether more than the first screen is meant.
        is_long: bool,
    },
    /// Replay a recorded simulation.
    Replay {
        /// The run file.
        run: String,
        /// Number of the trial.
        trial: u32,
        /// Number of the simulation.
        simulation: u32,
        /// Whether its system is Python code.
        is_python: bool,
    },
    /// Write a page about a run and open it.
    Report {
        /// The run file.
        run: String,
    },
    /// Simulate one scenario.
    Simulate {
        /// The values of axes, by name.
        at: Vec<(String, String)>,
    },
}

/// A simulation of a run file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Recorded {
    /// The run file.
    pub run: String,
    /// Number of the trial.
    pub trial: u32,
    /// Number of the simulation.
    pub simulation: u32,
    /// Present path of the controller, if it was moved.
    pub controller: Option<String>,
}

/// How a front words what to ask, on one line.
pub type Words = fn(&Command) -> String;

/// One way to avoid an error. An error has a list of them; each is enough.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// Give these settings, all of them together.
    Set(Vec<(Key, Choice)>),
    /// Leave out a setting.
    Unset(Key),
    /// Choose another value.
    Another(Key),
    /// Ask this first.
    Run(Command),
    /// Do this, beside settings.
    Advice(&'static str),
    /// A sentence that guesses what was meant.
    Hint(String),
    /// The remedy helps under this condition.
    If(String, Box<Remedy>),
}

impl Remedy {
    /// Returns the remedy to give a setting.
    pub fn set(key: Key, value: Choice) -> Remedy {
        Remedy::Set(vec![(key, value)])
    }

    /// Returns the remedy under a condition, such as "the file was moved".
    #[must_use]
    pub fn when(self, condition: impl Into<String>) -> Remedy {
        Remedy::If(condition.into(), Box::new(self))
    }

    /// Returns the keys that it names.
    pub fn keys(&self) -> Vec<Key> {
        match self {
            Remedy::Set(settings) => settings.iter().map(|(key, _)| *key).collect(),
            Remedy::Unset(key) | Remedy::Another(key) => vec![*key],
            Remedy::Run(_) | Remedy::Advice(_) | Remedy::Hint(_) => Vec::new(),
            Remedy::If(_, remedy) => remedy.keys(),
        }
    }
}
