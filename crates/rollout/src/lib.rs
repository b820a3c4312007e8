//! Environment, controller, initial box, noise and the episode they make together.
