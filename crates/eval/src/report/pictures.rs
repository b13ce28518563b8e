//! The figures of a report, each with its caption.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose, stick};
use horizon_model::{Kinematic, Model};

use super::flight::Flight;
use super::group::{Group, Looked};
use super::quantity::Quantity;
use crate::figure::{
    self, AlongPath, Figure, SeenFlights, SeenInSpace, TimeBars, TimeLine, TimePanel,
};
use crate::metrics::PathProgress;
use crate::recordings::ticks::TickRow;

/// The sum of inputs begins anew at the state so often, so that both fit on one axis. s
const SUM_S: f64 = 5.0;

/// A figure with what a reader needs to understand it.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    /// Name of its file, without ending.
    pub name: String,
    pub caption: String,
    pub figure: Figure,
}

/// Figures of all flights together.
pub(super) fn of_groups(groups: &[Group]) -> Vec<Picture> {
    let mut pictures = vec![from_above("all-above", "Flights from above", groups)];
    let progress: Vec<Vec<f64>> = groups.iter().map(progress).collect();
    let along = |quantity: Quantity| -> Vec<Vec<f64>> {
        groups.iter().map(|group| samples(group, quantity)).collect()
    };
    if progress.iter().all(Vec::is_empty) {
        return pictures;
    }
    let marks = targets(groups);
    let ways = |values: &[Vec<f64>]| -> Figure {
        let groups: Vec<_> = ways(groups, &progress, values);
        figure::density_over_progress("Where the time was spent", &marks, &groups)
    };
    pictures.push(Picture {
        name: "all-density".into(),
        caption: "Density of the samples over the progress along the line (thesis figure 5.6): a Gaussian kernel \
                  estimate with Scott's bandwidth. Where it is high, the vehicle was slow."
            .into(),
        figure: ways(&progress),
    });
    let band = |quantity: Quantity, name: &str, caption: &str| {
        let (quantity_name, unit, _) = quantity.label();
        let (title, values) = (format!("{quantity_name} over progress"), along(quantity));
        let groups = self::ways(groups, &progress, &values);
        Picture {
            name: format!("all-{name}"),
            caption: caption.into(),
            figure: figure::band_over_progress(&title, (quantity_name, unit), &marks, &groups),
        }
    };
    pictures.push(band(
        Quantity::DistanceM,
        "distance",
        "Horizontal distance to the line over the progress along it (thesis figure 5.7): median and the band that \
         holds 95 % of the samples in each of 75 parts of the line.",
    ));
    pictures.push(band(
        Quantity::InputNorm,
        "input",
        "Norm of the four sticks over the progress along the line (thesis figure 5.8): median and the band that \
         holds 95 % of the samples in each of 75 parts of the line.",
    ));
    pictures
}

/// Figures of one flight. `prefix` makes the names of their files unique.
pub(super) fn of_flight(looked: &Looked, prefix: &str) -> Vec<Picture> {
    let flight = &looked.flight;
    let picture = |name: &str, caption: &str, figure| Picture {
        name: format!("{prefix}-{name}"),
        caption: caption.to_owned(),
        figure,
    };
    let finish = looked.row.numbers.get(&Quantity::FinishS);
    let flown = finish.map_or_else(String::new, |finish| format!(" ({:.2} s)", finish.median));
    let title = format!("{}{flown}", flight.name);
    let mut pictures = vec![
        picture(
            "space",
            "The flight in space (thesis figures 5.4, 5.9, 5.10), its shadow on the floor, and the reference dashed. \
             Time from first to last target in brackets.",
            in_space(&title, flight),
        ),
        picture("above", "The same from above.", above(&title, looked)),
        picture(
            "state",
            "State, its prediction over the dead time, drawn when it was made, and the cumulative input of equation \
             5.1 (thesis figure 5.5): the sticks summed up by equation 4.1 with the parameters of the moment. The sum \
             begins anew at the state every 5 s. Dead time, lag and drift, which equation 4.1 lacks, move the sum up to a \
             metre from the state on a good flight. Below: the distance of the state from the reference.",
            states(&title, flight),
        ),
        picture("sticks", "Sticks that were sent, each in -1..1.", sticks(&title, flight)),
    ];
    if flight.ticks.iter().any(|tick| tick.param.is_some()) {
        let caption = "Parameters as estimated in flight; constant where they were held.";
        pictures.push(picture("parameters", caption, parameters(&title, flight)));
    }
    if flight.ticks.iter().any(|tick| tick.timing.is_some()) {
        let caption = "The loop: time of estimator and controller, how late each tick began, how old its mocap sample \
                       was, and below when the vehicle was flown, when sent sticks did not act (by the link monitor), \
                       and each fault.";
        pictures.push(picture("loop", caption, the_loop(&title, looked)));
    }
    pictures
}

/// Flights that stand for all: every one of four or less, else the fastest, the middle one, the slowest
/// and the one that was farthest from its line.
pub(super) fn shown(group: &Group) -> Vec<&Looked> {
    if group.looked.len() <= 4 {
        return group.looked.iter().collect();
    }
    let number =
        |looked: &&Looked, quantity| looked.row.numbers.get(&quantity).map(|spread| spread.max);
    let sorted = |quantity| -> Vec<&Looked> {
        let mut looked: Vec<&Looked> =
            group.looked.iter().filter(|one| number(one, quantity).is_some()).collect();
        let value = |one: &Looked| number(&one, quantity).unwrap_or(f64::NAN);
        looked.sort_by(|a, b| value(a).total_cmp(&value(b)));
        looked
    };
    let (by_time, by_distance) = (sorted(Quantity::FinishS), sorted(Quantity::DistanceM));
    let mut shown: Vec<&Looked> = Vec::new();
    let ends =
        [by_time.first(), by_time.get(by_time.len() / 2), by_time.last(), by_distance.last()];
    for looked in ends.into_iter().flatten().copied() {
        if !shown.iter().any(|one| one.row.file == looked.row.file) {
            shown.push(looked);
        }
    }
    if shown.is_empty() { group.looked.iter().take(4).collect() } else { shown }
}

fn progress(group: &Group) -> Vec<f64> {
    group.looked.iter().flat_map(|looked| looked.measured.progress.iter().copied()).collect()
}

/// Samples of the flights that have a progress.
fn samples(group: &Group, quantity: Quantity) -> Vec<f64> {
    let with_line = group.looked.iter().filter(|looked| !looked.measured.progress.is_empty());
    with_line
        .filter_map(|looked| looked.measured.numbers.get(&quantity))
        .flat_map(|values| values.iter().copied())
        .collect()
}

fn ways<'a>(
    groups: &'a [Group],
    progress: &'a [Vec<f64>],
    values: &'a [Vec<f64>],
) -> Vec<AlongPath<'a>> {
    let way = |((group, progress), values): ((&'a Group, &'a Vec<f64>), &'a Vec<f64>)| AlongPath {
        name: &group.name,
        progress,
        values,
    };
    groups.iter().zip(progress).zip(values).map(way).collect()
}

/// Progresses of the inner targets of the first flight with a line.
fn targets(groups: &[Group]) -> Vec<f64> {
    let mut flights = groups.iter().flat_map(|group| &group.looked).map(|looked| &looked.flight);
    let Some(flight) = flights.find(|flight| !flight.outline.is_empty()) else { return Vec::new() };
    let Some(way) = PathProgress::new(&flight.outline) else { return Vec::new() };
    let inner = flight.targets.iter().skip(1).take(flight.targets.len().saturating_sub(2));
    inner.map(|target| way.place(target).progress).collect()
}

fn horizontal(poses: &[Pose]) -> Vec<(f64, f64)> {
    poses.iter().map(|at| (at[pose::X], at[pose::Y])).collect()
}

fn track(ticks: &[TickRow]) -> Vec<Pose> {
    ticks.iter().filter_map(|tick| tick.estimate).collect()
}

fn from_above(name: &str, title: &str, groups: &[Group]) -> Picture {
    let of_group = |group: &Group| {
        let mut outlines: Vec<&[Pose]> = Vec::new();
        for outline in group.looked.iter().map(|looked| looked.flight.outline.as_slice()) {
            if !outlines.contains(&outline) {
                outlines.push(outline);
            }
        }
        // Between two lines there is a gap.
        let gap = vec![(f64::NAN, f64::NAN)];
        let with_gap = |outline: &[Pose]| [horizontal(outline), gap.clone()].concat();
        let outline: Vec<_> = outlines.into_iter().flat_map(with_gap).collect();
        let tracks =
            group.looked.iter().map(|looked| horizontal(&track(looked.flight.judged_ticks())));
        (outline, tracks.collect::<Vec<_>>())
    };
    let drawn: Vec<_> = groups.iter().map(of_group).collect();
    let tracks: Vec<Vec<&[(f64, f64)]>> =
        drawn.iter().map(|(_, tracks)| tracks.iter().map(Vec::as_slice).collect()).collect();
    let seen: Vec<_> = groups
        .iter()
        .zip(&drawn)
        .zip(&tracks)
        .map(|((group, (outline, _)), tracks)| SeenFlights { name: &group.name, outline, tracks })
        .collect();
    Picture {
        name: name.to_owned(),
        caption: "Every flight from above, from its first target to its last, over the \
                  lines that they followed, dashed (thesis figure 5.4)."
            .to_owned(),
        figure: figure::tracks(title, &seen),
    }
}

fn above(title: &str, Looked { flight, .. }: &Looked) -> Figure {
    let track = horizontal(&track(flight.judged_ticks()));
    let outline = horizontal(&flight.outline);
    let seen = flight.judged_ticks().iter().filter(|tick| tick.estimate.is_some());
    let times: Vec<f64> = seen.map(|tick| flight.time_s(tick)).collect();
    figure::tracks(title, &[SeenFlights { name: "flight", outline: &outline, tracks: &[&track] }])
        .with_times(&times, &track)
}

fn in_space(title: &str, flight: &Flight) -> Figure {
    let places = |poses: &[Pose]| -> Vec<[f64; 3]> {
        poses.iter().map(|at| [at[pose::X], at[pose::Y], at[pose::Z]]).collect()
    };
    let (outline, track) = (places(&flight.outline), places(&track(flight.judged_ticks())));
    figure::space(title, &SeenInSpace { outline: &outline, track: &track })
}

fn times_s(flight: &Flight) -> Vec<f64> {
    flight.ticks.iter().map(|tick| flight.time_s(tick)).collect()
}

/// A row of `pick`ed poses over time, NaN where there is none.
fn row(flight: &Flight, row: usize, pick: impl Fn(&TickRow) -> Option<Pose>) -> Vec<f64> {
    flight.ticks.iter().map(|tick| pick(tick).map_or(f64::NAN, |at| at[row])).collect()
}

fn states(title: &str, flight: &Flight) -> Figure {
    let sums = cumulative_input(flight);
    let columns: Vec<[Vec<f64>; 4]> = (0..pose::COUNT)
        .map(|k| {
            let state = row(flight, k, |tick| tick.estimate);
            let mut wanted = row(flight, k, |tick| tick.reference.or(tick.target));
            if k == pose::THETA {
                for (wanted, near) in
                    wanted.iter_mut().zip(&state).filter(|(_, near)| near.is_finite())
                {
                    *wanted = unwrap_near(*wanted, *near);
                }
            }
            let sum = sums.iter().map(|sum| sum.map_or(f64::NAN, |sum| sum[k])).collect();
            [state, row(flight, k, |tick| tick.prediction), sum, wanted]
        })
        .collect();
    let lines: Vec<[TimeLine<'_>; 4]> = columns
        .iter()
        .map(|[state, prediction, sum, wanted]| {
            let line = |name, values, is_reference| TimeLine { name, values, is_reference };
            [
                line("reference", wanted, true),
                line("state", state, false),
                line("prediction", prediction, false),
                line("cumulative input", sum, false),
            ]
        })
        .collect();
    let error_m: Vec<f64> = flight.ticks.iter().map(error_m).collect();
    let error = [TimeLine { name: "distance", values: &error_m, is_reference: false }];
    let rows = Kinematic::STATE.iter().zip(&lines);
    let rows = rows.map(|(row, lines)| TimePanel { name: row.name, unit: row.unit, lines });
    let error = TimePanel { name: "error", unit: "m", lines: &error };
    figure::over_time(title, &times_s(flight), &rows.chain([error]).collect::<Vec<_>>(), &[])
}

/// Distance of the estimate from the reference, NaN without one of them. m
fn error_m(tick: &TickRow) -> f64 {
    let pair = tick.estimate.zip(tick.reference.or(tick.target));
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

fn sticks(title: &str, flight: &Flight) -> Figure {
    let column = |k: usize| -> Vec<f64> {
        flight.ticks.iter().map(|tick| tick.u_sent.map_or(f64::NAN, |u| u[k])).collect()
    };
    let names = [
        (stick::ROLL, "roll"),
        (stick::PITCH, "pitch"),
        (stick::YAW, "yaw"),
        (stick::THROTTLE, "throttle"),
    ];
    let columns = names.map(|(k, name)| (name, column(k)));
    let lines = columns
        .each_ref()
        .map(|(_, values)| [TimeLine { name: "sent", values, is_reference: false }]);
    let panels: Vec<_> = columns
        .iter()
        .zip(&lines)
        .map(|((name, _), lines)| TimePanel { name, unit: "1", lines })
        .collect();
    figure::over_time(title, &times_s(flight), &panels, &[])
}

fn parameters(title: &str, flight: &Flight) -> Figure {
    let columns: Vec<Vec<f64>> = (0..Kinematic::PARAMETER.len())
        .map(|k| flight.ticks.iter().map(|tick| tick.param.map_or(f64::NAN, |p| p[k])).collect())
        .collect();
    let lines: Vec<_> = columns
        .iter()
        .map(|values| [TimeLine { name: "estimate", values, is_reference: false }])
        .collect();
    let panels: Vec<_> = Kinematic::PARAMETER
        .iter()
        .zip(&lines)
        .map(|(row, lines)| TimePanel { name: row.name, unit: row.unit, lines })
        .collect();
    figure::over_time(title, &times_s(flight), &panels, &[])
}

fn the_loop(title: &str, looked: &Looked) -> Figure {
    let flight = &looked.flight;
    let timing = |pick: fn(&tello_flight::cycle::Timing) -> i64| -> Vec<f64> {
        let ms =
            |tick: &TickRow| tick.timing.map_or(f64::NAN, |timing| pick(&timing) as f64 * 1e-6);
        flight.ticks.iter().map(ms).collect()
    };
    let solve_ms = timing(|timing| timing.estimate_ns + timing.plan_ns);
    let late_ms = timing(|timing| timing.late_ns);
    let age_ms: Vec<f64> = flight
        .ticks
        .iter()
        .map(|tick| tick.mocap_age_s.map_or(f64::NAN, |age_s| age_s * 1e3))
        .collect();
    let line = |values| [TimeLine { name: "each tick", values, is_reference: false }];
    let [solve, late, age] = [line(&solve_ms), line(&late_ms), line(&age_ms)];
    let panels = [
        TimePanel { name: "solve", unit: "ms", lines: &solve },
        TimePanel { name: "late", unit: "ms", lines: &late },
        TimePanel { name: "mocap age", unit: "ms", lines: &age },
    ];
    let is_flown = |tick: &TickRow| tick.phase == Some(tello_flight::Phase::Flying);
    let mut named = vec![
        ("flown by the controller".to_owned(), spans_s(flight, is_flown)),
        ("sticks do not act".to_owned(), spans_s(flight, |tick| tick.is_link_down == Some(true))),
    ];
    for fault in &looked.row.faults {
        let is_present =
            |tick: &TickRow| tick.faults.iter().any(|name| name.replace('_', " ") == fault.name);
        named.push((format!("fault: {}", fault.name), spans_s(flight, is_present)));
    }
    let bars: Vec<_> = named.iter().map(|(name, spans_s)| TimeBars { name, spans_s }).collect();
    figure::over_time(title, &times_s(flight), &panels, &bars)
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
