//! `fly --tui`: the flight as a picture on the terminal that the program runs in.
//!
//! Owns the terminal's screen while the flight lasts, and how often the picture is drawn. It reads no key: that is
//! `io::manual`. The newest facts are drawn on a thread of its own, which a slow terminal may hold up as it
//! likes.

mod numbers;
mod picture;
mod room;

use std::collections::VecDeque;
use std::io::{self, BufWriter, IsTerminal};
use std::sync::Arc;
use std::thread;
use std::time::Duration;

use anyhow::{Result, bail};
use ratatui::backend::{Backend, CrosstermBackend};
use ratatui::crossterm::cursor::{Hide, Show};
use ratatui::crossterm::execute;
use ratatui::crossterm::style::Colored;
use ratatui::crossterm::terminal::{EnterAlternateScreen, LeaveAlternateScreen};
use ratatui::layout::Rect;
use ratatui::{Terminal, TerminalOptions, Viewport};
use rtrb::Consumer;
use tello_eval::telemetry::{FlightHeader, Telemetry};
use tello_io::held_messages::{Messages, Newest};

use self::picture::{Palette, draw};
use super::live::Watched;
use super::status::Status;

/// How often the picture is drawn.
const PERIOD: Duration = Duration::from_millis(100);

/// Pictures with the same facts after which they count as old: a second.
const OLD_AFTER: u32 = 10;

/// Most samples of the histories, one for each picture: more than a screen is wide.
const HISTORY: usize = 400;

/// Largest picture: a terminal may claim any size, and each cell costs memory. columns, rows
const SIZE_MAX: (u16, u16) = (1000, 400);

/// Room for all that a picture sends, so that it goes in one piece. bytes
const PICTURE_BYTES: usize = 1 << 16;

/// The terminal's second screen, without a cursor. Dropped, the terminal shows what it showed before, then
/// the messages of the flight.
#[derive(Debug)]
pub(super) struct Screen {
    /// `None` where they do not go to the terminal.
    messages: Option<Messages>,
}

impl Screen {
    /// Takes the screen.
    ///
    /// # Errors
    /// The standard output is no terminal, or cannot be written to.
    pub(super) fn enter() -> Result<Self> {
        if !io::stdout().is_terminal() {
            bail!(
                "--tui draws on a terminal, and the standard output is none: leave out one of both"
            );
        }
        let messages = io::stderr().is_terminal().then(Messages::hold).transpose()?;
        let screen = Self { messages };
        execute!(io::stdout(), EnterAlternateScreen, Hide)?;
        Ok(screen)
    }

    /// The drawing of `watched` on this screen.
    pub(super) fn picture(&self, briefing: FlightHeader, watched: Watched) -> Picture {
        let messages = self.messages.as_ref().map(Messages::newest);
        let palette = Palette::new(!Colored::ansi_color_disabled_memoized());
        Picture { watched, messages, view: View::new(briefing, palette) }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // A terminal that is gone needs no screen.
        execute!(io::stdout(), Show, LeaveAlternateScreen).ok();
    }
}

/// Drawing of a flight.
#[derive(Debug)]
pub(super) struct Picture {
    watched: Watched,
    messages: Option<Newest>,
    view: View,
}

/// Content of the picture.
#[derive(Debug)]
struct View {
    briefing: FlightHeader,
    palette: Palette,
    facts: Arc<Telemetry>,
    /// The newest status of the control thread, for when the facts are old.
    status: Option<Status>,
    /// Pictures with these facts so far.
    repeated: u32,
    /// Whether there is no control thread any more.
    is_over: bool,
    /// Largest lateness and longest solve of the last second before each picture, the newest last. us
    late_us: VecDeque<u64>,
    solve_us: VecDeque<u64>,
    messages: Vec<String>,
}

impl Picture {
    /// Draws until the control thread, which pushes `statuses`, or the terminal is gone.
    pub(super) fn show(mut self, mut statuses: Consumer<Status>) {
        let out = BufWriter::with_capacity(PICTURE_BYTES, io::stdout());
        let viewport = TerminalOptions { viewport: Viewport::Fixed(Rect::ZERO) };
        let terminal = Terminal::with_options(CrosstermBackend::new(out), viewport);
        let Ok(mut terminal) = terminal else { return };
        let mut area = Rect::ZERO;
        while !self.view.is_over {
            // The last picture shows it: it stays while a drone without control is landed.
            self.view.is_over = statuses.is_abandoned();
            while let Ok(status) = statuses.pop() {
                self.view.status = Some(status);
            }
            let facts = Arc::clone(&self.watched.borrow_and_update());
            self.view.look(facts);
            if let Some(messages) = &self.messages {
                self.view.messages = messages.lines(picture::MESSAGES_MAX);
            }
            if fit(&mut terminal, &mut area).is_err()
                || terminal.draw(|frame| draw(frame, &self.view)).is_err()
            {
                return;
            }
            thread::sleep(PERIOD);
        }
    }
}

/// Brings the picture to the size of the terminal, at most [`SIZE_MAX`].
fn fit<B: Backend>(terminal: &mut Terminal<B>, area: &mut Rect) -> Result<(), B::Error> {
    let size = terminal.size()?;
    let fitting = Rect::new(0, 0, size.width.min(SIZE_MAX.0), size.height.min(SIZE_MAX.1));
    if *area != fitting {
        *area = fitting;
        terminal.resize(fitting)?;
    }
    Ok(())
}

impl View {
    fn new(briefing: FlightHeader, palette: Palette) -> Self {
        Self {
            briefing,
            palette,
            facts: Arc::default(),
            status: None,
            repeated: 0,
            is_over: false,
            late_us: VecDeque::with_capacity(HISTORY),
            solve_us: VecDeque::with_capacity(HISTORY),
            messages: Vec::new(),
        }
    }

    fn look(&mut self, facts: Arc<Telemetry>) {
        self.repeated = if facts.step == self.facts.step { self.repeated + 1 } else { 0 };
        let worst = &facts.worst;
        let solve_ms = worst.estimate_ms + worst.plan_ms;
        for (history, ms) in [(&mut self.late_us, worst.late_ms), (&mut self.solve_us, solve_ms)] {
            if history.len() == HISTORY {
                history.pop_front();
            }
            history.push_back(horizon_model::whole(ms * 1e3) as u64);
        }
        self.facts = facts;
    }

    /// Whether there is no news, though the control thread lives.
    fn is_old(&self) -> bool {
        self.repeated >= OLD_AFTER && self.facts.phase.is_some()
    }
}

#[cfg(test)]
mod tests;
