//! `tello-ctl mocap watch`: where one object is in our frame, where up is and which way it points.

mod advice;
mod turn;

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use horizon_model::angle::wrap;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use serde_json::json;
use tello_io::clock::{Clock, TimeNs};
use tello_io::mocap::{
    Axes, MocapSettings, MocapTable, Placement, SourceAxis, Survey, SurveyTrack, TrackReport,
    survey,
};
use tokio::signal::ctrl_c;
use tokio::time::timeout;

use self::advice::print_advice;
use self::turn::{HeadingTurn, Turn};
use super::rate;
use super::source::{self, SourceArgument};
use crate::{Verdict, stdio};

/// Shortest displacement that gives a direction. m
pub(super) const DISPLACEMENT_MIN_M: f64 = 0.1;

/// Largest distance of a vehicle in a room from the origin, along one axis. m
const PLACE_MAX_M: f64 = 100.0;

/// Watch one object: its pose in our frame, where up is, which way it points, rate, age and gaps.
///
/// Our frame: metres, z up, right-handed; the nose is the body's x axis. To check the axes, put the vehicle on the
/// floor, start this, lift the vehicle straight up by half a metre: z must grow, and the tilt stay near 0. To check
/// the nose, start again and carry the vehicle nose first: the way must be the heading. The last lines show along
/// which axes of the source it moved and what to write into the settings.
///
/// Exit code: 0 if the object was seen, 1 if not, 2 for arguments or settings that make no sense.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The source by kind and address, such as `natnet=192.168.1.5:1510`; without a port the usual one.
    #[arg(long, value_name = "KIND=HOST:PORT", conflicts_with = "config", requires = "object")]
    source: Option<SourceArgument>,
    /// Name of the object in the motion capture system [default: that of the settings; needed with --source].
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// Settings of `tello-ctl fly`, for their source, object and axes [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// How long to watch; Ctrl-C ends it before.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    seconds: f64,
    /// Print one JSON object at the end, in place of a line twice a second.
    #[arg(long)]
    json: bool,
}

/// Result of watching one object.
#[derive(Debug, Serialize)]
struct Watched {
    object: String,
    #[serde(flatten)]
    report: TrackReport,
    /// Newest pose; null if it was not seen.
    now: Option<WatchedPose>,
    /// Displacement from the first to the furthest place; null if it was too short for a direction.
    #[serde(rename = "way")]
    displacement: Option<Displacement>,
    /// Turn from the first to the newest place, if there is one.
    #[serde(skip)]
    turn: Option<Turn>,
    /// Why there is no connection, or why it was given up.
    trouble: Option<String>,
    /// Refused messages.
    #[serde(skip)]
    refused: Option<String>,
    /// The settings that this was read with.
    settings: MocapTable,
    /// The rate to write into them, where the source does not announce its own and the measured one is another; null:
    /// none. Hz
    suggested_rate_hz: Option<f64>,
}

/// A pose in our frame.
#[derive(Debug, Clone, Copy, Serialize)]
struct WatchedPose {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    heading_deg: f64,
    /// Angle between the body's top and up.
    tilt_deg: f64,
    /// Time since it was seen.
    age_s: f64,
}

/// Displacement of the object, from its first to its furthest place.
#[derive(Debug, Clone, Copy, Serialize)]
struct Displacement {
    length_m: f64,
    /// The axis of the source that comes nearest, and how far it is off.
    source_axis: SourceAxis,
    source_off_deg: f64,
    /// The axis of the object, as the source defined it, that comes nearest.
    object_axis: SourceAxis,
    object_off_deg: f64,
    /// Angle of the displacement above the floor in our frame; 90 is up.
    climb_deg: f64,
    /// Angle between the displacement and the nose by these settings.
    #[serde(skip)]
    nose_off_deg: f64,
    /// Angle from the nose to the displacement, from above, by these settings; positive to the left.
    #[serde(skip)]
    side_deg: f64,
}

pub(super) async fn run(arguments: &Arguments) -> Result<Verdict> {
    let seconds = duration(arguments.seconds)?;
    let table = match (&arguments.source, &arguments.object) {
        (Some(source), Some(object)) => source.table(object),
        (_, object) => {
            let table = source::of_settings(arguments.config.as_ref())?;
            object.as_ref().map_or(table.clone(), |object| table.of_object(object))
        }
    };
    let settings = MocapSettings::try_from(&table).map_err(|error| error.under("mocap"))?;
    let (clock, axes) = (Clock::start(), settings.axes());
    let mut shown_at: Option<TimeNs> = None;
    let mut turn = HeadingTurn::default();
    let mut result = Ok(());
    let survey = survey(&settings, clock, end(seconds), |survey, now| {
        let newest = track(survey, settings.object()).and_then(|track| track.places);
        if let Some([_, newest]) = newest {
            turn.observe(heading_rad(&newest, &axes));
        }
        let is_due = shown_at.is_none_or(|at| now.since(at).seconds() >= 0.5);
        if is_due && !arguments.json && result.is_ok() {
            shown_at = Some(now);
            result = stdio::line(line(survey, settings.object(), &axes, now));
        }
    })
    .await;
    result?;
    let watched = watched(&table, &settings, &survey, turn.shown(), clock.now());
    if arguments.json {
        stdio::line(json!(watched))?;
    } else {
        print_advice(&watched, &survey)?;
    }
    Ok(if watched.now.is_some() { Verdict::Good } else { Verdict::Bad })
}

/// A time to listen.
pub(super) fn duration(seconds: f64) -> Result<Duration> {
    if !(0.1..=86_400.0).contains(&seconds) {
        bail!("--seconds {seconds} is not within 0.1 and 86400");
    }
    Ok(Duration::from_secs_f64(seconds))
}

/// The end of the time to listen, or Ctrl-C: what was seen until then is reported.
pub(super) async fn end(after: Duration) {
    timeout(after, ctrl_c()).await.ok();
}

/// The object of the settings among those of a source.
fn track<'a>(survey: &'a Survey, object: &str) -> Option<&'a SurveyTrack> {
    survey.objects.get(object)
}

fn seen(track: &SurveyTrack, axes: &Axes, now: TimeNs) -> Option<WatchedPose> {
    let [_, newest] = track.places?;
    let ([x_m, y_m, z_m], [.., r22]) = axes.place(&newest);
    let age_s = track.seen_at.map_or(0.0, |at| now.since(at).seconds());
    let heading_deg = heading_rad(&newest, axes).to_degrees();
    let tilt_deg = r22.clamp(-1.0, 1.0).acos().to_degrees();
    Some(WatchedPose { x_m, y_m, z_m, heading_deg, tilt_deg, age_s })
}

/// Why a place is hardly one in metres; `None` if it may be.
pub(super) fn unit_doubt(place_w_m: [f64; 3], has_frame: bool) -> Option<String> {
    let key = if has_frame { ", or in the \"unit\" of its settings" } else { "" };
    place_w_m.iter().any(|x_m| x_m.abs() > PLACE_MAX_M).then(|| {
        format!("More than {PLACE_MAX_M} m from the origin: is the source in metres{key}?")
    })
}

/// Whether two objects have the name. A source may send a frame twice, or two with one time stamp.
pub(super) fn is_doubled(report: &TrackReport) -> bool {
    20 * report.doubled > report.frames
}

/// Refused messages of a source; `None`: none.
fn refused(survey: &Survey) -> Option<String> {
    survey.refused.map(|why| format!("{} malformed: {why}", survey.malformed))
}

/// From the first place to the furthest one, in our frame. m
fn longest(track: &SurveyTrack, axes: &Axes) -> Option<Vector3<f64>> {
    let ([first, _], furthest) = (track.places?, track.furthest?);
    let [first_w, furthest_w] = [first, furthest].map(|at| Vector3::from(axes.place(&at).0));
    Some(furthest_w - first_w)
}

/// Largest distance of an object from its first place; 0 if it was not seen. m
pub(super) fn moved_m(track: &SurveyTrack, axes: &Axes) -> f64 {
    longest(track, axes).map_or(0.0, |displacement| displacement.norm())
}

fn displacement(track: &SurveyTrack, axes: &Axes) -> Option<Displacement> {
    let ([first, _], furthest) = (track.places?, track.furthest?);
    let displacement_w = longest(track, axes)?;
    let length_m = displacement_w.norm();
    if length_m < DISPLACEMENT_MIN_M {
        return None;
    }
    let raw = Vector3::from(furthest.pos_v) - Vector3::from(first.pos_v);
    let (source_axis, source_off) = SourceAxis::nearest(&raw);
    let in_object = Matrix3::from_row_slice(&first.matrix).transpose() * raw;
    let (object_axis, object_off) = SourceAxis::nearest(&in_object);
    let ([..], [nose_x, _, _, nose_y, _, _, nose_z, ..]) = axes.place(&first);
    Some(Displacement {
        length_m,
        source_axis,
        source_off_deg: source_off.to_degrees(),
        object_axis,
        object_off_deg: object_off.to_degrees(),
        climb_deg: (displacement_w.z / length_m).clamp(-1.0, 1.0).asin().to_degrees(),
        side_deg: wrap(displacement_w.y.atan2(displacement_w.x) - nose_y.atan2(nose_x))
            .to_degrees(),
        nose_off_deg: displacement_w.angle(&Vector3::new(nose_x, nose_y, nose_z)).to_degrees(),
    })
}

/// Heading of the object, from above, by these settings. rad
fn heading_rad(at: &Placement, axes: &Axes) -> f64 {
    let ([..], [r00, _, _, r10, ..]) = axes.place(at);
    r10.atan2(r00)
}

fn watched(
    table: &MocapTable,
    settings: &MocapSettings,
    survey: &Survey,
    turn: Option<Turn>,
    now: TimeNs,
) -> Watched {
    let (object, axes) = (settings.object(), settings.axes());
    let track = track(survey, object);
    let report = track.map(|track| track.report_at(now)).unwrap_or_default();
    Watched {
        object: object.to_owned(),
        report,
        now: track.and_then(|track| seen(track, &axes, now)),
        displacement: track.and_then(|track| displacement(track, &axes)),
        turn,
        trouble: survey.trouble.clone(),
        refused: refused(survey),
        settings: table.clone(),
        suggested_rate_hz: rate::other_hz(table, report.usual_hz),
    }
}

/// One line while it is watched.
fn line(survey: &Survey, object: &str, axes: &Axes, now: TimeNs) -> String {
    let Some(track) = track(survey, object) else {
        let refused = refused(survey).map_or_else(String::new, |text| format!(", {text}"));
        return format!("{object}: not there; {} messages{refused}", survey.messages);
    };
    let report = track.report_at(now);
    let stream = format!("{:.1} Hz, {} gaps", report.rate_hz, report.gaps);
    match seen(track, axes, now) {
        None => format!("{object}: never seen in {} frames; {stream}", report.frames),
        Some(WatchedPose { x_m, y_m, z_m, heading_deg, tilt_deg, age_s }) => format!(
            "x {x_m:7.3}  y {y_m:7.3}  z {z_m:7.3} m  heading {heading_deg:6.1}  tilt {tilt_deg:5.1} deg  \
             age {:4.0} ms  {stream}",
            1e3 * age_s
        ),
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use tello_io::mocap::{FrameTable, Unit};

    use super::advice::axes_with_up;
    use super::*;

    /// A track that began at the origin, level, and got to a place.
    pub(super) fn track_to(pos_v: [f64; 3]) -> SurveyTrack {
        let matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let [first, last] = [[0.0; 3], pos_v].map(|pos_v| Placement { pos_v, matrix });
        let mut track = SurveyTrack::default();
        (track.places, track.furthest) = (Some([first, last]), Some(last));
        track
    }

    #[test]
    fn a_place_that_no_room_has_is_one_in_another_unit() {
        assert_eq!(unit_doubt([99.0, -3.0, 1.0], true), None);
        let doubt = unit_doubt([499.5, 0.0, 0.0], false).unwrap();
        assert!(!doubt.contains("\"unit\""), "a source without that key: {doubt}");
        for far in [[499.5, 300.4, 39.9], [0.0, -101.0, 0.0]] {
            assert!(
                unit_doubt(far, true).is_some_and(|doubt| doubt.contains("\"unit\"")),
                "{far:?}"
            );
        }
    }

    #[test]
    fn a_lift_in_a_source_whose_y_points_up_is_recognized() {
        let track = track_to([0.01, 0.5, -0.02]);
        let lifted = displacement(&track, &Axes::ours()).unwrap();
        assert_eq!((lifted.source_axis, lifted.object_axis), (SourceAxis::Y, SourceAxis::Y));
        assert!(lifted.climb_deg.abs() < 5.0 && lifted.source_off_deg < 5.0, "{lifted:?}");
        // With the settings that it suggests, up is right.
        let table = FrameTable { axes: Some(axes_with_up(SourceAxis::Y)), ..FrameTable::default() };
        let axes = Axes::new(Some(&table), Unit::Metre).unwrap();
        assert!(displacement(&track, &axes).unwrap().climb_deg > 85.0);
        assert!(displacement(&track_to([0.05, 0.0, 0.0]), &Axes::ours()).is_none(), "too short");
    }

    #[test]
    fn a_heading_is_the_direction_of_the_nose_from_above() {
        let matrix = [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let right = Placement { pos_v: [0.0; 3], matrix };
        assert!((heading_rad(&right, &Axes::ours()) + FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn heading_and_tilt_are_those_of_the_newest_place() {
        let seen = seen(&track_to([1.0, 2.0, 3.0]), &Axes::ours(), TimeNs(0)).unwrap();
        assert_eq!((seen.x_m, seen.y_m, seen.z_m), (1.0, 2.0, 3.0));
        assert!(seen.heading_deg.abs() < 1e-9 && seen.tilt_deg.abs() < 1e-5, "{seen:?}");
    }
}
