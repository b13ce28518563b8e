//! A recorded flight in the live page: one file that plays without a server.
//!
//! Owns how the files of the page and the facts of the flight become one. The facts are those that a browser would have
//! got; of a long flight some are left out.

use anyhow::{Result, ensure};
use tello_eval::flight_log::TickRecord;
use tello_eval::telemetry::{FlightHeader, TelemetryBuilder};
use tello_flight::cycle::FlightTable;
use tello_io::mocap::StreamReport;

use super::server::{PAGE, SCRIPT, STYLE};

/// Most facts in a page: five a second for ten minutes.
const FACTS_MAX: usize = 3_000;

const PLAYER: &str = include_str!("player.html");
const PLAY: &str = include_str!("play.js");

/// Nothing from anywhere but this file.
const POLICY: &str = "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; \
                      script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:\">";

/// Gathers the facts of a flight.
#[derive(Debug)]
pub(crate) struct Playback {
    builder: TelemetryBuilder,
    briefing: FlightHeader,
    /// Telemetry as JSON.
    facts: Vec<String>,
}

impl Playback {
    /// Nothing gathered of `flight` so far.
    ///
    /// # Errors
    /// The mission or a dead time breaks its rule.
    pub(crate) fn new(flight: &FlightTable) -> Result<Self> {
        let (builder, briefing) = TelemetryBuilder::new(flight)?;
        Ok(Self { builder, briefing, facts: Vec::new() })
    }

    /// Adds a tick; called for every one.
    ///
    /// # Errors
    /// A number that JSON does not know.
    pub(crate) fn add(&mut self, tick: &TickRecord) -> Result<()> {
        if let Some(facts) = self.builder.observe(tick, StreamReport::default) {
            self.facts.push(serde_json::to_string(&facts)?);
        }
        Ok(())
    }

    /// The page; a `note` stands at its end.
    ///
    /// # Errors
    /// There are no facts to play.
    pub(crate) fn page(&self, note: Option<&str>) -> Result<String> {
        ensure!(!self.facts.is_empty(), "there is no tick to play");
        let stride = self.facts.len().div_ceil(FACTS_MAX);
        let facts: Vec<&str> = self.facts.iter().step_by(stride).map(String::as_str).collect();
        let briefing = serde_json::to_string(&self.briefing)?;
        let (note, facts) = (serde_json::to_string(&note)?, facts.join(","));
        let recording = format!("{{\"briefing\":{briefing},\"note\":{note},\"facts\":[{facts}]}}");
        // No text of a flight can end the element.
        let recording = recording.replace('<', "\\u003c");
        let scripts = format!(
            "<script type=\"application/json\" id=\"recording\">{recording}</script>\n\
             <script>\n{SCRIPT}{PLAY}</script>\n</body>"
        );
        Ok(PAGE
            .replace(
                "<link rel=\"stylesheet\" href=\"page.css\">",
                &format!("<style>\n{STYLE}</style>"),
            )
            .replace("<script src=\"page.js\" defer></script>", POLICY)
            .replace("</header>", &format!("</header>\n{PLAYER}"))
            .replace("</body>", &scripts))
    }
}

#[cfg(test)]
mod tests;
