//! One SQLite file a run, a row a simulation.
