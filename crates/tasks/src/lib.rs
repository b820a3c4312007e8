//! The manipulation tasks, one folder each, with their experts.
