//! The templates of Dwyer's scopes, of EARS and of FRET.

use super::table::{DWYER, condition, time};
use super::{Family, Pattern, Shown, Slot};

const EARS: &str =
    "Mavin, Wilkinson, Harwood and Novak, Easy Approach to Requirements Syntax (EARS), RE 2009";
const FRET: &str = "Giannakopoulou, Pressburger, Mavridou and Schumann, Automated formalization of structured natural \
                    language requirements, Information and Software Technology 137, 2021";

/// The parameters, with one meaning in each family.
const SLOTS: &[Slot] = &[
    condition("p", "what is absent, holds, occurs, comes first, or is the trigger"),
    condition("q", "what needs `p` before it, or responds to `p`"),
    condition("begin", "what opens the scope"),
    condition("end", "what closes the scope"),
    condition("response", "what the system does"),
    condition("trigger", "the event, which counts where it starts, also at the first sample"),
    condition("state", "when the requirement applies"),
    condition("feature", "whether the system has the feature: the same at all samples"),
    Slot { default: Some("true"), ..condition("scope", "the mode in which the requirement applies") },
    Slot { default: Some("true"), ..condition("condition", "the trigger") },
    condition("stop", "the stop condition"),
    time("deadline", None, "latest response"),
    time("duration", None, "duration of the timing"),
];

/// Returns the parameter with this name. An unknown one fails the build.
const fn slot(name: &str) -> Slot {
    let mut index = 0;
    while !is_equal(SLOTS[index].name.as_bytes(), name.as_bytes()) {
        index += 1;
    }
    SLOTS[index]
}

const fn is_equal(a: &[u8], b: &[u8]) -> bool {
    let mut index = 0;
    while index < a.len() && index < b.len() && a[index] == b[index] {
        index += 1;
    }
    index == a.len() && index == b.len()
}

/// Returns samples 0 and 1.
const fn bits<const N: usize>(text: &[u8; N]) -> [f64; N] {
    let mut values = [0.0; N];
    let mut index = 0;
    while index < N {
        values[index] = (text[index] - b'0') as f64;
        index += 1;
    }
    values
}

/// A template: name, source, words, formula; each condition with its samples in the trace that
/// satisfies the formula and in the one that violates it; a time with its value.
macro_rules! template {
    ($name:literal, $source:ident, $words:expr, $formula:expr,
     [$($slot:ident $holds:literal $fails:literal),+] $(, $time:ident = $value:literal)?) => {
        Pattern {
            name: $name,
            words: $words,
            formula: $formula,
            slots: &[$(slot(stringify!($slot)),)+ $(slot(stringify!($time)),)?],
            source: $source,
            shown: Shown {
                settings: &[
                    $((stringify!($slot), concat!(stringify!($slot), " >= 1")),)+
                    $((stringify!($time), $value),)?
                ],
                signals: &[$(stringify!($slot)),+],
                satisfies: &[$(&bits($holds)),+],
                violates: &[$(&bits($fails)),+],
            },
        }
    };
}

/// The words of a pattern in a scope.
macro_rules! within {
    (globally $body:literal) => {
        concat!("In the whole trace, ", $body)
    };
    (before $body:literal) => {
        concat!("Before the first time of {end}, if there is one, ", $body)
    };
    (after $body:literal) => {
        concat!("From the first time of {begin} on, ", $body)
    };
    (between $body:literal) => {
        concat!("From each {begin} to the next {end}, if one follows, ", $body)
    };
    (after_until $body:literal) => {
        concat!("From each {begin} to the next {end}, or to the end of the trace, ", $body)
    };
}

/// The formula of a condition that holds in a scope which `end` closes. Without `end`, the first
/// two scopes require nothing.
macro_rules! up_to_end {
    (before $body:literal) => {
        concat!("(always(not {end})) or ((", $body, ") unless {end})")
    };
    (between $body:literal) => {
        concat!(
            "always(({begin} and not {end}) implies ((always(not {end})) or ((",
            $body,
            ") unless {end})))"
        )
    };
    (after_until $body:literal) => {
        concat!("always(({begin} and not {end}) implies ((", $body, ") unless {end}))")
    };
}

/// The patterns of Dwyer, Avrunin and Corbett in their five scopes.
pub(super) const SCOPES: Family = Family {
    title: "Scopes",
    text: "Five patterns of Dwyer, Avrunin and Corbett in their five scopes; `invariant` is their \
           universality. `invariant`, `absence` and `precedence` without a scope are above. A scope contains \
           the sample that opens it, and not the one that closes it; a sample at which both conditions hold \
           opens none. Each sample of `begin` opens a scope, but with `after` only the first one. On a finite \
           trace, `before` and `between` require nothing if `end` does not follow, and other scopes end with \
           the trace. `existence` and `response` are violated if the event is missing at the end of the scope; \
           `absence`, `invariant` and `precedence` are satisfied. What must not happen before an event that may never come \
           is `precedence`.",
    patterns: &[
        template!("absence-before", DWYER, within!(before "{p} does not hold."), up_to_end!(before "not {p}"),
            [p b"0001" b"0100", end b"0010" b"0010"]),
        template!("absence-after", DWYER, within!(after "{p} does not hold."),
            "always((once {begin}) implies not {p})", [begin b"0100" b"0100", p b"1000" b"1001"]),
        template!("absence-between", DWYER, within!(between "{p} does not hold."), up_to_end!(between "not {p}"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"100001" b"001000"]),
        template!("absence-after-until", DWYER, within!(after_until "{p} does not hold."),
            up_to_end!(after_until "not {p}"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"100100" b"100001"]),
        template!("invariant-before", DWYER, within!(before "{p} holds at every time."), up_to_end!(before "{p}"),
            [p b"1100" b"1000", end b"0010" b"0010"]),
        template!("invariant-after", DWYER, within!(after "{p} holds at every time."),
            "always((once {begin}) implies {p})", [begin b"0100" b"0100", p b"0111" b"0110"]),
        template!("invariant-between", DWYER, within!(between "{p} holds at every time."),
            up_to_end!(between "{p}"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"011000" b"010000"]),
        template!("invariant-after-until", DWYER, within!(after_until "{p} holds at every time."),
            up_to_end!(after_until "{p}"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"011011" b"011010"]),
        template!("existence-globally", DWYER, within!(globally "{p} holds at some time."), "eventually {p}",
            [p b"0001" b"0000"]),
        template!("existence-before", DWYER, within!(before "{p} holds at some time."),
            "(not {end}) unless ({p} and not {end})", [p b"0100" b"0010", end b"0010" b"0010"]),
        template!("existence-after", DWYER, within!(after "{p} holds at some time."),
            "(always(not {begin})) or eventually({begin} and eventually {p})",
            [begin b"0100" b"0100", p b"0001" b"1000"]),
        template!("existence-between", DWYER, within!(between "{p} holds at some time."),
            "always(({begin} and not {end}) implies ((not {end}) unless ({p} and not {end})))",
            [begin b"010010" b"010010", end b"000100" b"000100", p b"001000" b"100100"]),
        template!("existence-after-until", DWYER, within!(after_until "{p} holds at some time."),
            "always(({begin} and not {end}) implies ((not {end}) until ({p} and not {end})))",
            [begin b"010010" b"010010", end b"000100" b"000100", p b"001001" b"001000"]),
        template!("precedence-before", DWYER, within!(before "{q} does not hold before {p} has held."),
            "(always(not {end})) or ((not {q}) unless ({p} or {end}))",
            [p b"0100" b"0010", q b"0010" b"0100", end b"0001" b"0001"]),
        template!("precedence-after", DWYER, within!(after "{q} does not hold before {p} has held."),
            "(not {begin}) unless ({begin} and ((not {q}) unless {p}))",
            [begin b"0100" b"0100", p b"0010" b"1001", q b"1011" b"0010"]),
        template!("precedence-between", DWYER, within!(between "{q} does not hold before {p} has held."),
            "always(({begin} and not {end}) implies ((always(not {end})) or ((not {q}) unless ({p} or {end}))))",
            [begin b"01000" b"01000", end b"00001" b"00001", p b"00100" b"10000", q b"10010" b"00010"]),
        template!("precedence-after-until", DWYER, within!(after_until "{q} does not hold before {p} has held."),
            "always(({begin} and not {end}) implies ((not {q}) unless ({p} or {end})))",
            [begin b"01000" b"01000", end b"00000" b"00000", p b"00100" b"10000", q b"10010" b"00010"]),
        template!("response-globally", DWYER, within!(globally "{q} follows each time of {p}."),
            "always({p} implies eventually {q})", [p b"0100" b"0100", q b"0001" b"1000"]),
        template!("response-before", DWYER, within!(before "{q} follows each time of {p}."),
            up_to_end!(before "{p} implies ((not {end}) unless ({q} and not {end}))"),
            [p b"10001" b"10000", q b"01000" b"00010", end b"00010" b"00010"]),
        template!("response-after", DWYER, within!(after "{q} follows each time of {p}."),
            "always(({p} and once {begin}) implies eventually {q})",
            [begin b"0100" b"0100", p b"1010" b"0010", q b"0001" b"0100"]),
        template!("response-between", DWYER, within!(between "{q} follows each time of {p}."),
            up_to_end!(between "{p} implies ((not {end}) unless ({q} and not {end}))"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"001001" b"001000", q b"001000" b"000100"]),
        template!("response-after-until", DWYER, within!(after_until "{q} follows each time of {p}."),
            up_to_end!(after_until "{p} implies ((not {end}) until ({q} and not {end}))"),
            [begin b"010010" b"010010", end b"000100" b"000100", p b"001010" b"001010", q b"001001" b"001000"]),
    ],
};

/// The templates of EARS.
pub(super) const EARS_TEMPLATES: Family = Family {
    title: "EARS",
    text: "The templates of EARS, which has no formal semantics; this one is ours. An event or an unwanted \
           condition counts where it starts, also at the first sample. A deadline that the end of the trace \
           cuts must be met before the end.",
    patterns: &[
        template!("ears-ubiquitous", EARS, "The system shall {response}: it holds at every time.", "always {response}",
            [response b"111" b"110"]),
        template!("ears-state-driven", EARS, "While {state}, the system shall {response}.",
            "always({state} implies {response})", [state b"0110" b"0110", response b"0110" b"0100"]),
        template!("ears-event-driven", EARS, "When {trigger}, the system shall {response}, at the latest {deadline} later.",
            "always(rise({trigger}) implies eventually[0:{deadline}] {response})",
            [trigger b"01100" b"01100", response b"00010" b"10001"], deadline = "2s"),
        template!("ears-unwanted-behavior", EARS,
            "If {trigger}, then the system shall {response}, at the latest {deadline} later.",
            "always(rise({trigger}) implies eventually[0:{deadline}] {response})",
            [trigger b"0100" b"0100", response b"0010" b"0001"], deadline = "1s"),
        template!("ears-optional-feature", EARS, "Where {feature}, the system shall {response}.",
            "always({feature} implies {response})", [feature b"000" b"111", response b"010" b"110"]),
    ],
};

/// The timings of FRET.
pub(super) const FRET_TEMPLATES: Family = Family {
    title: "FRET",
    text: "Requirements of FRET have a scope, a condition, a component, a timing and a response. The pattern \
           is the timing, and the component is not in the formula. An interval of the scope is a longest run \
           of samples at which `scope` holds, `true` for the whole trace: `m` is FRET's in mode m, `not m` not \
           in, `historically(not m)` before, `once(s_prev m and not m)` after. In an interval, the requirement \
           is triggered where `condition` starts to hold, and at the first sample if it holds there; `true` \
           triggers once in each interval. The end of the trace ends the interval, too: a response that is \
           missing then violates `eventually`, but not `within`, whose duration must fit into the interval; \
           `always`, `for` and `until` require the response up to there.",
    patterns: &[
        template!("fret-immediately", FRET, "While {scope}, upon {condition}, {response} holds at the same time.",
            "always(rise({scope} and {condition}) implies {response})",
            [scope b"011011" b"011011", condition b"001111" b"001111", response b"001010" b"001001"]),
        template!("fret-always", FRET, "While {scope}, upon {condition}, {response} holds at every time from then on.",
            "always(rise({scope} and {condition}) implies ({response} unless not {scope}))",
            [scope b"01110" b"01110", condition b"00100" b"00100", response b"00110" b"00100"]),
        template!("fret-never", FRET, "While {scope}, upon {condition}, {response} holds at no time from then on.",
            "always(rise({scope} and {condition}) implies ((not {response}) unless not {scope}))",
            [scope b"01110" b"01110", condition b"00100" b"00100", response b"11001" b"00010"]),
        template!("fret-eventually", FRET, "While {scope}, upon {condition}, {response} holds at some time from then on.",
            "always(rise({scope} and {condition}) implies ({scope} until ({scope} and {response})))",
            [scope b"01110" b"01110", condition b"00100" b"00100", response b"00010" b"10001"]),
        template!("fret-until", FRET,
            "While {scope}, upon {condition}, {response} holds at every time until the first time of {stop} from then on, or to the end.",
            "always(rise({scope} and {condition}) implies ({response} unless ({stop} or not {scope})))",
            [scope b"11111" b"11111", condition b"01000" b"01000", response b"01100" b"01000", stop b"00010" b"00010"]),
        template!("fret-before", FRET,
            "While {scope}, upon {condition}, {response} holds before the first time of {stop} from then on, if there is one.",
            "always(rise({scope} and {condition}) implies (({response} or not {scope}) release not ({scope} and {stop})))",
            [scope b"11111" b"11111", condition b"01000" b"01000", response b"00100" b"00010", stop b"00010" b"00010"]),
        template!("fret-within", FRET,
            "While {scope}, upon {condition}, {response} holds at some time from then to {duration} later.",
            "always((once[{duration}:{duration}] rise({scope} and {condition})) implies once[0:{duration}]({response} or not \
             {scope}))",
            [scope b"111111" b"111111", condition b"010010" b"010010", response b"000100" b"000010"], duration = "2s"),
        template!("fret-for", FRET,
            "While {scope}, upon {condition}, {response} holds at every time from then to {duration} later.",
            "always(rise({scope} and {condition}) implies ({response} unless[0:{duration}] not {scope}))",
            [scope b"111111" b"111111", condition b"010001" b"010001", response b"011101" b"011011"], duration = "2s"),
        template!("fret-after", FRET,
            "While {scope}, upon {condition}, {response} does not hold from then to {duration} later, and holds at the next \
             sample.",
            "always(rise({scope} and {condition}) implies (((not {response}) unless[0:{duration}] not {scope}) and \
             ((always[0:{duration}] {scope}) implies always[{duration}:{duration}] next ({response} or not {scope}))))",
            [scope b"11111" b"11111", condition b"01000" b"01000", response b"10010" b"00110"], duration = "1s"),
    ],
};
