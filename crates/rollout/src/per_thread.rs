use std::sync::{Mutex, MutexGuard, PoisonError};

/// Values for each thread of the rayon pool, such as buffers and workers. They are made at their
/// first use and kept.
///
/// Each thread of the pool in which it was made has a place of its own, so that these threads do
/// not wait for each other.
#[derive(Debug)]
pub struct PerThread<T> {
    /// Values of each thread that are not in use.
    free: Vec<Mutex<Vec<T>>>,
}

impl<T> PerThread<T> {
    /// Makes a place for each thread of the current pool, without values.
    pub fn new() -> PerThread<T> {
        PerThread { free: (0..rayon::current_num_threads()).map(|_| Mutex::default()).collect() }
    }

    /// Calls `function` with a value of this thread. If none is free, `make` makes one.
    ///
    /// While `function` waits for another pool, as a policy with its own threads does, rayon may
    /// run it a second time on the same thread. Then it gets a second value. A panic of `function`
    /// drops its value.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn with<R, E>(
        &self,
        make: impl FnOnce() -> Result<T, E>,
        function: impl FnOnce(&mut T) -> R,
    ) -> Result<R, E> {
        // Threads of another pool share the places.
        let free = &self.free[rayon::current_thread_index().unwrap_or(0) % self.free.len()];
        let known = lock(free).pop();
        let mut value = match known {
            Some(value) => value,
            None => make()?,
        };
        let result = function(&mut value);
        lock(free).push(value);
        Ok(result)
    }
}

impl<T> Default for PerThread<T> {
    fn default() -> PerThread<T> {
        PerThread::new()
    }
}

/// Locks. Nothing panics while the lock is held.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn a_second_use_on_the_same_thread_gets_another_value_and_both_are_kept() {
        let made = Cell::new(0);
        let make = || {
            made.set(made.get() + 1);
            Ok::<_, Infallible>(0)
        };
        let counts = PerThread::new();
        for round in 1..=3 {
            let inner = |outer: &mut i32| {
                *outer += 1;
                counts.with(make, |inner| assert_eq!((*inner, *outer), (10 * (round - 1), round))).unwrap();
                counts.with(make, |inner| *inner += 10).unwrap();
            };
            counts.with(make, inner).unwrap();
        }
        assert_eq!(made.get(), 2);
    }

    #[test]
    fn a_panic_drops_the_value_and_the_next_use_makes_another_one() {
        let counts = PerThread::new();
        let add = |panics: bool| {
            counts.with(
                || Ok::<_, Infallible>(0),
                |count| {
                    *count += 1;
                    assert!(!panics, "as requested");
                    *count
                },
            )
        };
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        alone.install(|| {
            assert_eq!([add(false), add(false)], [Ok(1), Ok(2)]);
            assert!(std::panic::catch_unwind(|| add(true)).is_err());
            assert_eq!(add(false), Ok(1));
        });
    }

    #[test]
    fn threads_of_a_larger_pool_share_the_values() {
        let small = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let large = rayon::ThreadPoolBuilder::new().num_threads(4).build().unwrap();
        let counts = small.install(PerThread::new);
        let uses = large.broadcast(|_| counts.with(|| Ok::<_, Infallible>(0), |count| *count += 1));
        assert_eq!(uses.len(), 4);
        assert_eq!(counts.free.iter().flat_map(|free| lock(free).clone()).sum::<i32>(), 4);
    }
}
