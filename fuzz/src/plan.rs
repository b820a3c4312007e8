//! Plans.

use mishandle::{Plan, ResolvedPlan};

/// Checks the laws:
/// - a plan that is read and written reads as the same plan;
/// - every plan of a toy either resolves, to itself with the name of its space, or is an error. A
///   plan of a task can name files, so it is not resolved here.
pub fn check(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let Ok(plan) = Plan::from_toml(text) else { return };
    // Compared as text, because a NaN differs from itself.
    let written = plan.to_toml();
    let again = Plan::from_toml(&written).unwrap_or_else(|error| panic!("{error} in {written}"));
    assert_eq!(again.to_toml(), written);
    assert_eq!(format!("{again:?}"), format!("{plan:?}"));
    let toy = Plan { target: "toy/sphere-2d".to_string(), controller: String::new(), ..plan };
    if let Ok(resolved) = ResolvedPlan::new(&toy) {
        // A plan without a space is one about the first space of its target.
        let space = if toy.space.is_empty() { "starts".to_string() } else { toy.space.clone() };
        assert_eq!(resolved.plan.to_toml(), Plan { space, ..toy }.to_toml());
    }
}

pub fn seeds() -> Vec<Vec<u8>> {
    let page = include_str!("../../docs/reference/plans.md");
    let documented = page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next());
    let evaluation =
        "format = 2\ntarget = \"ball-balancing\"\ncontroller = \"ppo\"\n[evaluate]\nbox = \"reachable\"\n";
    let options = "target = \"toy/sphere-2d\"\nseed = \"18446744073709551615\"\n[falsify]\nsearch = \"nelder-mead\"\n\
                   [falsify.options]\nxatol = 1e-3\nadaptive = true\nstart = [0.5, 1]\n\
                   initial-simplex = [[0, 1], [0.5, 1], [1, 1]]\n";
    documented.chain([evaluation, options]).map(|text| text.as_bytes().to_vec()).collect()
}
