use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use horizon_model::rows::Sticks;

use super::*;

const DT_S: f64 = 0.02;
/// When the inputs leave the line. s
const CORNER_S: f64 = 2.5;

/// A vehicle whose inputs lead along a line, turned by `line_rad` from the nose, and from [`CORNER_S`] on to its left.
struct Flight {
    monitor: MirrorMonitor,
    v_w: Complex<f64>,
    at: Pose,
}

impl Flight {
    /// At the heading `theta_rad` of the poses.
    fn new(theta_rad: f64) -> Self {
        let at = Pose::new(0.3, -0.2, 1.0, theta_rad);
        Self { monitor: MirrorMonitor::new(DT_S), v_w: Complex::default(), at }
    }

    /// A tick with the inputs `asked_b`, left and ahead; the motion has the velocity `target_w` after the lag.
    fn tick(&mut self, asked_b: Complex<f64>, target_w: Complex<f64>, link_is_up: bool) -> bool {
        self.v_w += (target_w - self.v_w) * (1.0 - lag_decay(DT_S));
        self.at[pose::X] += self.v_w.re * DT_S;
        self.at[pose::Y] += self.v_w.im * DT_S;
        let mut u_applied = Sticks::zeros();
        (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (asked_b.re, -asked_b.im);
        self.monitor.update(&Sample { pose: Some(self.at), drone: None, u_applied, link_is_up })
    }
}

/// The inputs: to and fro along the line, then to its left.
fn asked_b(t_s: f64, line_rad: f64) -> Complex<f64> {
    let along = if t_s < 1.5 { 0.4 } else { -0.2 };
    let ahead = if t_s < CORNER_S { Complex::from(along) } else { Complex::new(-0.1, 0.3) };
    ahead * Complex::from_polar(1.0, line_rad)
}

/// When a mirrored frame is found, after the corner. s
fn found_s(
    theta_rad: f64,
    line_rad: f64,
    motion_b: impl Fn(Complex<f64>) -> Complex<f64>,
) -> Option<f64> {
    let mut flight = Flight::new(theta_rad);
    (0..300).map(|k| f64::from(k) * DT_S).find_map(|t_s| {
        let asked_b = asked_b(t_s, line_rad);
        let target_w = 1.9 * motion_b(asked_b) * Complex::from_polar(1.0, theta_rad);
        // From 1 s on, the link monitor takes what it sees for an outage.
        flight.tick(asked_b, target_w, t_s < 1.0).then_some(t_s - CORNER_S)
    })
}

#[test]
fn a_mirrored_frame_is_found_at_the_first_corner_whatever_line_the_motion_begins_on() {
    for theta_rad in [0.0, 1.0, -2.5] {
        for line_rad in [0.0, FRAC_PI_4, FRAC_PI_2, 2.0, PI, -0.4] {
            // The nose right, off by a right angle as with x and y exchanged, and off by half a turn.
            for nose_rad in [0.0, FRAC_PI_2, PI] {
                let nose = Complex::from_polar(1.0, nose_rad);
                let case = format!("{theta_rad}, {line_rad}, {nose_rad} rad");
                let mirrored_s = found_s(theta_rad, line_rad, |u| nose * u.conj());
                assert!(
                    mirrored_s.is_some_and(|s| (0.6..1.3).contains(&s)),
                    "{case}: {mirrored_s:?}"
                );
                assert_eq!(found_s(theta_rad, line_rad, |u| nose * u), None, "{case}");
            }
        }
    }
}

#[test]
fn a_mirrored_frame_whose_heading_turns_is_found() {
    // The heading diverges, as the yaw acts to the other side, too.
    let mut flight = Flight::new(0.0);
    let found_s = (0..300).map(|k| f64::from(k) * DT_S).find(|t_s| {
        flight.at[pose::THETA] = 0.3 * t_s * t_s;
        let asked_b = asked_b(*t_s, 0.0);
        let target_w = 1.9 * asked_b.conj() * Complex::from_polar(1.0, flight.at[pose::THETA]);
        flight.tick(asked_b, target_w, false)
    });
    assert!(found_s.is_some_and(|found_s| found_s < CORNER_S + 1.3), "{found_s:?}");
}

#[test]
fn a_motion_along_a_line_or_without_the_inputs_shows_no_mirror() {
    for line_rad in [0.0, 1.0, 2.5] {
        let along = Complex::from_polar(1.0, line_rad);
        let motions: [&dyn Fn(f64) -> Complex<f64>; 4] =
            [&|_| Complex::default(), &|_| 0.8 * along, &|t_s| along * (2.0 * t_s).sin(), &|t_s| {
                along * t_s.cos() + Complex::from(0.3)
            }];
        for (k, motion) in motions.iter().enumerate() {
            let mut flight = Flight::new(0.0);
            for t_s in (0..300).map(|k| f64::from(k) * DT_S) {
                assert!(!flight.tick(asked_b(t_s, 0.3), motion(t_s), false), "{k}, {t_s} s");
            }
        }
    }
}

#[test]
fn the_comparison_ends_with_a_motion_in_two_directions_and_begins_anew_on_the_ground() {
    let mut flight = Flight::new(0.0);
    let mut over_s = None;
    for t_s in (0..300).map(|k| f64::from(k) * DT_S) {
        let asked_b = asked_b(t_s, 0.0);
        assert!(!flight.tick(asked_b, 1.9 * asked_b, true));
        over_s = over_s.or(flight.monitor.is_over.then_some(t_s));
    }
    assert!(over_s.is_some_and(|s| s > CORNER_S + 0.2 && s < CORNER_S + 1.0), "{over_s:?}");
    flight.monitor.reset();
    assert!(flight.monitor.is_over, "poses that jump mirror no frame");
    flight.monitor.reset_on_ground();
    assert!(!flight.monitor.is_over);
    flight.monitor.end();
    assert!(flight.monitor.is_over);
}

#[test]
fn a_frame_that_was_found_stays_mirrored_until_the_vehicle_stands() {
    let mut flight = Flight::new(0.0);
    let mut fly = |t_s: f64, link_is_up| {
        let asked_b = asked_b(t_s, 0.0);
        flight.tick(asked_b, 1.9 * asked_b.conj(), link_is_up)
    };
    assert!((0..300).map(|k| f64::from(k) * DT_S).any(|t_s| fly(t_s, true)));
    let is_found = |monitor: &mut MirrorMonitor| {
        let u_applied = Sticks::zeros();
        monitor.update(&Sample { pose: None, drone: None, u_applied, link_is_up: false })
    };
    assert!((0..1000).all(|_| is_found(&mut flight.monitor)), "it hovers");
    flight.monitor.end();
    flight.monitor.reset();
    assert!(is_found(&mut flight.monitor), "an outage of a hovering vehicle, a jump of the poses");
    flight.monitor.reset_on_ground();
    assert!(!is_found(&mut flight.monitor));
}

#[test]
fn poses_of_4_hz_show_a_mirrored_frame_and_longer_gaps_are_left_out() {
    for (gap, is_found) in [(12, true), (25, false)] {
        let mut flight = Flight::new(0.0);
        let found = (0..400).any(|k| {
            let asked_b = asked_b(f64::from(k) * DT_S, 0.0);
            let mut u_applied = Sticks::zeros();
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (asked_b.re, -asked_b.im);
            flight.v_w += (1.9 * asked_b.conj() - flight.v_w) * (1.0 - lag_decay(DT_S));
            flight.at[pose::X] += flight.v_w.re * DT_S;
            flight.at[pose::Y] += flight.v_w.im * DT_S;
            let pose = (k % gap == 0).then_some(flight.at);
            flight.monitor.update(&Sample { pose, drone: None, u_applied, link_is_up: true })
        });
        assert_eq!(found, is_found, "{gap} periods");
    }
}
