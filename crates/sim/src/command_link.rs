//! The command link: when the drone ignores its sticks.
//!
//! Owns the up and down times of the link (real Tellos ignore commands two to five seconds at a time,
//! about three times a minute). What a lost command does to the vehicle is [`crate::plant`]'s.

use crate::DT_S;
use crate::firmware::OutageBehaviour;
use crate::profile::Profile;
use crate::random::{Purpose, Random};

/// Shape of the down times. 1
const DOWN_SIGMA: f64 = 0.6;
/// Longest down time. s
const DOWN_MAX_S: f64 = 15.0;

/// Mean up time and median down time, if commands get lost at all. s
///
/// The thesis' closed-loop flights are [`Profile::Outages`]: down for 25 % of the time in the long
/// run, for 21 % of a 20 s flight, which starts with the link up.
fn times_s(profile: Profile) -> Option<(f64, f64)> {
    match profile {
        Profile::Clean | Profile::GoodDay | Profile::Typical | Profile::BadDay => None,
        Profile::MildOutages => Some((20.0, 3.0)),
        Profile::Outages => Some((14.0, 4.0)),
    }
}

/// State of the link, advanced once per step.
#[derive(Debug, Clone)]
pub struct CommandLink {
    times_s: Option<(f64, f64)>,
    random: Random,
    is_up: bool,
    outage: OutageBehaviour,
    /// Draws what acts during an outage.
    outage_random: Random,
    /// Whether the last sticks that arrived stay applied during the present or last outage.
    pub(crate) is_held: bool,
    /// Time until the state changes. s
    remaining_s: f64,
}

impl CommandLink {
    /// A link that is up; its outages level the vehicle. `seed` selects when they come, `profile` how often.
    pub fn new(profile: Profile, seed: u64) -> Self {
        let times_s = times_s(profile);
        let mut random = Random::new(seed, Purpose::Radio);
        let remaining_s = times_s.map_or(0.0, |(up_s, _)| random.exponential(up_s));
        let outage_random = Random::new(seed, Purpose::Outage);
        let outage = OutageBehaviour::Level;
        Self { times_s, random, is_up: true, outage, outage_random, is_held: false, remaining_s }
    }

    /// The link with `outage` in place of its outages.
    #[must_use]
    pub(crate) fn with_outages(self, outage: OutageBehaviour) -> Self {
        Self { outage, ..self }
    }

    /// Whether commands arrive during the coming step: up times are exponential, down times
    /// log-normal and capped.
    pub fn step(&mut self) -> bool {
        let Some((up_s, down_s)) = self.times_s else { return true };
        while self.remaining_s <= 0.0 {
            self.is_up = !self.is_up;
            if !self.is_up {
                let is_drawn = self.outage_random.chance(0.5);
                self.is_held = match self.outage {
                    OutageBehaviour::Level => false,
                    OutageBehaviour::Held => true,
                    OutageBehaviour::Mixed => is_drawn,
                };
            }
            self.remaining_s += if self.is_up {
                self.random.exponential(up_s)
            } else {
                self.random.log_normal(down_s, DOWN_SIGMA).min(DOWN_MAX_S)
            };
        }
        self.remaining_s -= DT_S;
        self.is_up
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::check::maximum;

    use super::*;

    /// Lengths of the link's (up, down) periods over `steps` steps. s
    fn periods(profile: Profile, steps: u32) -> (Vec<f64>, Vec<f64>) {
        let mut link = CommandLink::new(profile, 5);
        let (mut up, mut down) = (Vec::new(), Vec::new());
        let (mut was_up, mut length_s) = (true, 0.0);
        for _ in 0..steps {
            let is_up = link.step();
            if is_up != was_up {
                (if was_up { &mut up } else { &mut down }).push(length_s);
                (was_up, length_s) = (is_up, 0.0);
            }
            length_s += DT_S;
        }
        (up, down)
    }

    #[test]
    fn a_perfect_link_is_always_up() {
        for profile in [Profile::Clean, Profile::GoodDay, Profile::Typical, Profile::BadDay] {
            let (up, down) = periods(profile, 100_000);
            assert!(up.is_empty() && down.is_empty(), "{profile:?}");
        }
    }

    #[test]
    fn up_and_down_times_follow_the_flights() {
        for (profile, up_s, down_s) in
            [(Profile::Outages, 14.0, 4.0), (Profile::MildOutages, 20.0, 3.0)]
        {
            let (up, mut down) = periods(profile, 4_000_000);
            let mean = up.iter().sum::<f64>() / up.len() as f64;
            let error = up_s / (up.len() as f64).sqrt();
            assert!((mean - up_s).abs() < 3.0 * error, "{profile:?}: up {mean} s, sd {error}");

            down.sort_by(f64::total_cmp);
            let median = down[down.len() / 2];
            // Standard error of a median: sqrt(pi / 2) sigma / sqrt(n), on the logarithm.
            let error = 1.2533 * DOWN_SIGMA / (down.len() as f64).sqrt();
            assert!((median / down_s).ln().abs() < 3.0 * error, "{profile:?}: down {median} s");
            let longest = down.iter().copied().fold(0.0, maximum);
            assert!(
                (14.0..=DOWN_MAX_S + DT_S).contains(&longest),
                "{profile:?}: longest {longest} s"
            );
        }
    }

    #[test]
    fn outages_are_held_released_or_both_and_come_at_the_same_times() {
        let states = |outage| -> Vec<(bool, bool)> {
            let mut link = CommandLink::new(Profile::Outages, 7).with_outages(outage);
            (0..200_000).map(|_| (link.step(), link.is_held)).collect()
        };
        let [level, held, mixed] =
            [OutageBehaviour::Level, OutageBehaviour::Held, OutageBehaviour::Mixed].map(states);
        let times = |states: &[(bool, bool)]| -> Vec<bool> {
            states.iter().map(|(is_up, _)| *is_up).collect()
        };
        assert!(times(&level) == times(&held) && times(&level) == times(&mixed));
        let down = |states: Vec<(bool, bool)>| states.into_iter().filter(|(is_up, _)| !is_up);
        assert!(down(level).all(|(_, is_held)| !is_held));
        assert!(down(held).all(|(_, is_held)| is_held));
        let count = down(mixed.clone()).count() as f64;
        let held = down(mixed).filter(|(_, is_held)| *is_held).count() as f64 / count;
        // About 210 outages.
        assert!((0.3..0.7).contains(&held), "{held} of the time in outages is held");
    }

    #[test]
    fn a_strong_link_is_down_a_quarter_of_the_time() {
        // Mean down time 4 exp(0.18) = 4.8 s, less the cap; 4.7 / (14 + 4.7) = 0.25.
        let mut link = CommandLink::new(Profile::Outages, 6);
        let down = (0..4_000_000).filter(|_| !link.step()).count() as f64 / 4e6;
        assert!((0.235..0.265).contains(&down), "down {down}");
    }
}
