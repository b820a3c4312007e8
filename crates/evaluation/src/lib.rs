//! Success rate, dangerous behavior rate and task completion time, with intervals.
