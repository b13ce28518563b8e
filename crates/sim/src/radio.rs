//! The command link: when the drone ignores its sticks.
//!
//! Owns the up and down times of the link (real Tellos ignore commands two to five seconds at a time,
//! about three times a minute). What a lost command does to the vehicle is [`crate::plant`]'s.

use crate::DT_S;
use crate::random::{Purpose, Random};

/// How often commands get lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LostCommands {
    /// Every command arrives.
    Never,
    /// 20 s up, 3 s down.
    Mild,
    /// 14 s up, 4 s down: the thesis' closed-loop flights. Down for 25 % of the time in the long run,
    /// for 21 % of a 20 s flight, which starts with the link up.
    Strong,
}

/// Shape of the down times.
const DOWN_SIGMA: f64 = 0.6;
/// Longest down time. s.
const DOWN_MAX_S: f64 = 15.0;

impl LostCommands {
    /// Mean up time and median down time. s.
    fn times_s(self) -> Option<(f64, f64)> {
        match self {
            Self::Never => None,
            Self::Mild => Some((20.0, 3.0)),
            Self::Strong => Some((14.0, 4.0)),
        }
    }
}

/// State of the link, advanced once per step.
#[derive(Debug, Clone)]
pub struct Radio {
    lost: LostCommands,
    random: Random,
    is_up: bool,
    /// Time until the state changes. s.
    remaining_s: f64,
}

impl Radio {
    /// A link that is up.
    pub fn new(lost: LostCommands, seed: u64) -> Self {
        let mut random = Random::new(seed, Purpose::Radio);
        let remaining_s = lost.times_s().map_or(0.0, |(up_s, _)| random.exponential(up_s));
        Self { lost, random, is_up: true, remaining_s }
    }

    /// Whether commands arrive during the coming step: up times are exponential, down times
    /// log-normal and capped.
    pub fn step(&mut self) -> bool {
        let Some((up_s, down_s)) = self.lost.times_s() else { return true };
        while self.remaining_s <= 0.0 {
            self.is_up = !self.is_up;
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
    use super::*;

    /// Lengths of the link's (up, down) periods over `steps` steps. s.
    fn periods(lost: LostCommands, steps: u32) -> (Vec<f64>, Vec<f64>) {
        let mut radio = Radio::new(lost, 5);
        let (mut up, mut down) = (Vec::new(), Vec::new());
        let (mut was_up, mut length_s) = (true, 0.0);
        for _ in 0..steps {
            let is_up = radio.step();
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
        let (up, down) = periods(LostCommands::Never, 100_000);
        assert!(up.is_empty() && down.is_empty());
    }

    #[test]
    fn up_and_down_times_follow_the_flights() {
        for (lost, up_s, down_s) in
            [(LostCommands::Strong, 14.0, 4.0), (LostCommands::Mild, 20.0, 3.0)]
        {
            let (up, mut down) = periods(lost, 4_000_000);
            let mean = up.iter().sum::<f64>() / up.len() as f64;
            let error = up_s / (up.len() as f64).sqrt();
            assert!((mean - up_s).abs() < 3.0 * error, "{lost:?}: up {mean} s, sd {error}");

            down.sort_by(f64::total_cmp);
            let median = down[down.len() / 2];
            // Standard error of a median: sqrt(pi / 2) sigma / sqrt(n), on the logarithm.
            let error = 1.2533 * DOWN_SIGMA / (down.len() as f64).sqrt();
            assert!((median / down_s).ln().abs() < 3.0 * error, "{lost:?}: down {median} s");
            let longest = down.iter().copied().fold(0.0, f64::max);
            assert!((14.0..=DOWN_MAX_S + DT_S).contains(&longest), "{lost:?}: longest {longest} s");
        }
    }

    #[test]
    fn a_strong_link_is_down_a_quarter_of_the_time() {
        // Mean down time 4 exp(0.18) = 4.8 s, less the cap; 4.7 / (14 + 4.7) = 0.25.
        let mut radio = Radio::new(LostCommands::Strong, 6);
        let down = (0..4_000_000).filter(|_| !radio.step()).count() as f64 / 4e6;
        assert!((0.235..0.265).contains(&down), "down {down}");
    }
}
