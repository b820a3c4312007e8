//! MuJoCo behind a small safe interface: a shared model, one state per thread.
