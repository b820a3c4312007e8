//! Jobs side by side, each on one thread.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use rayon::ThreadPoolBuilder;

use crate::zoo::ZooError;

/// How many jobs are done, and how many failed. Interrupted jobs are neither.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JobOutcome {
    /// Jobs that are done.
    pub done: usize,
    /// Jobs that failed.
    pub failed: usize,
}

/// Runs the jobs in their order, `workers` at a time, until `stop`. A failure does not end the
/// other jobs. `ended` receives the result of each job that was not interrupted.
///
/// Each worker has a rayon pool of one thread, so that a job takes one core and its result does not
/// depend on the others.
pub(crate) fn run_side_by_side<J: Sync>(
    jobs: &[J],
    workers: usize,
    stop: &(dyn Fn() -> bool + Sync),
    work: impl Fn(&J) -> Result<(), ZooError> + Sync,
    ended: impl Fn(&J, &Result<(), ZooError>) + Sync,
) -> Result<JobOutcome, ZooError> {
    let [next, done, failed] = [const { AtomicUsize::new(0) }; 3];
    let pools = (0..workers.clamp(1, jobs.len().max(1)))
        .map(|_| ThreadPoolBuilder::new().num_threads(1).build().map_err(ZooError::Threads))
        .collect::<Result<Vec<_>, _>>()?;
    let take_jobs = || {
        while !stop() {
            let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            let result = work(job);
            let counter = match &result {
                Ok(()) => &done,
                Err(ZooError::Interrupted) => continue,
                Err(_) => &failed,
            };
            counter.fetch_add(1, Ordering::Relaxed);
            ended(job, &result);
        }
    };
    thread::scope(|scope| {
        for pool in &pools {
            scope.spawn(|| pool.install(take_jobs));
        }
    });
    Ok(JobOutcome { done: done.into_inner(), failed: failed.into_inner() })
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::AtomicBool;

    use super::*;

    #[test]
    fn a_failure_does_not_end_the_other_jobs_and_a_stop_ends_all() {
        let reported = Mutex::new(Vec::new());
        let stop = AtomicBool::new(false);
        let work = |job: &u32| match job {
            2 => Err(ZooError::Busy),
            5 => {
                stop.store(true, Ordering::Relaxed);
                Err(ZooError::Interrupted)
            }
            _ => Ok(()),
        };
        let ended = |job: &u32, result: &Result<(), _>| reported.lock().unwrap().push((*job, result.is_ok()));
        let is_stopped = || stop.load(Ordering::Relaxed);
        let outcome = run_side_by_side(&[1, 2, 3, 4, 5, 6, 7], 1, &is_stopped, work, ended).unwrap();
        assert_eq!(outcome, JobOutcome { done: 3, failed: 1 });
        assert_eq!(*reported.lock().unwrap(), [(1, true), (2, false), (3, true), (4, true)]);
    }

    #[test]
    fn jobs_run_at_the_same_time_on_one_thread_each() {
        let running = AtomicUsize::new(0);
        let work = |_: &u32| {
            assert_eq!(rayon::current_num_threads(), 1);
            running.fetch_add(1, Ordering::SeqCst);
            // Each job waits for the other, which a single worker would never start.
            while running.load(Ordering::SeqCst) < 2 {
                thread::yield_now();
            }
            Ok(())
        };
        let outcome = run_side_by_side(&[1, 2], 2, &|| false, work, |_, _| {}).unwrap();
        assert_eq!(outcome, JobOutcome { done: 2, failed: 0 });
    }
}
