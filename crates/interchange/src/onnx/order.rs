//! The order in which a model's values are computed.
//!
//! The runtime plans the operators of an output by recursion along its inputs, which would overflow
//! the stack of a thread for a long chain. It stops at values that earlier outputs need, so that
//! values at regular depths, requested in their order, keep the recursion short.

use std::collections::{HashMap, HashSet};

use rten_onnx::onnx::GraphProto;

/// Largest number of operators from one asked value to the next.
///
/// A level of the recursion takes 0.3 KB of a stack with at least 1 MB.
const MAX_DEPTH: usize = 500;

/// Returns `outputs` and the values between them that keep the plan of the runtime short, each
/// once. The operators of the graph are in the order of their inputs.
pub(super) fn asked_values(graph: &GraphProto, outputs: &[&str]) -> Vec<String> {
    // What the outputs need: other values would be computed in vain.
    let mut needed: HashSet<&str> = outputs.iter().copied().collect();
    for node in graph.node.iter().rev() {
        if node.output.iter().any(|name| needed.contains(name.as_str())) {
            needed.extend(node.input.iter().map(String::as_str));
        }
    }
    let written: HashSet<&str> =
        graph.node.iter().flat_map(|node| &node.output).map(String::as_str).collect();
    let mut asked: Vec<String> = Vec::new();
    let mut ask = |name: &str| {
        if !asked.iter().any(|known| known == name) {
            asked.push(name.to_string());
        }
    };
    outputs.iter().filter(|name| !written.contains(*name)).for_each(|name| ask(name));
    let mut depths: HashMap<&str, usize> = HashMap::new();
    for node in &graph.node {
        let Some(first) = node.output.iter().find(|name| needed.contains(name.as_str())) else {
            continue;
        };
        let depth = |name: &String| depths.get(name.as_str()).copied().unwrap_or(0);
        let depth = 1 + node.input.iter().map(depth).max().unwrap_or(0);
        let own = outputs.iter().filter(|name| node.output.iter().any(|output| output == *name));
        let own: Vec<&str> = own.copied().collect();
        own.iter().for_each(|name| ask(name));
        if own.is_empty() && depth == MAX_DEPTH {
            ask(first);
        }
        let depth = if own.is_empty() && depth < MAX_DEPTH { depth } else { 0 };
        depths.extend(node.output.iter().map(|name| (name.as_str(), depth)));
    }
    asked
}
