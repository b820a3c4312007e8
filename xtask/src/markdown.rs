//! Links of Markdown pages.

/// Returns every link of a page outside code, with its line.
pub fn links(text: &str) -> impl Iterator<Item = (usize, &str)> {
    lines(text)
        .filter(|(_, _, is_code)| !is_code)
        .flat_map(|(number, line, _)| targets(line).map(move |target| (number, target)))
}

/// Replaces the links of a page outside code for which `new` returns a link.
pub fn rewrite(text: &str, mut new: impl FnMut(&str) -> Option<String>) -> String {
    let mut rewritten = String::new();
    for (_, line, is_code) in lines(text) {
        let mut found: Vec<(usize, &str)> = if is_code { Vec::new() } else { places(line).collect() };
        found.sort_unstable();
        let mut end = 0;
        for (start, target) in found {
            if let Some(link) = new(target) {
                rewritten += &line[end..start];
                rewritten += &link;
                end = start + target.len();
            }
        }
        rewritten += &line[end..];
        rewritten.push('\n');
    }
    rewritten
}

/// Returns the path of a link from the root, where a leading `/` also starts; `None` if it leaves
/// the repository.
pub fn resolve(page: &str, link: &str) -> Option<String> {
    let folder = page.rsplit_once('/').filter(|_| !link.starts_with('/')).map_or("", |(folder, _)| folder);
    let mut parts: Vec<&str> = Vec::new();
    for part in folder.split('/').chain(link.split('/')) {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            name => parts.push(name),
        }
    }
    Some(parts.join("/"))
}

/// Returns the lines of a page with their numbers, and whether they belong to a code block.
pub fn lines(text: &str) -> impl Iterator<Item = (usize, &str, bool)> {
    let mut in_code = false;
    (1..).zip(text.lines()).map(move |(number, line)| {
        let is_fence = line.trim_start().starts_with("```");
        in_code ^= is_fence;
        (number, line, in_code || is_fence)
    })
}

/// Returns the link targets of a line with their places.
fn places(line: &str) -> impl Iterator<Item = (usize, &str)> {
    // A target is a part of the line.
    targets(line).map(|target| (target.as_ptr() as usize - line.as_ptr() as usize, target))
}

/// Returns the link targets of a line: inline (`[a](b)`), definitions (`[a]: b`) and HTML
/// (`src="b"`, `href="b"`).
fn targets(line: &str) -> impl Iterator<Item = &str> {
    // Odd pieces between backticks are code.
    let prose = line.split('`').step_by(2);
    let inline = prose.flat_map(|text| text.split("](").skip(1).map(|rest| until(rest, &[')', ' '])));
    let html = line
        .split_once('<')
        .map_or("", |(_, tags)| tags)
        .split("src=\"")
        .flat_map(|part| part.split("href=\""))
        .skip(1)
        .map(|rest| until(rest, &['"']));
    let definition =
        line.strip_prefix('[').and_then(|rest| rest.split_once("]: ")).map(|(_, rest)| until(rest, &[' ']));
    inline.chain(html).chain(definition)
}

/// Returns the text before the first of these characters.
pub fn until<'a>(text: &'a str, ends: &[char]) -> &'a str {
    text.split(ends).next().unwrap_or(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn links_are_rewritten_outside_code() {
        let text = "[a](x.md) `[a](x.md)` <img src=\"x.md\"> [b](y.md)\n```\n[a](x.md)\n```\n[c]: x.md\n";
        let expected = "[a](z) `[a](x.md)` <img src=\"z\"> [b](y.md)\n```\n[a](x.md)\n```\n[c]: z\n";
        assert_eq!(rewrite(text, |link| (link == "x.md").then(|| "z".to_owned())), expected);
    }
}
