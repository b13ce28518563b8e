//! `tello-ctl mocap list`: which objects a system has, and how well their poses come.

use std::collections::BTreeSet;
use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::Result;
use clap::Args;
use serde::Serialize;
use serde_json::json;
use tello_io::clock::{Clock, TimeNs};
use tello_io::mocap::{MocapKind, MocapSettings, MocapTable, Refusal, Survey, TrackReport, survey};
use tokio::task::JoinSet;

use super::rate::is_wrong;
use super::source::{self, SourceArgument};
use super::watch::{self, DISPLACEMENT_MIN_M, unit_doubt};
use crate::{Verdict, stdio};

/// Fewer frames give no rate.
const FRAMES_MIN: u64 = 100;

/// List the objects of a motion capture system with rate, jitter, gaps and latency.
///
/// With a HOST every protocol is tried at its usual port, at once: NatNet (OptiTrack) 1510, QTM (Qualisys) 22223,
/// VRPN 3883, Vicon DataStream 801, the thesis' relay 51602; and Vicon's object stream is listened for at 51001.
/// Without, the source of the settings is listed.
///
/// Exit code: 0 if an object was seen, 1 if none, 2 for arguments or settings that make no sense.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Computer of the motion capture system, name or address; or one source, KIND=HOST:PORT.
    #[arg(conflicts_with_all = ["source", "config"])]
    host: Option<String>,
    /// A source by kind and address, such as `natnet=192.168.1.5:1510`. Repeatable.
    #[arg(long, value_name = "KIND=HOST:PORT", conflicts_with = "config")]
    source: Vec<SourceArgument>,
    /// Settings of `tello-ctl fly`, for their source [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// How long to listen.
    #[arg(long, value_name = "SECONDS", default_value_t = 3.0)]
    seconds: f64,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// All sources that were found.
#[derive(Debug, Serialize)]
struct Found {
    sources: Vec<FoundSource>,
}

/// One source with its objects.
#[derive(Debug, Serialize)]
struct FoundSource {
    kind: &'static str,
    address: String,
    /// Whether anything came from it.
    is_there: bool,
    /// Frame rate that it announces; null if it does not. Hz
    announced_hz: Option<f64>,
    messages: u64,
    malformed: u64,
    /// Why the newest of those was refused.
    #[serde(skip)]
    refused: Option<Refusal>,
    /// Whether there was a connection, or a port of ours.
    #[serde(skip)]
    is_open: bool,
    /// Why there is no connection, or why it was given up.
    trouble: Option<String>,
    objects: Vec<FoundObject>,
}

/// One object of a source.
#[derive(Debug, Serialize)]
struct FoundObject {
    name: String,
    #[serde(flatten)]
    report: TrackReport,
    /// Newest place in our frame by the settings' axes; null if it was not seen. m
    #[serde(rename = "position_m")]
    position_w_m: Option<[f64; 3]>,
    /// Distance from its first place to the furthest one. m
    moved_m: f64,
    /// Settings to write for a flight.
    settings: MocapTable,
}

/// Which of the objects is the drone.
#[derive(Debug)]
enum Drone<'a> {
    NotSeen,
    /// One of so many.
    OneOf(usize),
    Is(&'a FoundObject),
}

pub(super) async fn run(arguments: &Arguments) -> Result<Verdict> {
    let seconds = watch::duration(arguments.seconds)?;
    let tables: Vec<MocapTable> = if let Some(source) = one_source(arguments)? {
        vec![source.table("any")]
    } else if let Some(host) = &arguments.host {
        let usual = |kind| SourceArgument::usual(kind, host).table("any");
        MocapKind::ALL.map(usual).into()
    } else if arguments.source.is_empty() {
        vec![source::of_settings(arguments.config.as_ref())?]
    } else {
        arguments.source.iter().map(|source| source.table("any")).collect()
    };
    let found = Found { sources: listen(tables, seconds).await? };
    stdio::report(&found, arguments.json)?;
    let is_seen =
        found.sources.iter().flat_map(|source| &source.objects).any(|o| o.report.seen > 0);
    Ok(if is_seen { Verdict::Good } else { Verdict::Bad })
}

/// The source that stands in place of a host.
fn one_source(arguments: &Arguments) -> Result<Option<SourceArgument>> {
    arguments.host.as_ref().filter(|host| host.contains('=')).map(|host| host.parse()).transpose()
}

/// Listens to all sources at once.
async fn listen(tables: Vec<MocapTable>, seconds: Duration) -> Result<Vec<FoundSource>> {
    let clock = Clock::start();
    let mut tasks = JoinSet::new();
    for (index, table) in tables.into_iter().enumerate() {
        let settings = MocapSettings::try_from(&table).map_err(|error| error.under("mocap"))?;
        tasks.spawn(async move {
            let survey = survey(&settings, clock, watch::end(seconds), |_, _| ()).await;
            (index, found(&table, &settings, survey, clock.now()))
        });
    }
    let mut sources = tasks.join_all().await;
    sources.sort_by_key(|(index, _)| *index);
    Ok(sources.into_iter().map(|(_, source)| source).collect())
}

fn found(table: &MocapTable, settings: &MocapSettings, survey: Survey, now: TimeNs) -> FoundSource {
    let axes = settings.axes();
    let objects = survey.objects.iter().map(|(name, track)| {
        let report = track.report_at(now);
        FoundObject {
            name: name.clone(),
            report,
            position_w_m: track.places.map(|[_, newest]| axes.place(&newest).0),
            moved_m: watch::moved_m(track, &axes),
            settings: super::rate::suggested(table, name, report.usual_hz),
        }
    });
    FoundSource {
        kind: table.kind().name(),
        address: table.address().1.to_owned(),
        is_there: survey.messages > 0,
        announced_hz: (survey.announced_hz > 0.0 && !table.kind().has_set_rate())
            .then_some(survey.announced_hz),
        messages: survey.messages,
        malformed: survey.malformed,
        refused: survey.refused,
        is_open: survey.connects > 0,
        trouble: survey.trouble,
        objects: objects.collect(),
    }
}

impl Display for Found {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for source in &self.sources {
            writeln!(f, "{source}")?;
        }
        match self.drone() {
            Drone::NotSeen => writeln!(
                f,
                "No object was seen. Is the system streaming, is the address right, does a firewall let it through?"
            ),
            Drone::OneOf(count) => writeln!(
                f,
                "{count} objects were seen, and nothing shows which of them is the drone: move it by hand while this \
                 listens, or watch one with tello-ctl mocap watch."
            ),
            Drone::Is(object) => {
                let settings = json!(object.settings);
                writeln!(
                    f,
                    "To fly {:?}, write into the settings: \"mocap\": {settings}",
                    object.name
                )?;
                writeln!(f, "Axes and nose are not known yet: tello-ctl mocap watch shows them.")
            }
        }
    }
}

impl Found {
    /// Which object is the drone: the only one by name, else the only one that moved.
    fn drone(&self) -> Drone<'_> {
        let objects = self.sources.iter().flat_map(|source| &source.objects);
        let seen: Vec<&FoundObject> = objects.filter(|object| object.report.seen > 0).collect();
        let Some(first) = seen.first() else { return Drone::NotSeen };
        if seen.iter().all(|object| object.name == first.name) {
            return Drone::Is(first);
        }
        let mut moved = seen.iter().filter(|object| object.moved_m >= DISPLACEMENT_MIN_M);
        match moved.next() {
            Some(first) if moved.all(|object| object.name == first.name) => Drone::Is(first),
            _ => {
                let names: BTreeSet<&str> =
                    seen.iter().map(|object| object.name.as_str()).collect();
                Drone::OneOf(names.len())
            }
        }
    }
}

impl Display for FoundSource {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {}: ", self.kind, self.address)?;
        if !self.is_there {
            return match &self.trouble {
                Some(trouble) => write!(f, "nothing ({trouble})"),
                None if self.is_open => write!(f, "open, but nothing comes"),
                None => write!(f, "nothing"),
            };
        }
        write!(f, "{} messages", self.messages)?;
        if let Some(hz) = self.announced_hz {
            write!(f, ", announces {} Hz", (hz * 1e2).round() / 1e2)?;
            let counts = |object: &&FoundObject| object.report.frames > FRAMES_MIN;
            let measured = self.objects.iter().filter(counts).map(|object| object.report.usual_hz);
            if let Some(usual_hz) = measured.clone().find(|usual_hz| is_wrong(hz, *usual_hz)) {
                write!(
                    f,
                    ", but {usual_hz:.1} Hz come: a flight refuses that, set the rate right in the system"
                )?;
            }
        }
        if self.malformed > 0 {
            write!(f, ", {} malformed", self.malformed)?;
        }
        if let Some(why) = self.refused {
            write!(f, " ({why})")?;
        }
        if let Some(trouble) = &self.trouble {
            write!(f, ", {trouble}")?;
        }
        for object in &self.objects {
            write!(f, "\n  {object}")?;
        }
        Ok(())
    }
}

impl Display for FoundObject {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let TrackReport {
            frames,
            seen,
            doubled,
            missing,
            rate_hz,
            jitter_s,
            gaps,
            gap_max_s,
            latency_mean_s,
            ..
        } = self.report;
        write!(
            f,
            "{:<20} {rate_hz:6.1} Hz, jitter {:.1} ms, {gaps} gaps, longest {:.0} ms, latency ",
            format!("{:?}", self.name),
            1e3 * jitter_s,
            1e3 * gap_max_s
        )?;
        if latency_mean_s > 0.0 {
            write!(f, "{:.1} ms", 1e3 * latency_mean_s)?;
        } else {
            write!(f, "not reported")?;
        }
        let frames = frames + missing;
        if let Some([x, y, z]) = self.position_w_m {
            write!(f, ", seen in {seen} of {frames}, at {x:.3} {y:.3} {z:.3} m")?;
            if let Some(doubt) = unit_doubt([x, y, z], self.settings.has_frame()) {
                write!(f, ". {doubt}")?;
            }
        } else {
            write!(f, ", never seen in {frames} frames")?;
        }
        if watch::is_doubled(&self.report) {
            write!(f, "; TWO OBJECTS have this name, in {doubled} frames: rename one")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The advice on objects that were seen and moved so far, by name. m
    fn advice(objects: &[(&str, f64)]) -> String {
        let table = SourceArgument::usual(MocapKind::Relay, "a").table("any");
        let object = |(name, moved_m): &(&str, f64)| FoundObject {
            name: (*name).to_owned(),
            report: TrackReport { frames: 1, seen: 1, ..TrackReport::default() },
            position_w_m: Some([0.0; 3]),
            moved_m: *moved_m,
            settings: table.of_object(name),
        };
        Found { sources: vec![source(objects.iter().map(object).collect())] }.to_string()
    }

    fn source(objects: Vec<FoundObject>) -> FoundSource {
        FoundSource {
            kind: "relay",
            address: "a:51602".into(),
            is_there: true,
            announced_hz: None,
            messages: 1,
            malformed: 0,
            refused: None,
            is_open: true,
            trouble: None,
            objects,
        }
    }

    #[test]
    fn what_is_wrong_with_a_source_is_reported_beside_it() {
        let table = SourceArgument::usual(MocapKind::Relay, "a").table("any");
        let report =
            TrackReport { frames: 300, seen: 300, usual_hz: 100.0, ..TrackReport::default() };
        let object = FoundObject {
            name: "tello ".into(),
            report,
            position_w_m: Some([0.0; 3]),
            moved_m: 0.0,
            settings: table.of_object("tello "),
        };
        let wrong = FoundSource {
            announced_hz: Some(37.0),
            malformed: 7,
            refused: Some(Refusal::Rotation),
            ..source(vec![object])
        };
        let text = wrong.to_string();
        assert!(text.contains("announces 37 Hz, but 100.0 Hz come"), "{text}");
        assert!(
            text.contains("7 malformed (a rotation is none") && text.contains("\"tello \""),
            "{text}"
        );
        let silent = FoundSource { is_there: false, ..source(Vec::new()) }.to_string();
        assert!(silent.ends_with("open, but nothing comes"), "{silent}");
    }

    #[test]
    fn only_an_object_that_can_be_the_drone_is_suggested() {
        let one = advice(&[("tello", 0.0)]);
        assert!(one.contains("To fly \"tello\""), "{one}");
        let two = advice(&[("ball", 0.01), ("tello", 0.02)]);
        assert!(two.contains("2 objects were seen") && !two.contains("To fly"), "{two}");
        let moved = advice(&[("ball", 0.01), ("tello", 0.3)]);
        assert!(moved.contains("To fly \"tello\""), "{moved}");
        let both = advice(&[("ball", 0.2), ("tello", 0.3)]);
        assert!(both.contains("2 objects were seen"), "{both}");
        // The same object by two protocols.
        let twice = advice(&[("tello", 0.0), ("tello", 0.0)]);
        assert!(twice.contains("To fly \"tello\""), "{twice}");
    }
}
