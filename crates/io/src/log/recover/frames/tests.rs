//! Frames of files with one defect each.

use std::fs;

use super::super::tests::fresh;
use super::*;

fn record(opcode: u8, data: &[u8]) -> Vec<u8> {
    [&[opcode][..], &(data.len() as u64).to_le_bytes(), data].concat()
}

/// A file of `parts` behind the magic: opcodes of its frames, bytes without a record, and bytes behind the log.
fn read(name: &str, parts: &[&[u8]]) -> (Vec<u8>, u64, u64) {
    let path = fresh(&format!("frames-{}.mcap", name.replace(' ', "-")));
    fs::write(&path, [MAGIC, &parts.concat()[..]].concat()).unwrap();
    let mut frames = Frames::new(File::open(&path).unwrap()).unwrap();
    fs::remove_file(path).unwrap();
    let mut opcodes = Vec::new();
    while let Some(frame) = frames.next().unwrap() {
        opcodes.push(frame.opcode);
    }
    (opcodes, frames.unread_bytes, frames.rest_bytes())
}

#[test]
fn each_defect_of_a_frame_costs_its_bytes_and_no_more() {
    // 17, 13 and 29 bytes.
    let (head, end) = (record(op::HEADER, &[0; 8]), record(op::DATA_END, &[0; 4]));
    let footer = record(op::FOOTER, &[0; 20]);
    // Of known opcodes, and one byte shorter than its fields.
    let [below, above] = [op::HEADER - 1, op::DATA_END + 1].map(|opcode| record(opcode, &[0; 4]));
    let short = record(op::DATA_END, &[0; 3]);
    let (mut too_long, mut torn) = (record(op::DATA_END, &[0; 5]), end.clone());
    too_long.truncate(13);
    torn.truncate(8);
    let all: &[u8] = &[op::HEADER, op::DATA_END, op::FOOTER];
    let check = |name: &str, parts: &[&[u8]], opcodes: usize, unread_bytes, rest_bytes| {
        let opcodes = all.iter().copied().take(opcodes).collect();
        assert_eq!(read(name, parts), (opcodes, unread_bytes, rest_bytes), "{name}");
    };
    check("whole", &[&head, &end, &footer, MAGIC], 3, 0, 0);
    check("bytes behind the end", &[&head, &end, &footer, MAGIC, b"12345"], 3, 0, 5);
    check("no end", &[&head, &end], 2, 0, 0);
    check("a record with too few bytes", &[&head, &short, &end, &footer, MAGIC], 3, 12, 0);
    check("the same as the last one", &[&head, &short], 1, 12, 0);
    // Behind it no chunk follows: the rest up to the magic is lost.
    check("opcode 0", &[&head, &below, &end, &footer, MAGIC], 1, 55, 0);
    check("opcode 16", &[&head, &above, &end, &footer, MAGIC], 1, 55, 0);
    check("a length beyond the end", &[&head, &too_long], 1, 13, 0);
    check("a torn head of a record", &[&head, &torn], 1, 8, 0);
}

#[test]
fn the_sizes_of_a_chunk_fit_its_frame_and_what_is_accepted() {
    // 8 + 8 + 8 + 4 + (4 + 3) + 8 bytes of fields, and 5 of records.
    let frame = Frame { opcode: op::CHUNK, data: vec![0; 43 + 5] };
    let most = RECORD_BYTES_MAX as u64;
    for (compressed_size, uncompressed_size, fits) in
        [(5, most, true), (5, most + 1, false), (4, 9, false), (6, 9, false), (u64::MAX, 9, false)]
    {
        let header = ChunkHeader {
            message_start_time: 0,
            message_end_time: 0,
            uncompressed_size,
            uncompressed_crc: 0,
            compression: "lz4".into(),
            compressed_size,
        };
        assert_eq!(is_chunk(&header, &frame), fits, "{header:?}");
    }
}
