//! From the controller's sticks to a person's and back without a jump.
//!
//! Owns how the sticks of a new pilot begin. Estimator and controller receive the sent sticks, so that
//! nothing else has to know of the change.

use horizon_model::rows::Sticks;

use crate::Pilot;

/// How long the sticks of a new pilot take to count in full. Sudden enough for a person who evades something:
/// the vehicle itself needs a third of a second before it answers at all. s
const HAND_OVER_S: f64 = 0.2;

/// The change from the last sticks that were sent to those of another pilot.
#[derive(Debug, Clone, Default)]
pub(super) struct HandOver {
    pilot: Option<Pilot>,
    /// Sticks when the pilot took over, and the pilot's fraction now; `None` once it is one.
    running: Option<(Sticks, f64)>,
}

impl HandOver {
    /// The sticks to send for `u_new` of `pilot`, between them and the last ones that were sent before the pilot
    /// took over: `u = (1 - c) u_before + c u_new`, with `c`, `fraction` in code, from 0 to 1 in [`HAND_OVER_S`].
    /// A controller that takes over where no pilot steered has full authority at once, as after a take-off.
    pub(super) fn blend(
        &mut self,
        pilot: Pilot,
        u_new: &Sticks,
        u_newest: &Sticks,
        dt_s: f64,
    ) -> Sticks {
        if self.pilot != Some(pilot) {
            let is_gradual = self.pilot.is_some() || pilot == Pilot::Person;
            self.running = is_gradual.then_some((*u_newest, 0.0));
            self.pilot = Some(pilot);
        }
        let Some((u_before, fraction)) = self.running else { return *u_new };
        let fraction = fraction + dt_s / HAND_OVER_S;
        self.running = (fraction < 1.0).then_some((u_before, fraction));
        let fraction = fraction.min(1.0);
        u_before * (1.0 - fraction) + u_new * fraction
    }

    /// No pilot steers.
    pub(super) fn end(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;

    use super::*;

    const BEFORE: Sticks = Sticks::new(0.8, -0.4, 0.0, 0.2);
    const AFTER: Sticks = Sticks::new(-1.0, 0.0, 0.5, 0.2);

    #[test]
    fn the_sticks_of_a_new_pilot_count_in_full_after_ten_ticks_and_never_jump() {
        let mut hand_over = HandOver::default();
        assert_eq!(hand_over.blend(Pilot::Controller, &BEFORE, &Sticks::zeros(), 0.02), BEFORE);
        for (pilot, u_new) in [(Pilot::Person, AFTER), (Pilot::Controller, BEFORE)] {
            let mut u = if u_new == AFTER { BEFORE } else { AFTER };
            for tick in 1..=11 {
                let next = hand_over.blend(pilot, &u_new, &u, 0.02);
                assert!(amax(&(next - u)) < 0.181, "{pilot:?}, tick {tick}: {u} to {next}");
                u = next;
            }
            assert_eq!(u, u_new, "{pilot:?}");
        }
    }

    #[test]
    fn a_controller_that_takes_over_from_no_pilot_has_all_at_once() {
        let mut hand_over = HandOver::default();
        hand_over.blend(Pilot::Person, &AFTER, &BEFORE, 0.02);
        hand_over.end();
        assert_eq!(hand_over.blend(Pilot::Controller, &AFTER, &BEFORE, 0.02), AFTER);
    }
}
