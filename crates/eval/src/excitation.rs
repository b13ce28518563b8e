//! A flight for identification: sums of sines on all four axes at once.
//!
//! Owns the amplitudes and phases, and how they are scaled to a room. The axes have no frequency in common, in a room
//! of any size, so that what one stick does is not taken for what another does. Amplitudes and phases of x and y
//! maximize the information about gain, lag, dead time, dead zone, acceleration limit and `theta_0` of the nominal
//! vehicle (D-optimal: determinant of the information matrix; Ljung, System Identification, 13.3) within 1.5 m/s and
//! 1.2 m/s^2, more than the vehicle can do, without which its limit would not show.
//! `docs/benchmarks/2026-11-24-learning` has the program that found them.

use std::f64::consts::TAU;

use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, finite, in_range};
use tello_flight::{FollowTable, StartTable, TIMED_COUNT, TrajectoryTable, WaitTable};

/// One sine of an axis.
#[derive(Debug, Clone, Copy)]
struct Tone {
    /// Periods in [`PATTERN_S`]. 1
    periods: f64,
    /// Amplitude. m, of the heading rad
    amplitude: f64,
    /// Phase at the beginning. rad
    phase_rad: f64,
}

const fn tone(periods: f64, amplitude: f64, phase_rad: f64) -> Tone {
    Tone { periods, amplitude, phase_rad }
}

/// Time after which the sines repeat, at [`HALF_WIDTH_M`]. s
const PATTERN_S: f64 = 60.0;

/// Largest distance of the pattern from its centre along x and y. m
const HALF_WIDTH_M: f64 = 1.5;

/// Tones of x and y: `BUILT_IN` of `docs/benchmarks/2026-11-24-learning/design.py`.
const X: [Tone; 4] = [
    tone(6.0, 0.426, 2.93),
    tone(8.0, 0.671, 5.74),
    tone(13.0, 0.041, 2.14),
    tone(22.0, 0.114, 1.93),
];
const Y: [Tone; 4] = [
    tone(7.0, 1.298, 3.70),
    tone(9.0, 0.181, 0.33),
    tone(14.0, 0.064, 5.16),
    tone(23.0, 0.076, 0.50),
];

/// Largest distance from the middle upwards and downwards; 0.6 m/s and 1.3 m/s^2 at most. m
const HALF_HEIGHT_M: f64 = 0.36;
const Z: [Tone; 3] = [tone(11.0, 0.198, 1.55), tone(17.0, 0.128, 4.77), tone(29.0, 0.075, 1.69)];

/// Tones of the heading; about 1.2 rad/s and 3.6 rad/s^2 at most.
const THETA: [Tone; 4] = [
    tone(12.0, 0.293, 3.09),
    tone(19.0, 0.185, 5.40),
    tone(25.0, 0.141, 2.06),
    tone(37.0, 0.095, 6.15),
];

/// Periods in [`PATTERN_S`] by which frequencies of two axes differ at least, where a size allows it: two sines can
/// be distinguished in a pattern if they differ by some tenths of a period. 1
const APART: f64 = 0.4;

/// How much slower than by its size alone a pattern may run for that. %
const SLOWER_PERCENT: u8 = 30;

/// Time in which the sines grow at the beginning, and fade at the end. s
const RAMP_S: f64 = 4.0;

/// Time between two poses of the mission: the fastest sine has 16 in a period. s
const SPACING_S: f64 = 0.1;

/// The reference slows down where the vehicle, which cannot do all that is asked for, is so late, and waits. m
const LATE_M: (f64, f64) = (0.3, 0.7);

/// Acceleration on the way to the first pose. m/s^2
const APPROACH_MPS2: f64 = 0.9;

/// Where and how long to fly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excitation {
    /// Middle of the pattern: x, y, z in m, theta in rad.
    pub centre: Pose,
    /// Largest distance of the reference from the centre along x and y; the vehicle passes it by some 0.3 m. A smaller
    /// one is flown with shorter periods, a larger one with longer ones. m, 0.3..=4
    pub half_width_m: f64,
    /// Largest distance from the middle upwards and downwards. m, 0.1..=1
    pub half_height_m: f64,
    /// Duration. s, 20..=600
    pub duration_s: f64,
}

impl Excitation {
    /// The flight as poses over time, at rest at both ends.
    ///
    /// # Errors
    /// A value outside of its range.
    pub fn trajectory(&self) -> Result<TrajectoryTable, SettingError> {
        let Self { centre, half_width_m, half_height_m, duration_s } = *self;
        for (row, value) in centre.iter().enumerate() {
            finite(&format!("centre[{row}]"), *value)?;
        }
        in_range("half_width_m", half_width_m, 0.3..=4.0)?;
        in_range("half_height_m", half_height_m, 0.1..=1.0)?;
        in_range("duration_s", duration_s, 20.0..=600.0)?;
        let (wide, high) = (half_width_m / HALF_WIDTH_M, half_height_m / HALF_HEIGHT_M);
        let [wide_pace, high_pace] = paces(wide, high);
        let at = |t_s: f64| {
            let grown = ramp(t_s.min(duration_s - t_s) / RAMP_S);
            let axis = |tones: &[Tone], scale: f64, pace: f64| {
                grown * scale * tones.iter().map(|tone| tone.at(t_s * pace)).sum::<f64>()
            };
            Pose::new(
                axis(&X, wide, wide_pace),
                axis(&Y, wide, wide_pace),
                axis(&Z, high, high_pace),
                axis(&THETA, 1.0, 1.0),
            )
        };
        let steps = horizon_model::steps(duration_s, SPACING_S);
        let row = |step: usize| -> [f64; TIMED_COUNT] {
            let t_s = duration_s * step as f64 / steps as f64;
            let pose = centre + at(t_s);
            let rounded = |value: f64| (value * 1e4).round() / 1e4;
            [t_s, pose[pose::X], pose[pose::Y], pose[pose::Z], pose[pose::THETA]].map(rounded)
        };
        let (begin_m, stop_m) = LATE_M;
        Ok(TrajectoryTable {
            points: tello_flight::PointsTable::Rows((0..=steps).map(row).collect()),
            accel_max_mps2: APPROACH_MPS2,
            follow: FollowTable {
                reach: 0.4,
                start: StartTable::default(),
                wait: WaitTable { begin_m, stop_m, aside_m: None },
            },
        })
    }
}

impl Tone {
    /// Its value `t_s` after the beginning of the pattern.
    fn at(&self, t_s: f64) -> f64 {
        self.amplitude * (TAU * self.periods * t_s / PATTERN_S + self.phase_rad).sin()
    }
}

/// How much faster a pattern runs whose size is multiplied by `scale`: a smaller one with the same accelerations, a
/// larger one with the same speeds. 1
fn pace(scale: f64) -> f64 {
    1.0 / scale.sqrt().max(scale)
}

/// Paces of x and y, and of z, for patterns of these sizes: [`pace`], slowed down as far as keeps the frequencies of
/// the axes apart.
fn paces(wide: f64, high: f64) -> [f64; 2] {
    let of = |axes: &[&[Tone]], pace: f64| -> Vec<f64> {
        axes.iter().flat_map(|tones| tones.iter().map(|tone| tone.periods * pace)).collect()
    };
    let high_pace = apart(pace(high), &of(&[&Z], 1.0), &of(&[&THETA], 1.0));
    let others = [of(&[&Z], high_pace), of(&[&THETA], 1.0)].concat();
    [apart(pace(wide), &of(&[&X, &Y], 1.0), &others), high_pace]
}

/// The greatest pace, at most `pace`, at which no frequency of `scaled` is nearer than [`APART`] to one of `others`;
/// where there is none within [`SLOWER_PERCENT`], that which keeps them furthest apart.
fn apart(pace: f64, scaled: &[f64], others: &[f64]) -> f64 {
    let nearest = |pace: f64| {
        let gaps = scaled.iter().flat_map(|a| others.iter().map(move |b| (pace * a - b).abs()));
        gaps.fold(f64::INFINITY, f64::min)
    };
    let paces = (0..=SLOWER_PERCENT).map(|percent| pace * (1.0 - 0.01 * f64::from(percent)));
    paces
        .map(|pace| (pace, nearest(pace).min(APART)))
        .reduce(|best, next| if next.1 > best.1 { next } else { best })
        .map_or(pace, |(pace, _)| pace)
}

/// From 0 to 1 without a jump of the rate.
fn ramp(fraction: f64) -> f64 {
    let fraction = fraction.clamp(0.0, 1.0);
    fraction * fraction * (3.0 - 2.0 * fraction)
}

#[cfg(test)]
mod tests {
    use tello_flight::{Mission, MissionTable, PointsTable};

    use super::*;

    fn of_size(half_width_m: f64, half_height_m: f64) -> Excitation {
        let centre = Pose::new(1.0, -2.0, 1.4, 0.3);
        Excitation { centre, half_width_m, half_height_m, duration_s: 60.0 }
    }

    #[test]
    fn it_stays_in_its_box_and_within_what_a_vehicle_may_be_asked_for() {
        for (half_width_m, half_height_m) in [(0.4, 0.15), (1.0, 0.3), (1.5, 0.36), (3.0, 0.6)] {
            let table = of_size(half_width_m, half_height_m).trajectory().unwrap();
            let mission = Mission::new(&MissionTable::Trajectory(table), 0.02).unwrap();
            let survey = mission.survey();
            let [x, y, z] = [0, 1, 2].map(|axis| [survey.low_w[axis], survey.high_w[axis]]);
            for ([low_m, high_m], half_m, centre_m) in
                [(x, half_width_m, 1.0), (y, half_width_m, -2.0), (z, half_height_m, 1.4)]
            {
                let reached_m = (high_m - centre_m).max(centre_m - low_m);
                assert!(
                    reached_m < 1.03 * half_m && reached_m > 0.6 * half_m,
                    "{half_width_m}: {low_m}..{high_m}"
                );
            }
            let fastest = survey.fastest.unwrap();
            assert!(fastest.speed_mps < 1.75, "{half_width_m}: {fastest:?}");
        }
    }

    #[test]
    fn it_begins_and_ends_at_rest_in_its_centre() {
        let TrajectoryTable { points: PointsTable::Rows(rows), .. } =
            of_size(1.5, 0.36).trajectory().unwrap()
        else {
            unreachable!("made of rows")
        };
        assert_eq!(rows.len(), 601);
        for end in [&rows[..3], &rows[598..]] {
            for [_, x, y, z, theta] in end {
                let off = [x - 1.0, y + 2.0, z - 1.4, theta - 0.3].map(f64::abs);
                assert!(off.iter().all(|off| *off < 0.02), "{off:?}");
            }
        }
        assert_eq!(rows[600][0].to_bits(), 60.0_f64.to_bits());
    }

    #[test]
    fn no_two_axes_have_a_frequency_in_common() {
        for half_width_dm in 3..=40 {
            for half_height_dm in 1..=10 {
                let wide = 0.1 * f64::from(half_width_dm) / HALF_WIDTH_M;
                let high = 0.1 * f64::from(half_height_dm) / HALF_HEIGHT_M;
                let [wide_pace, high_pace] = paces(wide, high);
                let axes = [(&X[..], wide_pace), (&Y, wide_pace), (&Z, high_pace), (&THETA, 1.0)];
                for (axis, (tones, pace)) in axes.iter().enumerate() {
                    let others = axes[axis + 1..].iter().flat_map(|(tones, pace)| {
                        tones.iter().map(move |tone| tone.periods * pace)
                    });
                    for b in others {
                        for a in tones.iter().map(|tone| tone.periods * pace) {
                            assert!((a - b).abs() > 0.2, "{wide} x {high}: {a} and {b}");
                        }
                    }
                }
            }
        }
        let as_designed = paces(1.0, 1.0).map(f64::to_bits);
        assert_eq!(as_designed, [1.0_f64.to_bits(); 2], "the pattern as it was designed");
    }

    #[test]
    fn what_does_not_fit_is_refused_with_its_name() {
        let mut table = of_size(1.5, 0.36);
        table.duration_s = 5.0;
        let error = table.trajectory().unwrap_err().to_string();
        assert!(error.contains("duration_s"), "{error}");
        let error = of_size(f64::NAN, 0.3).trajectory().unwrap_err().to_string();
        assert!(error.contains("half_width_m"), "{error}");
    }
}
