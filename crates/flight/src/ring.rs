//! Ring buffer of the newest values.

/// The newest values of a fixed number, each by how many pushes ago it came.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ring<T> {
    values: Vec<T>,
    newest: usize,
}

impl<T: Copy> Ring<T> {
    /// A ring of `len` >= 1 values, all of them `value`. The only allocation.
    pub(crate) fn new(value: T, len: usize) -> Self {
        Self { values: vec![value; len], newest: 0 }
    }

    /// Number of values.
    pub(crate) fn len(&self) -> usize {
        self.values.len()
    }

    /// Replaces the oldest value by `value`, which becomes the newest.
    pub(crate) fn push(&mut self, value: T) {
        self.newest = (self.newest + 1) % self.len();
        self.values[self.newest] = value;
    }

    /// The value of `back` pushes ago, 0 for the newest; modulo the length.
    pub(crate) fn back(&self, back: usize) -> T {
        self.values[self.index(back)]
    }

    /// Replaces the value of `back` pushes ago, modulo the length.
    pub(crate) fn replace(&mut self, back: usize, value: T) {
        let index = self.index(back);
        self.values[index] = value;
    }

    /// All values in no particular order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &T> {
        self.values.iter()
    }

    fn index(&self, back: usize) -> usize {
        let len = self.len();
        (self.newest + len - back % len) % len
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_found_by_their_age_and_the_oldest_one_is_replaced() {
        let mut ring = Ring::new(0, 3);
        (1..=4).for_each(|value| ring.push(value));
        assert_eq!([0, 1, 2, 3].map(|back| ring.back(back)), [4, 3, 2, 4]);
        ring.replace(1, 9);
        ring.push(5);
        assert_eq!([0, 1, 2].map(|back| ring.back(back)), [5, 4, 9]);
        assert_eq!((ring.len(), ring.iter().sum::<i32>()), (3, 18));
    }
}
