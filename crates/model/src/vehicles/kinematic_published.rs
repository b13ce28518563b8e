//! The vehicle model of the thesis' published program.
//!
//! Owns one mistake: the program reads the altitude where the heading belongs in the two roll terms.
//! The thesis' parameters (table 5.1) and its hand-tuned heading correction are those of this model,
//! so it reproduces and explains them. It flies in the baseline only; everything else is
//! [`Kinematic`].

use crate::Matrix;
use crate::model::{Model, ParameterHessian};
use crate::row::Row;
use crate::vehicles::kinematic::{ByInput, ByParameter, ByState, Kinematic, Parameter};
use crate::vehicles::rows::{Pose, Sticks, gain, pose, stick};

/// [`Kinematic`] with the altitude in place of the heading in the roll terms:
/// `x' = lambda_h (sin(z + theta_0) roll + cos psi pitch)`,
/// `y' = lambda_h (sin psi pitch - cos(z + theta_0) roll)`, with `psi = theta + theta_0`.
///
/// The rows are those of [`Kinematic`]; the altitude in metres is read as an angle in radians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct KinematicPublished;

/// A state and an input at which [`Kinematic`] is asked for one part of the motion.
type Part = (Pose, Sticks);

/// The published motion as two motions of [`Kinematic`]: all sticks but roll at `s`, and roll alone
/// at `s` with the altitude in the heading's place.
#[inline]
fn parts(s: &Pose, u: &Sticks) -> [Part; 2] {
    let (mut s_turned, mut u_rest, mut u_roll) = (*s, *u, Sticks::zeros());
    s_turned[pose::THETA] = s[pose::Z];
    u_rest[stick::ROLL] = 0.0;
    u_roll[stick::ROLL] = u[stick::ROLL];
    [(*s, u_rest), (s_turned, u_roll)]
}

impl Model<{ pose::COUNT }, { stick::COUNT }, { pose::COUNT }, { gain::COUNT }>
    for KinematicPublished
{
    const NAME: &'static str = "kinematic_published";
    const STATE: [Row; pose::COUNT] = Kinematic::STATE;
    const INPUT: [Row; stick::COUNT] = Kinematic::INPUT;
    const OBSERVATION: [Row; pose::COUNT] = Kinematic::OBSERVATION;
    const PARAMETER: [Row; gain::COUNT] = Kinematic::PARAMETER;

    #[inline]
    fn step(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> Pose {
        let [(s, u_rest), (s_turned, u_roll)] = parts(s, u);
        let moved = Kinematic.step(&s_turned, &u_roll, p, dt_s) - s_turned;
        Kinematic.step(&s, &u_rest, p, dt_s) + moved
    }

    #[inline]
    fn step_by_state(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> ByState {
        let [(s, u_rest), (s_turned, u_roll)] = parts(s, u);
        let by_turned = Kinematic.step_by_state(&s_turned, &u_roll, p, dt_s);
        let mut j = Kinematic.step_by_state(&s, &u_rest, p, dt_s);
        j[(pose::X, pose::Z)] = by_turned[(pose::X, pose::THETA)];
        j[(pose::Y, pose::Z)] = by_turned[(pose::Y, pose::THETA)];
        j
    }

    #[inline]
    fn step_by_input(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> ByInput {
        let [(s, u_rest), (s_turned, u_roll)] = parts(s, u);
        let by_turned = Kinematic.step_by_input(&s_turned, &u_roll, p, dt_s);
        let mut j = Kinematic.step_by_input(&s, &u_rest, p, dt_s);
        j.set_column(stick::ROLL, &by_turned.column(stick::ROLL));
        j
    }

    #[inline]
    fn step_by_parameter(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> ByParameter {
        // The motion is linear in the sticks, so its parts add up.
        let [(s, u_rest), (s_turned, u_roll)] = parts(s, u);
        Kinematic.step_by_parameter(&s, &u_rest, p, dt_s)
            + Kinematic.step_by_parameter(&s_turned, &u_roll, p, dt_s)
    }

    #[inline]
    fn hessian_by_parameter(
        &self,
        s: &Pose,
        u: &Sticks,
        p: &Parameter,
        dt_s: f64,
        w: &Pose,
    ) -> Option<ParameterHessian<{ pose::COUNT }, { gain::COUNT }>> {
        let [(s, u_rest), (s_turned, u_roll)] = parts(s, u);
        let turned = Kinematic.hessian_by_parameter(&s_turned, &u_roll, p, dt_s, w)?;
        let mut curvature = Kinematic.hessian_by_parameter(&s, &u_rest, p, dt_s, w)?;
        curvature.by_state[(pose::Z, pose::Z)] = turned.by_state[(pose::THETA, pose::THETA)];
        curvature.by_state_parameter.set_row(pose::Z, &turned.by_state_parameter.row(pose::THETA));
        curvature.by_parameter += turned.by_parameter;
        Some(curvature)
    }

    #[inline]
    fn observe(&self, s: &Pose) -> Pose {
        *s
    }

    #[inline]
    fn observe_by_state(&self, _s: &Pose) -> ByState {
        Matrix::identity()
    }

    #[inline]
    fn at_rest(&self, o: &Pose) -> Pose {
        *o
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::check::{Point, model_gap};

    const DT_S: f64 = 0.02;

    fn p(theta_0: f64) -> Parameter {
        Parameter::from([1.0658, 0.4471, 0.9569, theta_0])
    }

    #[test]
    fn every_jacobian_meets_its_numeric_twin() {
        for theta in [-9.0, -PI, 0.0, 0.3, PI - 1e-9, PI + 1e-9, 7.0] {
            for z in [0.0, 0.4, 1.3, 2.5] {
                let at = Point {
                    s: Pose::new(0.4, -1.2, z, theta),
                    u: Sticks::new(0.7, -0.6, 0.5, -0.9),
                    p: p(-0.1742),
                    dt_s: DT_S,
                };
                // Central differences of sines over a step of 6e-6 leave about 1e-10.
                let gap = model_gap(&KinematicPublished, &at).gap;
                assert!(gap < 1e-8, "gap {gap:e} at theta = {theta}, z = {z}");
            }
        }
    }

    #[test]
    fn it_is_the_kinematic_model_where_altitude_equals_heading() {
        let (s, u) = (Pose::new(0.4, -1.2, 1.3, 1.3), Sticks::new(0.7, -0.6, 0.5, -0.9));
        let gap =
            KinematicPublished.step(&s, &u, &p(0.2), DT_S) - Kinematic.step(&s, &u, &p(0.2), DT_S);
        assert!(gap.norm() < 1e-15, "{gap}");
    }

    #[test]
    fn a_roll_flies_where_the_altitude_points() {
        // Facing +x at an altitude of pi / 2 m, a roll to the right should fly to -y; it flies to +x.
        let s = Pose::new(0.0, 0.0, FRAC_PI_2, 0.0);
        let roll = Sticks::new(1.0, 0.0, 0.0, 0.0);
        let moved = KinematicPublished.step(&s, &roll, &p(0.0), DT_S) - s;
        let expected = Pose::new(DT_S * p(0.0)[gain::LAMBDA_H], 0.0, 0.0, 0.0);
        assert!((moved - expected).norm() < 1e-15, "{moved}");
    }
}
