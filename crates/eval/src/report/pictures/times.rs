//! The figures of one flight over its time.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose, stick};
use horizon_model::{Kinematic, Model, Row};
use tello_flight::Phase;

use crate::figure::{self, Figure, TimeBars, TimeLine, TimePanel, TimeSpans};
use crate::recordings::ticks::TickRow;
use crate::report::assessment::is_faulty;
use crate::report::flight::Flight;
use crate::report::group::EvaluatedFlight;

/// The sum of inputs begins anew at the state so often, so that both fit on one axis. s
const SUM_S: f64 = 5.0;

/// Label of the intervals in which the link monitor judges that sent sticks have no effect.
const LINK_DOWN: &str = "sticks do not act";

fn is_link_down(tick: &TickRow) -> bool {
    tick.is_link_down == Some(true)
}

/// Panels with a band for the time in which sent sticks did not act, and one for that of a fault, if there was any.
fn with_bands(title: &str, flight: &Flight, panels: &[TimePanel<'_>]) -> Figure {
    let named = [(LINK_DOWN, spans_s(flight, is_link_down)), ("fault", spans_s(flight, is_faulty))];
    let occurred = named.into_iter().filter(|(_, spans_s)| !spans_s.is_empty());
    let bands = occurred.map(|(name, spans_s)| TimeBars { name: name.to_owned(), spans_s });
    let spans = TimeSpans { bars: Vec::new(), bands: bands.collect() };
    figure::over_time(title, &times_s(flight), panels, &spans)
}

fn times_s(flight: &Flight) -> Vec<f64> {
    flight.ticks.iter().map(|tick| flight.time_s(tick)).collect()
}

/// A row of `pick`ed poses over time, NaN where there is none.
fn row(flight: &Flight, row: usize, pick: impl Fn(&TickRow) -> Option<Pose>) -> Vec<f64> {
    flight.ticks.iter().map(|tick| pick(tick).map_or(f64::NAN, |at| at[row])).collect()
}

/// State, prediction, cumulative input and reference, and below them the distance from the reference.
pub(super) fn states(title: &str, flight: &Flight) -> Figure {
    let sums = cumulative_input(flight);
    let line = |name, values, is_reference| TimeLine { name, values, is_reference };
    let panel = |(k, of): (usize, Row)| {
        let state = row(flight, k, |tick| tick.estimate);
        let mut wanted = row(flight, k, |tick| tick.reference.or(tick.target));
        if k == pose::THETA {
            for (wanted, near) in wanted.iter_mut().zip(&state).filter(|(_, near)| near.is_finite())
            {
                *wanted = unwrap_near(*wanted, *near);
            }
        }
        let sum = sums.iter().map(|sum| sum.map_or(f64::NAN, |sum| sum[k])).collect();
        let lines = vec![
            line("reference", wanted, true),
            line("state", state, false),
            line("prediction", row(flight, k, |tick| tick.prediction), false),
            line("cumulative input", sum, false),
        ];
        TimePanel { name: of.name, unit: of.unit, lines }
    };
    let error = line("distance", flight.ticks.iter().map(error_m).collect(), false);
    let error = TimePanel { name: "error", unit: "m", lines: vec![error] };
    let panels: Vec<_> =
        Kinematic::STATE.into_iter().enumerate().map(panel).chain([error]).collect();
    with_bands(title, flight, &panels)
}

/// Distance of the estimate from the reference; NaN without one of them, and where the vehicle does not follow it: a
/// landing would be all that is seen. m
fn error_m(tick: &TickRow) -> f64 {
    let is_followed = matches!(tick.phase, None | Some(Phase::Flying));
    let pair = tick.estimate.zip(tick.reference.or(tick.target)).filter(|_| is_followed);
    pair.map_or(f64::NAN, |(at, wanted)| (at - wanted).fixed_rows::<3>(pose::X).norm())
}

/// Equation 5.1 for every row: the sticks summed up from the state, anew every [`SUM_S`].
fn cumulative_input(flight: &Flight) -> Vec<Option<Pose>> {
    let (mut sum, mut begun_s): (Option<Pose>, f64) = (None, f64::NEG_INFINITY);
    let of_tick = |tick: &TickRow| {
        let now_s = flight.time_s(tick);
        let (Some(at), Some(p)) = (tick.estimate, tick.param) else {
            sum = None;
            return None;
        };
        let mut from = match sum {
            Some(sum) if now_s - begun_s < SUM_S => sum,
            _ => {
                begun_s = now_s;
                at
            }
        };
        let shown = from;
        // The direction is that of the vehicle, not that of the sum.
        let theta = std::mem::replace(&mut from[pose::THETA], at[pose::THETA]);
        let u = tick.u_sent.unwrap_or_default();
        let mut next = Kinematic.step(&from, &u, &p, flight.dt_s);
        next[pose::THETA] += theta - at[pose::THETA];
        sum = Some(next);
        (now_s > begun_s).then_some(shown) // a gap where the sum begins anew
    };
    flight.ticks.iter().map(of_tick).collect()
}

/// Sticks that were sent.
pub(super) fn sticks(title: &str, flight: &Flight) -> Figure {
    let names = [
        (stick::ROLL, "roll"),
        (stick::PITCH, "pitch"),
        (stick::YAW, "yaw"),
        (stick::THROTTLE, "throttle"),
    ];
    let panels = names.map(|(k, name)| {
        let sent = flight.ticks.iter().map(|tick| tick.u_sent.map_or(f64::NAN, |u| u[k]));
        let line = TimeLine { name: "sent", values: sent.collect(), is_reference: false };
        TimePanel { name, unit: "1", lines: vec![line] }
    });
    with_bands(title, flight, &panels)
}

/// Estimated parameters.
pub(super) fn parameters(title: &str, flight: &Flight) -> Figure {
    let panel = |(k, row): (usize, Row)| {
        let values = flight.ticks.iter().map(|tick| tick.param.map_or(f64::NAN, |p| p[k]));
        let line = TimeLine { name: "estimate", values: values.collect(), is_reference: false };
        TimePanel { name: row.name, unit: row.unit, lines: vec![line] }
    };
    let panels: Vec<_> = Kinematic::PARAMETER.into_iter().enumerate().map(panel).collect();
    figure::over_time(title, &times_s(flight), &panels, &TimeSpans::default())
}

/// Times of the loop, and bars for the part of the flight, the link and each fault.
pub(super) fn the_loop(title: &str, looked: &EvaluatedFlight) -> Figure {
    let flight = &looked.flight;
    let timing = |pick: fn(&tello_flight::cycle::Timing) -> i64| -> Vec<f64> {
        let ms =
            |tick: &TickRow| tick.timing.map_or(f64::NAN, |timing| pick(&timing) as f64 * 1e-6);
        flight.ticks.iter().map(ms).collect()
    };
    let solve_ms = timing(|timing| timing.estimate_ns + timing.plan_ns);
    let late_ms = timing(|timing| timing.late_ns);
    let age_ms = |tick: &TickRow| tick.mocap_age_s.map_or(f64::NAN, |age_s| age_s * 1e3);
    let age_ms = flight.ticks.iter().map(age_ms).collect();
    let panels =
        [("solve", solve_ms), ("late", late_ms), ("mocap age", age_ms)].map(|(name, values)| {
            let line = TimeLine { name: "each tick", values, is_reference: false };
            TimePanel { name, unit: "ms", lines: vec![line] }
        });
    let is_flown = |tick: &TickRow| tick.phase == Some(Phase::Flying);
    let bar = |name: &str, spans_s| TimeBars { name: name.to_owned(), spans_s };
    let mut bars = vec![
        bar("flown by the controller", spans_s(flight, is_flown)),
        bar(LINK_DOWN, spans_s(flight, is_link_down)),
    ];
    for fault in &looked.row.faults {
        let is_present =
            |tick: &TickRow| tick.faults.iter().any(|name| name.replace('_', " ") == fault.name);
        bars.push(bar(&format!("fault: {}", fault.name), spans_s(flight, is_present)));
    }
    let spans = TimeSpans { bars, bands: Vec::new() };
    figure::over_time(title, &times_s(flight), &panels, &spans)
}

/// From when to when `is_true` holds. s
fn spans_s(flight: &Flight, is_true: impl Fn(&TickRow) -> bool) -> Vec<(f64, f64)> {
    let runs = flight.ticks.chunk_by(|a, b| is_true(a) == is_true(b));
    let true_runs = runs.filter(|run| run.first().is_some_and(&is_true));
    true_runs
        .filter_map(|run| {
            Some((flight.time_s(run.first()?), flight.time_s(run.last()?) + flight.dt_s))
        })
        .collect()
}

#[cfg(test)]
mod tests;
