//! Printed advice on axes, nose, unit and rate after an object was watched.

use anyhow::Result;
use tello_io::mocap::{FrameTable, SourceAxis, Survey, TrackReport};

use super::{DISPLACEMENT_MIN_M, Displacement, Turn, Watched, WatchedPose, is_doubled, unit_doubt};
use crate::stdio;

/// Largest tilt of a body that stands on the floor. deg
const TILT_MAX_DEG: f64 = 20.0;

/// Largest angle between nose and displacement of an object that was carried nose first by hand. deg
const NOSE_OFF_MAX_DEG: f64 = 20.0;

/// Axes whose third is the given one, right-handed.
pub(super) fn axes_with_up(up: SourceAxis) -> [SourceAxis; 3] {
    match up {
        SourceAxis::X => [SourceAxis::Y, SourceAxis::Z, SourceAxis::X],
        SourceAxis::Y => [SourceAxis::X, SourceAxis::MinusZ, SourceAxis::Y],
        SourceAxis::Z => [SourceAxis::X, SourceAxis::Y, SourceAxis::Z],
        SourceAxis::MinusX => [SourceAxis::Y, SourceAxis::MinusZ, SourceAxis::MinusX],
        SourceAxis::MinusY => [SourceAxis::X, SourceAxis::Z, SourceAxis::MinusY],
        SourceAxis::MinusZ => [SourceAxis::X, SourceAxis::MinusY, SourceAxis::MinusZ],
    }
}

/// Prints the advice.
pub(super) fn print_advice(watched: &Watched, survey: &Survey) -> Result<()> {
    let Some(now) = watched.now else { return print_unseen(watched, survey) };
    if is_doubled(&watched.report) {
        return stdio::line(format_args!(
            "Two objects are called {:?}, in {} frames: rename one; the numbers above mix both objects.",
            watched.object, watched.report.doubled
        ));
    }
    print_stream(watched, &now)?;
    print_displacement(watched)?;
    print_settings(watched)
}

/// The object was not seen: reasons, and the objects that are there.
fn print_unseen(watched: &Watched, survey: &Survey) -> Result<()> {
    let names: Vec<String> = survey.objects.keys().map(|name| format!("{name:?}")).collect();
    stdio::line(format_args!("{:?} was not seen.", watched.object))?;
    if let Some(trouble) = &watched.trouble {
        stdio::line(format_args!("The connection: {trouble}."))?;
    }
    if let Some(refused) = &watched.refused {
        stdio::line(format_args!("Refused: {refused}."))?;
    }
    if !names.is_empty() {
        return stdio::line(format_args!("There are: {}", names.join(", ")));
    }
    // Else the reason is printed.
    if watched.trouble.is_none() && watched.refused.is_none() {
        stdio::line("There are no objects. tello-ctl mocap list HOST tries every protocol.")?;
    }
    Ok(())
}

/// Tilt, refused poses, gaps and unit.
fn print_stream(watched: &Watched, now: &WatchedPose) -> Result<()> {
    if now.tilt_deg > TILT_MAX_DEG {
        stdio::line(format_args!(
            "Its top leans {:.0} degrees from up: if the vehicle stands level, the axes are wrong, or the object was \
             defined while it leaned.",
            now.tilt_deg
        ))?;
    }
    if let Some(refused) = &watched.refused {
        stdio::line(format_args!("Refused: {refused}."))?;
    }
    let TrackReport { gaps, gap_max_s, .. } = watched.report;
    if gaps > 0 {
        stdio::line(format_args!("{gaps} gaps, the longest {gap_max_s:.2} s."))?;
    }
    if let Some(doubt) = unit_doubt([now.x_m, now.y_m, now.z_m], watched.settings.has_frame()) {
        stdio::line(doubt)?;
    }
    Ok(())
}

/// Axes, nose and hand by the displacement and the turn.
fn print_displacement(watched: &Watched) -> Result<()> {
    if let Some(line) = watched.turn.map(turn_line) {
        stdio::line(line)?;
    }
    match watched.displacement {
        None if watched.turn.is_some() => Ok(()),
        None => stdio::line(format_args!(
            "It did not move by {DISPLACEMENT_MIN_M} m. Lift it straight up to check the axes, carry it nose first to check the \
             nose. If it was lifted, the source is in another unit than these settings state."
        )),
        Some(displacement) => displacement_lines(&displacement, watched.settings.has_frame())?
            .into_iter()
            .try_for_each(stdio::line),
    }
}

/// The settings that were used, and the rate to write into them.
fn print_settings(watched: &Watched) -> Result<()> {
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

/// The side of an angle that grows to the left, and the other one.
fn sides(angle_deg: f64) -> (&'static str, &'static str) {
    if angle_deg > 0.0 { ("left", "right") } else { ("right", "left") }
}

/// What a turn by hand shows.
fn turn_line(turn: Turn) -> String {
    let Turn::By(turned_deg) = turn else {
        return "It turned while it was not seen, to which side is unknown: start again and turn it slowly to the left, \
                by a quarter."
            .into();
    };
    let (side, other) = sides(turned_deg);
    format!(
        "It turned by {turned_deg:+.0} degrees, to the {side}: if you turned it to the {other}, the frame is \
         mirrored; do not fly."
    )
}

/// Advice on axes and nose by the displacement; `has_frame`: the settings of the source have axes.
fn displacement_lines(displacement: &Displacement, has_frame: bool) -> Result<Vec<String>> {
    let Displacement { climb_deg, nose_off_deg, side_deg, .. } = *displacement;
    let mut lines = vec![measured_line(displacement)];
    if climb_deg > 60.0 {
        lines.push("If you lifted it, up is right.".into());
        return Ok(lines);
    }
    if climb_deg.abs() < 30.0 && (side_deg.abs() - 90.0).abs() < NOSE_OFF_MAX_DEG {
        let (side, other) = sides(side_deg);
        lines.push(format!(
            "By these settings it moved to its {side}: if you carried it to its {other}, the frame is mirrored or the \
             nose is wrong; do not fly."
        ));
    }
    if is_nose_right(displacement) {
        lines.push(format!(
            "If you carried it nose first, the nose is right: the way is the heading, off by {nose_off_deg:.0} degrees."
        ));
    }
    if has_frame {
        lines.extend(frame_lines(displacement)?);
    } else {
        lines.extend(system_lines(displacement));
    }
    Ok(lines)
}

/// Whether an object that was carried nose first has its nose where the settings say.
fn is_nose_right(displacement: &Displacement) -> bool {
    displacement.nose_off_deg < NOSE_OFF_MAX_DEG
}

/// The displacement along the axes of the source and of the object.
fn measured_line(displacement: &Displacement) -> String {
    let Displacement {
        length_m,
        source_axis,
        source_off_deg,
        object_axis,
        object_off_deg,
        climb_deg,
        ..
    } = *displacement;
    format!(
        "It moved {length_m:.2} m: along {} of the source (off by {source_off_deg:.0} degrees), along {} of the object \
         (off by {object_off_deg:.0}), {climb_deg:.0} degrees above the floor by these settings.",
        source_axis.name(),
        object_axis.name()
    )
}

/// What to change in the motion capture system, whose axes the settings cannot turn.
fn system_lines(displacement: &Displacement) -> Vec<String> {
    let mut lines =
        vec!["If you lifted it, up is wrong: set the vertical axis of the system to z.".into()];
    if !is_nose_right(displacement) {
        let text = "If you carried it nose first, the nose is wrong: the x axis of the object has to be that of the \
                    way, define it again in the system.";
        lines.push(text.into());
    }
    lines
}

/// What to write into the settings of the frame.
fn frame_lines(displacement: &Displacement) -> Result<Vec<String>> {
    let Displacement { source_axis, object_axis, object_off_deg, climb_deg, .. } = *displacement;
    let frame = FrameTable { axes: Some(axes_with_up(source_axis)), nose: None, unit: None };
    let frame = serde_json::to_string(&frame)?;
    let mut lines = vec![format!("If you lifted it, up is wrong: write \"frame\": {frame}")];
    if climb_deg.abs() < 30.0 && !is_nose_right(displacement) {
        let name = object_axis.name();
        lines.push(if object_off_deg < NOSE_OFF_MAX_DEG {
            format!("If you carried it nose first, the nose is {name:?}: write \"nose\": {name:?} into \"frame\".")
        } else {
            format!(
                "If you carried it nose first, no axis of the object is its nose (the nearest one is off by \
                 {object_off_deg:.0} degrees): define it again in the system, nose along x."
            )
        });
    }
    Ok(lines)
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::{Axes, Placement, Unit};

    use super::super::displacement;
    use super::super::tests::track_to;
    use super::*;

    #[test]
    fn every_axis_can_be_up_without_mirroring() {
        for up in SourceAxis::ALL {
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

    #[test]
    fn a_nose_that_is_right_is_called_right() {
        let words = |pos_v: [f64; 3], has_frame: bool| {
            let displacement = displacement(&track_to(pos_v), &Axes::ours()).unwrap();
            displacement_lines(&displacement, has_frame).unwrap().join("\n")
        };
        for has_frame in [false, true] {
            let ahead = words([1.0, 0.1, 0.0], has_frame);
            assert!(ahead.contains("the nose is right") && !ahead.contains("again"), "{ahead}");
            assert!(!ahead.contains("\"nose\""), "{ahead}");
        }
        assert!(words([0.0, 1.0, 0.0], false).contains("the nose is wrong"));
        assert!(words([0.0, 1.0, 0.0], true).contains("write \"nose\": \"y\""));
        assert!(words([0.0, 0.0, 1.0], false).ends_with("up is right."));
        assert!(
            words([0.0, 1.0, 0.0], true)
                .contains("moved to its left: if you carried it to its right")
        );
        assert!(
            words([0.0, -1.0, 0.0], false)
                .contains("moved to its right: if you carried it to its left")
        );
        assert!(!words([1.0, 0.0, 0.0], true).contains("mirrored"));
        assert!(
            turn_line(Turn::By(-90.0)).starts_with(
                "It turned by -90 degrees, to the right: if you turned it to the left"
            )
        );
        let between = words([1.0, 0.8, 0.0], true);
        assert!(between.contains("no axis of the object is its nose"), "{between}");
        assert!(
            !between.contains("the nose is right") && !between.contains("\"nose\""),
            "{between}"
        );
    }
}
