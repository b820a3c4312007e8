//! Properties that all problems have.

use mishandle_rollout::{Request, Seed, Specification, Target};
use mishandle_stl::Formula;
use mishandle_toys::arch::PROBLEMS;

fn target(name: &str) -> Target {
    mishandle_toys::arch::target(&format!("arch/{name}")).expect("a problem").expect("a target")
}

#[test]
fn nominal_inputs_satisfy_every_requirement_and_any_input_gives_a_verdict() {
    for problem in PROBLEMS {
        let target = target(problem.name());
        let requirement = Formula::parse(&target.formulas[0].text).expect("a formula");
        for space in &target.spaces {
            let mut system =
                target.system(space, &Specification::new(requirement.clone())).expect("a system");
            let scenarios = [space.nominal(), space.sample(Seed(1), 0), space.sample(Seed(1), 1)];
            let requests = scenarios.map(|scenario| Request::new(scenario, Seed(0)));
            let episodes = system.rollout(&requests).expect("episodes");
            assert!(!episodes[0].is_violated(), "{}", problem.name());
            assert!(
                episodes.iter().all(|episode| episode.verdict.robustness.is_some()),
                "{}",
                problem.name()
            );
            assert_eq!(episodes[0].steps, problem.episode_steps());
            assert_eq!(system.rollout(&requests).expect("episodes"), episodes, "{}", problem.name());
        }
    }
}

#[test]
fn constrained_inputs_are_free_inputs_without_a_ramp() {
    for problem in PROBLEMS {
        let target = target(problem.name());
        let [constrained, free] = [&target.spaces[0], &target.spaces[1]];
        assert_eq!((constrained.name(), free.name()), ("instance-2", "instance-1"));
        assert_eq!(constrained.axes(), &free.axes()[..free.axes().len() - 1]);
        assert_eq!(
            free.axes().last().map(|axis| (axis.name.as_str(), axis.nominal)),
            Some(("ramp", Some(0.0)))
        );
    }
}
