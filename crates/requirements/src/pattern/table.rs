//! The table of patterns without a scope.

use super::{ParameterKind, Pattern, Shown, Slot};

pub(super) const DWYER: &str = "Dwyer, Avrunin and Corbett, Patterns in Property Specifications for Finite-State Verification, \
                     ICSE 1999";
const KONRAD: &str = "Konrad and Cheng, Real-time Specification Patterns, ICSE 2005";
const MALER: &str = "Maler and Nickovic, Monitoring Temporal Properties of Continuous Signals, FORMATS 2004";
const BOUFAIED: &str = "Boufaied et al., Signal-Based Properties of Cyber-Physical Systems, Journal of Systems and Software \
                        174, 2021";
const ROBOTS: &str = "usual in specifications of manipulators; no published pattern";

pub(super) const fn condition(name: &'static str, meaning: &'static str) -> Slot {
    Slot { name, kind: ParameterKind::Condition, default: None, meaning }
}

const fn signal(name: &'static str, meaning: &'static str) -> Slot {
    Slot { name, kind: ParameterKind::Signal, default: None, meaning }
}

const fn number(name: &'static str, default: Option<&'static str>, meaning: &'static str) -> Slot {
    Slot { name, kind: ParameterKind::Number, default, meaning }
}

pub(super) const fn time(name: &'static str, default: Option<&'static str>, meaning: &'static str) -> Slot {
    Slot { name, kind: ParameterKind::Time, default, meaning }
}

/// Patterns without a scope, related ones together.
pub(super) const GENERAL: &[Pattern] = &[
    Pattern {
        name: "invariant",
        words: "At every time, {p} holds.",
        formula: "always {p}",
        slots: &[condition("p", "what always holds")],
        source: DWYER,
        shown: Shown {
            settings: &[("p", "x <= 1")],
            signals: &["x"],
            satisfies: &[&[0.0, 0.5, 1.0]],
            violates: &[&[0.0, 1.5, 1.0]],
        },
    },
    Pattern {
        name: "absence",
        words: "At no time, {p} holds.",
        formula: "always(not {p})",
        slots: &[condition("p", "what never happens")],
        source: DWYER,
        shown: Shown {
            settings: &[("p", "x > 1")],
            signals: &["x"],
            satisfies: &[&[0.0, 0.5, 1.0]],
            violates: &[&[0.0, 1.5, 1.0]],
        },
    },
    Pattern {
        name: "while",
        words: "At every time at which {p} holds, {q} holds, too.",
        formula: "always({p} implies {q})",
        slots: &[condition("p", "when the requirement applies"), condition("q", "what holds then")],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("p", "contact >= 0.5"), ("q", "force <= 10")],
            signals: &["contact", "force"],
            satisfies: &[&[0.0, 1.0, 1.0, 0.0], &[15.0, 5.0, 10.0, 12.0]],
            violates: &[&[0.0, 1.0, 1.0, 0.0], &[15.0, 5.0, 11.0, 12.0]],
        },
    },
    Pattern {
        name: "existence",
        words: "{p} holds at some time from the start to {deadline}.",
        formula: "eventually[0:{deadline}] {p}",
        slots: &[condition("p", "what happens"), time("deadline", None, "latest time")],
        source: KONRAD,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("deadline", "2s")],
            signals: &["x"],
            satisfies: &[&[0.0, 0.0, 1.0, 0.0]],
            violates: &[&[0.0, 0.0, 0.0, 1.0]],
        },
    },
    Pattern {
        name: "precedence",
        words: "{q} does not hold before {p} has held: at the first time of {q}, {p} holds or has held.",
        formula: "(not {q}) unless {p}",
        slots: &[condition("p", "what comes first"), condition("q", "what needs it")],
        source: DWYER,
        shown: Shown {
            settings: &[("p", "gripper <= 0.1"), ("q", "height > 0.2")],
            signals: &["gripper", "height"],
            satisfies: &[&[1.0, 0.1, 0.1], &[0.0, 0.1, 0.3]],
            violates: &[&[1.0, 1.0, 0.1], &[0.0, 0.3, 0.3]],
        },
    },
    Pattern {
        name: "response",
        words: "Whenever {p} holds, {q} holds at some time from then to {deadline} later.",
        formula: "always({p} implies eventually[0:{deadline}] {q})",
        slots: &[
            condition("p", "the trigger"),
            condition("q", "the response"),
            time("deadline", None, "latest response"),
        ],
        source: KONRAD,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("q", "y <= 0.1"), ("deadline", "2s")],
            signals: &["x", "y"],
            satisfies: &[&[0.0, 1.0, 0.0, 0.0, 0.0], &[1.0, 1.0, 1.0, 0.0, 1.0]],
            violates: &[&[0.0, 1.0, 0.0, 0.0, 0.0], &[1.0, 1.0, 1.0, 1.0, 0.0]],
        },
    },
    Pattern {
        name: "reaction",
        words: "Each time {p} starts to hold, {q} holds at some time from then to {deadline} later.",
        formula: "always(s_prev(not {p}) and {p} implies eventually[0:{deadline}] {q})",
        slots: &[
            condition("p", "the trigger, which counts where it starts, not at the first sample"),
            condition("q", "the response"),
            time("deadline", None, "latest response"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("q", "y >= 1"), ("deadline", "1s")],
            signals: &["x", "y"],
            satisfies: &[&[0.0, 1.0, 1.0, 1.0, 1.0], &[0.0, 0.0, 1.0, 0.0, 0.0]],
            violates: &[&[0.0, 1.0, 1.0, 1.0, 1.0], &[0.0, 0.0, 0.0, 1.0, 1.0]],
        },
    },
    Pattern {
        name: "response-and-hold",
        words: "Each time {p} starts to hold, {q} holds for {duration} without a break, starting at the latest {deadline} \
                later.",
        formula: "always(s_prev(not {p}) and {p} implies eventually[0:{deadline}] always[0:{duration}] {q})",
        slots: &[
            condition("p", "the trigger, which counts where it starts, not at the first sample"),
            condition("q", "the response"),
            time("deadline", None, "latest start of the response"),
            time("duration", None, "how long it must last"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("p", "alarm >= 0.5"), ("q", "speed <= 0.1"), ("deadline", "1s"), ("duration", "2s")],
            signals: &["alarm", "speed"],
            satisfies: &[&[0.0, 1.0, 1.0, 0.0, 0.0, 0.0], &[2.0, 2.0, 0.0, 0.1, 0.0, 1.0]],
            violates: &[&[0.0, 1.0, 1.0, 0.0, 0.0, 0.0], &[2.0, 2.0, 0.0, 0.1, 1.0, 0.0]],
        },
    },
    Pattern {
        name: "hold-for",
        words: "Each time {p} starts to hold, {q} holds from then to {duration} later.",
        formula: "always(s_prev(not {p}) and {p} implies always[0:{duration}] {q})",
        slots: &[
            condition("p", "the trigger, which counts where it starts, not at the first sample"),
            condition("q", "what holds then"),
            time("duration", None, "how long"),
        ],
        source: KONRAD,
        shown: Shown {
            settings: &[("p", "closed >= 1"), ("q", "force < 20"), ("duration", "2s")],
            signals: &["closed", "force"],
            satisfies: &[&[0.0, 1.0, 1.0, 1.0, 1.0], &[30.0, 5.0, 10.0, 15.0, 25.0]],
            violates: &[&[0.0, 1.0, 1.0, 1.0, 1.0], &[30.0, 5.0, 10.0, 25.0, 15.0]],
        },
    },
    Pattern {
        name: "minimum-duration",
        words: "Each time {p} starts to hold, it holds from then to {duration} later, both ends included.",
        formula: "always(s_prev(not {p}) and {p} implies always[0:{duration}] {p})",
        slots: &[
            condition("p", "what lasts; if the first sample has it, its start is unknown and not checked"),
            time("duration", None, "how long at least, from its first sample to its last"),
        ],
        source: KONRAD,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("duration", "2s")],
            signals: &["x"],
            satisfies: &[&[0.0, 1.0, 1.0, 1.0, 0.0]],
            violates: &[&[0.0, 1.0, 1.0, 0.0, 0.0]],
        },
    },
    Pattern {
        name: "minimum-gap",
        words: "Each time {p} stops holding, it does not hold from then to {gap} later, both ends included.",
        formula: "always(s_prev {p} and not {p} implies always[0:{gap}](not {p}))",
        slots: &[
            condition("p", "what must not chatter"),
            time("gap", None, "shortest pause, from its first sample to its last"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("gap", "2s")],
            signals: &["x"],
            satisfies: &[&[1.0, 0.0, 0.0, 0.0, 1.0]],
            violates: &[&[1.0, 0.0, 0.0, 1.0, 1.0]],
        },
    },
    Pattern {
        name: "recurrence",
        words: "From every time on, {p} holds at some time from then to {period} later.",
        formula: "always(eventually[0:{period}] {p})",
        slots: &[condition("p", "what happens again and again"), time("period", None, "longest pause")],
        source: KONRAD,
        shown: Shown {
            settings: &[("p", "x >= 1"), ("period", "2s")],
            signals: &["x"],
            satisfies: &[&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]],
            violates: &[&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0]],
        },
    },
    Pattern {
        name: "recovery",
        words: "Whenever {p} does not hold, it holds again for {duration} without a break, starting at the latest {deadline} \
                later.",
        formula: "always((not {p}) implies eventually[0:{deadline}] always[0:{duration}] {p})",
        slots: &[
            condition("p", "the normal state"),
            time("deadline", None, "latest start of the recovery"),
            time("duration", None, "how long it must last"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("p", "tilt <= 5"), ("deadline", "2s"), ("duration", "1s")],
            signals: &["tilt"],
            satisfies: &[&[0.0, 9.0, 9.0, 2.0, 2.0, 0.0]],
            violates: &[&[0.0, 9.0, 9.0, 9.0, 2.0, 2.0]],
        },
    },
    Pattern {
        name: "reach-and-stay",
        words: "{p} holds for {duration} without a break, starting at the latest {deadline} after the start.",
        formula: "eventually[0:{deadline}] always[0:{duration}] {p}",
        slots: &[
            condition("p", "the goal"),
            time("deadline", None, "latest arrival"),
            time("duration", None, "how long it must last"),
        ],
        source: MALER,
        shown: Shown {
            settings: &[("p", "distance <= 0.1"), ("deadline", "2s"), ("duration", "1s")],
            signals: &["distance"],
            satisfies: &[&[0.5, 0.3, 0.1, 0.1, 0.4]],
            violates: &[&[0.5, 0.1, 0.3, 0.1, 0.1]],
        },
    },
    Pattern {
        name: "settling",
        words: "From some time at the latest {deadline} after the start on, {signal} stays within {band} of {target} up to the \
                end.",
        formula: "eventually[0:{deadline}] always(abs({signal} - {target}) <= {band})",
        slots: &[
            signal("signal", "what settles"),
            signal("target", "where it settles: a number or a signal"),
            number("band", None, "largest deviation afterwards, in the unit of the signal"),
            time("deadline", None, "settling time"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("signal", "x"), ("target", "1"), ("band", "0.1"), ("deadline", "2s")],
            signals: &["x"],
            satisfies: &[&[0.0, 1.3, 1.05, 0.95, 1.0]],
            violates: &[&[0.0, 1.3, 1.05, 0.8, 1.0]],
        },
    },
    Pattern {
        name: "overshoot",
        words: "At every time, {signal} is at most {overshoot} above {target}.",
        formula: "always({signal} - {target} <= {overshoot})",
        slots: &[
            signal("signal", "what follows the target"),
            signal("target", "the target: a number or a signal"),
            number("overshoot", None, "largest overshoot, in the unit of the signal"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("signal", "x"), ("target", "1"), ("overshoot", "0.2")],
            signals: &["x"],
            satisfies: &[&[0.0, 1.1, 0.9, 1.0]],
            violates: &[&[0.0, 1.3, 0.9, 1.0]],
        },
    },
    Pattern {
        name: "range",
        words: "At every time, {signal} is from {low} to {high}.",
        formula: "always({signal} >= {low} and {signal} <= {high})",
        slots: &[
            signal("signal", "what stays in the range"),
            number("low", None, "least value"),
            number("high", None, "greatest value"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("signal", "q"), ("low", "-1"), ("high", "2")],
            signals: &["q"],
            satisfies: &[&[0.0, -1.0, 2.0]],
            violates: &[&[0.0, -1.5, 2.0]],
        },
    },
    Pattern {
        name: "rate-limit",
        words: "From one sample to the next, {signal} changes by at most {change}.",
        formula: "always[1:inf](abs({signal} - (prev {signal})) <= {change})",
        slots: &[
            signal("signal", "what changes slowly"),
            number("change", None, "largest change between two samples, in the unit of the signal"),
        ],
        source: BOUFAIED,
        shown: Shown {
            settings: &[("signal", "q"), ("change", "0.5")],
            signals: &["q"],
            satisfies: &[&[3.0, 3.5, 3.25, 3.0]],
            violates: &[&[3.0, 3.5, 4.25, 4.0]],
        },
    },
    Pattern {
        name: "clearance",
        words: "At every time, {distance} is at least {minimum}.",
        formula: "always({distance} >= {minimum})",
        slots: &[
            signal("distance", "distance to obstacles or people"),
            number("minimum", None, "smallest distance, in the unit of the signal"),
        ],
        source: ROBOTS,
        shown: Shown {
            settings: &[("distance", "gap"), ("minimum", "0.1")],
            signals: &["gap"],
            satisfies: &[&[0.5, 0.1, 0.3]],
            violates: &[&[0.5, 0.05, 0.3]],
        },
    },
    Pattern {
        name: "bounded-force",
        words: "At every time, {force} is at most {limit} in size.",
        formula: "always(abs({force}) <= {limit})",
        slots: &[
            signal("force", "force or torque"),
            number("limit", None, "largest size, in the unit of the signal"),
        ],
        source: ROBOTS,
        shown: Shown {
            settings: &[("force", "fz"), ("limit", "20")],
            signals: &["fz"],
            satisfies: &[&[0.0, -20.0, 12.0]],
            violates: &[&[0.0, -25.0, 12.0]],
        },
    },
    Pattern {
        name: "no-contact-until",
        words: "{force} stays at most {touch} up to the time at which {ready} first holds, which is at the latest {deadline} \
                after the start.",
        formula: "({force} <= {touch}) until[0:{deadline}] {ready}",
        slots: &[
            signal("force", "contact force"),
            number("touch", Some("0.5"), "largest force without contact, in the unit of the signal"),
            condition("ready", "what allows contact"),
            time("deadline", None, "latest time"),
        ],
        source: ROBOTS,
        shown: Shown {
            settings: &[("force", "f"), ("touch", "0.5"), ("ready", "aligned >= 1"), ("deadline", "3s")],
            signals: &["f", "aligned"],
            satisfies: &[&[0.0, 0.1, 4.0, 5.0], &[0.0, 0.0, 1.0, 1.0]],
            violates: &[&[0.0, 4.0, 4.0, 5.0], &[0.0, 0.0, 1.0, 1.0]],
        },
    },
    Pattern {
        name: "mutual-exclusion",
        words: "At no time, both {p} and {q} hold.",
        formula: "always(not ({p} and {q}))",
        slots: &[condition("p", "one state"), condition("q", "the other")],
        source: DWYER,
        shown: Shown {
            settings: &[("p", "brake >= 1"), ("q", "drive >= 1")],
            signals: &["brake", "drive"],
            satisfies: &[&[1.0, 0.0, 0.0], &[0.0, 0.0, 1.0]],
            violates: &[&[1.0, 1.0, 0.0], &[0.0, 1.0, 1.0]],
        },
    },
];
