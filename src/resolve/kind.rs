/// Kind of the targets that are written in Python.
pub(crate) const PYTHON: &str = "python";
