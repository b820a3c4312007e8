//! Simulations of a scenario, as text; why simulations have no verdict; traces.

use std::path::Path;

use anyhow::Result;
use mishandle::results::{BoxPoint, Noise, Repeats, Simulation};
use mishandle::stl::Trace;
use mishandle::store::{self, RunHeader, StoredTrace, TraceColumn};
use mishandle_text::{decimal, plural};

use super::{escape, explanation, output, requirements, scenario, subject};

/// Describes a recorded simulation by its numbers: `trial 2 (corner), simulation 5`.
pub fn name(trial: u32, point: Option<BoxPoint>, simulation: u32) -> String {
    let point = point.map_or(String::new(), |point| format!(" ({point})"));
    format!("trial {trial}{point}, simulation {simulation}")
}

/// Returns the simulations of a scenario: one with its explanation, or how often repeats fail.
pub fn text(found: &Simulation) -> String {
    let heading = subject::heading(&found.subject);
    match (&found.explanation, &found.repeats) {
        (Some(explanation), _) => {
            let requirements = requirements::verdicts_text(found.requirements.as_deref());
            format!("{heading}\n{}{requirements}", explanation::text(explanation))
        }
        (None, Some(repeats)) => format!("{heading}\n{}", repeated_text(found, repeats)),
        (None, None) => heading,
    }
}

fn repeated_text(found: &Simulation, repeats: &Repeats) -> String {
    let mut text = format!(
        "{}\nformula {}\n\n{}",
        scenario::text(found.subject.space_axes.iter().zip(found.scenario.values().copied())),
        escape::name(&found.formula),
        mishandle::run::failure_text(repeats),
    );
    if let Some(quantiles) = &repeats.quantiles {
        let mut rows = vec![vec!["robustness".to_string()]];
        rows[0].extend(["minimum", "5 %", "median", "95 %", "maximum"].map(String::from));
        rows.push(vec![String::new()]);
        rows[1].extend(quantiles.iter().map(|quantile| decimal(quantile.robustness.0, 4)));
        text.push_str(&format!("\n\n{}", output::table(&rows)));
    }
    if repeats.without_verdict > 0 {
        text.push_str(&format!("\n\n{} without a verdict", plural(repeats.without_verdict, "simulation")));
    }
    text + &found.noise.as_ref().map_or(String::new(), noise_text)
}

fn noise_text(noise: &Noise) -> String {
    let Noise { scenario_share, scenario_share_interval, scenarios, repeats } = *noise;
    let of = format!("{}, {} each", plural(scenarios, "random scenario"), plural(repeats, "simulation"));
    match scenario_share {
        Some(share) => format!(
            "\n\nvariance of the robustness: {:.0} % from the scenario{}, {:.0} % from noise ({of}); a region that none of them \
             met is in neither share",
            100.0 * share,
            scenario_share_interval.map_or(String::new(), |[low, high]| format!(
                " [{:.0}, {:.0}]",
                100.0 * low,
                100.0 * high
            )),
            100.0 * (1.0 - share)
        ),
        None => format!("\n\nthe robustness of {of} has no variance to split: it is constant or infinite"),
    }
}

/// Returns a paragraph about the screened simulations without a verdict; empty if all have one.
pub fn without_gpu_verdict(simulations: u64, overflows: u64) -> String {
    if simulations == 0 {
        return String::new();
    }
    let simulations = plural(simulations, "simulation");
    format!(
        "\n\n{simulations} without a verdict on the GPU, {overflows} of them for lack of memory for contacts or constraints"
    )
}

/// Writes a trace as CSV, with `more` columns after the signals.
pub fn write_trace(path: &Path, header: &RunHeader, trace: &Trace, more: &[TraceColumn]) -> Result<()> {
    let columns = (0..trace.names().len()).map(|i| trace.column(i).to_vec()).collect();
    let stored = StoredTrace { columns };
    output::write_new(path, |out| Ok(store::export_trace_csv(header, &stored, more, out)?))?;
    output::message(&format!("wrote the trace to {}", path.display()));
    Ok(())
}
