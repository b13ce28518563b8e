//! A log of ours, repeated and compared bit by bit.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::path::Path;

use anyhow::{Result, bail};
use schemars::JsonSchema;
use serde::Serialize;
use tello_flight::cycle::{self, FlightTable, Inbox, Sink, Tick, Timing, Topic, Unwatched};
use tello_io::config;
use tello_io::log::LogReader;

use super::drawn_log::DrawnLog;
use super::{Options, TickObserver};
use crate::flight_log::{self, TickRecord};
use crate::{REVISION, parameter_file};

/// Conclusion of a comparison: the first that holds, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Finding {
    /// A record differs, and no tick before it is missing.
    Different,
    /// Equal up to a tick that the log does not have.
    TickMissing,
    /// Equal up to the tear.
    Torn,
    /// Equal, but no stick moved: nothing of the controller was repeated.
    NeverSteered,
    /// Every record of every compared channel of a complete flight is equal.
    Equal,
}

/// Result of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ReplayReport {
    /// Conclusion.
    finding: Finding,
    /// Whether every record of every compared channel is equal, the log complete and the flight real.
    pub(super) is_equal: bool,
    /// Ticks repeated.
    ticks: u64,
    /// Ticks in which sticks were sent that are not neutral.
    ticks_steered: u64,
    /// How the log ends, if it is torn.
    torn: Option<String>,
    /// First step that is missing in the log.
    first_gap: Option<u64>,
    /// Each compared channel.
    channels: BTreeMap<&'static str, Channel>,
    /// Revision that wrote the log.
    revision_then: String,
    /// This revision.
    revision_now: &'static str,
}

/// Comparison of one channel.
#[derive(Debug, Clone, PartialEq, Default, Serialize, JsonSchema)]
struct Channel {
    records: u64,
    different: u64,
    first: Option<Difference>,
}

/// First difference on a channel.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
struct Difference {
    step: u64,
    /// The logged record; null if there is none.
    then: Option<String>,
    /// The repeated record; null if there is none.
    now: Option<String>,
}

pub(super) fn run(
    path: &Path,
    options: &Options<'_>,
    mut watch: Option<TickObserver<'_>>,
) -> Result<ReplayReport> {
    let mut log = LogReader::open(path)?;
    let mut flight = flight_log::settings(&log, path)?;
    if let Some(path) = options.config {
        flight.cycle = config::load::<config::FlyTable>(path)?.cycle;
    }
    parameter_file::apply(options.params, &mut flight.cycle)?;
    let mut replay = Replay::new(&flight, &log, options)?;
    let mut is_tick_whole = true;
    let mut open = None;
    while let Some(message) = log.next_message()? {
        match Topic::named(message.topic) {
            Some(Topic::Inbox) => {
                is_tick_whole = false;
                open = Some(message.t);
                replay.repeat(&message.decode()?)?;
            }
            // The last record of a tick.
            Some(Topic::Timing) if open == Some(message.t) => {
                is_tick_whole = true;
                if let Some(watch) = &mut watch {
                    replay.record.timing = message.decode()?;
                    watch(&flight, &replay.record)?;
                    replay.record.timing = Timing::default();
                }
            }
            Some(Topic::Jitter) | None => {}
            // Without its inbox it is of a tick that is missing.
            Some(_) if open != Some(message.t) => replay.note_gap(),
            Some(topic) => replay.compare(topic, message.data),
        }
    }
    let torn = match log.ending() {
        Some(ending) if !ending.is_complete() => Some(ending.to_string()),
        // Mended after a tear: the rest of the tick is not known.
        _ if !is_tick_whole => Some("cut within its last tick".to_owned()),
        _ => None,
    };
    replay.finish(path, torn)
}

/// A flight being repeated.
struct Replay {
    cycle: Box<dyn Tick>,
    record: TickRecord,
    now: TickJson,
    out: Option<DrawnLog>,
    report: ReplayReport,
    /// Step of the next tick.
    next_step: u64,
}

impl Replay {
    fn new(flight: &FlightTable, log: &LogReader, options: &Options<'_>) -> Result<Self> {
        let cycle = cycle::build(flight)?;
        let shape = cycle.new_outcome();
        let started_unix_ns = log.head().started_unix_ns;
        let create = |path: &Path| DrawnLog::create(path, flight, started_unix_ns, &shape);
        Ok(Self {
            cycle,
            record: TickRecord::with_buffers(&shape),
            now: TickJson::default(),
            out: options.out.map(create).transpose()?,
            report: ReplayReport {
                finding: Finding::Different,
                is_equal: false,
                ticks: 0,
                ticks_steered: 0,
                torn: None,
                first_gap: None,
                channels: BTreeMap::new(),
                revision_then: log.head().revision.clone(),
                revision_now: REVISION,
            },
            next_step: 0,
        })
    }

    /// From here on ticks are missing, and maybe records of the tick before.
    fn note_gap(&mut self) {
        self.report.first_gap.get_or_insert(self.next_step);
        self.now.records.clear();
    }

    /// Closes the tick before and repeats the next.
    fn repeat(&mut self, inbox: &Inbox) -> Result<()> {
        if inbox.step != self.next_step {
            self.note_gap();
        }
        self.next_step = inbox.step + 1;
        self.close_tick();
        self.record.inbox = inbox.clone();
        let mut watch = Unwatched::as_recorded(inbox);
        self.cycle.tick(inbox, &mut watch, &mut self.record.out);
        self.record.out.records(&mut self.now)?;
        self.report.ticks += 1;
        let is_steered = self.record.out.u_sent.amax() > 0.0;
        self.report.ticks_steered += u64::from(is_steered);
        if let Some(out) = &mut self.out {
            out.write(&self.record)?;
        }
        Ok(())
    }

    fn compare(&mut self, topic: Topic, then: &[u8]) {
        let now = self.now.records.remove(&topic);
        self.note(topic, Some(then), now.as_deref());
    }

    /// The output of the repeated tick that the log does not have.
    fn close_tick(&mut self) {
        for (topic, now) in std::mem::take(&mut self.now.records) {
            self.note(topic, None, Some(&now));
        }
    }

    fn note(&mut self, topic: Topic, then: Option<&[u8]>, now: Option<&[u8]>) {
        let channel = self.report.channels.entry(topic.name()).or_default();
        channel.records += 1;
        if then == now {
            return;
        }
        channel.different += 1;
        let text =
            |json: Option<&[u8]>| json.map(|json| String::from_utf8_lossy(json).into_owned());
        let step = self.record.out.step;
        channel.first.get_or_insert_with(|| Difference { step, then: text(then), now: text(now) });
    }

    fn finish(mut self, path: &Path, torn: Option<String>) -> Result<ReplayReport> {
        if self.report.ticks == 0 {
            let torn = torn.map_or_else(String::new, |torn| format!(" (it is {torn})"));
            bail!("{}: no tick in it: nothing to repeat{torn}", path.display());
        }
        if torn.is_none() {
            self.close_tick();
        }
        if let Some(out) = self.out {
            out.finish()?;
        }
        self.report.torn = torn;
        self.report.finding = self.report.finding();
        self.report.is_equal = self.report.finding == Finding::Equal;
        Ok(self.report)
    }
}

/// The records of one tick as the log would hold them.
#[derive(Default)]
struct TickJson {
    records: BTreeMap<Topic, Vec<u8>>,
}

impl Sink for TickJson {
    type Error = serde_json::Error;

    fn put<R: Serialize>(&mut self, topic: Topic, record: &R) -> Result<(), serde_json::Error> {
        self.records.insert(topic, serde_json::to_vec(record)?);
        Ok(())
    }
}

impl ReplayReport {
    fn finding(&self) -> Finding {
        let firsts = self.channels.values().filter_map(|channel| channel.first.as_ref());
        let first = firsts.map(|first| first.step).min();
        // Behind a missing tick nothing can be equal.
        let is_different = first.is_some_and(|step| self.first_gap.is_none_or(|gap| step < gap));
        if is_different {
            Finding::Different
        } else if self.first_gap.is_some() {
            Finding::TickMissing
        } else if self.torn.is_some() {
            Finding::Torn
        } else if self.ticks_steered == 0 {
            Finding::NeverSteered
        } else {
            Finding::Equal
        }
    }

    /// The last line.
    pub(super) fn verdict(&self) -> String {
        let ticks = self.ticks;
        match self.finding {
            Finding::Different => "NOT equal".to_owned(),
            Finding::TickMissing => {
                "not judged: equal up to the missing tick, behind it nothing can be compared".into()
            }
            Finding::Torn => format!("not judged: equal up to the tear, in {ticks} ticks"),
            Finding::NeverSteered => {
                format!("not judged: {ticks} ticks are equal, and none of them steered")
            }
            Finding::Equal => "equal, bit by bit".to_owned(),
        }
    }
}

impl Display for ReplayReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<20} {:>8} {:>10}  first difference", "channel", "records", "different")?;
        for (name, channel) in &self.channels {
            write!(f, "{name:<20} {:>8} {:>10}", channel.records, channel.different)?;
            match &channel.first {
                Some(first) => writeln!(f, "  tick {}", first.step)?,
                None => writeln!(f)?,
            }
        }
        let earliest = self.channels.iter().filter_map(|(name, channel)| {
            channel.first.as_ref().map(|first| (first.step, *name, first))
        });
        if let Some((step, name, first)) = earliest.min_by_key(|(step, ..)| *step) {
            let text = |record: &Option<String>| record.clone().unwrap_or("nothing".into());
            writeln!(f, "first difference: tick {step}, {name}")?;
            writeln!(f, "  then {}", text(&first.then))?;
            writeln!(f, "  now  {}", text(&first.now))?;
        }
        if let Some(torn) = &self.torn {
            writeln!(f, "the log is {torn}")?;
        }
        if let Some(step) = self.first_gap {
            writeln!(f, "the log has no tick {step}: what follows it cannot be repeated")?;
        }
        if self.ticks_steered == 0 {
            writeln!(f, "never steered: a log without sticks proves nothing")?;
        }
        let (then, now) = (&self.revision_then, self.revision_now);
        writeln!(
            f,
            "{} ticks, {} of them steered; written by {then}, repeated by {now}",
            self.ticks, self.ticks_steered
        )?;
        writeln!(f, "{}", self.verdict())
    }
}

#[cfg(test)]
mod tests;
