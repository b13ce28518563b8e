//! From the controller's sticks to a person's without a jump.
//!
//! Owns how the sticks of a person begin. The way back needs nothing: the controller plans from the
//! sticks under way.

use tello_model::rows::Sticks;

/// How long the sticks of a person take to count in full. Sudden enough for whoever evades something:
/// the vehicle itself needs a third of a second before it answers at all. s
const HAND_OVER_S: f64 = 0.2;

/// The change from the last sticks that were sent to those of a person.
#[derive(Debug, Clone, Default)]
pub(super) struct HandOver {
    /// Sticks when the person took over, and his share now; `None` while nobody steers by hand.
    under_way: Option<(Sticks, f64)>,
}

impl HandOver {
    /// The sticks to send for `u_hand`, between them and the last ones sent before the person took
    /// over: `u = (1 - c) u_before + c u_hand`, with `c` from 0 to 1 in 0.2 s.
    pub(super) fn blend(&mut self, u_hand: &Sticks, u_newest: &Sticks, dt_s: f64) -> Sticks {
        let (u_before, share) = self.under_way.unwrap_or((*u_newest, 0.0));
        let share = (share + dt_s / HAND_OVER_S).min(1.0);
        self.under_way = Some((u_before, share));
        u_before * (1.0 - share) + u_hand * share
    }

    /// The person does not steer.
    pub(super) fn end(&mut self) {
        self.under_way = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sticks_of_a_person_count_in_full_after_ten_ticks_and_never_jump() {
        let mut hand_over = HandOver::default();
        let (before, hand) = (Sticks::new(0.8, -0.4, 0.0, 0.2), Sticks::new(-1.0, 0.0, 0.5, 0.2));
        let mut u = before;
        for tick in 1..=10 {
            let next = hand_over.blend(&hand, &u, 0.02);
            assert!((next - u).amax() < 0.181, "tick {tick}: {u} to {next}");
            u = next;
        }
        assert!((u - hand).amax() < 1e-12, "{u}");
        // A second time it begins at what is sent then.
        hand_over.end();
        assert!((hand_over.blend(&before, &hand, 0.02) - hand).amax() < 0.181);
    }
}
