//! Where the vehicle would be if the link monitor is wrong.
//!
//! Owns the worst case of a command outage: while the commands are taken to be lost, other states apply all of
//! them. The supervisor lands if one of them leaves the room: the motion capture may see another object.

use horizon_model::rows::Sticks;
use nalgebra::SVector;

use super::Vehicle;

/// The states that follow all commands, since an outage was detected.
#[derive(Debug, Clone)]
pub(super) struct WorstCase<const NS: usize, const NP: usize> {
    /// The parameter before the flight. An object that follows no commands has lowered the gains of the estimate
    /// before the outage is detected.
    p_prior: SVector<f64, NP>,
    /// With the estimate of the parameter, and with the parameter before the flight. Units of the rows
    s: Option<[SVector<f64, NS>; 2]>,
    /// Time since the detection. s
    for_s: f64,
}

impl<const NS: usize, const NP: usize> WorstCase<NS, NP> {
    /// No outage so far; `p_prior` is the parameter before the flight.
    pub(super) fn new(p_prior: SVector<f64, NP>) -> Self {
        Self { p_prior, s: None, for_s: 0.0 }
    }

    /// One period of `dt_s` with the state of the link as detected; `u_nominal` would have been applied in it.
    pub(super) fn follow(
        &mut self,
        model: &impl Vehicle<NS, NP>,
        link_is_up: bool,
        (s_hat, p_hat): (&SVector<f64, NS>, &SVector<f64, NP>),
        u_nominal: &Sticks,
        dt_s: f64,
    ) {
        if link_is_up {
            (self.s, self.for_s) = (None, 0.0);
            return;
        }
        let [by_estimate, by_prior] = self.s.unwrap_or([*s_hat; 2]);
        self.s = Some([
            model.step(&by_estimate, u_nominal, p_hat, dt_s),
            model.step(&by_prior, u_nominal, &self.p_prior, dt_s),
        ]);
        self.for_s += dt_s;
    }

    /// States by the estimated parameter and by the prior, and the time since the detection, s; `None` without an
    /// outage.
    pub(super) fn states(&self) -> Option<([SVector<f64, NS>; 2], f64)> {
        Some((self.s?, self.for_s))
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use horizon_model::rows::{pose, stick};
    use nalgebra::Vector4;

    use super::*;

    #[test]
    fn an_outage_is_followed_by_both_parameters_until_the_link_is_up() {
        let mut u_nominal = Sticks::zeros();
        u_nominal[stick::PITCH] = 1.0;
        let mut worst_case = WorstCase::new(Vector4::new(1.5, 0.4, 1.0, 0.0));
        let s_hat = Vector4::new(1.0, 0.0, 1.0, 0.0);
        // An outage has lowered the estimate of the gain.
        let estimate = (&s_hat, &Vector4::new(0.5, 0.4, 1.0, 0.0));
        for _ in 0..50 {
            worst_case.follow(&Kinematic, false, estimate, &u_nominal, 0.02);
        }
        let (states, for_s) = worst_case.states().unwrap();
        assert!((for_s - 1.0).abs() < 1e-12, "{for_s}");
        let x_m = states.map(|s| s[pose::X]);
        assert!((x_m[0] - 1.5).abs() < 1e-9 && (x_m[1] - 2.5).abs() < 1e-9, "{x_m:?}");
        worst_case.follow(&Kinematic, true, estimate, &u_nominal, 0.02);
        assert!(worst_case.states().is_none());
    }
}
