//! The bar that a long command shows.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};

/// A bar on a terminal for `count` seeds, with their rate and the time left.
///
/// # Errors
/// None in practice: the template is ours.
pub(crate) fn of_seeds(count: u64, is_shown: bool) -> Result<ProgressBar> {
    let bar = if is_shown { ProgressBar::new(count) } else { ProgressBar::hidden() };
    let style = "{bar:40} {pos}/{len} seeds, {per_sec}, {eta} left";
    bar.set_style(ProgressStyle::with_template(style)?);
    Ok(bar)
}
