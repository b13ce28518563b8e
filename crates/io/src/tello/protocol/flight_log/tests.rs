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
