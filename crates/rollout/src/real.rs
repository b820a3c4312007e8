/// A number of an observation or action. All are exact as `f64`.
pub trait Real: Copy {
    /// Returns the number with double precision.
    fn to_f64(self) -> f64;
    /// Returns the nearest number.
    fn nearest(value: f64) -> Self;
    /// Returns the sum, with the offset rounded to this precision before.
    #[must_use]
    fn plus(self, offset: f64) -> Self;
}

impl Real for f32 {
    fn to_f64(self) -> f64 {
        f64::from(self)
    }

    fn nearest(value: f64) -> f32 {
        value as f32
    }

    fn plus(self, offset: f64) -> f32 {
        self + offset as f32
    }
}

impl Real for f64 {
    fn to_f64(self) -> f64 {
        self
    }

    fn nearest(value: f64) -> f64 {
        value
    }

    fn plus(self, offset: f64) -> f64 {
        self + offset
    }
}
