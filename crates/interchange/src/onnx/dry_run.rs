//! Computes a model once, before it controls anything.

use std::collections::{HashMap, HashSet};

use rten::{Model, NodeId, RunOptions, Value, ValueOrView, ValueView};
use rten_onnx::onnx::GraphProto;
use rten_tensor::Layout;

use super::cost::{MAX_HELD, MAX_NUMBERS, MAX_PRODUCTS, bound, cost_of, determines_shape};
use super::meaning::Context;
use super::policy::{one_thread, without_panic};
use crate::OnnxProblem;

/// Computes all operators one by one on an observation of zeros, each only after a bound of its
/// memory and its time was checked.
///
/// As no shape depends on the numbers of an observation, the bounds hold for every observation. The
/// values `kept` are held until the end.
pub(super) fn dry_run(
    model: &Model,
    graph: &GraphProto,
    opset: i64,
    inputs: HashMap<String, Value>,
    kept: &[String],
) -> Result<HashMap<String, Value>, OnnxProblem> {
    let run_problem = |reason: String| OnnxProblem::Run { reason };
    let mut depends_on_input: HashSet<String> = inputs.keys().cloned().collect();
    let mut values = inputs;
    let options = one_thread();
    let constants = graph.initializer.iter().filter_map(|tensor| tensor.name.as_deref());
    let nodes = graph.node.iter().filter(|node| node.op_type.as_deref() == Some("Constant"));
    for name in constants.chain(nodes.flat_map(|node| node.output.iter().map(String::as_str))) {
        let found = run(model, vec![], &[name], &options).map_err(run_problem)?;
        values.extend(found.into_iter().map(|value| (name.to_string(), value)));
    }
    let mut last_readers: HashMap<&str, usize> = HashMap::new();
    for (index, node) in graph.node.iter().enumerate() {
        last_readers.extend(node.input.iter().map(|name| (name.as_str(), index)));
    }
    // The outputs are read after all operators.
    last_readers.extend(kept.iter().map(|name| (name.as_str(), usize::MAX)));
    let context = Context::new(graph, opset);
    let mut products = 0_usize;
    let mut held = 0_usize;
    for (index_of_node, node) in graph.node.iter().enumerate() {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let Some(cost) = cost_of(operator) else { continue };
        let label = |name: Option<&String>| format!("`{operator}` of `{}`", name.map_or("", String::as_str));
        let mut arguments = Vec::new();
        for (index, name) in node.input.iter().enumerate() {
            if name.is_empty() {
                arguments.push(None);
                continue;
            }
            let depends = depends_on_input.contains(name);
            if depends && determines_shape(operator, index) {
                return Err(OnnxProblem::Unsupported {
                    found: format!(
                        "the operator {}, whose shape depends on the observation",
                        label(node.output.first())
                    ),
                    hint: "export a policy whose shapes are constant".to_string(),
                });
            }
            let value = values.get(name).ok_or_else(|| OnnxProblem::Format {
                reason: format!("{} reads `{name}` before an operator writes it", label(node.output.first())),
            })?;
            arguments.push(Some(value));
        }
        if let Some((what, way_out)) = context.difference(node, &arguments) {
            return Err(OnnxProblem::Unsupported {
                found: format!("the operator {}, which {what}", label(node.output.first())),
                hint: way_out.to_string(),
            });
        }
        let too_large = || OnnxProblem::Size {
            reason: format!(
                "{} has inputs of other shapes, more than {MAX_NUMBERS} numbers, or the model needs more than {MAX_PRODUCTS} multiplications \
                 or {MAX_HELD} numbers at a time",
                label(node.output.first())
            ),
        };
        let (numbers, own) = bound(cost, &arguments, node).ok_or_else(too_large)?;
        products = products.saturating_add(own);
        if numbers > MAX_NUMBERS || products > MAX_PRODUCTS || held.saturating_add(numbers) > MAX_HELD {
            return Err(too_large());
        }
        let cuts_dependence = matches!(operator, "Shape" | "Size");
        let depends = !cuts_dependence && node.input.iter().any(|name| depends_on_input.contains(name));
        let known: HashSet<&str> =
            node.input.iter().filter(|name| !name.is_empty()).map(String::as_str).collect();
        let inputs = known.into_iter().filter_map(|name| Some((name, values.get(name)?))).collect();
        let outputs: Vec<&str> =
            node.output.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
        let found = run(model, inputs, &outputs, &options)
            .map_err(|reason| run_problem(format!("{}: {reason}", label(node.output.first()))))?;
        for (output, value) in outputs.into_iter().zip(found) {
            held += value.len();
            values.insert(output.to_string(), value);
            if depends {
                depends_on_input.insert(output.to_string());
            }
        }
        // As in a control step, a value is kept until the last operator has read it.
        for name in node.input.iter().chain(&node.output) {
            if last_readers.get(name.as_str()).is_none_or(|last| *last == index_of_node) {
                let removed = values.remove(name).map_or(0, |value| value.len());
                held = held.saturating_sub(removed);
            }
        }
    }
    Ok(values)
}

/// Computes values from others.
fn run(
    model: &Model,
    inputs: Vec<(&str, &Value)>,
    outputs: &[&str],
    options: &RunOptions,
) -> Result<Vec<Value>, String> {
    let text = |error: rten::RunError| error.to_string();
    let inputs: Vec<(NodeId, ValueOrView<'_>)> = inputs
        .into_iter()
        .map(|(name, value)| Ok((model.node_id(name)?, ValueView::from(value).into())))
        .collect::<Result<_, _>>()
        .map_err(text)?;
    let outputs: Vec<NodeId> =
        outputs.iter().map(|name| model.node_id(name)).collect::<Result<_, _>>().map_err(text)?;
    without_panic(|| model.run(inputs, &outputs, Some(options.clone())).map_err(text))
}
