//! Rates: those of the settings, and what measured ones suggest.

use tello_io::mocap::MocapTable;

/// A measured rate that differs by less is the one of the settings, or of the source. 1
const RATE_NEAR: f64 = 5e-3;

/// A rate by name is the measured one within this. 1
const NAME_NEAR: f64 = 3e-3;

/// Largest whole factor between what a source announces and how many of its frames come. 1
const FACTOR_MAX: f64 = 8.0;

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

/// Whether a flight would refuse the rate that a source announces: neither it nor a whole part of it is measured.
pub(super) fn is_wrong(announced_hz: f64, measured_hz: f64) -> bool {
    if !(announced_hz > 0.0 && measured_hz > 0.0) {
        return false;
    }
    let ratio = announced_hz / measured_hz;
    let factor = if ratio >= 1.0 { ratio } else { ratio.recip() };
    (factor / factor.round() - 1.0).abs() > RATE_NEAR || factor.round() > FACTOR_MAX
}

/// The rate that a source is likely to have by its name: a whole number, or that of film and video, 1000/1001 of a
/// multiple of 24 or 30; the measured one if none of them is near. At least 1
fn nominal_hz(measured_hz: f64) -> f64 {
    let measured_hz = measured_hz.max(1.0);
    let whole_hz = measured_hz.round();
    let film_hz = (measured_hz * 1.001).round();
    let is_film = (film_hz % 24.0).abs() < 0.5 || (film_hz % 30.0).abs() < 0.5;
    let video_hz = if is_film && film_hz < 125.0 { film_hz / 1.001 } else { whole_hz };
    let apart_hz = |hz: f64| (measured_hz - hz).abs();
    let nearest_hz = if apart_hz(video_hz) < apart_hz(whole_hz) { video_hz } else { whole_hz };
    if apart_hz(nearest_hz) <= NAME_NEAR * measured_hz {
        (nearest_hz * 1e3).round() / 1e3
    } else {
        (measured_hz * 1e2).round() / 1e2
    }
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
            (62.503, 62.5),
            (99.91, 100.0),
            (23.98, 23.976),
        ] {
            let found_hz = nominal_hz(measured_hz);
            assert!((found_hz - expected_hz).abs() < 1e-9, "{measured_hz}: {found_hz}");
        }
    }

    #[test]
    fn an_announced_rate_is_wrong_if_neither_it_nor_a_whole_part_of_it_comes() {
        for (announced_hz, measured_hz, expected) in [
            (100.0, 100.1, false),
            (59.94, 60.0, false),
            (240.0, 60.01, false),
            (50.0, 100.0, false),
            (0.0, 100.0, false),
            (100.6, 100.0, true),
            (37.0, 100.0, true),
            (900.0, 100.0, true),
        ] {
            assert_eq!(
                is_wrong(announced_hz, measured_hz),
                expected,
                "{announced_hz}, {measured_hz}"
            );
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
