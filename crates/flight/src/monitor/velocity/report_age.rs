//! Comparison of the poses with the drone's velocity if its reports have one assumed age.
//!
//! Owns the axes of the drone for this age, and the difference between both displacements.

use nalgebra::Complex;

use super::{AXES_KINDS, FIXED, MotionSample, VELOCITY_DRIFT_MPS, shortened};
use crate::forgetting::decay;

/// Time constant with which motion that showed the axes is forgotten. s
const AXES_FORGET_S: f64 = 30.0;
/// Least motion that shows the axes: integral of the squared deviation of the drone's velocity from its mean. m^2/s
pub(super) const MOTION_MIN: f64 = 0.15;
/// Multiple of [`MOTION_MIN`] from which on the age and the scale of the reports are known. 1
const WELL_KNOWN: f64 = 4.0;
/// Speed by the poses over speed by the drone: range of axes that fit, and to which it is clipped until it is well
/// known. 1
const SCALE: [f64; 2] = [0.6, 1.6];
const SCALE_EARLY: [f64; 2] = [0.75, 1.33];
/// Least fraction of the variance of the poses' velocity that the drone's explains if the axes fit (R^2). 1
const DETERMINATION_MIN: f64 = 0.7;

/// Axes of the drone that fit the motion.
#[derive(Debug, Clone, Copy)]
struct Fit {
    /// `R`: their rotation from those of the world, times the speed by the poses over that by the drone. 1
    axes: Complex<f64>,
    /// `rho^2`, the coefficient of determination. 1, 0..=1
    determination: f64,
}

/// Poses and velocity reports so far, with the assumed age.
#[derive(Debug, Clone, Default)]
pub(super) struct ReportAge {
    pub(super) sums: Sums,
    /// Axes by their kind, as motion showed them last; `None`: no axes of this kind fit.
    axes: [Option<Fit>; AXES_KINDS],
    /// `x` by kind of axes: displacement by the poses less that by the drone. m
    error_m: [Complex<f64>; AXES_KINDS],
    /// Displacement by the drone since the newest pose, by kind of axes, and its time. m, s
    drone_d_m: [Complex<f64>; AXES_KINDS],
    drone_s: f64,
    /// Whether the drone was silent since the newest pose: its displacement since then is not known.
    was_silent: bool,
}

impl ReportAge {
    /// Takes a tick on the ground: the differences are zero.
    pub(super) fn reset_on_ground(&mut self) {
        self.error_m = [Complex::default(); AXES_KINDS];
    }

    /// Forgets all but the fraction `keep` of the differences.
    pub(super) fn forget(&mut self, keep: f64) {
        for error_m in &mut self.error_m {
            *error_m *= keep;
        }
    }

    /// Notes whether the drone reported in this period and whether there is a pose of this age. Returns whether the
    /// drone's displacement since the pose before is known.
    pub(super) fn note_report(&mut self, is_heard: bool, is_pose: bool) -> bool {
        let is_known = is_heard && !self.was_silent;
        if !is_known {
            self.begin_motion();
        }
        // From a pose on, the displacement is known again.
        self.was_silent = !is_known && !is_pose;
        is_known
    }

    /// Integrates the difference over a period for each kind of axes that fits.
    pub(super) fn compare(&mut self, motion: &MotionSample, dt_s: f64) {
        self.drone_s += dt_s;
        for (drone_d_m, drone_d_mps) in self.drone_d_m.iter_mut().zip(&motion.drone_d_mps) {
            *drone_d_m += drone_d_mps * dt_s;
        }
        for ((error_m, fit), drone_d_mps) in
            self.error_m.iter_mut().zip(&self.axes).zip(&motion.drone_d_mps)
        {
            if let Some(Fit { axes, .. }) = fit {
                *error_m = shortened(*error_m, VELOCITY_DRIFT_MPS * dt_s) + motion.poses_w_m
                    - axes * drone_d_mps * dt_s;
            }
        }
    }

    /// Begins the next motion after a pose.
    pub(super) fn begin_motion(&mut self) {
        self.drone_d_m = [Complex::default(); AXES_KINDS];
        self.drone_s = 0.0;
    }

    /// The least difference; `None` before a kind of axes fits. m
    pub(super) fn error_m(&self) -> Option<f64> {
        let known = self.error_m.iter().zip(&self.axes).filter(|(_, axes)| axes.is_some());
        known.map(|(error_m, _)| error_m.norm()).min_by(f64::total_cmp)
    }

    /// Learns the axes from a motion between two poses. Known axes stay while there is too little motion to show any.
    pub(super) fn learn(&mut self, motion: &MotionSample) {
        let drone_d_mps = self.drone_d_m.map(|drone_d_m| drone_d_m / self.drone_s);
        self.sums.add(&MotionSample { drone_d_mps, ..*motion }, self.drone_s);
        let is_well_known = self.is_well_known();
        for (kind, axes) in self.axes.iter_mut().enumerate() {
            if self.sums.variance(kind) < MOTION_MIN {
                continue;
            }
            *axes = self.sums.fit(kind).map(|fit| {
                let scale = fit.axes.norm();
                let [low, high] = if is_well_known { SCALE } else { SCALE_EARLY };
                Fit { axes: fit.axes * (scale.clamp(low, high) / scale), ..fit }
            });
        }
    }

    /// Whether there was enough motion to show the age of the reports and their scale, too.
    pub(super) fn is_well_known(&self) -> bool {
        self.sums.variance(FIXED) >= WELL_KNOWN * MOTION_MIN
    }

    /// How well the best axes explain the motion; 0 if none do.
    pub(super) fn determination(&self) -> f64 {
        self.best().map_or(0.0, |fit| fit.determination)
    }

    /// Speed by the poses over speed by the drone with the best axes; 1 without any.
    pub(super) fn scale(&self) -> f64 {
        self.best().map_or(1.0, |fit| fit.axes.norm())
    }

    fn best(&self) -> Option<&Fit> {
        let fits = self.axes.iter().flatten();
        fits.reduce(|a, b| if b.determination > a.determination { b } else { a })
    }
}

/// Exponentially weighted sums over poses and reports. Deviations from the means are compared: a constant drift
/// of the poses does not change the axes.
#[derive(Debug, Clone, Default)]
pub(super) struct Sums {
    time_s: f64,
    /// Displacement by the poses. m
    poses_w_m: Complex<f64>,
    /// For each kind of axes: the displacement by the drone. m
    drone_d_m: [Complex<f64>; AXES_KINDS],
    /// For each kind of axes: displacement by the poses times conjugate velocity by the drone. m^2/s
    products: [Complex<f64>; AXES_KINDS],
    /// Squared speed by the drone. m^2/s
    squares: f64,
    /// Squared speed by the poses. m^2/s
    pub(super) poses_squares: f64,
}

impl Sums {
    pub(super) fn add(&mut self, motion: &MotionSample, dt_s: f64) {
        let MotionSample { poses_w_m, in_s, ref drone_d_mps, .. } = *motion;
        let keep = decay(dt_s, AXES_FORGET_S);
        self.time_s = self.time_s * keep + dt_s;
        self.poses_w_m = self.poses_w_m * keep + poses_w_m;
        self.poses_squares = self.poses_squares * keep + poses_w_m.norm_sqr() / in_s;
        self.squares = self.squares * keep + drone_d_mps[FIXED].norm_sqr() * dt_s;
        let sums = self.drone_d_m.iter_mut().zip(&mut self.products);
        for ((drone_d_m, product), drone_d_mps) in sums.zip(drone_d_mps) {
            *drone_d_m = *drone_d_m * keep + drone_d_mps * dt_s;
            *product = *product * keep + poses_w_m * drone_d_mps.conj();
        }
    }

    /// Integral of the squared deviation of the drone's velocity from its mean. m^2/s
    pub(super) fn variance(&self, kind: usize) -> f64 {
        self.squares - self.drone_d_m[kind].norm_sqr() / self.time_s.max(f64::MIN_POSITIVE)
    }

    /// The axes of `kind` in the world, and how well they explain the motion; `None` if they do not fit it.
    fn fit(&self, kind: usize) -> Option<Fit> {
        let time_s = self.time_s.max(f64::MIN_POSITIVE);
        let drone_d_m = self.drone_d_m[kind];
        let covariance = self.products[kind] - self.poses_w_m * drone_d_m.conj() / time_s;
        let variance = self.variance(kind);
        let poses_variance = self.poses_squares - self.poses_w_m.norm_sqr() / time_s;
        let axes = covariance / variance;
        let determination = covariance.norm_sqr() / (variance * poses_variance);
        let [low, high] = SCALE;
        let fits = (low..=high).contains(&axes.norm()) && determination >= DETERMINATION_MIN;
        fits.then_some(Fit { axes, determination })
    }

    /// Rotation of the axes of `kind` from those of the world; `None` if they do not fit the motion.
    pub(super) fn rotation(&self, kind: usize) -> Option<Complex<f64>> {
        self.fit(kind).map(|Fit { axes, .. }| axes / axes.norm())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Poses that move as `axes` times the drone's velocity in so many ticks, reported in each kind of axes.
    fn shown(axes: Complex<f64>, ticks: u32) -> ReportAge {
        let mut age = ReportAge::default();
        for k in 0..ticks {
            let t_s = f64::from(k) * 0.02;
            let by_drone_mps = Complex::new((2.0 * t_s).sin(), (3.0 * t_s).cos()) * 0.5;
            let motion = MotionSample {
                poses_w_m: axes * by_drone_mps * 0.02,
                in_s: 0.02,
                drone_d_mps: [by_drone_mps, by_drone_mps.conj(), by_drone_mps, by_drone_mps.conj()],
                is_pose: true,
            };
            age.compare(&motion, 0.02);
            age.learn(&motion);
            age.begin_motion();
        }
        age
    }

    #[test]
    fn motion_shows_the_axes_of_the_drone_and_the_scale_of_its_reports() {
        let axes = Complex::from_polar(1.2, 0.7);
        let age = shown(axes, 250);
        assert!(age.is_well_known());
        assert!((age.scale() - 1.2).abs() < 1e-9, "{}", age.scale());
        assert!((age.determination() - 1.0).abs() < 1e-9, "{}", age.determination());
        let turn = age.sums.rotation(FIXED).unwrap();
        assert!((turn - Complex::from_polar(1.0, 0.7)).norm() < 1e-9, "{turn}");
        assert_eq!(age.axes.map(|fit| fit.is_some()), [true, false, true, false]);
    }

    #[test]
    fn little_motion_and_another_scale_show_no_axes() {
        let brief = shown(Complex::from(1.0), 20);
        assert_eq!((brief.scale(), brief.determination(), brief.error_m()), (1.0, 0.0, None));
        for scale in [0.55, 1.65] {
            let other = shown(Complex::from(scale), 250);
            assert_eq!((other.scale(), other.error_m()), (1.0, None), "{scale}");
        }
    }

    #[test]
    fn what_a_silent_drone_flew_is_unknown_up_to_the_next_pose() {
        let mut age = ReportAge { drone_s: 1.0, ..ReportAge::default() };
        assert!(age.note_report(true, false) && age.drone_s > 0.0);
        assert!(!age.note_report(false, false));
        assert!(age.drone_s <= 0.0, "the motion begins anew");
        assert!(!age.note_report(true, false), "it reports again, in the middle of a motion");
        assert!(
            !age.note_report(true, true),
            "the motion that this pose ends was not reported whole"
        );
        assert!(age.note_report(true, false));
    }

    #[test]
    fn on_the_ground_all_differences_are_forgotten() {
        let fit = Fit { axes: Complex::from(1.0), determination: 1.0 };
        let mut age = ReportAge {
            axes: [Some(fit); AXES_KINDS],
            error_m: [Complex::from(2.0); AXES_KINDS],
            ..ReportAge::default()
        };
        assert_eq!(age.error_m(), Some(2.0));
        age.reset_on_ground();
        assert_eq!(age.error_m(), Some(0.0));
    }
}
