use std::f64::consts::{FRAC_PI_2, PI};

use proptest::prelude::*;

use horizon_model::angle;
use horizon_model::check::amax;
use horizon_model::rows::pose;

use super::*;
use crate::mocap::MocapCounters;
use crate::mocap::protocol::{SelectedProtocol, read};
use crate::mocap::source::SourceFrame;

fn line_of(line: &str) -> RelayPose<'_> {
    parse_line(line.as_bytes()).unwrap()
}

fn pose_of(line: &str) -> Pose {
    line_of(line).pose().unwrap()
}

/// What a stream for `tello` makes of these lines.
fn read_lines(lines: &[&str]) -> (Vec<SourceFrame>, MocapCounters) {
    let mut source =
        SelectedProtocol::new(Box::new(RelayProtocol::default()), "tello", Axes::ours());
    read(&mut source, lines.iter().map(|line| format!("{line}\n")))
}

#[test]
fn the_documented_examples_are_read() {
    let line =
        parse_line(b"1000 100.0 tello 0 1.0000 -2.0000 1.3000 0.0100 0.0200 0.3000").unwrap();
    assert_eq!((line.frame, line.object), (1000, "tello"));
    assert!((line.rate_hz - 100.0).abs() < 1e-12, "{line:?}");
    // A roll of 0.01 and a pitch of 0.02 turn the nose by about their product on top of the 0.3.
    let gap = line.pose().unwrap() - Pose::new(1.0, -2.0, 1.3, 0.300_224_894);
    assert!(amax(&gap) < 1e-9, "{line:?}");
    let line = b"1001 100.0 tello 1 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000";
    assert_eq!(parse_line(line).unwrap().at, None);
    // Half the turn has sine 0.1494: 2 asin(0.1494) = 0.29992, the digits carry 1e-4.
    let pose = pose_of("1002 100.0 tello 0 1.0000 -2.0000 1.3000 0.0 0.0 0.1494 0.9888");
    assert!((pose[pose::THETA] - 0.3).abs() < 2e-4, "{pose}");
}

#[test]
fn every_malformed_line_that_killed_the_old_client_is_refused() {
    for line in [
        "",
        "   ",
        "1 100 tello 0 1 2",
        "1 100 tello",
        "1\t100\ttello\t0\t1\t2\t3\t0\t0\t0",
        "1 100 tello 0 1 2 3",
        "1 100 tello 0 1 2 3 0",
        "1 100 tello 0 1 2 3 0 0",
        "1 100 tello 0 1 2 3 0 0 0 0 0",
        "1 100 tello 0 1 2 3 1 0 0 0 1 0 0 0 1 0 0",
        "1 100 tello 0 1,5 2 3 0 0 0",
        "1 100 tello 0 1 2 3 0 0 -nan",
        "1 100 tello 0.5 1 2 3 0 0 0",
        "a b c d e f g h i j k",
        "1 100 tello 0 1 2 3 0 0 0 0",
        "1 100 tello 0 1 2 3 0 0 0 9",
        "1 nan tello 0 1 2 3 0 0 0",
    ] {
        assert!(parse_line(line.as_bytes()).is_err(), "{line:?}");
        let (frames, counters) = read_lines(&[line, "2 100 tello 0 1 2 3 0 0 0"]);
        assert_eq!((frames.len(), counters.malformed.get()), (1, 1), "{line:?}");
    }
    for shifted in ["1 100 my tello 0 1 2 3 0 0 0", "1 100 tello 2 0 1 2 3 0 0 0 1"] {
        assert_eq!(parse_line(shifted.as_bytes()), Err(Refusal::Fields), "{shifted}");
    }
    assert_eq!(parse_line(b"1 100 t\xff"), Err(Refusal::Form));
    assert_eq!(parse_line(b"1 100 t\xff 0 1 2 3 0 0 0"), Err(Refusal::Form));
}

#[test]
fn numbers_that_are_no_rotation_or_a_body_that_tipped_over_are_refused() {
    for rotation in [
        "2 0 0 0 2 0 0 0 2",
        "1 0 0 0 1 0 0 0 -1",
        "1 0 0 0 -1 0 0 0 1",
        "0 0 0 0 0 0 0 0 0",
        "0 0 0 0.8",
        "3.1 0 0",
        "0 1.0479 0",
        "1 0 0 0",
    ] {
        let (frames, counters) = read_lines(&[&format!("1 100 tello 0 1 2 3 {rotation}")]);
        assert_eq!((frames.len(), counters.malformed.get()), (0, 1), "{rotation}");
    }
}

#[test]
fn occluded_or_all_zero_means_not_seen() {
    let pose = |line| line_of(line).at;
    assert_eq!(pose("1 100 tello 2 1 2 3 0 0 0.5"), None, "occluded with old values");
    assert_eq!(pose("1 100 tello 0 0 0 0 0 0 0"), None);
    assert_eq!(pose("1 100 tello 0 0 -0.0 0 0 0 0 0"), None, "zero quaternion");
    assert!(pose("1 100 tello 0 0 0 0 0 0 0.0001").is_some());
    assert!(pose("1 100 tello 0 0 0 0.0001 0 0 0").is_some());
}

#[test]
fn three_angles_of_a_level_body_give_the_third_on_the_circle() {
    for (sent, expected) in [(PI, PI), (-PI, -PI), (3.5, 3.5 - 2.0 * PI), (0.3, 0.3)] {
        let pose = pose_of(&format!("1 100 tello 0 1 2 3 0 0 {sent}"));
        assert!((pose[pose::THETA] - expected).abs() < 1e-12, "{sent}: {pose}");
    }
}

/// Heading `psi` after a pitch and a roll: `R = Rz(psi) Ry(pitch) Rx(roll)`, row-major.
fn matrix(psi: f64, pitch: f64, roll: f64) -> [f64; 9] {
    let ((sy, cy), (sp, cp), (sr, cr)) = (psi.sin_cos(), pitch.sin_cos(), roll.sin_cos());
    let top = [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr];
    let middle = [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr];
    let [a, b, c] = top;
    let [d, e, f] = middle;
    [a, b, c, d, e, f, -sp, cp * sr, cp * cr]
}

/// The same turn as a quaternion x y z w.
fn quaternion(psi: f64, pitch: f64, roll: f64) -> [f64; 4] {
    let ((sy, cy), (sp, cp), (sr, cr)) =
        ((psi / 2.0).sin_cos(), (pitch / 2.0).sin_cos(), (roll / 2.0).sin_cos());
    [
        cy * cp * sr - sy * sp * cr,
        cy * sp * cr + sy * cp * sr,
        sy * cp * cr - cy * sp * sr,
        cy * cp * cr + sy * sp * sr,
    ]
}

#[test]
fn a_quaternion_and_a_matrix_give_the_heading_of_a_tilted_body() {
    let text = |numbers: &[f64]| {
        let numbers: Vec<_> = numbers.iter().map(f64::to_string).collect();
        format!("1 100 tello 0 1 2 3 {}", numbers.join(" "))
    };
    for psi in [-3.1, -FRAC_PI_2, 0.0, 0.7, 2.0, 3.1] {
        for (pitch, roll) in [(0.0, 0.0), (0.3, -0.4), (-0.8, 0.7)] {
            let by_matrix = pose_of(&text(&matrix(psi, pitch, roll)))[pose::THETA];
            let by_quaternion = pose_of(&text(&quaternion(psi, pitch, roll)))[pose::THETA];
            assert!((by_matrix - psi).abs() < 1e-12, "{by_matrix} for {psi}");
            assert!((by_quaternion - psi).abs() < 1e-12, "{by_quaternion} for {psi}");
        }
    }
    for (pitch, roll) in [(FRAC_PI_2, 0.0), (-0.9, 0.9), (0.0, 1.06), (0.0, 3.1)] {
        for tilted in [text(&matrix(0.7, pitch, roll)), text(&quaternion(0.7, pitch, roll))] {
            assert_eq!(line_of(&tilted).pose(), None, "{pitch} {roll}");
            let (frames, counters) = read_lines(&[&tilted]);
            assert_eq!((frames.len(), counters.malformed.get()), (0, 1), "{pitch} {roll}");
        }
    }
}

#[test]
fn a_formatted_line_is_the_relays() {
    let mut bytes = Vec::new();
    let body = Body { name: b"tello", pos_v: [1.0, -2.0, 1.300_04], angles: [0.01, 0.0, 0.3] };
    format_line(1000, 100.0, "tello", Some(&body), &mut bytes);
    format_line(1001, 50.0, "tello", None, &mut bytes);
    let expected = "1000 100.0 tello 0 1.0000 -2.0000 1.3000 0.0100 0.0000 0.3000\n\
                    1001 50.0 tello 1 0.0000 0.0000 0.0000 0.0000 0.0000 0.0000\n";
    assert_eq!(String::from_utf8(bytes).unwrap(), expected);
}

#[test]
fn every_truncation_of_a_good_line_is_survived() {
    let line = b"1000 100.0 tello 0 1.0000 -2.0000 1.3000 0.0100 0.0200 0.3000";
    // Up to the first digit of the tenth field the line has too few fields.
    let whole_from = line.len() - "0.3000".len() + 1;
    for length in 0..line.len() {
        let is_read = parse_line(&line[..length]).is_ok();
        assert_eq!(is_read, length >= whole_from, "{length} bytes");
    }
}

proptest! {
    #[test]
    fn random_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Some(o) = parse_line(&bytes).ok().and_then(|line| line.pose()) {
            prop_assert!(o.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn fields_in_any_combination_give_finite_poses_or_errors(
        fields in prop::collection::vec(
            prop::sample::select(vec!["0", "1", "-1", "tello", "nan", "1e308", "-1e308", "0.5", "4.2"]),
            0..20,
        ),
    ) {
        let text = fields.join(" ");
        if let Some(o) = parse_line(text.as_bytes()).ok().and_then(|line| line.pose()) {
            prop_assert!(o.iter().all(|value| value.is_finite()));
            prop_assert!(o[pose::THETA].abs() <= PI);
        }
    }

    #[test]
    fn a_formatted_pose_comes_back_within_its_decimals(
        x in -20.0..20.0, y in -20.0..20.0, z in 0.1..5.0, theta in -PI..PI, frame: i64,
    ) {
        let mut bytes = Vec::new();
        let body = Body { name: b"tello", pos_v: [x, y, z], angles: [0.0, 0.0, theta] };
        format_line(frame, 100.0, "tello", Some(&body), &mut bytes);
        let sent = Pose::new(x, y, z, theta);
        let read = parse_line(bytes.strip_suffix(b"\n").unwrap()).unwrap();
        prop_assert_eq!(read.frame, frame);
        let gap = read.pose().unwrap() - sent;
        // Half of the last decimal, plus rounding; a heading of +-pi may have changed its sign.
        prop_assert!(amax(gap.fixed_rows::<3>(0).iter()) < 0.500_001e-4);
        prop_assert!(angle::wrap(gap[pose::THETA]).abs() < 0.500_001e-4);
    }
}
