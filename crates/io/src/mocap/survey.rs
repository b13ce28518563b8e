//! What a mocap source has: its objects, and how well their frames come.
//!
//! Reads a source for all of its objects, for people and for checks before a flight. A flight reads one object by
//! [`super::MocapClient`].

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::io;
use std::time::Duration;

use serde::Serialize;
use tokio::time::{sleep, timeout};

use super::axes::Placement;
use super::protocol::{BodyProtocol, Head, Name, OBJECTS_MAX, Taker};
use super::wire::{CHUNK_BYTES, Wire};
use super::{MocapCounters, MocapSettings, SourceError};
use crate::clock::{Clock, TimeNs};

/// A gap is longer than this many median periods.
const GAP_PERIODS: f64 = 2.5;
const BEAT: Duration = Duration::from_secs(1);
const CONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Time between two looks of a viewer.
const LOOK: Duration = Duration::from_millis(100);
const BACK_OFF: Duration = Duration::from_millis(200);

/// What a source showed.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    /// Objects by name; `#` and the identity for one without a name.
    pub objects: BTreeMap<String, Track>,
    /// Connections that were made.
    pub connects: u64,
    /// Complete messages received.
    pub messages: u64,
    /// Messages that were refused.
    pub malformed: u64,
    /// Why the last connection was not made or given up.
    pub trouble: Option<String>,
    /// Frame rate that the source announces; 0 if it does not. Hz
    pub announced_hz: f64,
}

/// How the frames of one object came.
#[derive(Debug, Clone, Default)]
pub struct Track {
    /// Frames that contained it.
    pub frames: u64,
    /// Frames in which it was seen.
    pub seen: u64,
    /// Times between frames. s
    periods_s: Vec<f64>,
    last_at: Option<TimeNs>,
    latency_sum_s: f64,
    latency_max_s: f64,
    /// First and newest place, in the axes and the unit of the source.
    pub places: Option<[Placement; 2]>,
    /// The place that was furthest from the first one.
    pub furthest: Option<Placement>,
    /// When it was seen last.
    pub seen_at: Option<TimeNs>,
}

/// Most periods that are kept of one object.
const PERIODS_MAX: usize = 1 << 16;

/// Numbers of a [`Track`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TrackReport {
    /// Frames that contained the object.
    pub frames: u64,
    /// Frames in which it was seen.
    pub seen: u64,
    /// Frames per second, gaps included. Hz
    pub rate_hz: f64,
    /// One over the median time between frames: the rate without gaps. Hz
    pub usual_hz: f64,
    /// Standard deviation of the time between frames. s
    pub jitter_s: f64,
    /// Times between frames beyond two and a half median ones.
    pub gaps: u64,
    /// Longest time between frames. s
    pub gap_max_s: f64,
    /// Mean age of frames when they were sent, as the source tells; 0 if it does not. s
    pub latency_mean_s: f64,
    /// Largest such age. s
    pub latency_max_s: f64,
}

impl Track {
    /// What the frames so far add up to.
    pub fn report(&self) -> TrackReport {
        let (frames, seen) = (self.frames, self.seen);
        let counted = TrackReport {
            frames,
            seen,
            latency_mean_s: self.latency_sum_s / frames.max(1) as f64,
            latency_max_s: self.latency_max_s,
            ..TrackReport::default()
        };
        let mut periods_s = self.periods_s.clone();
        periods_s.sort_unstable_by(f64::total_cmp);
        let (Some(&median_s), Some(&gap_max_s)) =
            (periods_s.get(periods_s.len() / 2), periods_s.last())
        else {
            return counted;
        };
        let count = periods_s.len() as f64;
        let mean_s = periods_s.iter().sum::<f64>() / count;
        let square = |period_s: &f64| (period_s - mean_s).powi(2);
        let is_gap = |period_s: &&f64| **period_s > GAP_PERIODS * median_s;
        let rate = |period_s: f64| if period_s > 0.0 { 1.0 / period_s } else { 0.0 };
        TrackReport {
            rate_hz: rate(mean_s),
            usual_hz: rate(median_s),
            jitter_s: (periods_s.iter().map(square).sum::<f64>() / count).sqrt(),
            gaps: periods_s.iter().filter(is_gap).count() as u64,
            gap_max_s,
            ..counted
        }
    }

    fn take(&mut self, now: TimeNs, at: Option<Placement>, head: Head) {
        self.frames += 1;
        let before = self.last_at.replace(now);
        if let Some(before) = before.filter(|_| self.periods_s.len() < PERIODS_MAX) {
            self.periods_s.push(now.since(before).seconds());
        }
        self.latency_sum_s += head.latency.seconds();
        self.latency_max_s = self.latency_max_s.max(head.latency.seconds());
        let Some(at) = at else { return };
        self.seen += 1;
        self.seen_at = Some(now);
        let [first, _] = *self.places.get_or_insert([at; 2]);
        self.places = Some([first, at]);
        if self.furthest.is_none_or(|furthest| apart(&at, &first) > apart(&furthest, &first)) {
            self.furthest = Some(at);
        }
    }
}

/// Distance of two places, in the unit of the source.
fn apart(a: &Placement, b: &Placement) -> f64 {
    a.pos.iter().zip(b.pos).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Takes the bodies of a frame until the frame is there.
struct Collect<'a> {
    survey: &'a mut Survey,
    bodies: Vec<(String, Option<Placement>)>,
    now: TimeNs,
}

impl Taker for Collect<'_> {
    fn body(&mut self, name: Name<'_>, at: Option<&Placement>) {
        let name = match name {
            Name { text: Some(text), id } => {
                // What came before its name did.
                if let Some(id) = id {
                    self.survey.objects.remove(&format!("#{id}"));
                }
                text.to_owned()
            }
            Name { id: Some(id), .. } => format!("#{id}"),
            Name { .. } => return,
        };
        if self.bodies.len() < OBJECTS_MAX {
            self.bodies.push((name, at.copied()));
        }
    }

    fn frame(&mut self, head: Head) {
        self.survey.announced_hz = head.rate_hz;
        for (name, at) in self.bodies.drain(..) {
            let objects = &mut self.survey.objects;
            if objects.len() < OBJECTS_MAX || objects.contains_key(&name) {
                objects.entry(name).or_default().take(self.now, at, head);
            }
        }
    }
}

/// Reads a source for so long, and calls `on_look` about ten times a second with what there is so far.
pub async fn survey(
    settings: &MocapSettings,
    clock: Clock,
    duration: Duration,
    mut on_look: impl FnMut(&Survey, TimeNs),
) -> Survey {
    let mut survey = Survey::default();
    // An end by time is the end that is meant.
    timeout(duration, read(settings, clock, &mut survey, &mut on_look)).await.ok();
    survey
}

/// Connects and reads again and again.
async fn read(
    settings: &MocapSettings,
    clock: Clock,
    survey: &mut Survey,
    on_look: &mut impl FnMut(&Survey, TimeNs),
) {
    let mut reader = Reader {
        protocol: settings.all(),
        counters: MocapCounters::default(),
        chunk: vec![0; CHUNK_BYTES],
        clock,
    };
    loop {
        let trouble = match timeout(CONNECT_TIMEOUT, Wire::open(settings)).await {
            Err(_) => "no answer".to_owned(),
            Ok(Err(error)) => error.to_string(),
            Ok(Ok(wire)) => {
                survey.connects += 1;
                match reader.read_connection(wire, survey, on_look).await {
                    Err(Ended::Wire(error)) => error.to_string(),
                    Err(Ended::Source(error)) => error.to_string(),
                    Ok(never) => match never {},
                }
            }
        };
        survey.trouble = Some(trouble);
        sleep(BACK_OFF).await;
    }
}

/// What reads one connection after the other.
struct Reader {
    protocol: Box<dyn BodyProtocol>,
    counters: MocapCounters,
    chunk: Vec<u8>,
    clock: Clock,
}

/// Why a connection ended.
enum Ended {
    Wire(io::Error),
    Source(SourceError),
}

impl From<io::Error> for Ended {
    fn from(error: io::Error) -> Self {
        Self::Wire(error)
    }
}

impl Reader {
    /// Reads until the connection ends or makes no sense.
    async fn read_connection(
        &mut self,
        mut wire: Wire,
        survey: &mut Survey,
        on_look: &mut impl FnMut(&Survey, TimeNs),
    ) -> Result<Infallible, Ended> {
        let Self { protocol, counters, chunk, clock } = self;
        protocol.restart();
        let mut requests = Vec::new();
        let mut beat_at: Option<TimeNs> = None;
        let mut look_at = clock.now();
        loop {
            let now = clock.now();
            if beat_at.is_none_or(|at| now.since(at).duration() >= BEAT) {
                beat_at = Some(now);
                protocol.beat();
            }
            requests.clear();
            protocol.take_requests(&mut requests);
            wire.write(&requests).await?;
            let received = timeout(LOOK, wire.read(chunk)).await;
            let now = clock.now();
            if now.since(look_at).duration() >= LOOK {
                look_at = now;
                on_look(survey, now);
            }
            let Ok(count) = received else { continue };
            let bytes = chunk.get(..count?).unwrap_or_default();
            let mut taker = Collect { survey, bodies: Vec::new(), now };
            let result = protocol.push(bytes, counters, &mut taker);
            survey.messages = counters.messages.get();
            survey.malformed = counters.malformed.get();
            result.map_err(Ended::Source)?;
            wire.join(protocol.group())?;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::SpanNs;

    #[test]
    fn rate_jitter_and_gaps_are_those_of_the_frames() {
        let mut track = Track::default();
        let head = Head { number: 1, rate_hz: 0.0, latency: SpanNs::from_ms(3), is_whole: true };
        assert_eq!(track.report(), TrackReport::default());
        // 100 Hz with one gap of 40 ms.
        for at_ms in [0, 10, 20, 60, 70, 80] {
            track.take(TimeNs(0).after(SpanNs::from_ms(at_ms)), None, head);
        }
        let report = track.report();
        assert_eq!((report.frames, report.seen, report.gaps), (6, 0, 1));
        let is_near = |value: f64, expected: f64| (value - expected).abs() < 1e-9;
        assert!(is_near(report.rate_hz, 62.5) && is_near(report.usual_hz, 100.0), "{report:?}");
        assert!(is_near(report.jitter_s, 0.012) && is_near(report.gap_max_s, 0.04), "{report:?}");
        assert!(is_near(report.latency_mean_s, 0.003), "{report:?}");
    }
}
