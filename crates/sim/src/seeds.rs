//! Many seeds side by side.
//!
//! Owns the order of the results and what an interrupt leaves out.

use std::ops::Range;

use anyhow::Result;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

/// Results of `fly` for each of `seeds`, in their order, on all threads. Once `is_interrupted` no further seed is
/// begun, and those are left out. `on_flown` is called after every one.
///
/// # Errors
/// The first error of `fly`.
pub(crate) fn fly_each<T: Send>(
    seeds: Range<u64>,
    is_interrupted: &(dyn Fn() -> bool + Sync),
    on_flown: &(dyn Fn() + Sync),
    fly: impl Fn(u64) -> Result<T> + Sync,
) -> Result<Vec<T>> {
    let of_seed = |seed| -> Result<Option<T>> {
        if is_interrupted() {
            return Ok(None);
        }
        let flown = fly(seed)?;
        on_flown();
        Ok(Some(flown))
    };
    let by_seed: Result<Vec<Option<T>>> = seeds.into_par_iter().map(of_seed).collect();
    Ok(by_seed?.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use anyhow::bail;

    use super::*;

    #[test]
    fn results_are_in_the_order_of_their_seeds_and_each_is_counted() {
        let count = AtomicU64::new(0);
        let on_flown = || {
            count.fetch_add(1, Ordering::Relaxed);
        };
        let squares = fly_each(3..40, &|| false, &on_flown, |seed| Ok(seed * seed)).unwrap();
        assert_eq!(squares, (3..40).map(|seed| seed * seed).collect::<Vec<_>>());
        assert_eq!(count.load(Ordering::Relaxed), 37);
    }

    #[test]
    fn an_interrupt_begins_no_seed_and_an_error_ends_all() {
        let fly = |seed| if seed == 5 { bail!("seed 5") } else { Ok(seed) };
        assert_eq!(fly_each(0..9, &|| true, &|| (), fly).unwrap(), Vec::<u64>::new());
        assert_eq!(fly_each(0..9, &|| false, &|| (), fly).unwrap_err().to_string(), "seed 5");
    }
}
