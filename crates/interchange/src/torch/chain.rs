//! Tensors in the order of a module as a chain of linear layers.

use super::tensor::NamedTensor;

/// The tensors of a layer: weight and bias.
pub(super) type Pair<'t> = (&'t NamedTensor, &'t NamedTensor);

/// Linear layers, with a layer normalization after each hidden one, or with none.
pub(super) struct Chain<'t> {
    pub linear: Vec<Pair<'t>>,
    pub norms: Vec<Pair<'t>>,
}

/// A module with weights, by the place that its name states.
struct Place<'t> {
    /// The name of the module around it, such as `net.` of `net.2`.
    parent: &'t str,
    /// Its number in a `Sequential`; `None` if its name ends with a word.
    index: Option<usize>,
    is_norm: bool,
}

impl<'t> Chain<'t> {
    /// Reads the chain. The error says which part is something else.
    ///
    /// The numbers in the names of a `Sequential` also count the modules without weights. Exactly
    /// one of them stands between two layers: the activation.
    pub(super) fn new(tensors: &[&'t NamedTensor]) -> Result<Chain<'t>, String> {
        let mut chain = Chain { linear: Vec::new(), norms: Vec::new() };
        let mut places: Vec<(&str, Place<'_>)> = Vec::new();
        for pair in tensors.chunks(2) {
            let (layer, is_norm) = chain.push(pair).ok_or("its layers do not form a chain")?;
            places.push((layer, Place::new(layer, is_norm)));
        }
        let Chain { linear, norms } = &chain;
        if linear.is_empty() || !(norms.is_empty() || norms.len() + 1 == linear.len()) {
            return Err("its layers do not form a chain".to_string());
        }
        for (index, (name, place)) in places.iter().enumerate() {
            let before = index.checked_sub(1).map(|before| &places[before]);
            match before.filter(|(_, before)| before.parent == place.parent) {
                Some((before_name, before)) => place
                    .check_after(before)
                    .map_err(|problem| format!("{problem} its layers `{before_name}` and `{name}`"))?,
                None if place.index.is_some_and(|index| index > 0) => {
                    return Err(format!("a module without weights stands before its layer `{name}`"));
                }
                None => {}
            }
        }
        Ok(chain)
    }

    /// Adds a layer; returns its name and whether it is a normalization. `None` if it does not fit.
    fn push(&mut self, pair: &[&'t NamedTensor]) -> Option<(&'t str, bool)> {
        let &[weight, bias] = pair else { return None };
        let layer = weight.name.strip_suffix("weight")?;
        if bias.name.strip_suffix("bias") != Some(layer) {
            return None;
        }
        let Chain { linear, norms } = self;
        let is_norm = match weight.shape[..] {
            [outputs, inputs] if bias.shape == [outputs] => {
                if linear.last().is_some_and(|(before, _)| before.shape[0] != inputs) {
                    return None;
                }
                linear.push((weight, bias));
                false
            }
            [size] if bias.shape == [size] && linear.len() == norms.len() + 1 => {
                norms.push((weight, bias));
                true
            }
            _ => return None,
        };
        Some((layer.trim_end_matches('.'), is_norm))
    }
}

impl Place<'_> {
    fn new(layer: &str, is_norm: bool) -> Place<'_> {
        let (parent, last) = layer.rfind('.').map_or(("", layer), |dot| layer.split_at(dot + 1));
        match last.parse() {
            Ok(index) => Place { parent, index: Some(index), is_norm },
            Err(_) => Place { parent: layer, index: None, is_norm },
        }
    }

    /// Checks the number of modules between the module `before` and this one.
    fn check_after(&self, before: &Place<'_>) -> Result<(), &'static str> {
        let (Some(from), Some(to)) = (before.index, self.index) else { return Ok(()) };
        match (self.is_norm, to.checked_sub(from)) {
            (true, Some(1)) | (false, Some(2)) => Ok(()),
            (true, _) => Err("an activation or another module stands between"),
            (false, Some(1)) => Err("no activation stands between"),
            (false, None | Some(0)) => Err("the numbers decrease between"),
            (false, _) => {
                Err("several modules without weights, such as a Dropout or a normalization, stand between")
            }
        }
    }
}
