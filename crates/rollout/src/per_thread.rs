use std::sync::Mutex;

/// A value for each thread of the rayon pool, such as buffers and workers.
///
/// A thread locks only its own value, so that threads do not wait for each other.
#[derive(Debug)]
pub struct PerThread<T> {
    values: Vec<Mutex<T>>,
}

impl<T: Send> PerThread<T> {
    /// Makes a value for each thread of the current pool.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn new<E>(make: impl Fn() -> Result<T, E>) -> Result<PerThread<T>, E> {
        let values = (0..rayon::current_num_threads()).map(|_| Ok(Mutex::new(make()?)));
        Ok(PerThread { values: values.collect::<Result<_, E>>()? })
    }

    /// Calls `function` with the value of this thread.
    ///
    /// While `function` waits for another pool, as a policy with its own threads does, rayon may run it a second time on the same thread.
    /// Then, and outside of the pool, it gets a value that `make` makes.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn with<R, E>(
        &self,
        make: impl FnOnce() -> Result<T, E>,
        function: impl FnOnce(&mut T) -> R,
    ) -> Result<R, E> {
        let own = rayon::current_thread_index().and_then(|index| self.values.get(index));
        match own.map(Mutex::try_lock) {
            Some(Ok(mut value)) => Ok(function(&mut value)),
            _ => Ok(function(&mut make()?)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;

    use super::*;

    #[test]
    fn a_second_use_on_the_same_thread_gets_another_value() {
        let make = || Ok::<_, Infallible>(0);
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        pool.install(|| {
            let counts = PerThread::new(make).unwrap();
            let inner = |outer: &mut i32| {
                *outer += 1;
                counts.with(make, |inner| *inner += 10).unwrap();
            };
            counts.with(make, inner).unwrap();
            assert_eq!(counts.with(make, |count| *count).unwrap(), 1);
        });
    }
}
