//! The frames of a motion capture that is faster or slower than the steps of the world.
//!
//! Frame i shows the room at i / rate, in the step before that time: the frame of the step, moved on as the drone moves
//! in the present step. No noise is drawn, so that the world is the same at every rate.

use std::ops::Range;

use horizon_model::rows::{Pose, pose};
use tello_io::mocap::ABOUT_Z;

use crate::DT_S;
use crate::mocap::MocapFrame;

/// Numbers of the frames in a step.
pub(crate) fn numbers(step: u32, rate_hz: f64) -> Range<u32> {
    let first = |step: f64| {
        // Half a thousandth of a frame: times of frames and steps coincide up to rounding.
        let number = (step * DT_S * rate_hz - 5e-4).ceil().max(0.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it saturates")]
        let number = number as u32;
        number
    };
    let step = f64::from(step);
    first(step)..first(step + 1.0)
}

/// Whether a frame is in `step`.
pub(crate) fn is_in_step(step: u64, rate_hz: f64) -> bool {
    // Frame numbers of 32 bits last for years.
    u32::try_from(step).is_ok_and(|step| !numbers(step, rate_hz).is_empty())
}

/// Time of a frame since its step began. s, 0..=0.02
pub(crate) fn offset_s(number: u32, step: u32, rate_hz: f64) -> f64 {
    (f64::from(number) / rate_hz - f64::from(step) * DT_S).clamp(0.0, DT_S)
}

/// The frame `number`: `frame` of a step, moved on where its pose changes by `change` in a step.
pub(crate) fn moved<'a>(
    frame: MocapFrame<'a>,
    number: u32,
    rate_hz: f64,
    change: &Pose,
) -> MocapFrame<'a> {
    let fraction = offset_s(number, frame.number, rate_hz) / DT_S;
    let body = frame.body.map(|mut body| {
        for (axis, row) in [pose::X, pose::Y, pose::Z].into_iter().enumerate() {
            body.pos_v[axis] += fraction * change[row];
        }
        body.angles[ABOUT_Z] += fraction * change[pose::THETA];
        body
    });
    MocapFrame { number, rate_hz, body, ..frame }
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::Body;

    use super::*;

    #[test]
    fn every_frame_is_in_one_step() {
        for rate_hz in [4.0, 29.97, 50.0, 59.94, 100.0, 120.0, 240.0, 333.0, 500.0] {
            let mut next = 0;
            for step in 0..50_000 {
                let numbers = numbers(step, rate_hz);
                assert_eq!(numbers.start, next, "{rate_hz} Hz, step {step}");
                next = numbers.end;
                assert!(numbers.into_iter().all(|number| {
                    let offset_s = f64::from(number) / rate_hz - f64::from(step) * DT_S;
                    (-1e-3 / rate_hz..DT_S).contains(&offset_s)
                }));
            }
            assert!((f64::from(next) / rate_hz - 1000.0).abs() <= 1.0 / rate_hz, "{rate_hz} Hz");
        }
        assert_eq!(numbers(7, 50.0), 7..8);
        assert_eq!(
            (0..10).filter(|step| is_in_step(*step, 25.0)).collect::<Vec<_>>(),
            [0, 2, 4, 6, 8]
        );
        assert_eq!((0..10).filter(|step| is_in_step(*step, 20.0)).count(), 4);
    }

    #[test]
    fn a_frame_goes_on_with_the_change_of_the_step() {
        let body = Body { name: b"tello", pos_v: [1.0, 2.0, 3.0], angles: [0.0, 0.0, 0.5] };
        let frame = MocapFrame { number: 3, rate_hz: 50.0, object: "tello", body: Some(body) };
        let change = Pose::new(0.02, 0.0, -0.04, 0.1);
        // Frames 12 to 15 of 200 Hz are those of step 3.
        assert_eq!(numbers(3, 200.0), 12..16);
        let moved = moved(frame, 13, 200.0, &change);
        let body = moved.body.unwrap();
        assert_eq!((moved.number, moved.rate_hz), (13, 200.0));
        let expected = [1.005, 2.0, 2.99, 0.525];
        let [x, y, z] = body.pos_v;
        for (value, expected) in [x, y, z, body.angles[ABOUT_Z]].into_iter().zip(expected) {
            assert!((value - expected).abs() < 1e-12, "{body:?}");
        }
    }
}
