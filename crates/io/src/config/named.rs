//! Keys that the log of a flight may lack and settings may not.
//!
//! A log from before such a key is read as it was flown. Settings without it would fly less protected than their
//! author believes, without a word.

use serde_json::Value;

use super::place::{Place, Step};
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
pub(super) fn unnamed(settings: &Value) -> impl Iterator<Item = (Place, String)> + '_ {
    let built_in: Value = parse(BUILT_IN_FLY).unwrap_or_default();
    NAMED.iter().filter_map(move |key| {
        let place = Place::of_key(key);
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
            let parent = Place::of_key(parent);
            parent.of_mut(&mut settings).unwrap().as_object_mut().unwrap().remove(name);
            let missed: Vec<_> = unnamed(&settings).collect();
            let [(place, text)] = &*missed else { panic!("{key}: {missed:?}") };
            assert_eq!(*place, parent);
            assert!(text.contains(&format!("missing field `{name}`")), "{text}");
        }
    }

    #[test]
    fn a_part_that_is_switched_off_needs_no_keys() {
        let mut settings: Value = parse(BUILT_IN_FLY).unwrap();
        settings["cycle"]["link"] = Value::Null;
        settings["cycle"]["mpc"]["walls"] = Value::Null;
        assert_eq!(unnamed(&settings).count(), 0);
    }
}
