//! The robot of the guide, with the files and the output that the page shows.

use crate::bench;
use crate::bench::Bench;

const PAGE: &str = include_str!("../../../docs/guide/robots.md");

/// Returns the blocks after a comment, each with the rest of the comment.
fn blocks(kind: &str) -> Vec<(String, String)> {
    let begin = format!("<!-- {kind}");
    PAGE.split(&begin)
        .skip(1)
        .map(|part| {
            let (name, rest) = part.split_once("-->").unwrap();
            let block = rest.split("```").nth(1).unwrap();
            let (_, text) = block.split_once('\n').unwrap();
            (name.trim().trim_start_matches(':').trim().to_string(), text.to_string())
        })
        .collect()
}

#[test]
fn the_robot_of_the_guide_gives_the_shown_output() {
    let bench = Bench::new();
    let files = blocks("file");
    assert_eq!(files.len(), 2);
    for (name, text) in files {
        bench.write(&name, &text);
    }
    let commands = blocks("command");
    assert_eq!(commands.len(), 2);
    for (_, block) in commands {
        let (command, expected) = block.split_once('\n').unwrap();
        let arguments = command.strip_prefix("$ mishandle ").unwrap();
        let found = bench.run(arguments);
        let output = bench::text(&found.stdout) + &bench::text(&found.stderr);
        for line in expected.lines() {
            assert!(output.contains(line), "{command} does not print: {line}\n{output}");
        }
    }
}

#[test]
fn the_robot_with_cameras_is_recorded() {
    let bench = Bench::new();
    let added = blocks("append");
    for (name, text) in blocks("file") {
        let more = added.iter().find(|(file, _)| *file == name).map_or("", |(_, text)| text);
        bench.write(&name, &(text + more));
    }
    let command = PAGE.lines().find_map(|line| line.strip_prefix("mishandle record ")).unwrap();
    let found = bench.run(&format!("record {command} --episodes 1 -k record.format=npz --size 8x8"));
    assert!(found.status.success(), "{}", bench::text(&found.stderr));
    let data = std::fs::read(bench.path("demonstrations/data.npz")).unwrap();
    for camera in ["desk", "ride"] {
        let column = format!("observation.images.{camera}.npy");
        assert!(data.windows(column.len()).any(|bytes| bytes == column.as_bytes()), "{camera}");
    }
    for (keys, said) in [
        ("--size 8x8", "record.size needs record.camera"),
        ("-k record.archive-share=0.1", "record.archive-share needs record.archive"),
        ("-k record.archive-share=2", "a number from 0 to 1"),
        ("-k record.format=hdf", "no format `hdf`"),
    ] {
        bench.refuses(&format!("record cartpole.toml --out other {keys}"), &[said]);
    }
}

#[test]
fn the_robot_has_a_margin_without_a_space_and_is_found_without_its_ending() {
    let bench = Bench::new();
    for (name, text) in blocks("file") {
        bench.write(&name, &text);
    }
    let found = bench.run("margin cartpole.toml --budget 60 --verbose");
    let output = bench::text(&found.stdout) + &bench::text(&found.stderr);
    assert!(matches!(found.status.code(), Some(0 | 1)), "{output}");
    assert!(output.contains("space disturbance (6 axes)"), "{output}");
    for command in ["evaluate cartpole", "falsify cartpole", "list cartpole"] {
        bench.refuses(command, &["did you mean the target file `cartpole.toml`?"]);
    }
}
