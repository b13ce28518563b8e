//! Vehicles that follow a reference.

use super::*;

/// Flies `mission` with a vehicle that is put to `place(reference, where it was)` each period, until
/// it is finished or `periods` have passed. The time comes back. s
pub(in crate::mission) fn fly(
    mission: &mut Mission,
    mut place: impl FnMut(&Reference, &Pose) -> Pose,
    periods: u32,
) -> f64 {
    let mut at = mission.first_pose();
    for step in 1..=periods {
        at = place(&now(mission), &at);
        mission.advance(&at);
        if mission.is_finished() {
            return f64::from(step) * DT_S;
        }
    }
    f64::from(periods) * DT_S
}

/// A vehicle that follows within its speed, but freezes, is pushed away and trembles.
pub(in crate::mission) struct Disturbed {
    state: u64,
    at: Pose,
    frozen: u32,
    was_frozen: bool,
}

impl Disturbed {
    pub(in crate::mission) fn new(seed: u64, at: Pose) -> Self {
        Self { state: seed, at, frozen: 0, was_frozen: false }
    }

    /// Where it is one period later.
    pub(in crate::mission) fn follow(&mut self, to: &Pose, is_disturbed: bool) -> Pose {
        self.was_frozen = self.frozen > 0;
        self.frozen = self.frozen.saturating_sub(1);
        if is_disturbed && self.random() < 0.004 {
            self.frozen = 150;
        }
        if is_disturbed && self.random() < 0.003 {
            let push = Pose::from_fn(|_, _| 2.0 * self.random() - 1.0);
            self.at += 0.7 * push;
        }
        if !is_disturbed || self.frozen == 0 {
            let displacement = to - self.at;
            self.at += displacement * (1.5 * DT_S / displacement.norm().max(1.5 * DT_S));
        }
        let noise = Pose::from_fn(|_, _| 0.02 * (self.random() - 0.5));
        self.at + noise
    }

    /// Whether it has just thawed.
    pub(in crate::mission) fn is_released(&self) -> bool {
        self.was_frozen && self.frozen == 0
    }

    /// Uniform in 0..1, from a linear congruential generator.
    fn random(&mut self) -> f64 {
        self.state = self
            .state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.state >> 11) as f64 / (1_u64 << 53) as f64
    }
}
