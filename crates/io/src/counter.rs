//! Counts that one thread makes and another reads.

use std::sync::atomic::{AtomicU64, Ordering};

/// A number that only grows. Reading and counting never wait.
#[derive(Debug, Default)]
pub struct Counter(AtomicU64);

impl Counter {
    /// The count so far. Never waits.
    pub fn get(&self) -> u64 {
        // No other memory depends on a count, hence no ordering.
        self.0.load(Ordering::Relaxed)
    }

    /// Increments the count.
    pub fn count(&self) {
        self.add(1);
    }

    pub(crate) fn add(&self, more: u64) {
        self.0.fetch_add(more, Ordering::Relaxed);
    }

    /// Makes the number at least `value`.
    pub(crate) fn raise(&self, value: u64) {
        self.0.fetch_max(value, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_grows_by_what_is_added_and_is_raised_and_never_lowered() {
        let counter = Counter::default();
        counter.count();
        counter.add(4);
        assert_eq!(counter.get(), 5);
        for (value, expected) in [(4, 5), (5, 5), (6, 6)] {
            counter.raise(value);
            assert_eq!(counter.get(), expected);
        }
    }
}
