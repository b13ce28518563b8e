//! The bar that a long command shows.

use std::time::Duration;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use parking_lot::Mutex;
use tello_eval::ident::Observer;

use crate::interrupt::Interrupt;
use crate::stdio;

/// Between two lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(10);

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

/// A bar on a terminal for seeds, with their rate and the time left; elsewhere a line of it now and then.
#[derive(Debug)]
pub(crate) struct Seeds {
    bar: ProgressBar,
    /// Since the beginning, of the latest line, if there are any.
    line_at: Option<Mutex<Duration>>,
}

impl Seeds {
    /// Of `count` seeds; nothing unless it `is_shown`.
    ///
    /// # Errors
    /// None in practice: the template is ours.
    pub(crate) fn of(count: u64, is_shown: bool) -> Result<Self> {
        let bar = if is_shown { ProgressBar::new(count) } else { ProgressBar::hidden() };
        let style = "{bar:40} {pos}/{len} seeds, {per_sec}, {eta} left";
        bar.set_style(ProgressStyle::with_template(style)?);
        let line_at = (is_shown && bar.is_hidden()).then(Mutex::default);
        Ok(Self { bar, line_at })
    }

    /// One seed more is done.
    pub(crate) fn advance(&self) {
        self.bar.inc(1);
        if let Some(mut line_at) = self.line_at.as_ref().and_then(Mutex::try_lock)
            && self.bar.elapsed() >= *line_at + LINE_EVERY
        {
            *line_at = self.bar.elapsed();
            stdio::note(self.line());
        }
    }

    pub(crate) fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// How far the work is, in words.
    fn line(&self) -> String {
        let (done, count) = (self.bar.position(), self.bar.length().unwrap_or(0));
        let left = self.bar.elapsed().as_secs_f64() / done.max(1) as f64
            * count.saturating_sub(done) as f64;
        format!("{done} of {count} seeds, about {left:.0} s left")
    }
}

#[cfg(test)]
mod tests;
