use super::super::decode::{self, Request};
use super::super::packet::objects;
use super::super::tests::{PUSH, bytes, packet};

#[test]
fn requests_are_the_documented_bytes() {
    assert_eq!(packet(|packet| packet.request_frame(true)), bytes(PUSH));
    let once = bytes("01002b1a 09000000 a2860100 01000000 00");
    assert_eq!(packet(|packet| packet.request_frame(false)), once);
    let next = bytes("01002b1a 0c000000 a8860100 04000000 01000000");
    let ping = bytes("01002b1a 10000000 2a000000 08000000 0100000000000000");
    assert_eq!(packet(|packet| packet.ping(1)), ping);
    let request = |bytes: &[u8]| {
        let (id, body) = objects(&bytes[8..]).next().unwrap().unwrap();
        decode::request(id, body).unwrap()
    };
    assert_eq!(
        [bytes(PUSH), once, next, ping].map(|bytes| request(&bytes)),
        [Request::EveryFrame, Request::Frame, Request::NextFrames(1), Request::Ping(1)]
    );
}
