//! A turn of the object by hand, which shows whether the frame is mirrored.
//!
//! Owns the sum of the turns from place to place: the difference of two headings has no side beyond half a turn.

use std::f64::consts::FRAC_PI_2;

use horizon_model::angle::wrap;

/// Smallest change of the heading that is a turn by hand, not how a person carries. deg
const TURN_MIN_DEG: f64 = 30.0;

/// Beyond it, between one place and the next, the side of a turn is not seen. rad
const TURN_STEP_MAX_RAD: f64 = FRAC_PI_2;

/// A turn about the vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Turn {
    /// By this angle, whole turns included; positive to the left. deg
    By(f64),
    /// Between two places so much that it may have been to the other side.
    Unseen,
}

/// Sum of the turns between one place and the next.
#[derive(Debug, Default)]
pub(super) struct HeadingTurn {
    /// Newest heading. rad
    theta_rad: Option<f64>,
    /// Since the first heading; positive to the left. rad
    turned_rad: f64,
    is_unseen: bool,
}

impl HeadingTurn {
    /// Takes the newest heading. rad
    pub(super) fn observe(&mut self, theta_rad: f64) {
        let Some(before_rad) = self.theta_rad.replace(theta_rad) else { return };
        let step_rad = wrap(theta_rad - before_rad);
        self.turned_rad += step_rad;
        self.is_unseen |= step_rad.abs() > TURN_STEP_MAX_RAD;
    }

    /// The turn; `None` below [`TURN_MIN_DEG`].
    pub(super) fn shown(&self) -> Option<Turn> {
        let turned_deg = self.turned_rad.to_degrees();
        if self.is_unseen {
            return Some(Turn::Unseen);
        }
        (turned_deg.abs() > TURN_MIN_DEG).then_some(Turn::By(turned_deg))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turn of an object whose headings were these, one after the other.
    fn turn_by(headings_deg: &[f64]) -> Option<Turn> {
        let mut turn = HeadingTurn::default();
        for heading_deg in headings_deg {
            turn.observe(wrap(heading_deg.to_radians()));
        }
        turn.shown()
    }

    #[test]
    fn a_turn_by_hand_is_the_sum_of_what_was_seen_of_it() {
        assert_eq!(turn_by(&[0.0, 20.0]), None);
        for expected_deg in [-200.0, -90.0, 120.0, 250.0, 400.0] {
            let parts = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
            let turn = turn_by(&parts.map(|part| 170.0 + part * expected_deg));
            let is_right = matches!(turn, Some(Turn::By(deg)) if (deg - expected_deg).abs() < 1e-9);
            assert!(is_right, "{expected_deg} degrees: {turn:?}");
        }
        assert_eq!(turn_by(&[0.0, 100.0]), Some(Turn::Unseen));
    }
}
