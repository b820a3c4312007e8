//! Gaussian-process regression for searches: model, hyperparameters, candidates and acquisition.
//!
//! | module | subject |
//! |---|---|
//! | `kernel` | Matérn-5/2 correlations with one length per coordinate |
//! | `regression` | posterior, marginal likelihood and leave-one-out predictions for given hyperparameters |
//! | `fit` | hyperparameters of the largest marginal posterior density |
//! | `transform` | robustness to targets of the model: heavy tails, ties and infinite values |
//! | `space` | typed coordinates: levels, faces, features |
//! | `history` | evaluated points, and which of them the model uses |
//! | `surrogate` | the model of a search: when to refit, when to extend |
//! | `candidates` | where to look for the next points |
//! | `acquisition` | which candidates to evaluate next |
//! | `trust_region` | a box around the best point that grows with successes and shrinks with failures |
//! | `refine` | local minimization of the lower confidence bound |
//! | `pathwise` | samples of the posterior for Thompson sampling |

pub(crate) mod acquisition;
pub(crate) mod candidates;
pub(crate) mod elementary;
mod fit;
pub(crate) mod history;
mod kernel;
mod pathwise;
mod refine;
mod regression;
pub(crate) mod space;
pub(crate) mod surrogate;
#[cfg(test)]
mod tests;
pub(crate) mod transform;
mod triangular;
pub(crate) mod trust_region;
