//! The bar that a long command shows.

use parking_lot::Mutex;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use tello_eval::ident::Observer;

use crate::interrupt::Interrupt;

/// A bar or a spinner for the parts of an identification; Ctrl-C stops it.
#[derive(Debug)]
pub(crate) struct Shown<'a> {
    has_bar: bool,
    interrupt: &'a Interrupt,
    bar: Mutex<ProgressBar>,
}

impl<'a> Shown<'a> {
    /// Nothing is shown unless `has_bar`.
    pub(crate) fn new(has_bar: bool, interrupt: &'a Interrupt) -> Self {
        Self { has_bar, interrupt, bar: Mutex::new(ProgressBar::hidden()) }
    }
}

impl Observer for Shown<'_> {
    fn is_stopped(&self) -> bool {
        self.interrupt.is_asked()
    }

    fn begin(&self, part: &str, count: Option<u64>) {
        if !self.has_bar {
            return;
        }
        let (bar, style) = match count {
            Some(count) => {
                (ProgressBar::new(count), "{msg} {bar:40} {pos}/{len}, {elapsed}, {eta} left")
            }
            None => (ProgressBar::new_spinner(), "{msg}, iteration {pos}, {elapsed}"),
        };
        if let Ok(style) = ProgressStyle::with_template(style) {
            bar.set_style(style);
        }
        bar.set_message(part.to_owned());
        *self.bar.lock() = bar;
    }

    fn advance(&self) {
        self.bar.lock().inc(1);
    }

    fn end(&self) {
        self.bar.lock().finish_and_clear();
    }
}

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

#[cfg(test)]
mod tests;
