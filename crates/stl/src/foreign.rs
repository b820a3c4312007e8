//! Words and symbols of other tools' formulas, with ours: Breach, MoonLight, FRET and S-TaLiRo.

/// Words of other languages and the operators that they are here.
const WORDS: [(&str, &str); 16] = [
    ("alw", "always"),
    ("alw_", "always"),
    ("globally", "always"),
    ("globally_", "always"),
    ("ev", "eventually"),
    ("ev_", "eventually"),
    ("finally", "eventually"),
    ("finally_", "eventually"),
    ("hist", "historically"),
    ("hist_", "historically"),
    ("once_", "once"),
    ("until_", "until"),
    ("since_", "since"),
    ("Z", "prev"),
    ("V", "release"),
    ("equiv", "iff"),
];

/// Symbols of other languages and the operators that they are here.
const SYMBOLS: [(&str, &str); 3] = [("=>", "implies"), ("<=>", "iff"), ("=", "==")];

const MIN: &str =
    "there is no `min`: `min(a, b) >= c` is `a >= c and b >= c`, and `min(a, b) <= c` is `a <= c or b <= c`";

const MAX: &str =
    "there is no `max`: `max(a, b) <= c` is `a <= c and b <= c`, and `max(a, b) >= c` is `a >= c or b >= c`";

/// Returns the operator that a word or symbol of another language is here.
pub(crate) fn operator(text: &str) -> Option<&'static str> {
    let is_word = |known: &str| match known.len() {
        1 => known == text,
        _ => known.eq_ignore_ascii_case(text),
    };
    let words = WORDS.iter().filter(|(known, _)| is_word(known));
    words.chain(SYMBOLS.iter().filter(|(known, _)| *known == text)).map(|(_, ours)| *ours).next()
}

/// Returns the hint on a function of other languages.
pub(crate) fn function(name: &str) -> Option<&'static str> {
    match name {
        "min" => Some(MIN),
        "max" => Some(MAX),
        _ => None,
    }
}

/// Returns the hint on a character of other languages.
pub(crate) fn character(character: char) -> Option<&'static str> {
    match character {
        '^' => Some("a power is `pow(x, y)`"),
        '\\' => Some("`/\\` is `and`, and `\\/` is `or`"),
        _ => None,
    }
}
