//! Multi-layer perceptrons: forward, backward, tangents, Adam, running normalisers.
