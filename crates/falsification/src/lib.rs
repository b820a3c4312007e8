//! Trials and campaigns: searches that try to push a robustness below zero.
