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
    LOG_TIME = "log.time",
    LOG_TIME_UNIT = "log.time-unit",
    LOG_UTC_OFFSET = "log.utc-offset",
    LOG_PERIOD = "log.period",
    LOG_RESAMPLE = "log.resample",
    LOG_DENSE = "log.dense",
    LOG_MISSING = "log.missing",
    LOG_DUPLICATES = "log.duplicates",
    LOG_SORT = "log.sort",
    LOG_LATENESS = "log.lateness",
    LOG_TOPIC = "log.topic",
    LOG_DELIMITER = "log.delimiter",
    LOG_DECIMAL = "log.decimal",
    LOG_UNIT = "log.unit",
    LOG_STRICT_HORIZON = "log.strict-horizon",
    NORMALIZER = "import.normalizer",
    ACTIVATION = "import.activation",
    OUTPUT_ACTIVATION = "import.output-activation",
    PARAMETER = "formula.set",
    RESOLUTION = "formula.resolution",
}

impl Key {
    /// Returns the name.
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
    /// A value that only the user knows, such as `SECONDS`.
    Shape(&'static str),
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

/// Something else to ask, as a remedy.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Import the policy of another tool.
    Import,
}

/// One way to avoid an error. An error has a list of them; each is enough.
#[derive(Clone, Debug, PartialEq)]
pub enum Remedy {
    /// Give these settings, all of them together.
    Set(Vec<(Key, Choice)>),
    /// Leave out a setting.
    Unset(Key),
    /// Ask this first.
    Run(Command),
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
            Remedy::Unset(key) => vec![*key],
            Remedy::Run(_) => Vec::new(),
            Remedy::If(_, remedy) => remedy.keys(),
        }
    }
}
