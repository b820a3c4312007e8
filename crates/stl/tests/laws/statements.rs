//! Where statements end: definitions, declarations and formulas over several lines.

use super::naive::{Random, Tree};
use mishandle_stl::{Formula, ParseError};

#[track_caller]
fn check_same(text: &str, other: &str) {
    let parse = |text: &str| Formula::parse(text).unwrap_or_else(|error| panic!("{text:?}: {error}"));
    assert_eq!(parse(text), parse(other), "{text:?} against {other:?}");
}

#[track_caller]
fn check_error(text: &str, parts: &[&str]) {
    let error = Formula::parse(text).expect_err(text).to_string();
    for part in parts {
        assert!(error.contains(part), "{text:?}: {error}");
    }
}

/// RTAMT 0.4.10 reads these texts as we do, but it refuses semicolons between statements and
/// declarations after a definition.
#[test]
fn definitions_on_lines_of_their_own_need_no_semicolons() {
    check_same("up = speed >= 2\neventually(up)", "eventually(speed >= 2)");
    check_same("up = speed >= 2;\neventually(up);\n", "eventually(speed >= 2)");
    check_same("up = speed >= 2\r\n\r\n// both\r\nlow = h < 1\r\nup and low", "speed >= 2 and h < 1");
    check_same("up = speed // 2 m/s\n(up) >= 1", "speed >= 1");
    check_same("up = speed >= 2 /* a\n b */ not(up)", "not(speed >= 2)");
    check_same("v = speed\nabs(v) >= 1", "abs(speed) >= 1");
    check_same("v = speed\n2 <= v", "2 <= speed");
    check_same("up = speed >= 2\nlow = h < 1", "h < 1");
    check_same("input float speed\nconst float k = 2\nup = speed >= k\nalways up", "always(speed >= 2)");
    check_same("up = speed >= 2\ninput float h\nalways up and h > 0", "always(speed >= 2) and h > 0");
    check_same("up = speed >= 2\n;\n;\nup\n;", "speed >= 2");
    check_same("up =\nspeed\n>= 2\nup", "speed >= 2");
}

#[test]
fn a_formula_may_wrap_over_lines() {
    check_same("always(a > 0)\nand b > 0", "always(a > 0) and b > 0");
    check_same("p = always(a > 0)\nand b > 0\np", "always(a > 0) and b > 0");
    check_same("p = (a\n- b\n> 0)\np", "a - b > 0");
    check_same("p = a -\nb > 0\np", "a - b > 0");
    check_same("a\n- b > 0", "a - b > 0");
    check_same("always\n[0\n:\n3\ns]\na", "always[0:3s] a");
    check_same("a until\n[0:3] b", "a until[0:3] b");
}

#[test]
fn a_line_that_could_continue_a_definition_or_follow_it_is_an_error_that_names_the_semicolon() {
    for (text, found) in [
        ("p = a > 1\n-b <= 2", "`-`"),
        ("p = a\n  - b\nalways(p > 0)", "`-`"),
        ("p = a > 1\nR > 2", "`R`"),
        ("p = a > 1\nrelease\n> 2", "`release`"),
        ("p = ln\n(a) > 0", "`(`"),
    ] {
        check_error(text, &["line 2", found, "write `;` before"]);
    }
    check_same("p = a > 1;\n-b <= 2", "-b <= 2");
    check_same("p = a > 1\n(-b) <= 2", "-b <= 2");
    check_same("p = ln(a) > 1\np", "ln(a) > 1");
    check_same("p = a > 1\n`R` > 2", "`R` > 2");
    check_error("const float k = 3\n-a > k", &["line 2", "expected `;` after a declaration"]);
    check_error("const float k = 3 - 1; a > k", &["expected `;`", "a constant is one number"]);
    check_error("input float a\n-a > 1", &["expected `;` after a declaration"]);
}

#[test]
fn on_one_line_a_semicolon_separates_statements() {
    for text in ["p = a > 1 always(p)", "p = a <= 2 s", "p = a > 1 (p)", "p = a > 1 // c"] {
        let whole = format!("{text} b");
        check_error(
            if text.ends_with('c') { "p = a > 1 /* c */ b" } else { &whole },
            &["`;` or a line break"],
        );
    }
    check_same("p = a > 1; always(p)", "always(a > 1)");
}

#[test]
fn the_hint_on_a_wrong_line_fits_its_cause() {
    check_error("a > 0\nb > 0", &["line 2, column 1", "only the last statement may omit `name =`"]);
    check_error("a > 0; b > 0", &["only the last statement may omit `name =`"]);
    check_error("a > 0\nAND b > 0", &["did you mean `and`?"]);
    check_error("p = a > 0\nAND b > 0\np", &["did you mean `and`?"]);
    check_error("p = a\nunti b\np", &["did you mean `until`?"]);
    check_error("p = a\n[0:3] b", &["line 2, column 1", "expected an operator or the next statement"]);
    check_error("p = a\n/ * b", &["line 2, column 3"]);
    check_error("p = a)\np", &["found `)`"]);
}

#[test]
fn a_name_is_defined_once_before_its_uses() {
    check_error("p = q > 1\nq = a\np", &["line 2, column 1: `q` is defined here, but column 5 reads it"]);
    check_error("out = p\np = a > 1", &["`p` is defined here"]);
    check_error("a = a > 1; always a", &["`a` is defined here, but column 5"]);
    check_error("p = a; p = b; p", &["column 8: `p` is already defined"]);
    check_error("p = a > 0\np = b > 0", &["line 2, column 1: `p` is already defined"]);
    check_error("p = a; `p` = b; p", &["`p` is already defined"]);
    check_error("const int p = 1; p = a > 0; p", &["`p` is already defined"]);
}

#[test]
fn an_operator_cannot_be_defined_without_backquotes() {
    for word in ["G", "always", "S", "and", "true", "abs", "X"] {
        for text in [format!("{word} = a > 0; a"), format!("p = a > 0\n{word} = p\np"), format!("{word} = a")]
        {
            check_error(&text, &[&format!("`{word}` is a word of the language"), "backquotes"]);
        }
        check_error(&format!("const float {word} = 1; a"), &["is a word of the language"]);
        check_same(&format!("`{word}` = a > 0\nnot `{word}`"), "not(a > 0)");
    }
}

#[test]
fn definitions_that_no_statement_reads_are_listed() {
    let unused = |text: &str| -> Vec<String> {
        let formula = Formula::parse(text).unwrap();
        formula.unused_definitions().into_iter().map(str::to_owned).collect()
    };
    assert_eq!(unused("p = a > 0\nb > 0"), ["p"]);
    assert_eq!(unused("const int k = 2; const int m = 3; p = a > 0; out = always[0:k] p"), ["m"]);
    assert!(unused("out = a > 0").is_empty());
}

/// A random formula over the names defined so far.
fn random_body(random: &mut Random, defined: &[String]) -> String {
    let size = random.below(3);
    let tree = Tree::random(random, size, 9).write(random);
    let signal = random.pick(&["a", "R", "ln", "release", "s", "float", "-a", "-1", "(a)", "`a b`"]);
    let part = match defined.get(random.below(defined.len() + 3)) {
        Some(name) => name.clone(),
        None => signal.to_owned(),
    };
    match random.below(6) {
        0 => part,
        1 => format!("{part} > 0"),
        2 => format!("{tree} and {part} > 1"),
        3 => format!("({part}) until ({tree})"),
        4 => format!("-{part} <= 2"),
        _ => tree,
    }
}

#[test]
fn a_line_break_between_statements_is_a_semicolon_or_an_error_that_names_it() {
    let mut random = Random(51);
    let mut same = 0;
    let mut refused = 0;
    for _ in 0..20_000 {
        let mut defined = Vec::new();
        let mut statements = Vec::new();
        for index in 0..random.below(4) {
            let name = random.pick(&["p", "float_1", "`p q`", "q.x", "`R`", "`G`"]);
            let name = if index == 0 { name.to_owned() } else { format!("n{index}") };
            match random.below(6) {
                0 => statements.push(format!("input float u{index}")),
                1 => {
                    statements.push(format!("const float {name} = {}", random.pick(&["1", "-2.5"])));
                    defined.push(name);
                }
                _ => {
                    statements.push(format!("{name} = {}", random_body(&mut random, &defined)));
                    defined.push(name);
                }
            }
        }
        statements.push(random_body(&mut random, &defined));
        let expected = Formula::parse(&statements.join(";"));
        assert_eq!(Formula::parse(&statements.join(";\n")).ok(), expected.clone().ok(), "{statements:?}");
        for separator in ["\n", "\r\n", " // c\n", "\n\n", ";\n// c\n"] {
            let text = statements.join(separator);
            match (Formula::parse(&text), &expected) {
                (Ok(found), Ok(expected)) => {
                    assert_eq!(found, *expected, "{text:?}");
                    same += 1;
                }
                (Err(error), _) => {
                    assert!(expected.is_err() || error.to_string().contains("`;`"), "{text:?}: {error}");
                    refused += 1;
                }
                (Ok(_), Err(error)) => panic!("{text:?} parses, but with semicolons: {error}"),
            }
        }
    }
    assert!(same > 50_000 && refused > 1000, "{same} {refused}");
}

/// Splits a text of ASCII characters where whitespace may be inserted: between tokens.
fn gaps(text: &str) -> Vec<usize> {
    let is_word = |c: char| c.is_ascii_alphanumeric() || "_.$".contains(c);
    let pairs = text.char_indices().zip(text.chars().skip(1));
    pairs
        .filter(|((_, before), after)| {
            let is_symbol = "<>=!-&|*/".contains(*before) && "<>=!-&|*/".contains(*after);
            let splits_word = is_word(*before) && is_word(*after);
            !(splits_word || is_symbol || "+-".contains(*after))
        })
        .map(|((index, before), _)| index + before.len_utf8())
        .collect()
}

#[test]
fn a_line_break_inside_a_formula_never_changes_it() {
    let mut random = Random(52);
    let mut same = 0;
    for case in 0..20_000 {
        let size = random.below(6);
        let body = Tree::random(&mut random, size, 10).write(&mut random);
        let text = match case % 4 {
            0 => body,
            1 => format!("p = {body}; p"),
            2 => format!("p = ({body}) - a > 1; const float k = 3; q = a R b; p and q > k"),
            _ => Formula::parse(&body).unwrap().to_string(),
        };
        let expected = Formula::parse(&text).unwrap();
        let gaps = gaps(&text);
        for _ in 0..if gaps.is_empty() { 0 } else { 4 } {
            let at = random.pick(&gaps);
            let line_break = random.pick(&["\n", "\r\n", " // c\n", "/*\n*/"]);
            let broken = format!("{}{line_break}{}", &text[..at], &text[at..]);
            match Formula::parse(&broken) {
                Ok(found) => {
                    assert_eq!(found, expected, "{broken:?}");
                    same += 1;
                }
                Err(error) => {
                    let is_named =
                        matches!(error, ParseError::Ambiguous { .. }) || error.to_string().contains("`;`");
                    assert!(is_named, "{broken:?}: {error}");
                }
            }
        }
    }
    assert!(same > 60_000, "{same}");
}
