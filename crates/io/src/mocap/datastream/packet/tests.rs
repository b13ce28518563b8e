use super::super::tests::bytes;
use super::*;

#[test]
fn a_long_announcement_makes_no_room_before_its_bytes_come() {
    let mut packets = Packets::default();
    packets.push(&bytes("01002b1a f0ff0f00 05000000"), |_| Ok(())).unwrap();
    assert!(packets.capacity() < 100, "{} bytes for 12", packets.capacity());
}

#[test]
fn a_packet_that_ends_within_an_object_is_refused_once() {
    // Objects 1 and 2, of 1 and 2 bytes.
    let packet = bytes("01000000 01000000 aa 02000000 02000000 bbcc");
    // At most four, so that errors without end are a failure.
    let read = |length| objects(&packet[..length]).take(4).collect::<Vec<_>>();
    for length in 0..packet.len() {
        let (read, whole) = (read(length), usize::from(length >= 9));
        let is_between = length == 0 || length == 9;
        assert_eq!(read.len(), whole + usize::from(!is_between), "{length} bytes");
        assert!(read[..whole].iter().all(Option::is_some), "{length} bytes");
        assert_eq!(read.last().is_none_or(Option::is_some), is_between, "{length} bytes");
    }
    assert_eq!(read(packet.len()), [Some((1, &[0xaa][..])), Some((2, &[0xbb, 0xcc][..]))]);
}

#[test]
fn a_packet_is_at_most_a_mebibyte_long_with_its_head() {
    let announce = |length: usize| {
        let length = u32::try_from(length).unwrap();
        Packets::default().push(&[MAGIC, length].map(u32::to_le_bytes).concat(), |_| Ok(()))
    };
    let max = PACKET_BYTES_MAX - HEAD_BYTES;
    assert_eq!(announce(max), Ok(()));
    let length = u32::try_from(max + 1).unwrap();
    assert_eq!(announce(max + 1), Err(SourceError::TooLong { length, max }));
}

#[test]
fn a_packet_of_a_lost_connection_does_not_go_on() {
    let mut packets = Packets::default();
    packets.push(&MAGIC.to_le_bytes(), |_| Ok(())).unwrap();
    packets.clear();
    let mut count = 0;
    let empty = [MAGIC, 0].map(u32::to_le_bytes).concat();
    packets
        .push(&empty, |_| {
            count += 1;
            Ok(())
        })
        .unwrap();
    assert_eq!(count, 1);
}
