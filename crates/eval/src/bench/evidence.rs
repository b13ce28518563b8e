//! What a check has shown, from its record: what changed when, after which order.

use horizon_model::angle::wrap;
use horizon_model::check::maximum;
use serde_json::{Value, json};

use super::checks::{Check, DroneEvidence};
use super::wire::{BenchEventKind, Event, Radians, Status};
use crate::display_rounding::to_thousandths;

/// A vehicle that is slower stands: reports have steps of 0.1 m/s.
const MOVED_MIN_MPS: f64 = 0.15;

/// Orders whose effect is looked for.
const ORDERS: [&str; 4] = ["take_off", "land", "emergency", "hello"];

/// The step in which the drone is landed whatever came before.
pub const ENDING: &str = "ending";

/// How a check ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EndingReport {
    /// Begin of the first ending, since the begin of the check. s
    pub began_s: f64,
    /// Whether the drone reported in the last ending that it is down.
    pub is_down: bool,
}

/// Numbers of a record, which `is_whole` unless the check was stopped, and whether the drone's reports agree with what
/// is expected; `null` where they prove nothing.
pub fn seen(
    check: &Check,
    is_whole: bool,
    events: &[Event],
    ending: Option<EndingReport>,
) -> Value {
    let ending_s = ending.map(|ending| ending.began_s);
    let is_before = |event: &&Event| ending_s.is_none_or(|ending_s| event.t_s < ending_s);
    let changes = changes(events);
    let answers = answers(events);
    let has_run = statuses(events).any(|(_, status)| status.is_running);
    let newest = statuses(events).take_while(|(t_s, _)| ending_s.is_none_or(|end_s| *t_s < end_s));
    let is_down = newest.last().is_some_and(|(_, status)| !status.is_running);
    let is_as_expected = match check.proof {
        _ if !is_whole => None,
        DroneEvidence::None => None,
        DroneEvidence::Down => has_run.then_some(is_down),
        DroneEvidence::NotDown => (has_run && !is_down).then_some(false),
        DroneEvidence::Answered => Some(answers.iter().all(|answer| !answer["after_s"].is_null())),
    };
    let times: Vec<f64> = statuses(events).map(|(t_s, _)| t_s).collect();
    let gap_s = times.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, maximum);
    let orders = events.iter().filter(is_before).filter(|event| order(event).is_some()).count();
    json!({
        "is_as_expected": is_as_expected,
        "changes": changes,
        "answers": answers,
        "steps": steps(events),
        "velocity": velocity(events),
        "turned_deg": turned_rad(events).map(|turned_rad| to_thousandths(turned_rad.to_degrees())),
        "height_m": range(statuses(events).filter_map(|(_, status)| status.height_m)),
        "battery_pct": statuses(events).last().and_then(|(_, status)| status.battery_pct),
        "statuses": times.len(),
        "longest_gap_s": to_thousandths(gap_s),
        "orders_before_the_ending": orders,
        "ending": ending.map(|EndingReport { began_s, is_down }| json!({
            "began_s": to_thousandths(began_s),
            "is_down": is_down,
            "lasted_s": to_thousandths(events.last().map_or(0.0, |event| event.t_s - began_s)),
        })),
    })
}

/// The lines of `seen` for people.
pub fn lines(seen: &Value) -> Vec<String> {
    let mut lines = vec![format!(
        "{} statuses, longest gap {} s, battery {} %, height {} m",
        seen["statuses"],
        shown(&seen["longest_gap_s"]),
        shown(&seen["battery_pct"]),
        shown(&seen["height_m"])
    )];
    for change in seen["changes"].as_array().into_iter().flatten() {
        lines.push(format!(
            "{} became {} at {} s, {} s after {}",
            change["what"], change["to"], change["t_s"], change["after_s"], change["after"]
        ));
    }
    for answer in seen["answers"].as_array().into_iter().flatten() {
        lines.push(format!(
            "{} #{} of {} s answered after {} s",
            answer["packet"], answer["sequence"], answer["t_s"], answer["after_s"]
        ));
    }
    let velocity = &seen["velocity"];
    lines.push(format!(
        "velocity: travelled {} m, extremes {} m/s, first 0.2 m/s at {} s",
        shown(&velocity["travelled_m"]),
        shown(&velocity["extremes_mps"]),
        shown(&velocity["moved_at_s"])
    ));
    if let Some(turned_deg) = seen["turned_deg"].as_f64() {
        lines.push(format!("heading: turned {turned_deg} degrees"));
    }
    for step in seen["steps"].as_array().into_iter().flatten() {
        lines.push(format!(
            "{:>7} s  flies {:<5}  height {:>5} m  velocity {} m/s  before: {}",
            shown(&step["t_s"]),
            shown(&step["is_flying"]),
            shown(&step["height_m"]),
            shown(&step["velocity_mps"]),
            step["step"].as_str().unwrap_or_default()
        ));
    }
    let is_as_expected = &seen["is_as_expected"];
    if !is_as_expected.is_null() {
        lines.push(format!("as expected by the drone's reports: {is_as_expected}"));
    }
    lines
}

/// A value for a person; a dash if there is none.
fn shown(value: &Value) -> String {
    if value.is_null() { "-".into() } else { value.to_string() }
}

fn statuses(events: &[Event]) -> impl Iterator<Item = (f64, Status)> {
    events.iter().filter_map(|event| match event.what {
        BenchEventKind::Status(status) => Some((event.t_s, status)),
        _ => None,
    })
}

/// The name of the order that `event` sends.
fn order(event: &Event) -> Option<&'static str> {
    match event.what {
        BenchEventKind::Sent { packet, .. } if ORDERS.contains(&packet) => Some(packet),
        _ => None,
    }
}

/// Each change of what the drone reports of flying and of its motors, with the first order of the newest kind
/// before it, or the ending.
fn changes(events: &[Event]) -> Vec<Value> {
    let mut changes = Vec::new();
    let (mut newest, mut before): (Option<(&str, f64)>, Option<Status>) = (None, None);
    for event in events {
        // The ending sends several orders in turn: none of them alone explains what follows.
        let is_ending = newest.is_some_and(|(name, _)| name == ENDING);
        let begins = match &event.what {
            BenchEventKind::Step(step) if step == ENDING => Some(ENDING),
            _ => order(event).filter(|_| !is_ending),
        };
        if let Some(order) = begins
            && newest.is_none_or(|(name, _)| name != order)
        {
            newest = Some((order, event.t_s));
        }
        let BenchEventKind::Status(status) = event.what else { continue };
        let was = before.replace(status).unwrap_or(status);
        for (what, was, is) in [
            ("is_flying", was.is_flying, status.is_flying),
            ("is_running", was.is_running, status.is_running),
        ] {
            if was != is {
                changes.push(json!({
                    "what": what,
                    "to": is,
                    "t_s": to_thousandths(event.t_s),
                    "after": newest.map(|(name, _)| name),
                    "after_s": newest.map(|(_, at_s)| to_thousandths(event.t_s - at_s)),
                }));
            }
        }
    }
    changes
}

/// Each numbered packet with the delay of its answer.
fn answers(events: &[Event]) -> Vec<Value> {
    let mut taken = vec![false; events.len()];
    let mut answers = Vec::new();
    for (i, event) in events.iter().enumerate() {
        let BenchEventKind::Sent { packet, sequence: Some(sent), .. } = event.what else {
            continue;
        };
        let is_answer = |what: &BenchEventKind| match *what {
            BenchEventKind::Ack { packet: of, sequence } => of == packet && sequence == sent,
            BenchEventKind::Version { sequence, .. } => packet == "version" && sequence == sent,
            _ => false,
        };
        let mut later = (i + 1)..events.len();
        let found = later.find(|j| !taken[*j] && is_answer(&events[*j].what));
        if let Some(j) = found {
            taken[j] = true;
        }
        answers.push(json!({
            "packet": packet,
            "sequence": sent,
            "t_s": to_thousandths(event.t_s),
            "after_s": found.map(|j| to_thousandths(events[j].t_s - event.t_s)),
        }));
    }
    answers
}

/// The last status of the drone before each step.
fn steps(events: &[Event]) -> Vec<Value> {
    let mut before: Option<Status> = None;
    let mut steps = Vec::new();
    for event in events {
        match &event.what {
            BenchEventKind::Status(status) => before = Some(*status),
            BenchEventKind::Step(step) => steps.push(json!({
                "t_s": to_thousandths(event.t_s),
                "step": step,
                "is_flying": before.map(|status| status.is_flying),
                "height_m": before.and_then(|status| status.height_m).map(to_thousandths),
                "velocity_mps": before.and_then(|status| status.velocity_d_mps).map(|v| v.map(to_thousandths)),
            })),
            _ => {}
        }
    }
    steps
}

/// Distance travelled and extremes of the reported velocity, and when it first reached 0.2 m/s.
fn velocity(events: &[Event]) -> Value {
    let (mut travelled_d_m, mut extremes_d_mps) = ([0.0; 3], [[0.0_f64; 2]; 3]);
    let mut moved_at_s = None;
    let mut before: Option<(f64, [f64; 3])> = None;
    for (t_s, status) in statuses(events) {
        let Some(velocity_d_mps) = status.velocity_d_mps else { continue };
        if let Some((before_s, was_d_mps)) = before {
            // Of a gap in the reports half a second counts at most: nothing is known of the rest.
            let dt_s = (t_s - before_s).min(0.5);
            for (distance_m, speed_mps) in travelled_d_m.iter_mut().zip(was_d_mps) {
                *distance_m += speed_mps * dt_s;
            }
        }
        for ([least, most], speed_mps) in extremes_d_mps.iter_mut().zip(velocity_d_mps) {
            (*least, *most) = (least.min(speed_mps), most.max(speed_mps));
        }
        if velocity_d_mps.iter().any(|speed_mps| speed_mps.abs() > MOVED_MIN_MPS) {
            moved_at_s.get_or_insert(to_thousandths(t_s));
        }
        before = Some((t_s, velocity_d_mps));
    }
    json!({
        "is_present": extremes_d_mps.iter().flatten().any(|speed_mps| *speed_mps != 0.0),
        "travelled_m": travelled_d_m.map(to_thousandths),
        "extremes_mps": extremes_d_mps.map(|range| range.map(to_thousandths)),
        "moved_at_s": moved_at_s,
    })
}

/// Turn by the reported heading, as the drone counts it; `null` if it reports none. rad
fn turned_rad(events: &[Event]) -> Option<f64> {
    let headings = events.iter().filter_map(|event| match event.what {
        BenchEventKind::Heading(yaw) => Some(yaw),
        BenchEventKind::Status(status) => status.yaw,
        _ => None,
    });
    let mut before_rad = None;
    let turns_rad = headings
        .map(|Radians(yaw_rad)| wrap(yaw_rad - before_rad.replace(yaw_rad).unwrap_or(yaw_rad)));
    turns_rad.reduce(|sum_rad, turn_rad| sum_rad + turn_rad)
}

/// Least and largest value; `null` without any.
fn range(values: impl Iterator<Item = f64>) -> Option<[f64; 2]> {
    values.fold(None, |range, value| {
        let [least, most] = range.unwrap_or([value; 2]);
        Some([least.min(value), most.max(value)])
    })
}

#[cfg(test)]
mod tests;
