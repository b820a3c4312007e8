//! Commands about a policy that sees.

use crate::bench::Bench;
use crate::graph::{Of, bytes, integer, node, node_with, value, weights};

/// Writes a policy of point-reaching that sees 16 x 12 pixels, moves with their mean red, and never
/// reaches the point.
fn write_policy(bench: &Bench) {
    let parts = [
        value(11, "i", &[1, 3, 12, 16]),
        node("GlobalAveragePool", &["i"], &["p"]),
        node("Flatten", &["p"], &["f"]),
        weights("w", &[3, 9], &[[0.1; 9], [0.0; 9], [0.0; 9]].concat()),
        node_with("Gemm", &["f", "w"], &["a"], &[("transB", Of::Number(0))]),
        value(12, "a", &[1, 9]),
    ];
    let model = [integer(1, 8), bytes(7, &parts.concat()), bytes(8, &integer(2, 13))].concat();
    std::fs::write(bench.path("seeing.onnx"), model).unwrap();
    bench.write("seeing.onnx.json", r#"{"task": "point-reaching", "images": [["i", "over"]]}"#);
}

#[test]
fn the_page_of_a_failure_shows_what_the_policy_saw_beside_the_nominal_images() {
    let bench = Bench::new();
    write_policy(&bench);
    let falsify =
        "falsify point-reaching --controller seeing.onnx --trials 1 --budget 3 -k falsify.isolate=false";
    let pages = [("starts+light-3", 2), ("starts", 0)].map(|(space, rows)| {
        bench.check(&format!("{falsify} --space {space} --out {space}.sqlite"), 1);
        bench.check(&format!("report {space}.sqlite -k report.probes=0 --out {space}.html"), 0);
        let page = std::fs::read_to_string(bench.path(&format!("{space}.html"))).unwrap();
        let count = |alt: &str| page.matches(&format!("height=\"120\" alt=\"{alt}")).count();
        let seen = count("What the policy saw through over at ");
        assert!(seen >= 3, "{space}: {seen}");
        let nominal = count("The same at nominal, ") + count("The difference, ");
        assert_eq!(nominal, rows * seen, "{space}");
        assert_eq!(count("How much covered patches of over change the action, occlusion at "), 1);
        assert!(page.contains("(8 x 8 patches)"), "{space}");
        page
    });
    assert!(pages[0].contains("all other axes at nominal, which violates the formula"));
    // A controller that sees nothing has no images.
    bench.check("falsify point-reaching --controller expert --formula 'always(finger_target_distance >= 1)' --trials 1 --budget 1 -k falsify.isolate=false --out expert.sqlite", 1);
    bench.check("report expert.sqlite -k report.probes=0 --out expert.html", 0);
    let page = std::fs::read_to_string(bench.path("expert.html")).unwrap();
    assert!(page.contains("class=\"strip\"") && !page.contains("the policy saw"));
}

/// A failure that image noise makes random is repeated with other seeds.
#[test]
fn noise_of_images_is_noise_to_a_policy_that_sees_and_to_no_other() {
    let bench = Bench::new();
    write_policy(&bench);
    let simulate = |controller: &str, noise: &str| {
        let at = format!(
            "--space starts+image-2 --at corruption=gaussian-noise,corruption_severity={noise} --repeat 3 \
             -k simulate.scenarios=0 --json"
        );
        bench.json(
            &format!("simulate point-reaching --controller {controller} {at}"),
            i32::from(controller != "expert"),
        )
    };
    let simulations = |found: &serde_json::Value| found["repeats"]["simulations"].as_u64().unwrap_or(1);
    for (controller, noise, expected) in
        [("seeing.onnx", "2", 3), ("seeing.onnx", "0", 1), ("expert", "2", 1)]
    {
        let found = simulate(controller, noise);
        assert_eq!(simulations(&found), expected, "{controller} {noise}: {found}");
    }
}
