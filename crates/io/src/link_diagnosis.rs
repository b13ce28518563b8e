//! What is wrong with the links of motion capture and drone, by their counters.
//!
//! For the list before a flight, for a flight that does not begin, and for its summary.

use tello_flight::cycle::SIGHTING_AGE_MAX;
use tello_flight::{Acceptance, Filtered};

use crate::config::FlyTable;
use crate::mocap::{MocapCounters, MocapKind, MocapTable, SincePose, StreamReport};
use crate::tello::Protocol;

/// Fewer frames without a pose are those that any source has now and then.
const HIDDEN_MIN: u64 = 10;

/// Headings that are refused for less time end no flight: `lost_s` is 2 s. s
const REFUSED_MIN_S: f64 = 1.5;

/// Smaller differences of a counted rate are jitter. 1
const RATE_APART_MIN: f64 = 3e-3;
/// Smaller ones may be: delays that change by 0.1 s cause 0.6 %. 1
const RATE_APART_SURE: f64 = 8e-3;

/// Message on a mocap stream that shows no drone: the first of these that applies.
pub fn mocap_trouble(table: &FlyTable, counters: &MocapCounters) -> String {
    let report = counters.report();
    let messages = counters.messages.get();
    let (key, address) = table.mocap.address();
    let object = table.mocap.object();
    unintelligible(counters, address)
        .or_else(|| unconnected(counters, key, address))
        .or_else(|| misnumbered(&report, object))
        .or_else(|| wrong_rate(&report, counters.announced_hz(), &table.mocap))
        .or_else(|| too_old(&report))
        .or_else(|| silent(messages, address))
        .or_else(|| unnamed(counters, object))
        .or_else(|| empty(&report, counters, address))
        // A drone that was seen for less than the 2 s that a clock takes is no fault of its source.
        .or_else(|| undated(&report, object).filter(|_| report.undated > 0))
        .unwrap_or_else(|| unseen(table, counters, &report))
}

/// Message if the source sent something that is not of its protocol.
fn unintelligible(counters: &MocapCounters, address: &str) -> Option<String> {
    let error = counters.given_up()?;
    Some(format!("{address} cannot be understood: {error}"))
}

/// Message if there was no connection.
fn unconnected(counters: &MocapCounters, key: &str, address: &str) -> Option<String> {
    (counters.connects.get() == 0).then(|| match counters.unopened() {
        None => format!("no pose, nobody is at {address}: is the system running, is {key} right?"),
        Some(why) => format!("no pose, {address} cannot be opened: {why}; is {key} right?"),
    })
}

/// Message if no message came.
fn silent(messages: u64, address: &str) -> Option<String> {
    (messages == 0)
        .then(|| format!("no pose, nothing comes from {address}: is the mocap system live?"))
}

/// Message if messages come and none of them has an object.
fn empty(report: &StreamReport, counters: &MocapCounters, address: &str) -> Option<String> {
    ([report.frames, report.other_object, report.malformed] == [0; 3]).then(|| {
        let messages = counters.messages.get();
        let answers = format!("{address} answers, {messages} messages, but");
        match counters.unopened() {
            Some(why) => format!("{answers} {why}"),
            None => format!(
                "{answers} no frame with an object comes: is streaming on, is the drone seen, does a firewall or a \
                 network without multicast keep frames back?"
            ),
        }
    })
}

/// Message for a stream in which the drone is seen, and nothing shows when.
pub fn undated(report: &StreamReport, object: &str) -> Option<String> {
    (report.frames > report.unseen && !report.has_clock).then(|| {
        format!(
            "{object:?} is seen, but its frame numbers and stamps do not keep pace with time: its poses cannot be dated"
        )
    })
}

/// Message for a stream that has objects, but not the drone.
fn unseen(table: &FlyTable, counters: &MocapCounters, report: &StreamReport) -> String {
    format!(
        "{} messages, {} of them of other objects, {} malformed{}: is the object's name ({:?}) right (tello-ctl mocap \
         list shows all), is the drone seen, is its z above cycle.filter.floor_m = {} m?",
        counters.messages.get(),
        report.other_object,
        report.malformed,
        counters.refused().map_or_else(String::new, |why| format!(" ({why})")),
        table.mocap.object(),
        table.cycle.filter.floor_m,
    )
}

/// Message if frames come at another rate than the source announces, or than the settings state for it.
pub fn wrong_rate(
    report: &StreamReport,
    announced_hz: Option<f64>,
    mocap: &MocapTable,
) -> Option<String> {
    let (count_hz, announced_hz) = report.count_hz.zip(announced_hz)?;
    let apart = (count_hz / announced_hz - 1.0).abs();
    if report.has_clock || apart < RATE_APART_MIN {
        return None;
    }
    let doubt = if apart < RATE_APART_SURE { " (or its network delays them unevenly)" } else { "" };
    let announced_hz = (announced_hz * 1e2).round() / 1e2;
    let kind = mocap.kind();
    let (who, what) = if kind.has_set_rate() {
        let what = if kind == MocapKind::Vrpn {
            "write the rate that the system is set to; if it is, the clock of its time stamps does not keep pace"
        } else {
            "write the rate that the system is set to"
        };
        (format!("mocap.{}.rate_hz is", kind.name()), what)
    } else {
        ("its source announces".to_owned(), "set the rate of the system right")
    };
    Some(format!(
        "{who} {announced_hz} Hz, counted are {count_hz:.1} Hz{doubt}: {what}, or the frames come with a delay that grows"
    ))
}

/// Message if frame numbers stand still, or if one has two places.
pub fn misnumbered(report: &StreamReport, object: &str) -> Option<String> {
    if report.frames <= 1 && report.repeated > 0 {
        let reason = "its frame numbers or time stamps stand still: its poses cannot be dated";
        return Some(reason.into());
    }
    // A server that starts anew may send one frame twice.
    (20 * report.doubled > report.frames + report.doubled).then(|| {
        format!(
            "two objects are called {object:?}, in {} frames: which of them is the drone?",
            report.doubled
        )
    })
}

/// Why poses ended in a flight, if the frames since the newest one show it.
pub fn hidden(since: SincePose, object: &str) -> Option<String> {
    let SincePose { other_object, unnamed, doubled, repeated, frames, undated } = since;
    let most = other_object.max(unnamed).max(doubled);
    Some(match most {
        // Other objects of an undated frame, or two places of one number, show nothing.
        _ if undated >= HIDDEN_MIN => format!(
            "{undated} frames of unknown time: was the recording begun anew, or the clock of the source set?"
        ),
        _ if frames == 0 && repeated >= HIDDEN_MIN => {
            format!("{repeated} frames with one number: frame numbers or time stamps stand still")
        }
        0..HIDDEN_MIN => return None,
        _ if most == doubled => {
            format!("{doubled} frames with two objects that are called {object:?}")
        }
        _ if most == unnamed => format!("{unnamed} frames with bodies that have no name"),
        _ => format!(
            "{other_object} frames with other objects only: was {object:?} renamed, or left out?"
        ),
    })
}

/// For how long headings were refused while positions were accepted.
#[derive(Debug, Default)]
pub struct RefusedHeadings {
    /// Since the newest heading that was accepted: later poses that end have another reason. s
    present_s: f64,
}

impl RefusedHeadings {
    /// Takes in the result of the filter in a tick of `dt_s`.
    pub fn add(&mut self, filtered: Option<Filtered>, dt_s: f64) {
        match filtered.map(|it| (it.position, it.heading)) {
            Some((Acceptance::Accepted, Acceptance::Held)) => self.present_s += dt_s,
            Some((_, Acceptance::Accepted)) => self.present_s = 0.0,
            _ => {}
        }
    }

    /// Why poses ended, if headings were refused for so long.
    pub fn reason(&self) -> Option<String> {
        (self.present_s > REFUSED_MIN_S).then(|| {
            format!(
                "headings refused for {:.1} s beside good positions: is the pattern of the markers symmetric?",
                self.present_s
            )
        })
    }
}

/// Message if a source sends bodies and has named none of them so far.
fn unnamed(counters: &MocapCounters, object: &str) -> Option<String> {
    (counters.sightings.get() == 0 && counters.unnamed.get() > 0).then(|| {
        format!(
            "no pose, the mocap system sends bodies and none that it names: is {object:?} among its rigid bodies? \
             object: \"#7\" means the one with the streaming identity 7 (tello-ctl mocap list shows all)"
        )
    })
}

/// Message if poses arrive older than those that count.
pub fn too_old(report: &StreamReport) -> Option<String> {
    let limit_s = SIGHTING_AGE_MAX.seconds();
    (report.latency_mean_s > limit_s).then(|| {
        format!(
            "poses are {:.2} s old when they arrive, in the mean, by the delay that their source announces or by the \
             clock; older ones than {limit_s} s do not count",
            report.latency_mean_s
        )
    })
}

/// Message on a drone without a status that has sent so many packets.
pub fn drone_trouble(table: &FlyTable, packets: u64) -> String {
    if packets > 0 {
        let address = &table.tello.address;
        let port = match table.tello.state_port {
            0 => "the free UDP port that tello.state_port = 0 takes".into(),
            port => format!("UDP port {port}"),
        };
        return match table.tello.protocol {
            Protocol::Binary => format!("{address} answers, but sends no status of its flight"),
            Protocol::Text => format!(
                "{address} answers, but does not report whether it flies: no state line with `bat`, and `time` or \
                 `tof`, comes to {port} of this machine; a firewall? Only SDK 3.0 sends to another port than 8890"
            ),
        };
    }
    format!(
        "it does not answer on {}: is it on, is this machine in its Wi-Fi, is no other program talking to \
         it? One that was spoken to in another protocol than tello.protocol has to be switched off and on.",
        table.tello.address
    )
}

#[cfg(test)]
mod tests;
