//! Keys that the log of a flight may lack and settings may not.
//!
//! A log from before such a key is read as it was flown. Settings without such a key are refused: the
//! protection would be off without notice.

use serde_json::Value;

use super::place::{KeyPath, Step};
use super::{BUILT_IN_FLY, parse};

const NAMED: [&str; 20] = [
    "cycle.uses_measurement_time",
    "cycle.standing",
    "cycle.filter.angle_growth_refused_rad",
    "cycle.link.dead_time_adapt_s",
    "cycle.link.dead_time_change_s",
    "cycle.link.dead_time_min_ratio",
    "cycle.link.outage_stick_max",
    "cycle.link.dead_time",
    "cycle.link.turn",
    "cycle.link.height",
    "cycle.mpc.walls",
    "cycle.mpc.walls.obstacle_accel_mps2",
    "cycle.mpc.walls.margin_sd",
    "cycle.mpc.walls.coasting",
    "cycle.obstacles",
    "cycle.supervisor.failsafe",
    "cycle.supervisor.failsafe.pressed_s",
    "cycle.supervisor.failsafe.person_gone_s",
    "cycle.monitors",
    "cycle.monitors.heading_rad",
];

/// The keys that `settings` have to name and do not: where they belong, and what the built-in settings have there.
pub(super) fn unnamed(settings: &Value) -> impl Iterator<Item = (KeyPath, String)> + '_ {
    let built_in: Value = parse(BUILT_IN_FLY).unwrap_or_default();
    NAMED.iter().filter_map(move |key| {
        let place = KeyPath::of_key(key);
        let parent = place.head(place.0.len() - 1);
        let Some(Step::Key(name)) = place.0.last() else { return None };
        let is_named = parent.of(settings)?.as_object()?.contains_key(name);
        let usual = place.of(&built_in)?;
        let text = format!("{parent}: missing field `{name}`; the built-in settings have {usual}");
        (!is_named).then_some((parent, text))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_is_in_the_built_in_settings_and_missed_where_it_is_not_named() {
        let built_in: Value = parse(BUILT_IN_FLY).unwrap();
        assert_eq!(unnamed(&built_in).count(), 0);
        for key in NAMED {
            let (parent, name) = key.rsplit_once('.').unwrap();
            let mut settings = built_in.clone();
            let parent = KeyPath::of_key(parent);
            parent.of_mut(&mut settings).unwrap().as_object_mut().unwrap().remove(name);
            let missed: Vec<_> = unnamed(&settings).collect();
            let [(place, text)] = &*missed else { panic!("{key}: {missed:?}") };
            assert_eq!(*place, parent);
            assert!(text.contains(&format!("missing field `{name}`")), "{text}");
        }
    }

    /// Places of all keys in `value`, below `place`.
    fn places(value: &Value, place: &KeyPath, to: &mut Vec<KeyPath>) {
        for (key, value) in value.as_object().into_iter().flatten() {
            let place = place.with(key);
            places(value, &place, to);
            to.push(place);
        }
    }

    #[test]
    fn settings_that_lack_any_key_of_the_built_in_ones_are_refused() {
        let built_in: Value = parse(BUILT_IN_FLY).unwrap();
        let mut all = Vec::new();
        places(&built_in, &KeyPath::default(), &mut all);
        let is_missed = |place: &KeyPath| {
            let mut settings = built_in.clone();
            let parent = place.head(place.0.len() - 1);
            let Some(Step::Key(name)) = place.0.last() else { return false };
            parent.of_mut(&mut settings).unwrap().as_object_mut().unwrap().remove(name);
            unnamed(&settings).next().is_some()
                || serde_json::from_value::<super::super::FlyTable>(settings).is_err()
        };
        let kept: Vec<String> =
            all.iter().filter(|place| !is_missed(place)).map(ToString::to_string).collect();
        // What these do if they are missing is in `docs/configuration.md`.
        let expected = [
            "cycle.mpc.stages",
            "cycle.mpc.walls.vehicle_radius_m",
            "cycle.supervisor.land_from_m",
            "real_time.frame_wait_s",
        ];
        assert_eq!(kept, expected, "of {} keys", all.len());
    }

    #[test]
    fn a_part_that_is_switched_off_needs_no_keys() {
        let mut settings: Value = parse(BUILT_IN_FLY).unwrap();
        settings["cycle"]["link"] = Value::Null;
        settings["cycle"]["mpc"]["walls"] = Value::Null;
        assert_eq!(unnamed(&settings).count(), 0);
    }
}
