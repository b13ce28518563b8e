use super::*;

/// State lines of real drones, one per kind of firmware.
const STATES: [&str; 4] = [
    "pitch:1;roll:5;yaw:0;vgx:0;vgy:0;vgz:0;templ:43;temph:46;tof:10;h:0;bat:83;baro:150.12;\
     time:0;agx:15.00;agy:-97.00;agz:-988.00;\r\n",
    "mid:257;x:0;y:0;z:0;mpry:0,0,0;pitch:0;roll:0;yaw:-20;vgx:0;vgy:0;vgz:0;templ:66;temph:69;\
     tof:10;h:0;bat:67;baro:1687.34;time:16;agx:6.00;agy:0.00;agz:-999.00;\r\n",
    "mid:-2;x:-200;y:-200;z:-200;mpry:0,0,0;pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:44;\
     temph:47;tof:10;h:0;bat:88;baro:138.82;time:0;agx:9.00;agy:0.00;agz:-1000.00;\r\n",
    "mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;pitch:0;roll:0;yaw:-3;vgx:0;vgy:0;vgz:1;templ:58;\
     temph:60;tof:71;h:50;bat:82;baro:-57.14;time:14;agx:17.00;agy:-4.00;agz:-956.00;\r\n",
];

#[test]
fn the_states_of_real_drones_are_read_and_written_byte_by_byte() {
    let mut written = Vec::new();
    for text in STATES {
        let state = StateLine::decode(text.as_bytes()).unwrap();
        state.encode(&mut written);
        assert_eq!(std::str::from_utf8(&written).unwrap(), text);
    }
    let old = StateLine::decode(STATES[0].as_bytes()).unwrap();
    let flying = StateLine::decode(STATES[3].as_bytes()).unwrap();
    let read = |field| (old.get(field), flying.get(field));
    assert_eq!(read(Field::Bat), (Some(83.0), Some(82.0)));
    assert_eq!(read(Field::Time), (Some(0.0), Some(14.0)));
    assert_eq!(read(Field::Tof), (Some(10.0), Some(71.0)));
    assert_eq!(read(Field::Mid), (None, Some(-1.0)));
    assert_eq!(read(Field::Baro), (Some(150.12), Some(-57.14)));
    assert_eq!((old.mpry, flying.mpry), (None, Some([-1, -1, -1])));
}

#[test]
fn unknown_keys_missing_keys_and_malformed_values_do_not_hide_the_others() {
    let text = "wind:3;bat:77;time:;tof:nan;h:inf;vgy4;mpry:1,2;:;;yaw:x;templ:4e400;agz:-1\r\n";
    let state = StateLine::decode(text.as_bytes()).unwrap();
    assert_eq!(state, StateLine::default().with(Field::Bat, 77.0).with(Field::Agz, -1.0));
    for empty in ["", "ok", "\r\n", "a:1;b:2;", "bat:;", "\u{7f}bat:3;"] {
        assert_eq!(StateLine::decode(empty.as_bytes()), None, "{empty:?}");
    }
}

#[test]
fn the_attitude_over_a_pad_is_three_integers_or_absent() {
    let mpry = |text: &str| {
        let state = StateLine::decode(format!("bat:1;mpry:{text};").as_bytes()).unwrap();
        state.mpry
    };
    assert_eq!(mpry("1,-2,3"), Some([1, -2, 3]));
    for wrong in ["", "1", "1,2", "1,2,3,4", "1,,3", "1,2,3.5", "1,2,40000"] {
        assert_eq!(mpry(wrong), None, "{wrong:?}");
    }
}

#[test]
fn heights_and_speeds_are_whole_tenths_in_the_range_of_a_log() {
    for (tenths, expected) in [(-12.6, -1.3), (1e9, 3276.7), (-1e9, -3276.8)] {
        let line = StateLine::default().with(Field::H, 10.0 * tenths);
        let height_m = line.height_m().unwrap();
        assert!((height_m - expected).abs() < 1e-9, "{tenths}");
        assert_eq!(line.velocity_d_mps(), None, "without an axis");
        let axes = [Field::Vgx, Field::Vgy, Field::Vgz];
        let line = axes.into_iter().fold(line, |line, axis| line.with(axis, tenths));
        assert_eq!(line.velocity_d_mps(), Some([height_m; 3]));
    }
    assert_eq!(StateLine::default().height_m(), None);
}

#[test]
fn a_heading_is_counter_clockwise_in_radians_and_within_a_turn() {
    for (line, expected) in [
        ("yaw:90;", Some(-std::f64::consts::FRAC_PI_2)),
        ("yaw:-180;", Some(std::f64::consts::PI)),
        ("yaw:0;", Some(0.0)),
        ("yaw:361;", None),
        ("yaw:1e300;", None),
        ("yaw:x;pitch:1;", None),
    ] {
        let got = StateLine::decode(line.as_bytes()).unwrap().heading_rad();
        assert_eq!(got, expected, "{line}");
    }
}
