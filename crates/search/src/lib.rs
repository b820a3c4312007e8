//! Searches that propose points of [0,1]^d and are told their value.
