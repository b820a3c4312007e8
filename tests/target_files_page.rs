//! The reference of target files lists all functions, and the guide's robot works as it says.

use std::path::PathBuf;

fn page(name: &str) -> (PathBuf, String) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("docs").join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    (path, text)
}

fn table(rows: impl Iterator<Item = [String; 2]>, head: &str) -> String {
    let rows: String = rows.map(|[name, meaning]| format!("| `{name}` | {meaning} |\n")).collect();
    format!("| {head} | value |\n|---|---|\n{rows}")
}

/// With the environment variable UPDATE, it writes the tables.
#[test]
fn the_reference_lists_all_functions() {
    let (path, text) = page("reference/target_files.md");
    let quantities = mishandle_robots::QUANTITY_FUNCTIONS
        .iter()
        .map(|function| [function.call.to_string(), function.meaning.to_string()]);
    let functions = mishandle_robots::functions()
        .map(|(name, arguments, meaning)| [format!("{name}({arguments})"), meaning.to_string()]);
    let mut expected = text.clone();
    for (mark, table) in
        [("quantities", table(quantities, "quantity")), ("functions", table(functions, "function"))]
    {
        let begin = format!("<!-- {mark} -->\n");
        let end = format!("<!-- end of {mark} -->");
        let (head, rest) = expected.split_once(&begin).unwrap();
        let (_, tail) = rest.split_once(&end).unwrap();
        expected = format!("{head}{begin}{table}{end}{tail}");
    }
    if std::env::var_os("UPDATE").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    assert!(text == expected, "docs/reference/target_files.md: run this test with UPDATE=1");
}
