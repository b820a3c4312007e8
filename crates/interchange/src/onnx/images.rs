//! The images that a model gets: their inputs, sizes and types.

use std::collections::HashSet;

use mishandle_rollout::Image;
use rten::Value;
use rten_onnx::onnx::{DataType, Dimension, GraphProto, ModelProto, TensorShapeProto};
use rten_tensor::Tensor;

use super::names::Names;
use super::policy::shape_text;
use crate::OnnxProblem;

/// Smallest and largest side of an image, pixels.
const SIDES: std::ops::RangeInclusive<i64> = 4..=256;

/// Operators that move the numbers of their first input and change none.
const MOVES: [&str; 8] =
    ["Flatten", "Identity", "Reshape", "Slice", "Split", "Squeeze", "Transpose", "Unsqueeze"];

/// An input that gets an image.
#[derive(Debug)]
pub(super) struct ImageInput {
    /// Name of the input.
    pub name: String,
    pub image: Image,
    /// Number of the images, the oldest first; `None` for the present one alone.
    pub history: Option<usize>,
    shape: Vec<usize>,
    /// Whether the channels come before the rows.
    channels_first: bool,
    /// Whether the input gets bytes. Otherwise it gets fractions of 255.
    is_bytes: bool,
}

impl ImageInput {
    /// Returns the images of a model, and makes the shapes of their inputs fixed. The runtime gets
    /// bytes as integers of 32 bits.
    pub(super) fn prepare(proto: &mut ModelProto, names: &Names) -> Result<Vec<ImageInput>, OnnxProblem> {
        let Some(graph) = proto.graph.as_mut() else { return Ok(Vec::new()) };
        let images = names.images.iter().map(|(name, camera)| prepare(graph, name, camera, names.history));
        let images: Vec<ImageInput> = images.collect::<Result<_, _>>()?;
        let bytes = images.iter().filter(|input| input.is_bytes).map(|input| input.name.clone()).collect();
        check_bytes(graph, bytes)?;
        Ok(images)
    }

    /// Returns the value of the images, the oldest first: red, green and blue of each pixel, rows
    /// from the top.
    pub(super) fn value(&self, rgb: &[u8]) -> Option<Value> {
        if self.is_bytes {
            self.tensor(rgb, i32::from)
        } else {
            self.tensor(rgb, |byte| f32::from(byte) / 255.0)
        }
    }

    /// Returns the value of black images.
    pub(super) fn black(&self) -> Option<Value> {
        self.value(&vec![0; self.history.unwrap_or(1) * self.image.bytes()])
    }

    fn tensor<'a, T>(&self, rgb: &'a [u8], convert: impl Fn(u8) -> T) -> Option<Value>
    where
        Value: From<Tensor<T>>,
    {
        let numbers: Vec<T> = if self.channels_first {
            let channels =
                |image: &'a [u8]| (0..3).flat_map(move |channel| image.iter().skip(channel).step_by(3));
            rgb.chunks(self.image.bytes()).flat_map(channels).map(|x| convert(*x)).collect()
        } else {
            rgb.iter().map(|byte| convert(*byte)).collect()
        };
        Tensor::try_from_data(&self.shape[..], numbers).ok().map(Value::from)
    }
}

fn prepare(
    graph: &mut GraphProto,
    name: &str,
    camera: &str,
    history: Option<usize>,
) -> Result<ImageInput, OnnxProblem> {
    let invalid = |reason| OnnxProblem::Interface { place: "its images".to_string(), reason };
    let input = graph.input.iter_mut().find(|input| input.name.as_deref() == Some(name));
    let input = input.ok_or_else(|| invalid(format!("the model has no input `{name}`")))?;
    let tensor = input.r#type.get_or_insert_default().tensor_type.get_or_insert_default();
    let kind = tensor.elem_type.unwrap_or(DataType::FLOAT);
    if kind != DataType::FLOAT && kind != DataType::UINT8 {
        return Err(OnnxProblem::Unsupported {
            found: format!("the image `{name}` of the type {}", kind.name().unwrap_or("unknown")),
            hint: "an image has bytes (UINT8) from 0 to 255 or 32-bit floating-point numbers from 0 to 1"
                .to_string(),
        });
    }
    let dims: Vec<Option<i64>> =
        tensor.shape.iter().flat_map(|shape| &shape.dim).map(|dim| dim.dim_value).collect();
    let history = history
        .filter(|length| dims.len() == 5 && dims[1].is_none_or(|found| i64::try_from(*length) == Ok(found)));
    let mut single = dims.clone();
    if history.is_some() {
        single.remove(1);
    }
    // Only the batch size and the length of the history may be free.
    let found = match single[..] {
        [None | Some(1), Some(3), Some(height), Some(width)] | [Some(3), Some(height), Some(width)] => {
            Some((true, height, width))
        }
        [None | Some(1), Some(height), Some(width), Some(3)] | [Some(height), Some(width), Some(3)] => {
            Some((false, height, width))
        }
        _ => None,
    };
    let found = found.filter(|(_, height, width)| SIDES.contains(height) && SIDES.contains(width));
    let Some((channels_first, height, width)) = found else {
        return Err(invalid(format!(
            "the image `{name}` has the shape {}; expected [1, 3, height, width] or [1, height, width, 3] \
             with sides from {} to {} pixels, or with a history of k images [1, k, …]",
            shape_text(&dims),
            SIDES.start(),
            SIDES.end()
        )));
    };
    let mut fixed: Vec<i64> = single.iter().map(|dim| dim.unwrap_or(1)).collect();
    if let Some(length) = history {
        fixed.insert(1, length as i64);
    }
    let dim = |size: &i64| Dimension { dim_value: Some(*size), dim_param: None };
    tensor.shape = Some(TensorShapeProto { dim: fixed.iter().map(dim).collect() });
    tensor.elem_type = Some(if kind == DataType::UINT8 { DataType::INT32 } else { DataType::FLOAT });
    Ok(ImageInput {
        name: name.to_string(),
        image: Image { camera: camera.to_string(), width: width as usize, height: height as usize },
        history,
        shape: fixed.into_iter().map(|size| size as usize).collect(),
        channels_first,
        is_bytes: kind == DataType::UINT8,
    })
}

/// Checks that operators move bytes or convert them: arithmetic of bytes overflows, and that of
/// integers of 32 bits does not.
fn check_bytes(graph: &GraphProto, mut bytes: HashSet<String>) -> Result<(), OnnxProblem> {
    for node in &graph.node {
        let operator = node.op_type.as_deref().unwrap_or_default();
        let reads = |name: &String| bytes.contains(name);
        match node.input.iter().position(reads) {
            None => {}
            Some(0) if MOVES.contains(&operator) => bytes.extend(node.output.iter().cloned()),
            Some(0) if matches!(operator, "Cast" | "CastLike" | "Shape") => {}
            Some(_) => {
                return Err(OnnxProblem::Unsupported {
                    found: format!("the operator `{operator}` of the bytes of an image"),
                    hint: "convert the image first: `image.float() / 255`".to_string(),
                });
            }
        }
    }
    Ok(())
}
