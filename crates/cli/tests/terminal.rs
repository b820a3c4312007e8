//! The progress bar in a terminal: it fits the width, and it is cleared at every end of the
//! command.

use std::process::{Command, Output};

use crate::bench::{Bench, text};

const TERMINAL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/in_terminal.py");

/// Runs the program in a terminal, with options of [`TERMINAL`].
fn in_terminal(bench: &Bench, columns: usize, options: &str, arguments: &str) -> Output {
    let program = bench.command(arguments);
    Command::new("python3")
        .args([TERMINAL, &columns.to_string()])
        .args(options.split_whitespace())
        .arg(program.get_program())
        .args(program.get_args())
        .current_dir(bench.path("."))
        .env("TERM", "xterm")
        .output()
        .unwrap()
}

/// Returns the final content of a terminal, and the length of the longest line at any time.
fn shown(bytes: &[u8], columns: usize) -> (Vec<String>, usize) {
    let text = String::from_utf8_lossy(bytes);
    let mut lines: Vec<Vec<char>> = vec![Vec::new()];
    let mut row = 0;
    let mut column = 0;
    let mut longest = 0;
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        match c {
            '\r' => column = 0,
            '\n' => {
                row += 1;
                lines.resize(lines.len().max(row + 1), Vec::new());
            }
            '\u{1b}' => {
                assert_eq!(rest.next(), Some('['), "another escape sequence than CSI");
                let mut number = String::new();
                let command = loop {
                    match rest.next().unwrap() {
                        c if c.is_ascii_digit() || "?;".contains(c) => number.push(c),
                        c => break c,
                    }
                };
                let count = number.parse::<usize>().unwrap_or(1);
                match command {
                    'A' => row -= count.min(row),
                    'B' => row = (row + count).min(lines.len() - 1),
                    'K' if number == "2" => lines[row].clear(),
                    'K' => lines[row].truncate(column),
                    'm' | 'h' | 'l' => {}
                    other => panic!("unknown sequence ESC[{number}{other}"),
                }
            }
            c => {
                let line = &mut lines[row];
                line.resize(line.len().max(column + 1), ' ');
                line[column] = c;
                column += 1;
                longest = longest.max(column);
                assert!(column <= columns, "a line of more than {columns} columns: {line:?}");
            }
        }
    }
    (
        lines.into_iter().map(|line| line.into_iter().collect::<String>().trim_end().to_string()).collect(),
        longest,
    )
}

fn has_bar(line: &str) -> bool {
    line.contains(" left") || line.contains("[#") || line.contains("[-")
}

const EVALUATE: &str = "evaluate point-reaching --controller expert --threads 1 --episodes";

#[test]
fn the_bar_fits_every_terminal_width_and_is_cleared() {
    for columns in [60, 80, 120, 200] {
        let bench = Bench::new();
        let output = in_terminal(
            &bench,
            columns,
            "",
            "falsify point-reaching --controller expert --trials 2 --budget 30 --json --out a.sqlite",
        );
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(
            text.contains("/60 simulations") && text.contains("[-"),
            "{columns}: no bar was shown\n{text}"
        );
        // The JSON document after the bar can be wider than the terminal.
        let bar = text.split('{').next().unwrap();
        let (lines, longest) = shown(bar.as_bytes(), columns);
        assert!(longest + 1 >= columns.min(70), "{columns}: the bar has {longest} columns");
        assert!(!lines.iter().any(|line| has_bar(line)), "{columns}: {lines:?}");
        assert_eq!(output.status.code(), Some(0), "{text}");
    }
}

#[test]
fn signals_clear_the_bar() {
    for (signal, count) in [("SIGINT", 1), ("SIGTERM", 1), ("SIGTERM", 2), ("SIGINT", 2)] {
        let bench = Bench::new();
        let options = format!("--signal {signal} 1 {count}");
        let output = in_terminal(&bench, 100, &options, &format!("{EVALUATE} 100000 --out a.sqlite"));
        assert_eq!(output.status.code(), Some(130), "{signal} {count}");
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        // 100,000 random starts, and the corners and the center of the initial box.
        assert!(text.contains("/100009 simulations"), "{text}");
        let (lines, _) = shown(&output.stdout, 200);
        assert!(lines.iter().any(|line| line.starts_with("finishing the running simulations")), "{lines:?}");
        assert!(!lines.iter().any(|line| has_bar(line)), "{signal} {count}: {lines:?}");
    }
}

#[test]
fn an_error_clears_the_bar() {
    let bench = Bench::new();
    let output = in_terminal(&bench, 80, "", &format!("{EVALUATE} 20 --out /dev/null/a.sqlite"));
    let (lines, _) = shown(&output.stdout, 200);
    assert_eq!(output.status.code(), Some(2), "{lines:?}");
    assert!(lines.iter().any(|line| line.starts_with("error: ")), "{lines:?}");
    assert!(!lines.iter().any(|line| has_bar(line)), "{lines:?}");
}

#[test]
fn list_fits_the_terminal_and_80_columns_in_a_pipe() {
    let bench = Bench::new();
    let widest = |text: &str| text.lines().map(|line| line.chars().count()).max().unwrap();
    let names = ["tasks", "point-reaching", "cube-stacking", "ball-pushing", "cloth-placing-7x7"];
    for arguments in names.map(|name| format!("list {name}")) {
        assert!(widest(&bench.check(&arguments, 0)) <= 80, "{arguments}");
    }
    // The longest word of a formula has 67 columns.
    let output = in_terminal(&bench, 70, "", "list tasks");
    let text = String::from_utf8_lossy(&output.stdout).replace('\r', "");
    assert!(widest(&text) <= 70, "{text}");
}

#[test]
fn escape_sequences_in_arguments_do_not_reach_the_terminal() {
    let bench = Bench::new();
    for arguments in ["\u{1b}]0;owned\u{7}", "evaluate --\u{1b}]0;owned\u{7}", "evaluate \u{1b}]0;owned\u{7}"]
    {
        let output = in_terminal(&bench, 80, "", arguments);
        let shown = text(&output.stdout);
        assert!(shown.contains("\\u{1b}]0;owned\\u{7}"), "{shown}");
        assert!(!shown.contains("\u{1b}]") && !shown.contains('\u{7}'), "{shown:?}");
    }
}
