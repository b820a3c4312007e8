//! The proposal distribution for sequences of disturbances: a mixture of policies and the
//! distribution itself.

use mishandle_random::{Seed, Sequence};

use crate::features::{Layout, choice_of, packed};
use crate::gaussian::Gaussian;
use crate::policy::{Policy, Sums};
use crate::proposal::{NOMINAL, centers, effective_size, log_sum};
use crate::scenarios::normals;
use crate::{Draw, Scenarios};

/// Largest number of components.
const MOST_COMPONENTS: usize = 4;

/// Smallest share of a component, so that no failure mode is forgotten.
const SMALLEST_SHARE: f64 = 0.05;

/// Steps of expectation maximization.
const STEPS: usize = 8;

/// Fewest equally weighted simulations that a component is fitted to.
const FEWEST: f64 = 4.0;

/// A simulation that a proposal is fitted to.
#[derive(Clone, Debug)]
pub(crate) struct Sample {
    /// Latent numbers of the axes that are not steered.
    pub others: Vec<f64>,
    /// Sums of [`Layout`] without the latent numbers.
    pub sums: Vec<f64>,
    /// The same at the last step that decided the robustness.
    pub decided: Vec<f64>,
    pub robustness: f64,
}

#[derive(Clone, Debug)]
struct Component {
    share: f64,
    others: Gaussian,
    /// One for each channel.
    policies: Vec<Policy>,
}

/// A defensive mixture over whole simulations: with probability 0.1, all disturbances are those of
/// the distribution itself, otherwise the policies of one component draw them, each from what it
/// sees in its control step. A simulation has one component from its first step to its last.
///
/// The weight of a simulation, the density of the distribution divided by that of the mixture, is
/// therefore at most 10, whatever the policies.
#[derive(Clone, Debug, Default)]
pub(crate) struct SequenceProposal {
    components: Vec<Component>,
}

impl SequenceProposal {
    /// Fits a mixture to weighted simulations, up to the steps that decided their robustness.
    /// Returns `None` if they are too few.
    pub(crate) fn fit(layout: &Layout, samples: &[(&Sample, f64)]) -> Option<SequenceProposal> {
        let signatures: Vec<Vec<f64>> = samples.iter().map(|(sample, _)| signature(layout, sample)).collect();
        let weights: Vec<f64> = samples.iter().map(|(_, weight)| *weight).collect();
        let mut responsibilities = modes(&signatures, &weights);
        let mut proposal = SequenceProposal::maximize(layout, samples, &responsibilities)?;
        for _ in 0..if proposal.components.len() == 1 { 0 } else { STEPS } {
            let parts = |(sample, _): &(&Sample, f64)| {
                normalized(proposal.log_terms(layout, &sample.others, &sample.decided))
            };
            responsibilities = samples.iter().map(parts).collect();
            proposal = SequenceProposal::maximize(layout, samples, &responsibilities)?;
        }
        Some(proposal)
    }

    /// Fits each component to its part of the simulations.
    fn maximize(
        layout: &Layout,
        samples: &[(&Sample, f64)],
        responsibilities: &[Vec<f64>],
    ) -> Option<SequenceProposal> {
        let k = responsibilities.first()?.len();
        let total: f64 = samples.iter().map(|(_, weight)| weight).sum();
        let mut components = Vec::with_capacity(k);
        for index in 0..k {
            let weights: Vec<f64> =
                samples.iter().zip(responsibilities).map(|((_, weight), row)| weight * row[index]).collect();
            let effective = effective_size(weights.iter().copied());
            if effective < FEWEST {
                continue;
            }
            let sum: f64 = weights.iter().sum();
            let others = Gaussian::fit(
                samples.iter().zip(&weights).map(|((sample, _), weight)| (sample.others.as_slice(), *weight)),
            )?;
            let scaled: Vec<(&Sample, f64)> = samples
                .iter()
                .zip(&weights)
                .filter(|(_, weight)| **weight > 0.0)
                .map(|((sample, _), weight)| (*sample, weight * effective / sum))
                .collect();
            let policies = policies(layout, &scaled, effective);
            components.push(Component { share: (sum / total).max(SMALLEST_SHARE), others, policies });
        }
        let sum: f64 = components.iter().map(|component: &Component| component.share).sum();
        components.iter_mut().for_each(|component| component.share /= sum);
        (!components.is_empty()).then_some(SequenceProposal { components })
    }

    /// Returns for each component the logarithm of its share times its density, divided by that of
    /// the distribution.
    fn log_terms(&self, layout: &Layout, others: &[f64], sums: &[f64]) -> Vec<f64> {
        let term = |component: &Component| {
            let of_channel = |(channel, policy): (usize, &Policy)| {
                let (n, products) = layout.of_group(sums, layout.groups()[channel]);
                let (moments, squares) = layout.of_channel(sums, channel);
                policy.log_ratio(n, products, moments, squares)
            };
            let steps: f64 = component.policies.iter().enumerate().map(of_channel).sum();
            component.share.ln() + component.others.log_ratio(others) + steps
        };
        self.components.iter().map(term).collect()
    }

    /// Returns the density of a simulation divided by that of the distribution.
    pub(crate) fn ratio(&self, layout: &Layout, sample: &Sample) -> f64 {
        if self.components.is_empty() {
            1.0
        } else {
            NOMINAL + (1.0 - NOMINAL) * log_sum(&self.log_terms(layout, &sample.others, &sample.sums)).exp()
        }
    }

    /// Returns the number of the component that has most probably drawn a simulation.
    pub(crate) fn likeliest(&self, layout: &Layout, sample: &Sample) -> usize {
        let terms = self.log_terms(layout, &sample.others, &sample.decided);
        (0..terms.len()).max_by(|a, b| terms[*a].total_cmp(&terms[*b])).unwrap_or(0)
    }

    /// Returns the number of components.
    pub(crate) fn components(&self) -> usize {
        self.components.len()
    }

    /// Returns the component of the simulation with a seed; `None` for the distribution itself.
    fn component(&self, seed: Seed) -> Option<&Component> {
        let mut left = (choice_of(seed) - NOMINAL) / (1.0 - NOMINAL);
        if left < 0.0 {
            return None;
        }
        for component in &self.components {
            if left < component.share {
                return Some(component);
            }
            left -= component.share;
        }
        self.components.last()
    }

    /// Draws a seed and the latent numbers of the axes that are not steered. The others are those
    /// of axes that do not begin before the simulation ends.
    pub(crate) fn draw(&self, layout: &Layout, scenarios: &Scenarios, random: &mut Sequence) -> Draw {
        let mut draw = Draw { latent: normals(scenarios.dimension(), random), seed: Seed(random.bits()) };
        if let Some(component) = self.component(draw.seed) {
            let others = component.others.draw(random);
            layout.others.iter().zip(others).for_each(|(index, z)| draw.latent[*index] = z);
        }
        draw
    }

    /// Returns the latent number of a channel in a control step with these features, from a
    /// standard normal number.
    pub(crate) fn chosen(&self, seed: Seed, channel: usize, features: &[f64], noise: f64) -> f64 {
        match self.component(seed) {
            Some(component) => component.policies[channel].draw(features, noise),
            None => noise,
        }
    }
}

/// Returns the direction of the disturbances of a simulation: for each channel the sums of its
/// latent numbers and of those times time, divided by their standard deviation.
fn signature(layout: &Layout, sample: &Sample) -> Vec<f64> {
    let of_channel = |channel: usize| {
        let (n, _) = layout.of_group(&sample.decided, layout.groups()[channel]);
        let (moments, _) = layout.of_channel(&sample.decided, channel);
        let scale = n.max(1.0).sqrt();
        [moments[0] / scale, moments[1] / scale * 3.0_f64.sqrt()]
    };
    (0..layout.groups().len()).flat_map(of_channel).chain(sample.others.iter().copied()).collect()
}

/// Separates weighted points into modes: normal distributions with unit covariance, which is that
/// of a signature under the distribution itself. Their number is the one with the lowest Bayesian
/// information criterion. Returns for each point the probabilities of the modes.
fn modes(points: &[Vec<f64>], weights: &[f64]) -> Vec<Vec<f64>> {
    let views: Vec<&[f64]> = points.iter().map(Vec::as_slice).collect();
    let dimension = points.first().map_or(0, Vec::len);
    let total: f64 = weights.iter().sum();
    let effective = effective_size(weights.iter().copied());
    let mut best = (f64::INFINITY, vec![vec![1.0]; points.len()]);
    for k in 1..=MOST_COMPONENTS.min(points.len()) {
        let mut means: Vec<Vec<f64>> =
            centers(&views, k).into_iter().map(|index| points[index].clone()).collect();
        let mut shares = vec![1.0 / k as f64; k];
        let mut parts = Vec::new();
        let mut likelihood = 0.0;
        for _ in 0..STEPS {
            let terms = |point: &Vec<f64>| -> Vec<f64> {
                let squared =
                    |mean: &Vec<f64>| point.iter().zip(mean).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                means.iter().zip(&shares).map(|(mean, share)| share.ln() - 0.5 * squared(mean)).collect()
            };
            let all: Vec<Vec<f64>> = points.iter().map(terms).collect();
            likelihood = all.iter().zip(weights).map(|(terms, weight)| weight / total * log_sum(terms)).sum();
            parts = all.into_iter().map(normalized).collect::<Vec<Vec<f64>>>();
            for (index, (mean, share)) in means.iter_mut().zip(&mut shares).enumerate() {
                let own: f64 = parts.iter().zip(weights).map(|(part, weight)| part[index] * weight).sum();
                *share = (own / total).max(1e-9);
                if own > 0.0 {
                    for (i, mean) in mean.iter_mut().enumerate() {
                        let sum = points.iter().zip(&parts).zip(weights);
                        *mean =
                            sum.map(|((point, part), weight)| part[index] * weight * point[i]).sum::<f64>()
                                / own;
                    }
                }
            }
        }
        let parameters = (k * (dimension + 1)) as f64 - 1.0;
        let criterion = parameters * effective.max(1.0).ln() - 2.0 * effective * likelihood;
        if criterion < best.0 {
            best = (criterion, parts);
        }
    }
    best.1
}

/// Returns the probabilities of components from the logarithms of their terms.
fn normalized(terms: Vec<f64>) -> Vec<f64> {
    let sum = log_sum(&terms);
    terms.into_iter().map(|term| (term - sum).exp()).collect()
}

/// Fits the policy of each channel to simulations whose weights add up to `effective`.
fn policies(layout: &Layout, samples: &[(&Sample, f64)], effective: f64) -> Vec<Policy> {
    let size = layout.features();
    let groups: Vec<(f64, Vec<f64>)> = (0..layout.group_count())
        .map(|group| {
            let mut sums = (0.0, vec![0.0; packed(size)]);
            for (sample, weight) in samples {
                let (n, products) = layout.of_group(&sample.decided, group);
                sums.0 += weight * n;
                sums.1.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
            }
            sums
        })
        .collect();
    let policy = |channel: usize| {
        let (n, products) = groups[layout.groups()[channel]].clone();
        let mut sums = Sums { n, products, moments: vec![0.0; size], squares: 0.0 };
        for (sample, weight) in samples {
            let (moments, squares) = layout.of_channel(&sample.decided, channel);
            sums.moments.iter_mut().zip(moments).for_each(|(sum, moment)| *sum += weight * moment);
            sums.squares += weight * squares;
        }
        Policy::fit(&sums, effective)
    };
    (0..layout.groups().len()).map(policy).collect()
}
