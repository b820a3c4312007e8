//! Runs: questions that simulations answer.
//!
//! [`evaluate`](evaluate()) and [`falsify`](falsify()) write every simulation to a run file as soon as it ends, and continue a run
//! that was interrupted. [`risk`](risk()) and [`margin`](margin()) estimate and search without a run file. The `*_on_backend`
//! functions screen thousands of scenarios on another physics engine; MuJoCo C gives every verdict.

mod campaign;
mod completion;
pub(crate) mod evaluate;
pub(crate) mod falsify;
pub(crate) mod header;
mod margin;
mod minimize;
pub(crate) mod record;
mod risk;
pub(crate) mod screening;
mod simulate;
pub(crate) mod violation;

pub use campaign::{CampaignRun, campaign_runs, create_campaign, free_campaign_folder};
pub use completion::unfinished;
pub use evaluate::{
    EvaluationOutcome, evaluate, evaluation_request, evaluation_simulations, rejects_scenarios,
};
pub use falsify::{FalsifyProgress, failure_rate_bound, falsify, falsify_on_backend};
pub use margin::{Margin, Witness, check_margin, margin, witness_repeats};
pub use minimize::{Minimized, axes_off_nominal, is_close, minimize};
pub use record::{create_run, recorded_axis, recorded_episode};
pub use risk::{risk, risk_assumption, risk_refusals, risk_scenarios};
pub use screening::{
    ScreenedEvaluationOutcome, evaluate_on_backend, gpu_backend, install_gpu_backend, risk_on_backend,
    screening,
};
pub use simulate::{measure_noise, repeat, repeat_seeds};
