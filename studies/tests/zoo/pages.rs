//! Figures on the pages do not contradict each other, whoever wrote them.

use std::fs;
use std::path::{Path, PathBuf};

/// Content found in a page.
#[derive(Debug, Default, PartialEq)]
struct Found {
    /// Number of pairs of a success rate and a strict success rate.
    pairs: usize,
    /// Number of full success rates of one controller.
    full: usize,
    contradictions: Vec<String>,
}

impl Found {
    fn pair(&mut self, success: f64, strict: f64, place: &str) {
        self.pairs += 1;
        if strict > success {
            self.contradictions.push(format!("strict {strict} is above success {success}: {place}"));
        }
    }

    fn success(&mut self, rate: f64, has_corners: bool, place: &str) {
        if rate >= 100.0 {
            self.full += 1;
            if !has_corners {
                self.contradictions.push(format!("success {rate} stands without its corners: {place}"));
            }
        }
    }
}

/// Returns the number at the start of a cell: `99.9 [99.4, 100.0]`, `**98.0**`.
fn number(cell: &str) -> Option<f64> {
    cell.trim_start_matches('*').split([' ', '*']).next()?.parse().ok()
}

fn cells(line: &str) -> Vec<&str> {
    line.trim().trim_matches('|').split('|').map(str::trim).collect()
}

/// Returns whether a cell states the corners: `8/8; strict 7/8`.
fn states_corners(cell: &str) -> bool {
    let counts = cell.trim_start_matches('*').split_once('/');
    counts.is_some_and(|(done, _)| done.parse::<u32>().is_ok())
}

/// Checks the rows of a table. A column of success rates is followed by the columns of its strict
/// rates and its corners.
fn check_table(header: &[&str], rows: &[&str], found: &mut Found) {
    for (index, title) in header.iter().enumerate() {
        let is_success = *title == "SR" || (title.ends_with(": SR") && !title.starts_with("paper"));
        if !is_success {
            continue;
        }
        let next = |name: &str| (index..header.len()).find(|other| header[*other].starts_with(name));
        for row in rows {
            let cells = cells(row);
            let Some(success) = number(cells[index]) else { continue };
            for part in ["strict SR", "careful SR"] {
                if let Some(part) = next(part).and_then(|part| number(cells[part])) {
                    found.pair(success, part, row);
                }
            }
            let has_corners = next("corners").is_some_and(|corners| states_corners(cells[corners]));
            found.success(success, has_corners, row);
        }
    }
}

/// Checks all tables and all printed evaluations of a page.
fn check(page: &str) -> Found {
    let mut found = Found::default();
    let lines: Vec<&str> = page.lines().collect();
    for block in lines.split(|line| !line.starts_with('|')).filter(|block| block.len() > 2) {
        check_table(&cells(block[0]), &block[2..], &mut found);
    }
    for block in page.split("```").skip(1).step_by(2) {
        // `success  100 %  98.12 % to 100 %  200  6 of 8`
        let row = |name: &str| {
            let line = block.lines().find(|line| line.starts_with(&format!("{name}  ")))?;
            Some((number(line[name.len()..].trim())?, line))
        };
        let Some((success, line)) = row("success") else { continue };
        for (part, _) in ["strict", "careful"].into_iter().filter_map(row) {
            found.pair(success, part, block);
        }
        let words: Vec<&str> = line.split_whitespace().collect();
        found.success(success, words.len() > 2 && words[words.len() - 2] == "of", block);
    }
    found
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

#[test]
fn no_strict_rate_is_above_success_and_no_full_success_stands_without_its_corners() {
    let mut pages: Vec<PathBuf> = fs::read_dir(repository().join("controllers"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "md"))
        .collect();
    pages.push(repository().join("docs/guide/tour.md"));
    let mut all = Found::default();
    for path in pages {
        let found = check(&fs::read_to_string(&path).unwrap());
        assert_eq!(found.contradictions, [""; 0], "{}", path.display());
        assert!(found.pairs > 0 && found.full > 0, "{} has no figures", path.display());
        all.pairs += found.pairs;
    }
    // 40 controllers and 8 experts, each with and without noise, strict and careful.
    assert!(all.pairs > 2 * 2 * 48, "{all:?}");
}

#[test]
fn a_contradiction_on_a_page_is_found() {
    let table =
        |row: &str| check(&format!("| task | SR | strict SR | corners |\n|---|--:|--:|--:|\n{row}\n"));
    let good = "| a | 100.0 [99, 100] | 98.0 | **7/8**; strict 6/8 |";
    assert_eq!(table(good), Found { pairs: 1, full: 1, ..Found::default() });
    for row in ["| a | 97.9 | 98.0 | 8/8 |", "| a | 100.0 | 98.0 | - |", "| a | 100.0 | 98.0 | |"] {
        assert_eq!(table(row).contradictions.len(), 1, "{row}");
    }
    let without = check("| task | SR |\n|---|--:|\n| a | 100.0 |\n");
    assert_eq!(without.contradictions.len(), 1, "{without:?}");
    let printed = |corners: &str| {
        check(&format!(
            "```console\nsuccess  100 %  98.1 % to 100 %  200  {corners}\nstrict   98 %   95 % to 99.2 %   200  -\n```\n"
        ))
    };
    assert_eq!(printed("8 of 8").contradictions, [""; 0]);
    assert_eq!(printed("-").contradictions.len(), 1);
}
