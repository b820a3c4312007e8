//! Files of requirements to start from.

/// The files by name.
pub const TEMPLATES: [(&str, &str); 2] = [
    ("iso-10218", include_str!("../templates/iso-10218.toml")),
    ("machinery-regulation", include_str!("../templates/machinery-regulation.toml")),
];

/// Returns the text of a template.
pub fn template(name: &str) -> Option<&'static str> {
    TEMPLATES.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::RequirementFile;

    #[test]
    fn every_template_says_that_it_is_no_certificate_and_has_clauses_and_sources() {
        for (name, text) in TEMPLATES {
            let file = RequirementFile::from_toml(text).expect(name);
            assert!(file.notice.expect(name).starts_with("Evidence, not certification"));
            for requirement in file.requirements {
                let has_all = requirement.text.is_some() && requirement.source.is_some();
                assert!(has_all && !requirement.clauses.is_empty(), "{name}: {}", requirement.name);
            }
        }
    }
}
