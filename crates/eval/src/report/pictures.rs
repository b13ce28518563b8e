//! The figures of a report, each with its caption.

mod times;

use horizon_model::rows::{Pose, pose};

use super::flight::Flight;
use super::group::{EvaluatedFlight, Group};
use super::quantity::{Measured, Quantity};
use crate::figure::{self, AlongPath, Figure, SeenFlights, SeenInSpace};
use crate::metrics::PathProgress;
use crate::recordings::ticks::TickRow;
use times::{parameters, states, sticks, the_loop};

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
    let along = |samples: fn(&Measured) -> &[f64]| -> Vec<AlongPath<'_>> {
        let of_groups = groups.iter().map(|group| AlongPath {
            name: &group.name,
            progress: pooled(group, |measured| &measured.progress),
            values: pooled(group, samples),
        });
        of_groups.collect()
    };
    let progress = along(|measured| &measured.progress);
    if progress.iter().all(|group| group.progress.is_empty()) {
        return pictures;
    }
    let marks = targets(groups);
    pictures.push(Picture {
        name: "all-density".into(),
        caption: "Density of the samples over the progress along the line (thesis figure 5.6): a Gaussian kernel \
                  estimate with Scott's bandwidth. Where it is high, the vehicle was slow."
            .into(),
        figure: figure::density_over_progress("Where the time was spent", &marks, &progress),
    });
    let band = |quantity: Quantity, samples: fn(&Measured) -> &[f64], name: &str, caption: &str| {
        let (quantity_name, unit, _) = quantity.label();
        let (title, groups) = (format!("{quantity_name} over progress"), along(samples));
        Picture {
            name: format!("all-{name}"),
            caption: caption.into(),
            figure: figure::band_over_progress(&title, (quantity_name, unit), &marks, &groups),
        }
    };
    pictures.push(band(
        Quantity::DistanceM,
        distances_m,
        "distance",
        "Horizontal distance to the line over the progress along it (thesis figure 5.7): median and the band that \
         holds 95 % of the samples in each of 75 parts of the line.",
    ));
    pictures.push(band(
        Quantity::InputNorm,
        |measured| &measured.input_norm,
        "input",
        "Norm of the four sticks over the progress along the line (thesis figure 5.8): median and the band that \
         holds 95 % of the samples in each of 75 parts of the line.",
    ));
    pictures
}

/// Figures of one flight. `prefix` makes the names of their files unique.
pub(super) fn of_flight(looked: &EvaluatedFlight, prefix: &str) -> Vec<Picture> {
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
             Time from first to last target in brackets. On a screen the pointer or the arrow keys turn it.",
            in_space(&title, flight),
        ),
        picture("above", "The same from above.", above(&title, looked)),
        picture(
            "state",
            "State, its prediction over the dead time, drawn when it was made, and the cumulative input of equation \
             5.1 (thesis figure 5.5): the sticks summed up by equation 4.1 with the parameters of the moment. The sum \
             begins anew at the state every 5 s. Dead time, lag and drift, which equation 4.1 lacks, move the sum up to a \
             metre from the state on a good flight. Below: the distance of the state from the reference in \
             flight. Bands: when sent sticks did not act (by the link monitor), and when there was a fault; the last figure names it.",
            states(&title, flight),
        ),
        picture(
            "sticks",
            "Sticks that were sent, each in -1..1, with the bands of the figure above.",
            sticks(&title, flight),
        ),
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
pub(super) fn shown(group: &Group) -> Vec<&EvaluatedFlight> {
    if group.looked.len() <= 4 {
        return group.looked.iter().collect();
    }
    let number = |looked: &&EvaluatedFlight, quantity| {
        looked.row.numbers.get(&quantity).map(|spread| spread.max)
    };
    let sorted = |quantity| -> Vec<&EvaluatedFlight> {
        let mut looked: Vec<&EvaluatedFlight> =
            group.looked.iter().filter(|one| number(one, quantity).is_some()).collect();
        let value = |one: &EvaluatedFlight| number(&one, quantity).unwrap_or(f64::NAN);
        looked.sort_by(|a, b| value(a).total_cmp(&value(b)));
        looked
    };
    let (by_time, by_distance) = (sorted(Quantity::FinishS), sorted(Quantity::DistanceM));
    let mut shown: Vec<&EvaluatedFlight> = Vec::new();
    let ends =
        [by_time.first(), by_time.get(by_time.len() / 2), by_time.last(), by_distance.last()];
    for looked in ends.into_iter().flatten().copied() {
        if !shown.iter().any(|one| one.row.file == looked.row.file) {
            shown.push(looked);
        }
    }
    if shown.is_empty() { group.looked.iter().take(4).collect() } else { shown }
}

/// Distances of the samples that have a progress. m
fn distances_m(measured: &Measured) -> &[f64] {
    let distances_m = measured.numbers.get(&Quantity::DistanceM).map_or(&[][..], Vec::as_slice);
    if measured.progress.is_empty() { &[] } else { distances_m }
}

/// The samples of all flights of a group that count.
fn pooled(group: &Group, samples: fn(&Measured) -> &[f64]) -> Vec<f64> {
    group.counted().flat_map(|one| samples(&one.measured).iter().copied()).collect()
}

/// Progresses of the inner targets of the first flight with a line.
fn targets(groups: &[Group]) -> Vec<f64> {
    let mut flights = groups.iter().flat_map(Group::counted).map(|looked| &looked.flight);
    let Some(flight) = flights.find(|flight| !flight.outline.is_empty()) else { return Vec::new() };
    let Some(path) = PathProgress::new(&flight.outline) else { return Vec::new() };
    let inner = flight.targets.iter().skip(1).take(flight.targets.len().saturating_sub(2));
    inner.map(|target| path.place(target).progress).collect()
}

fn horizontal(poses: &[Pose]) -> Vec<(f64, f64)> {
    poses.iter().map(|at| (at[pose::X], at[pose::Y])).collect()
}

fn track(ticks: &[TickRow]) -> Vec<Pose> {
    ticks.iter().filter_map(|tick| tick.estimate).collect()
}

/// A time for each place of [`track`] of the ticks that count. s
fn times_of_track_s(flight: &Flight) -> Vec<f64> {
    let seen = flight.judged_ticks().iter().filter(|tick| tick.estimate.is_some());
    seen.map(|tick| flight.time_s(tick)).collect()
}

fn from_above(name: &str, title: &str, groups: &[Group]) -> Picture {
    let seen = groups.iter().map(|group| {
        let mut outlines: Vec<&[Pose]> = Vec::new();
        for outline in group.looked.iter().map(|looked| looked.flight.outline.as_slice()) {
            if !outlines.contains(&outline) {
                outlines.push(outline);
            }
        }
        // Between two lines there is a gap.
        let gap = vec![(f64::NAN, f64::NAN)];
        let with_gap = |outline: &[Pose]| [horizontal(outline), gap.clone()].concat();
        let outline = outlines.into_iter().flat_map(with_gap).collect();
        let flights = group.looked.iter().map(|looked| looked.flight.judged_ticks());
        let tracks = flights.map(|ticks| horizontal(&track(ticks))).collect();
        SeenFlights { name: &group.name, outline, tracks }
    });
    let seen: Vec<_> = seen.collect();
    Picture {
        name: name.to_owned(),
        caption: "Every flight from above, from its first target to its last, over the \
                  lines that they followed, dashed (thesis figure 5.4)."
            .to_owned(),
        figure: figure::tracks(title, &seen),
    }
}

fn above(title: &str, EvaluatedFlight { flight, .. }: &EvaluatedFlight) -> Figure {
    let track = horizontal(&track(flight.judged_ticks()));
    let (outline, tracks) = (horizontal(&flight.outline), vec![track.clone()]);
    figure::tracks(title, &[SeenFlights { name: "flight", outline, tracks }])
        .with_times(&times_of_track_s(flight), &track)
}

fn in_space(title: &str, flight: &Flight) -> Figure {
    let places = |poses: &[Pose]| -> Vec<[f64; 3]> {
        poses.iter().map(|at| [at[pose::X], at[pose::Y], at[pose::Z]]).collect()
    };
    let (outline, track) = (places(&flight.outline), places(&track(flight.judged_ticks())));
    let time_s = times_of_track_s(flight);
    figure::space(title, &SeenInSpace { outline: &outline, track: &track, time_s: &time_s })
}

#[cfg(test)]
mod tests;
