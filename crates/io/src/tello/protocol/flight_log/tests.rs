use std::f64::consts::{FRAC_PI_2, PI};

use super::*;

/// Single-precision number at an offset of the body, decoded with the tick.
fn number(payload: &[u8], tick: u8, offset: usize) -> f32 {
    let raw = &payload[1 + HEAD_BYTES + offset..][..4];
    f32::from_le_bytes([raw[0] ^ tick, raw[1] ^ tick, raw[2] ^ tick, raw[3] ^ tick])
}

#[test]
fn the_envelope_has_separator_length_type_and_tick() {
    let payload = imu_payload(0x0102_03A5, 0.0);
    assert_eq!(payload.len(), 133);
    // Skipped byte, separator, 132 bytes, no check value, type 2048, tick.
    assert_eq!(payload[..11], [0, 0x55, 132, 0, 0, 0, 8, 0xA5, 3, 2, 1]);
    // A body of zeros is the low byte of the tick; there are no check values behind it.
    assert_eq!(payload[11..39], [0xA5; 28]);
    assert_eq!(payload[131..], [0; 2]);
}

#[test]
fn a_heading_is_read_back_within_half_a_turn_of_any_attitude_and_record() {
    for yaw_rad in [0.0, 0.7, -3.0, FRAC_PI_2] {
        let payload = imu_payload(0x0102_03A5, yaw_rad);
        let (tick, read_rad) = imu_heading(&payload).unwrap();
        assert_eq!(tick, 0x0102_03A5);
        assert!((read_rad - yaw_rad).abs() < 1e-6, "{read_rad} of {yaw_rad} rad");
        // A record of another kind before it, then a newer one of the same kind.
        let mut other = imu_payload(1, 2.0);
        other[6] = 9;
        let newer = imu_payload(2, yaw_rad - 0.1);
        let all = [&other[..], &payload[1..], &newer[1..]].concat();
        let (tick, read_rad) = imu_heading(&all).unwrap();
        assert_eq!(tick, 2);
        assert!((read_rad - yaw_rad + 0.1).abs() < 1e-6, "{read_rad} of {yaw_rad} rad");
    }
}

#[test]
fn the_heading_of_a_tilted_drone_is_that_about_the_vertical() {
    // Yaw 0.7, then pitch 0.4, in single precision.
    let [(sin_y, cos_y), (sin_p, cos_p)] = [0.35_f64, 0.2].map(f64::sin_cos);
    let quaternion = [cos_y * cos_p, -sin_y * sin_p, cos_y * sin_p, sin_y * cos_p];
    let mut payload = imu_payload(0, 0.0);
    for (place, entry) in quaternion.into_iter().enumerate() {
        let at = 1 + HEAD_BYTES + QUATERNION_W + place * ENTRY_BYTES;
        #[expect(clippy::cast_possible_truncation, reason = "single precision on the wire")]
        payload[at..][..ENTRY_BYTES].copy_from_slice(&(entry as f32).to_le_bytes());
    }
    let (_, yaw_rad) = imu_heading(&payload).unwrap();
    assert!((yaw_rad - 0.7).abs() < 1e-6, "{yaw_rad} rad");
}

#[test]
fn what_is_torn_or_no_rotation_has_no_heading() {
    let whole = imu_payload(0, 0.5);
    for length in 0..whole.len() {
        assert_eq!(imu_heading(&whole[..length]), None, "{length} bytes");
    }
    let mut endless = whole;
    endless[2] = 0;
    assert_eq!(imu_heading(&endless), None, "a record without length");
    for entry in [f32::NAN, 0.0, 3.0] {
        let mut other = whole;
        let at = 1 + HEAD_BYTES + QUATERNION_W;
        other[at..][..ENTRY_BYTES].copy_from_slice(&entry.to_le_bytes());
        assert_eq!(imu_heading(&other), None, "w = {entry}");
    }
}

#[test]
fn the_quaternion_is_the_heading_about_the_vertical() {
    for (yaw_rad, w, z) in [
        (0.0, 1.0, 0.0),
        (FRAC_PI_2, std::f32::consts::FRAC_1_SQRT_2, std::f32::consts::FRAC_1_SQRT_2),
        (-FRAC_PI_2, std::f32::consts::FRAC_1_SQRT_2, -std::f32::consts::FRAC_1_SQRT_2),
        (PI, 0.0, 1.0),
    ] {
        for tick in [0, 1, 0xFF] {
            let payload = imu_payload(u32::from(tick), yaw_rad);
            let read = [QUATERNION_W, QUATERNION_Z].map(|offset| number(&payload, tick, offset));
            // The rounding of single precision.
            let gap = (read[0] - w).abs().max((read[1] - z).abs());
            assert!(gap <= f32::EPSILON, "{yaw_rad} rad at tick {tick}: {read:?}");
            assert_eq!(Some(number(&payload, tick, ACCELERATION_Z)), Some(-1.0));
        }
    }
}
