//! Values, sizes and errors of expressions.

#![allow(clippy::unwrap_used, reason = "tests")]

use mishandle_robots::expression::{
    Argument, Compiler, ExpressionError, Meaning, Names, Place, Program, Reader, Reading, Size, parse, value,
};

/// Quantities of the tests: a vector of three numbers, and a list of forces.
#[derive(Clone, Debug, PartialEq)]
enum What {
    Position(String),
    Forces,
}

struct Robot;

impl Names<What> for Robot {
    fn name(&self, name: &str) -> Result<Meaning<What>, String> {
        let definition = |text: &str| Ok(Meaning::Definition(parse(text).unwrap()));
        match name {
            "home" => Ok(Meaning::Vector(vec![1.0, 2.0, 3.0])),
            "half" => Ok(Meaning::Number(0.5)),
            "twice" => definition("2 * position('arm')"),
            "loop" => definition("1 + loop"),
            "broken" => definition("home + missing"),
            // `chain7` is 1 + chain6, and so on.
            _ => match name.strip_prefix("chain").and_then(|number| number.parse::<u32>().ok()) {
                Some(0) => Ok(Meaning::Number(0.0)),
                Some(number) => definition(&format!("1 + chain{}", number - 1)),
                None => Err(format!("there is no `{name}`")),
            },
        }
    }

    fn reads(&self, function: &str) -> bool {
        matches!(function, "position" | "forces")
    }

    fn call(&self, function: &str, arguments: &[Argument]) -> Result<Reading<What>, String> {
        match (function, arguments) {
            ("forces", []) => Ok(Reading { what: What::Forces, size: Size::List }),
            ("position", [Argument::Text(name)]) => {
                Ok(Reading { what: What::Position(name.clone()), size: Size::Vector(3) })
            }
            _ => Err("wrong arguments".to_string()),
        }
    }

    fn functions(&self) -> Vec<String> {
        vec!["position".to_string(), "forces".to_string()]
    }
}

struct State {
    reads: usize,
    forces: Vec<f64>,
}

impl Reader<What> for State {
    fn read(&mut self, what: &What, out: &mut [f64]) {
        self.reads += 1;
        match what {
            What::Position(name) => {
                let sign = if name == "arm" { 1.0 } else { -1.0 };
                out.copy_from_slice(&[sign * 3.0, sign * 4.0, sign * 12.0]);
            }
            What::Forces => panic!("a list is not read at once"),
        }
    }

    fn list(&mut self, _what: &What, each: &mut dyn FnMut(f64)) {
        self.forces.iter().for_each(|force| each(*force));
    }
}

fn compiled(text: &str) -> Result<(Program<What>, Place), ExpressionError> {
    let mut compiler = Compiler::new();
    let place = compiler.add(&parse(text)?, &Robot)?;
    Ok((compiler.program(), place))
}

fn values_with(text: &str, forces: &[f64]) -> Vec<f64> {
    let (program, place) = compiled(text).unwrap_or_else(|error| panic!("{}", error.marked(text)));
    let mut memory = program.memory();
    program.run(&mut memory, &mut State { reads: 0, forces: forces.to_vec() });
    value(&memory, &place).to_vec()
}

fn values(text: &str) -> Vec<f64> {
    values_with(text, &[])
}

fn message(text: &str) -> String {
    match compiled(text) {
        Err(error) => error.message,
        Ok(_) => panic!("`{text}` is accepted"),
    }
}

#[test]
fn operators_bind_as_in_python() {
    // The right-hand sides are what Python prints.
    for (text, expected) in [
        ("1 + 2 * 3", 7.0),
        ("-2 ** 2", -4.0),
        ("2 ** -1", 0.5),
        ("2 ** 3 ** 2", 512.0),
        ("8 / 4 / 2", 1.0),
        ("8 - 4 - 2", 2.0),
        ("-7 % 3", 2.0),
        ("7 % -3", -2.0),
        ("1 < 2 < 3", 1.0),
        ("1 < 3 < 2", 0.0),
        ("not 1 < 2", 0.0),
        ("1 if 0 else 2 if 0 else 3", 3.0),
        ("0 or 2 and 0", 0.0),
        ("(1 + 2) * 3", 9.0),
        ("--3", 3.0),
        ("1e-3 * 1_000", 0.0),
    ] {
        if text.contains('_') {
            assert!(parse(text).is_err(), "numbers have no underscores");
        } else {
            assert_eq!(values(text), [expected], "{text}");
        }
    }
}

#[test]
fn numbers_are_applied_to_each_number_of_a_vector() {
    assert_eq!(values("position('arm') - home"), [2.0, 2.0, 9.0]);
    assert_eq!(values("half * home"), [0.5, 1.0, 1.5]);
    assert_eq!(values("home > 1.5"), [0.0, 1.0, 1.0]);
    assert_eq!(values("where(home > 1.5, home, -home)"), [-1.0, 2.0, 3.0]);
    assert_eq!(values("clip(home, 1.5, [9, 9, 2.5])"), [1.5, 2.0, 2.5]);
    assert_eq!(values("[0, *home[1:], home[0], home[-1]]"), [0.0, 2.0, 3.0, 1.0, 3.0]);
    assert_eq!(values("home[:2]"), [1.0, 2.0]);
}

#[test]
fn functions_of_vectors() {
    assert_eq!(values("norm(position('arm'))"), [13.0]);
    assert_eq!(values("max(position('arm'))"), [12.0]);
    assert_eq!(values("max(2, min(home))"), [2.0]);
    assert_eq!(values("mean(home)"), [2.0]);
    assert_eq!(values("dot(home, position('leg'))"), [-47.0]);
    assert_eq!(values("cross([1, 0, 0], [0, 1, 0])"), [0.0, 0.0, 1.0]);
    assert_eq!(values("len(home)"), [3.0]);
    assert_eq!(values("sum(home > 1) + product(home) + any(home > 5) + all(home > 0)"), [2.0 + 6.0 + 1.0]);
    assert_eq!(values("smoothstep(0.25)"), [0.15625]);
    assert_eq!(values("round(2.5) + round(3.5)"), [6.0]);
}

#[test]
fn rotations_agree_with_their_definitions() {
    // A quarter turn about z maps x to y.
    let close = |found: Vec<f64>, expected: &[f64]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?} {expected:?}");
    };
    close(values("rotate(quat_euler(0, 0, acos(0)), [1, 0, 0])"), &[0.0, 1.0, 0.0]);
    close(values("rotate_inverse(quat_euler(0, 0, acos(0)), [0, 1, 0])"), &[1.0, 0.0, 0.0]);
    close(values("euler(quat_euler(0.3, -0.4, 0.5))"), &[0.3, -0.4, 0.5]);
    // Roll, then pitch, then yaw, about fixed axes.
    let separate =
        "quat_multiply(quat_euler(0, 0, 0.5), quat_multiply(quat_euler(0, -0.4, 0), quat_euler(0.3, 0, 0)))";
    close(values(separate), &values("quat_euler(0.3, -0.4, 0.5)"));
    close(
        values("quat_multiply(quat_euler(0.3, 1, 2), quat_inverse(quat_euler(0.3, 1, 2)))"),
        &[1.0, 0.0, 0.0, 0.0],
    );
    close(values("wrap_angle([4, -4, 3])"), &[4.0 - std::f64::consts::TAU, std::f64::consts::TAU - 4.0, 3.0]);
}

#[test]
fn a_list_is_reduced_and_an_empty_one_is_0() {
    assert_eq!(values_with("max(forces()) + sum(forces())", &[2.0, 7.0, 1.0]), [17.0]);
    assert_eq!(values_with("min(forces())", &[2.0, 7.0, 1.0]), [1.0]);
    assert_eq!(values_with("max(forces()) + sum(forces())", &[]), [0.0]);
    assert!(message("forces() + 1").contains("needs a reduction"));
}

#[test]
fn an_undefined_value_is_never_hidden() {
    for text in [
        "max(0 / 0, 1)",
        "min(1, 0 / 0)",
        "max([1, 0 / 0, 2])",
        "min([0 / 0, 1])",
        "clip(0 / 0, 0, 1)",
        "sum([0 / 0])",
    ] {
        assert!(values(text)[0].is_nan(), "{text}");
    }
    assert!(values_with("max(forces())", &[1.0, f64::NAN, 2.0])[0].is_nan());
}

#[test]
fn a_quantity_is_read_once_and_constants_are_computed_before() {
    let (program, place) =
        compiled("norm(position('arm')) + twice[0] + position('arm')[1] + 2 * half").unwrap();
    let mut state = State { reads: 0, forces: vec![] };
    let mut memory = program.memory();
    program.run(&mut memory, &mut state);
    assert_eq!(value(&memory, &place), [13.0 + 6.0 + 4.0 + 1.0]);
    assert_eq!(state.reads, 1);
    assert_eq!(program.reads().count(), 1);
    let (constant, place) = compiled("norm([3, 4]) * half").unwrap();
    assert_eq!(constant.reads().count(), 0);
    assert_eq!(value(&constant.memory(), &place), [2.5], "the memory holds constants without a run");
}

#[test]
fn mistakes_name_the_place_and_a_way_out() {
    for (text, part) in [
        ("home + [1, 2]", "3 and 2 numbers"),
        ("home[3]", "index 3 is outside"),
        ("home[2:1]", "empty"),
        ("half[0]", "needs a vector"),
        ("home[position('arm')[0]]", "does not change"),
        ("[home, 1]", "write `*`"),
        ("[]", "at least one number"),
        ("nrm(home)", "there is no function `nrm`"),
        ("sin(1, 2)", "takes 1 argument, not 2"),
        ("cross(home, half)", "argument 2 of `cross` has 1 number, but 3 numbers are needed"),
        ("'text' + 1", "is not a number"),
        ("missing", "there is no `missing`"),
        ("loop", "uses itself"),
        ("broken", "in the definition of `broken`: there is no `missing`"),
        ("position(arm)", "wrong arguments"),
    ] {
        assert!(message(text).contains(part), "{text}: {}", message(text));
    }
    for (text, part) in [
        ("1 +", "found the end"),
        ("(1", "expected `)`"),
        ("1 2", "expected the end or an operator"),
        ("2x", "write `2 * ...`"),
        ("a = 1", "expected the end or an operator, found `=`"),
        ("'open", "not closed"),
        ("1 $ 2", "no meaning"),
        ("1e999", "too large"),
        ("if", "expected a number"),
    ] {
        let error = parse(text).unwrap_err();
        assert!(error.message.contains(part), "{text}: {}", error.message);
    }
}

#[test]
fn hostile_texts_are_errors() {
    let texts = [
        "(".repeat(10_000),
        "[".repeat(500),
        format!("{}1", "-(".repeat(300)),
        "1+".repeat(9_000),
        "a".repeat(30_000),
        format!("{}1", "not ".repeat(3_000)),
        format!("2{}", "**2".repeat(900)),
        "\u{0}".to_string(),
        "ä + 日本 ≤ 3".to_string(),
    ];
    for text in &texts {
        let error = parse(text).unwrap_err();
        assert!(!error.marked(text).is_empty());
    }
    // A long chain below the bound compiles on the small stack of a test.
    let chain = format!("1{}", " + 1".repeat(200));
    assert_eq!(values(&chain), [201.0]);
}

#[test]
fn a_chain_of_definitions_has_at_most_100() {
    let mut compiler = Compiler::new();
    let place = compiler.add(&parse("chain100").unwrap(), &Robot).unwrap();
    assert_eq!(value(&compiler.program().memory(), &place), [100.0]);
    let found = message("chain101");
    assert!(found.contains("more than 100 definitions") && found.len() < 120, "{found}");
}
