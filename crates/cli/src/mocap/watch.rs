//! `tello-ctl mocap watch`: where one object is in our frame, where up is and which way it points.

use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Result, bail};
use clap::Args;
use nalgebra::{Matrix3, Vector3};
use serde::Serialize;
use serde_json::json;
use tello_io::clock::{Clock, TimeNs};
use tello_io::mocap::{
    Axes, Axis, FrameTable, MocapSettings, MocapTable, Survey, SurveyTrack, TrackReport, survey,
};

use super::rate;
use super::source::{self, SourceArgument};
use crate::{Verdict, stdio};

/// Shorter ways do not tell a direction. m
pub(super) const WAY_MIN_M: f64 = 0.1;

/// Further from the origin is no vehicle in a room. m
const PLACE_MAX_M: f64 = 100.0;

/// A body that stands on the floor leans less than this. deg
const TILT_MAX_DEG: f64 = 20.0;

/// Watch one object: its pose in our frame, where up is, which way it points, rate, age and gaps.
///
/// Our frame: metres, z up, right-handed; the nose is the body's x axis. To check the axes, put the vehicle on the
/// floor, start this, lift the vehicle straight up by half a metre: z must grow, and the tilt stay near 0. To check
/// the nose, start again and carry the vehicle nose first: the way must be the heading. The last lines say along
/// which axes of the source it moved and what to write into the settings.
///
/// Exit code: 0 if the object was seen, 1 if not, 2 for arguments or settings that make no sense.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The source by kind and address, such as `natnet=192.168.1.5:1510`.
    #[arg(long, value_name = "KIND=HOST:PORT", conflicts_with = "config", requires = "object")]
    source: Option<SourceArgument>,
    /// Name of the object in the motion capture system [default: that of the settings].
    #[arg(long, value_name = "NAME")]
    object: Option<String>,
    /// Settings of `tello-ctl fly`, for their source, object and axes [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// How long to watch.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0)]
    seconds: f64,
    /// Print one JSON object at the end, in place of a line twice a second.
    #[arg(long)]
    json: bool,
}

/// What was seen.
#[derive(Debug, Serialize)]
struct Watched {
    object: String,
    #[serde(flatten)]
    report: TrackReport,
    /// Newest pose; null if it was not seen.
    now: Option<Seen>,
    /// The longest way from the first place; null if it was too short to tell a direction.
    way: Option<Way>,
    /// Why there is no connection, or why it was given up.
    trouble: Option<String>,
    /// The settings that this was read with.
    settings: MocapTable,
    /// The rate to write into them, where the source does not tell its own and the measured one is another; null:
    /// none. Hz
    suggested_rate_hz: Option<f64>,
}

/// A pose in our frame.
#[derive(Debug, Clone, Copy, Serialize)]
struct Seen {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    heading_deg: f64,
    /// Angle between the body's top and up.
    tilt_deg: f64,
    /// Time since it was seen.
    age_s: f64,
}

/// A straight way.
#[derive(Debug, Clone, Copy, Serialize)]
struct Way {
    length_m: f64,
    /// The axis of the source that comes nearest, and how far it is off.
    source_axis: Axis,
    source_off_deg: f64,
    /// The axis of the object, as the source defined it, that comes nearest.
    object_axis: Axis,
    object_off_deg: f64,
    /// Angle of the way above the floor in our frame; 90 is up.
    climb_deg: f64,
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
    let mut result = Ok(());
    let survey = survey(&settings, clock, seconds, |survey, now| {
        let is_due = shown_at.is_none_or(|at| now.since(at).seconds() >= 0.5);
        if is_due && !arguments.json && result.is_ok() {
            shown_at = Some(now);
            result = stdio::line(line(survey, settings.object(), &axes, now));
        }
    })
    .await;
    result?;
    let watched = watched(&table, &settings, &survey, clock.now());
    if arguments.json {
        stdio::line(json!(watched))?;
    } else {
        print_end(&watched, &survey)?;
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

/// The object of the settings among those of a source.
fn track<'a>(survey: &'a Survey, object: &str) -> Option<&'a SurveyTrack> {
    survey.objects.get(object)
}

fn seen(track: &SurveyTrack, axes: &Axes, now: TimeNs) -> Option<Seen> {
    let [_, newest] = track.places?;
    let ([x_m, y_m, z_m], [r00, _, _, r10, _, _, _, _, r22]) = axes.place(&newest);
    let age_s = track.seen_at.map_or(0.0, |at| now.since(at).seconds());
    let heading_deg = r10.atan2(r00).to_degrees();
    let tilt_deg = r22.clamp(-1.0, 1.0).acos().to_degrees();
    Some(Seen { x_m, y_m, z_m, heading_deg, tilt_deg, age_s })
}

/// Why a place is hardly one in metres; `None` if it may be.
pub(super) fn unit_doubt(place_w_m: [f64; 3]) -> Option<String> {
    place_w_m.iter().any(|x_m| x_m.abs() > PLACE_MAX_M).then(|| {
        format!(
            "More than {PLACE_MAX_M} m from the origin: is the source in metres, or in the \"unit\" of its settings?"
        )
    })
}

/// From the first place to the furthest one, in our frame. m
fn longest(track: &SurveyTrack, axes: &Axes) -> Option<Vector3<f64>> {
    let ([first, _], furthest) = (track.places?, track.furthest?);
    let [first_w, furthest_w] = [first, furthest].map(|at| Vector3::from(axes.place(&at).0));
    Some(furthest_w - first_w)
}

/// How far an object got from its first place; 0 if it was not seen. m
pub(super) fn moved_m(track: &SurveyTrack, axes: &Axes) -> f64 {
    longest(track, axes).map_or(0.0, |way| way.norm())
}

fn way(track: &SurveyTrack, axes: &Axes) -> Option<Way> {
    let ([first, _], furthest) = (track.places?, track.furthest?);
    let way = longest(track, axes)?;
    let length_m = way.norm();
    if length_m < WAY_MIN_M {
        return None;
    }
    let raw = Vector3::from(furthest.pos_v) - Vector3::from(first.pos_v);
    let (source_axis, source_off) = Axis::nearest(&raw);
    let in_object = Matrix3::from_row_slice(&first.matrix).transpose() * raw;
    let (object_axis, object_off) = Axis::nearest(&in_object);
    Some(Way {
        length_m,
        source_axis,
        source_off_deg: source_off.to_degrees(),
        object_axis,
        object_off_deg: object_off.to_degrees(),
        climb_deg: (way.z / length_m).clamp(-1.0, 1.0).asin().to_degrees(),
    })
}

fn watched(table: &MocapTable, settings: &MocapSettings, survey: &Survey, now: TimeNs) -> Watched {
    let (object, axes) = (settings.object(), settings.axes());
    let track = track(survey, object);
    let report = track.map(SurveyTrack::report).unwrap_or_default();
    Watched {
        object: object.to_owned(),
        report,
        now: track.and_then(|track| seen(track, &axes, now)),
        way: track.and_then(|track| way(track, &axes)),
        trouble: survey.trouble.clone(),
        settings: table.clone(),
        suggested_rate_hz: rate::other_hz(table, report.usual_hz),
    }
}

/// One line while it is watched.
fn line(survey: &Survey, object: &str, axes: &Axes, now: TimeNs) -> String {
    let Some(track) = track(survey, object) else {
        return format!("{object}: not there; {} messages", survey.messages);
    };
    let report = track.report();
    let stream = format!("{:.1} Hz, {} gaps", report.rate_hz, report.gaps);
    match seen(track, axes, now) {
        None => format!("{object}: never seen in {} frames; {stream}", report.frames),
        Some(Seen { x_m, y_m, z_m, heading_deg, tilt_deg, age_s }) => format!(
            "x {x_m:7.3}  y {y_m:7.3}  z {z_m:7.3} m  heading {heading_deg:6.1}  tilt {tilt_deg:5.1} deg  \
             age {:4.0} ms  {stream}",
            1e3 * age_s
        ),
    }
}

/// Axes whose third is the given one, right-handed.
fn axes_with_up(up: Axis) -> [Axis; 3] {
    match up {
        Axis::X => [Axis::Y, Axis::Z, Axis::X],
        Axis::Y => [Axis::X, Axis::MinusZ, Axis::Y],
        Axis::Z => [Axis::X, Axis::Y, Axis::Z],
        Axis::MinusX => [Axis::Y, Axis::MinusZ, Axis::MinusX],
        Axis::MinusY => [Axis::X, Axis::Z, Axis::MinusY],
        Axis::MinusZ => [Axis::X, Axis::MinusY, Axis::MinusZ],
    }
}

/// What to conclude, for people.
fn print_end(watched: &Watched, survey: &Survey) -> Result<()> {
    let Some(now) = watched.now else {
        let names: Vec<&str> = survey.objects.keys().map(String::as_str).collect();
        stdio::line(format_args!("{:?} was not seen.", watched.object))?;
        if let Some(trouble) = &watched.trouble {
            stdio::line(format_args!("The connection: {trouble}."))?;
        }
        return if names.is_empty() {
            stdio::line("There are no objects. tello-ctl mocap list HOST tries every protocol.")
        } else {
            stdio::line(format_args!("There are: {}", names.join(", ")))
        };
    };
    let doubled = watched.report.doubled;
    if doubled > 0 {
        return stdio::line(format_args!(
            "Two objects are called {:?}, in {doubled} frames: rename one; what is above is of both.",
            watched.object
        ));
    }
    if now.tilt_deg > TILT_MAX_DEG {
        stdio::line(format_args!(
            "Its top leans {:.0} degrees from up: if the vehicle stands level, the axes are wrong, or the object was \
             defined while it leaned.",
            now.tilt_deg
        ))?;
    }
    if let Some(doubt) = unit_doubt([now.x_m, now.y_m, now.z_m]) {
        stdio::line(doubt)?;
    }
    match watched.way {
        None => stdio::line(format_args!(
            "It did not move by {WAY_MIN_M} m. Lift it straight up to check the axes, carry it nose first to check the \
             nose. If it was lifted, the source is in another unit than these settings say."
        ))?,
        Some(way) => print_way(&way, watched.settings.has_frame())?,
    }
    let settings = serde_json::to_string(&watched.settings)?;
    stdio::line(format_args!("Settings that were used: \"mocap\": {settings}"))?;
    if let Some(rate_hz) = watched.suggested_rate_hz {
        let measured_hz = watched.report.usual_hz;
        stdio::line(format_args!(
            "Measured are {measured_hz:.2} Hz: write \"rate_hz\": {rate_hz} for a flight."
        ))?;
    }
    Ok(())
}

/// `has_frame`: the settings of the source have axes.
fn print_way(way: &Way, has_frame: bool) -> Result<()> {
    let Way { length_m, source_axis, source_off_deg, object_axis, object_off_deg, climb_deg } =
        *way;
    stdio::line(format_args!(
        "It moved {length_m:.2} m: along {} of the source (off by {source_off_deg:.0} degrees), along {} of the object \
         (off by {object_off_deg:.0}), {climb_deg:.0} degrees above the floor by these settings.",
        source_axis.name(),
        object_axis.name()
    ))?;
    if climb_deg > 60.0 {
        return stdio::line("If you lifted it, up is right.");
    }
    if !has_frame {
        return stdio::line(
            "If you lifted it, up is wrong: set the vertical axis of the system to z. If you carried it nose first, the x \
             axis of the object has to be that of the way: define it again in the system.",
        );
    }
    let frame = |axes, nose| {
        let (axes, nose) = (Some(axes), nose);
        serde_json::to_string(&FrameTable { axes, nose, unit: None })
    };
    stdio::line(format_args!(
        "If you lifted it, up is wrong: write \"frame\": {}",
        frame(axes_with_up(source_axis), None)?
    ))?;
    if climb_deg.abs() < 30.0 {
        stdio::line(format_args!(
            "If you carried it nose first, the nose is {:?}: write \"nose\": {:?} into \"frame\".",
            object_axis.name(),
            object_axis.name()
        ))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::{Placement, Unit};

    use super::*;

    #[test]
    fn every_axis_can_be_up_without_mirroring() {
        for up in Axis::ALL {
            let axes = axes_with_up(up);
            assert_eq!(axes[2], up);
            let table = FrameTable { axes: Some(axes), ..FrameTable::default() };
            let axes = Axes::new(Some(&table), Unit::Metre).unwrap();
            let raised: [f64; 3] = up.vector().into();
            let matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            let ([_, _, z_m], _) = axes.place(&Placement { pos_v: raised, matrix });
            assert!((z_m - 1.0).abs() < 1e-12, "{up:?}");
        }
    }

    /// A track that began at the origin, level, and got to a place.
    fn track_to(pos_v: [f64; 3]) -> SurveyTrack {
        let matrix = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let [first, last] = [[0.0; 3], pos_v].map(|pos_v| Placement { pos_v, matrix });
        let mut track = SurveyTrack::default();
        (track.places, track.furthest) = (Some([first, last]), Some(last));
        track
    }

    #[test]
    fn a_place_that_no_room_has_is_one_in_another_unit() {
        assert_eq!(unit_doubt([99.0, -3.0, 1.0]), None);
        for far in [[499.5, 300.4, 39.9], [0.0, -101.0, 0.0]] {
            assert!(unit_doubt(far).is_some_and(|doubt| doubt.contains("\"unit\"")), "{far:?}");
        }
    }

    #[test]
    fn a_lift_in_a_source_whose_y_points_up_is_recognized() {
        let track = track_to([0.01, 0.5, -0.02]);
        let lifted = way(&track, &Axes::ours()).unwrap();
        assert_eq!((lifted.source_axis, lifted.object_axis), (Axis::Y, Axis::Y));
        assert!(lifted.climb_deg.abs() < 5.0 && lifted.source_off_deg < 5.0, "{lifted:?}");
        // With the settings that it suggests, up is right.
        let table = FrameTable { axes: Some(axes_with_up(Axis::Y)), ..FrameTable::default() };
        let axes = Axes::new(Some(&table), Unit::Metre).unwrap();
        assert!(way(&track, &axes).unwrap().climb_deg > 85.0);
        assert!(way(&track_to([0.05, 0.0, 0.0]), &Axes::ours()).is_none(), "too short");
    }

    #[test]
    fn heading_and_tilt_are_those_of_the_newest_place() {
        let seen = seen(&track_to([1.0, 2.0, 3.0]), &Axes::ours(), TimeNs(0)).unwrap();
        assert_eq!((seen.x_m, seen.y_m, seen.z_m), (1.0, 2.0, 3.0));
        assert!(seen.heading_deg.abs() < 1e-9 && seen.tilt_deg.abs() < 1e-5, "{seen:?}");
    }
}
