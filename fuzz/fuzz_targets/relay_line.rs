//! Lines of the thesis' relay: what is understood is written and read again without a change.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::mocap::{Body, RelayPose, format_line, parse_line};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(line) = parse_line(bytes) {
        let RelayPose { frame, rate_hz, object, .. } = line;
        let body = line.pose().map(|pose| {
            let [x, y, z, theta] = pose.into();
            Body { name: object.as_bytes(), pos_v: [x, y, z], angles: [0.0, 0.0, theta] }
        });
        let mut written = Vec::new();
        format_line(frame, rate_hz, object, body.as_ref(), &mut written);
        let again = parse_line(written.strip_suffix(b"\n").unwrap_or(&written));
        assert!(again.is_ok(), "{line:?} was written as {:?}", String::from_utf8_lossy(&written));
    }
});
