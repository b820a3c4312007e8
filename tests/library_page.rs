//! The output in docs/guide/library.md matches the output of its program. `cargo xtask external`
//! runs the commands of the page.

use mishandle::rollout::{Request, Seed};
use mishandle::{Plan, ResolvedPlan};

#[test]
fn the_page_shows_the_robustness_of_its_episode() {
    let page = include_str!("../docs/guide/library.md");
    let plan = Plan::from_toml("target = \"ball-balancing\"\ncontroller = \"ppo\"").unwrap();
    let mut system = ResolvedPlan::new(&plan).unwrap().system().unwrap();
    let start = Request::new([0.342, 0.1], Seed(0));
    let episode = &system.rollout(&[start]).unwrap()[0];
    let line = format!("\nrobustness {:?} after {} steps\n", episode.verdict.robustness, episode.steps);
    assert!(page.contains(&line), "{line}");
}
