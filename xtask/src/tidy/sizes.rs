//! Sizes of files: whoever clones the repository downloads each version of each file, and whoever
//! comes reads the first page.

use super::{File, Problem, Tree};
use crate::markdown::links;

/// Largest size of a file, bytes.
const LARGEST: usize = 256 << 10;

/// Most lines and links of the first page.
const FRONT: [usize; 2] = [120, 25];

pub fn check(tree: &Tree) -> Vec<Problem> {
    let large = tree.files.iter().filter(|file| file.size > LARGEST && !may_be_large(&file.path));
    large.map(problem).chain(tree.file("README.md").and_then(front)).collect()
}

/// Returns the problem of a first page that is too long to be read.
fn front(page: &File) -> Option<Problem> {
    let [lines, links] = [page.text.lines().count(), links(&page.text).count()];
    let what = format!("has {lines} lines and {links} links, more than {} or {}", FRONT[0], FRONT[1]);
    (lines > FRONT[0] || links > FRONT[1]).then(|| Problem { path: page.path.clone(), line: 1, what })
}

/// Returns whether a file may be larger: weights of controllers, and what tests compare with.
fn may_be_large(path: &str) -> bool {
    path.starts_with("controllers/") || path.split('/').any(|folder| folder == "tests")
}

fn problem(file: &File) -> Problem {
    let what = format!(
        "has {} KB, more than {}; store what pages and scripts compute from, or a digest",
        file.size.div_ceil(1 << 10),
        LARGEST >> 10
    );
    Problem { path: file.path.clone(), line: 1, what }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_large_file_is_found_outside_controllers_and_tests() {
        let allowed = "a".repeat(LARGEST);
        let large = "a".repeat(LARGEST + 1);
        let tree = Tree::of(&[
            ("studies/experiments/paper/allowed.csv", &allowed),
            ("studies/experiments/paper/rows.csv", &large),
            ("controllers/cube-stacking/ppo.safetensors", &large),
            ("crates/stl/tests/golden/values.json", &large),
            ("tests/golden/bits.json", &large),
            ("docs/attests.html", &large),
        ]);
        let found: Vec<String> = check(&tree).iter().map(ToString::to_string).collect();
        let what = "has 257 KB, more than 256; store what pages and scripts compute from, or a digest";
        let paths = ["studies/experiments/paper/rows.csv", "docs/attests.html"];
        assert_eq!(found, paths.map(|path| format!("{path}:1: {what}")));
    }

    #[test]
    fn the_size_of_a_binary_file_counts() {
        let picture = File { path: "docs/a.png".into(), text: String::new(), size: LARGEST + 1 };
        assert_eq!(check(&Tree { files: vec![picture] }).len(), 1);
    }

    #[test]
    fn the_first_page_is_short() {
        let found = |text: &str| {
            check(&Tree::of(&[("README.md", text), ("docs/README.md", &"a\n".repeat(200))])).len()
        };
        assert_eq!(found(&"a\n".repeat(FRONT[0])), 0);
        assert_eq!(found(&"a\n".repeat(FRONT[0] + 1)), 1);
        assert_eq!(found(&"[a](b) ".repeat(FRONT[1])), 0);
        assert_eq!(found(&"[a](b) ".repeat(FRONT[1] + 1)), 1);
    }
}
