//! Rates: those of the settings, and what measured ones suggest.

use tello_io::mocap::MocapTable;

/// A measured rate that differs by less is the one of the settings. 1
const RATE_NEAR: f64 = 5e-3;

/// The rate of a source that does not announce its own. Hz
fn set_hz(table: &MocapTable) -> Option<f64> {
    match table {
        MocapTable::Udp(table) => Some(table.rate_hz),
        MocapTable::Vrpn(table) => Some(table.rate_hz),
        MocapTable::Relay(_)
        | MocapTable::Datastream(_)
        | MocapTable::Natnet(_)
        | MocapTable::Qtm(_) => None,
    }
}

/// Settings for an object, with the measured rate, without gaps, where the source does not announce its own.
pub(super) fn suggested(table: &MocapTable, object: &str, rate_hz: f64) -> MocapTable {
    let mut suggested = table.of_object(object);
    suggested.set_rate_hz(nominal_hz(rate_hz));
    suggested
}

/// The rate that settings should have where the measured one is not theirs. Hz
pub(super) fn other_hz(table: &MocapTable, measured_hz: f64) -> Option<f64> {
    let set_hz = set_hz(table).filter(|_| measured_hz > 0.0)?;
    let is_near = (measured_hz / set_hz - 1.0).abs() < RATE_NEAR;
    (!is_near).then(|| nominal_hz(measured_hz))
}

/// The rate that a source is likely to have by its name: a whole number, or that of film and video, 1000/1001 of one.
fn nominal_hz(measured_hz: f64) -> f64 {
    let whole_hz = measured_hz.round().max(1.0);
    let video_hz = (measured_hz * 1.001).round().max(1.0) / 1.001;
    let is_video = (measured_hz - video_hz).abs() < (measured_hz - whole_hz).abs();
    let is_video = is_video && (20.0..125.0).contains(&measured_hz);
    if is_video { (video_hz * 1e3).round() / 1e3 } else { whole_hz }
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::VrpnTable;

    use super::*;

    #[test]
    fn a_measured_rate_has_the_name_of_the_nearest_usual_one() {
        for (measured_hz, expected_hz) in [
            (59.938, 59.94),
            (60.01, 60.0),
            (29.969, 29.97),
            (240.04, 240.0),
            (499.8, 500.0),
            (0.2, 1.0),
        ] {
            let found_hz = nominal_hz(measured_hz);
            assert!((found_hz - expected_hz).abs() < 1e-9, "{measured_hz}: {found_hz}");
        }
    }

    #[test]
    fn the_rate_of_the_settings_stands_unless_another_was_measured() {
        let table = |rate_hz| {
            let (address, object) = ("a:3883".into(), "tello".into());
            MocapTable::Vrpn(VrpnTable { address, object, rate_hz, frame: None })
        };
        assert_eq!(other_hz(&table(59.94), 60.01), None);
        assert_eq!(other_hz(&table(100.0), 0.0), None, "nothing was measured");
        assert_eq!(other_hz(&table(100.0), 239.8), Some(240.0));
    }
}
