//! Pages about margins, metamorphic relations and failure probabilities.

use std::ops::ControlFlow;

use mishandle::plan::{MarginPlan, MetamorphicPlan, RelationPlan, RiskPlan};
use mishandle::results::Answer;
use mishandle::run::{Engine, ask, create_run};
use mishandle::store::RunFile;
use mishandle::{Plan, ResolvedPlan};
use mishandle_report::{RunReport, page};

/// Asks the question of a plan, for at most `calls` calls of its progress. Returns the answer and
/// its page.
fn asked(plan: &Plan, calls: u64) -> (Answer, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.sqlite");
    let resolved = ResolvedPlan::new(plan).unwrap();
    let run = create_run(&resolved, Some(&path)).unwrap();
    let mut left = calls;
    let answer = ask(&resolved, run, Engine::Direct, &mut |_| {
        left = left.saturating_sub(1);
        if left > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    let answer = answer.unwrap();
    let run = RunFile::open(&path).unwrap();
    let report = RunReport::load(&run, "runs/run.sqlite", None, crate::data).unwrap();
    (answer, page(&[report]))
}

#[track_caller]
fn check_parts(html: &str, parts: &[&str]) {
    for part in parts {
        assert!(html.contains(part), "{part} is not in\n{html}");
    }
}

fn car(margin: Option<MarginPlan>, risk: Option<RiskPlan>) -> Plan {
    Plan { margin, risk, space: "dynamics+events".to_string(), ..Plan::new("toy/car-following", "") }
}

#[test]
fn the_page_of_a_margin_has_the_amplitudes_and_the_witness() {
    let plan = car(Some(MarginPlan { budget: 300, ..MarginPlan::default() }), None);
    let (answer, html) = asked(&plan, u64::MAX);
    let Answer::Margin(found) = answer else { panic!("{answer:?}") };
    let witness = found.witness.unwrap();
    check_parts(
        &html,
        &[
            "of its range makes toy/car-following violate its requirement",
            "smallest amplitude with a violation",
            &format!("simulation {}, seed {}.</p>", witness.simulation, witness.seed.0),
            &format!("trial: 1, simulation: {}", witness.simulation),
            "The dashed line is at the smallest amplitude with a violation.",
            "Scenario of the witness",
        ],
    );
    let rows = html.split("Amplitudes in the order").nth(2).unwrap().split("</table>").next().unwrap();
    assert_eq!(rows.matches("<tr><td>").count(), found.levels.len(), "{rows}");
    assert!(!html.contains("trials falsified"), "a margin has no trials");
}

/// Points of a square that move by 0.1 m, and stay where they are.
fn moved_points() -> Plan {
    let relation = |change: &str| {
        let change = [("x".to_string(), change.to_string())].into();
        RelationPlan { change, ..RelationPlan::default() }
    };
    let relations = [("moved".to_string(), relation("+0.1")), ("same".to_string(), relation("*1"))].into();
    let metamorphic = Some(MetamorphicPlan { pairs: 400, relations, ..MetamorphicPlan::default() });
    Plan { metamorphic, ..Plan::new("toy/sphere-2d", "") }
}

#[test]
fn the_page_of_relations_has_the_broken_pairs_and_a_chart_of_each_relation() {
    let (answer, html) = asked(&moved_points(), u64::MAX);
    let Answer::Metamorphic(found) = answer else { panic!("{answer:?}") };
    let moved = &found.relations[0];
    let worst = &moved.worst[0];
    check_parts(
        &html,
        &[
            "toy/sphere-2d breaks the relation moved.",
            "Pairs that break moved",
            "Robustness of the pairs of same",
            &format!("moved: {} follow-up cases out of bounds", moved.out_of_bounds),
            &format!("trial: 1, simulation: {}", worst.pair),
            &format!("trial: 2, simulation: {}", worst.pair),
            "of the change is enough: x by",
        ],
    );
    assert!(!html.contains("Pairs that break same") && !html.contains("trials falsified"));
    let rows = html.split("Broken pairs, the largest").nth(2).unwrap().split("</table>").next().unwrap();
    assert_eq!(rows.matches("<tr><td>").count() as u64, moved.broken.min(20), "{rows}");
}

#[test]
fn the_page_of_a_probability_has_the_interval_and_what_it_assumes() {
    let risk = RiskPlan { simulations: 3000, ..RiskPlan::default() };
    let (answer, html) = asked(&Plan { risk: Some(risk), ..Plan::new("toy/hidden-corner", "") }, u64::MAX);
    let Answer::Risk(found) = answer else { panic!("{answer:?}") };
    let assumption = found.probability.as_ref().and_then(|answer| answer.assumption.clone());
    check_parts(&html, &["Parts of the estimation", "Axes that are drawn at random", "95 % interval"]);
    match assumption {
        Some(assumption) => check_parts(
            &html,
            &[
                "probability of at most",
                "which assumes nothing.",
                &format!("<strong>If {assumption}</strong>"),
            ],
        ),
        None => check_parts(&html, &["assumes nothing"]),
    }
    assert!(!html.contains("trials falsified"), "a probability has no trials");
}

#[test]
fn an_interrupted_run_has_a_page_that_says_so() {
    for plan in [
        car(Some(MarginPlan { budget: 300, ..MarginPlan::default() }), None),
        car(None, Some(RiskPlan { simulations: 3000, ..RiskPlan::default() })),
        moved_points(),
    ] {
        let (_, html) = asked(&plan, 2);
        check_parts(&html, &["<strong>The run is not finished"]);
    }
}
