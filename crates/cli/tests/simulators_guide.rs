//! The simulators of the guide, with the files and the output that the page shows.

use crate::bench::{Bench, text};

const PAGE: &str = include_str!("../../../docs/guide/simulators.md");

const ALLOWED: &str = "MISHANDLE_ALLOW_PROGRAMS";

#[test]
fn the_simulators_of_the_guide_give_the_shown_output() {
    let bench = Bench::new();
    let mut commands = 0;
    for part in PAGE.split("<!-- ").skip(1) {
        let (comment, rest) = part.split_once(" -->").unwrap();
        let (kind, name) = comment.split_once(": ").unwrap();
        let (_, block) = rest.split("```").nth(1).unwrap().split_once('\n').unwrap();
        if kind == "file" {
            bench.write(name, block);
            continue;
        }
        assert_eq!(kind, "command");
        let (command, expected) = block.split_once('\n').unwrap();
        let command = command.strip_prefix("$ ").unwrap();
        let permission = format!("{ALLOWED}=1 ");
        let arguments = command.strip_prefix(&permission).unwrap_or(command);
        let mut program = bench.command(arguments.strip_prefix("mishandle ").unwrap());
        if command != arguments {
            program.env(ALLOWED, "1");
        }
        let output = program.output().unwrap();
        let printed = text(&output.stdout) + &text(&output.stderr);
        assert_eq!(output.status.code(), name.parse().ok(), "{command}\n{printed}");
        for line in expected.lines() {
            assert!(printed.contains(line), "{command} does not print: {line}\n{printed}");
        }
        commands += 1;
    }
    assert_eq!(commands, 6);
}
