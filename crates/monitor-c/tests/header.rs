//! The header declares what the library has: functions with their parameters, values of
//! enumerations, and the text of every doc comment.

use std::path::Path;

const UPDATE: &str = "run `cargo xtask monitor --update`";

/// Reads a file of this package.
fn file(path: &str) -> String {
    std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).expect(path)
}

/// Returns a text with one space for each gap between words.
fn spaced(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns a type of Rust as C writes it before a name.
fn in_c(kind: &str) -> String {
    if let Some(target) = kind.strip_prefix("*mut ") {
        return format!("{} *", in_c(target)).replace("* *", "**");
    }
    if let Some(target) = kind.strip_prefix("*const ") {
        let target = in_c(target);
        // `const` of a pointer follows its star.
        return if target.ends_with('*') { format!("{target}const *") } else { format!("const {target} *") };
    }
    match kind {
        "c_char" => "char".to_owned(),
        "f64" => "double".to_owned(),
        "usize" => "size_t".to_owned(),
        "MishandleMonitor" => format!("struct {kind}"),
        "MishandleStatus" | "MishandleVerdict" => format!("enum {kind}"),
        other => other.to_owned(),
    }
}

/// Returns the type and the name of a parameter or function.
fn declared(kind: &str, name: &str) -> String {
    let kind = in_c(kind);
    if kind.ends_with('*') { kind + name } else { format!("{kind} {name}") }
}

/// Returns the declaration in C of a function, from the text after `extern "C" fn `.
fn declaration(text: &str) -> String {
    let (signature, _) = text.split_once(" {\n").expect("a body");
    let (name, rest) = signature.split_once('(').expect("parameters");
    let (parameters, result) = rest.split_once(')').expect("an end of the parameters");
    let parameters: Vec<String> = parameters
        .split(',')
        .filter_map(|parameter| parameter.trim().split_once(": "))
        .map(|(name, kind)| declared(kind, name))
        .collect();
    let parameters = if parameters.is_empty() { "void".to_owned() } else { parameters.join(", ") };
    let result = result.strip_prefix(" -> ").unwrap_or("void");
    format!("{}({parameters});", declared(result, name))
}

/// Returns a name in the style of constants: `NULL_POINTER` for `NullPointer`.
fn constant(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.push(letter.to_ascii_uppercase());
    }
    text
}

#[test]
fn the_header_declares_every_function_and_no_other() {
    let source = file("src/lib.rs");
    let header = spaced(&file("include/mishandle_monitor.h"));
    let functions: Vec<String> = source.split("extern \"C\" fn ").skip(1).map(declaration).collect();
    for function in &functions {
        assert!(header.contains(function), "the header lacks `{function}`; {UPDATE}");
    }
    assert_eq!(header.matches(");").count(), functions.len(), "the header has another function; {UPDATE}");
}

#[test]
fn the_header_has_every_value_of_an_enumeration() {
    let source = file("src/lib.rs");
    let header = spaced(&file("include/mishandle_monitor.h"));
    let mut expected = 0;
    for text in source.split("#[repr(C)]").skip(1) {
        let (head, body) =
            text.split_once("pub enum ").and_then(|(_, text)| text.split_once(" {\n")).expect("an enum");
        let body = body.split_once("\n}").expect("an end").0;
        for value in body.lines().map(str::trim).filter(|line| !line.starts_with("//")) {
            let (name, number) = value.trim_end_matches(',').split_once(" = ").expect("a number");
            let value = format!("{}_{} = {number},", constant(head), constant(name));
            assert!(header.contains(&value), "the header lacks `{value}`; {UPDATE}");
            expected += 1;
        }
    }
    assert_eq!(header.matches(" = ").count(), expected, "the header has another value; {UPDATE}");
}

#[test]
fn the_header_has_every_doc_comment() {
    let header = spaced(&file("include/mishandle_monitor.h"));
    let source = file("src/lib.rs");
    // A doc comment of something private is not in the header.
    let public = source.split("\nimpl MishandleMonitor").next().expect("a beginning");
    for line in public.lines().filter_map(|line| line.trim().strip_prefix("/// ")) {
        assert!(header.contains(&spaced(line)), "the header lacks `{line}`; {UPDATE}");
    }
}
