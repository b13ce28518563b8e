//! Lines out of a byte stream, in bounded memory.

#![deny(clippy::indexing_slicing)]

/// Longest line that is kept, without its line feed. A pose with a matrix has about 130 bytes.
pub(crate) const LINE_BYTES_MAX: usize = 1024;

/// Assembles lines from chunks that are cut anywhere.
///
/// A line that is too long is dropped as a whole, up to its line feed.
#[derive(Debug)]
pub struct Lines {
    /// Start of the line whose end has not yet arrived.
    partial: Vec<u8>,
    /// Whether the rest of the present line is thrown away.
    is_too_long: bool,
}

impl Default for Lines {
    fn default() -> Self {
        Self { partial: Vec::with_capacity(LINE_BYTES_MAX), is_too_long: false }
    }
}

impl Lines {
    /// Calls `on_line` for each line that `chunk` completes, without line feed and a carriage return
    /// before it; `None` stands for a line that was too long.
    ///
    /// No allocation.
    pub fn push(&mut self, chunk: &[u8], mut on_line: impl FnMut(Option<&[u8]>)) {
        for piece in chunk.split_inclusive(|byte| *byte == b'\n') {
            let body = piece.strip_suffix(b"\n");
            self.keep(body.unwrap_or(piece));
            if body.is_some() {
                let line = self.partial.strip_suffix(b"\r").unwrap_or(&self.partial);
                on_line((!self.is_too_long).then_some(line));
                self.clear();
            }
        }
    }

    /// Forgets the line that has not ended: its connection is gone.
    pub fn clear(&mut self) {
        self.partial.clear();
        self.is_too_long = false;
    }

    fn keep(&mut self, piece: &[u8]) {
        if self.partial.len() + piece.len() > LINE_BYTES_MAX {
            self.is_too_long = true;
        } else {
            self.partial.extend_from_slice(piece);
        }
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lines_of<'a>(chunks: impl IntoIterator<Item = &'a [u8]>) -> Vec<Option<Vec<u8>>> {
        let mut assembler = Lines::default();
        let mut lines = Vec::new();
        for chunk in chunks {
            assembler.push(chunk, |line| lines.push(line.map(<[u8]>::to_vec)));
            assert!(assembler.partial.capacity() == LINE_BYTES_MAX, "the buffer grew");
        }
        lines
    }

    fn good<const N: usize>(lines: [&str; N]) -> [Option<Vec<u8>>; N] {
        lines.map(|line| Some(line.as_bytes().to_vec()))
    }

    #[test]
    fn one_chunk_may_hold_several_lines_and_a_start() {
        assert_eq!(lines_of([b"one\ntwo\r\n\nfo".as_slice()]), good(["one", "two", ""]));
    }

    #[test]
    fn a_line_may_be_cut_at_every_byte() {
        let text = b"1000 100.0 tello\r\nnext\n";
        for at in 0..=text.len() {
            let (left, right) = text.split_at(at);
            assert_eq!(lines_of([left, right]), good(["1000 100.0 tello", "next"]), "{at}");
        }
    }

    #[test]
    fn a_line_of_the_limit_is_kept_and_one_byte_more_is_dropped() {
        for (length, is_kept) in [(LINE_BYTES_MAX, true), (LINE_BYTES_MAX + 1, false)] {
            let mut text = vec![b'x'; length];
            text.extend_from_slice(b"\nnext\n");
            for step in [1, 7, text.len()] {
                let lines = lines_of(text.chunks(step));
                assert_eq!(lines.len(), 2, "{length} bytes by {step}");
                assert_eq!(lines[0].as_ref().map(Vec::len), is_kept.then_some(length));
                assert_eq!(lines[1..], good(["next"]));
            }
        }
    }

    #[test]
    fn a_cleared_start_does_not_leak_into_the_next_line() {
        let mut assembler = Lines::default();
        assembler.push(b"half", |_| panic!("no line has ended"));
        assembler.clear();
        let mut lines = Vec::new();
        assembler.push(b"whole\n", |line| lines.push(line.map(<[u8]>::to_vec)));
        assert_eq!(lines, good(["whole"]));
    }

    proptest! {
        #[test]
        fn lines_do_not_depend_on_the_cuts(
            bytes in prop::collection::vec(prop_oneof![3 => Just(b'\n'), 9 => any::<u8>()], 0..300),
            step in 1_usize..50,
        ) {
            prop_assert_eq!(lines_of(bytes.chunks(step)), lines_of([bytes.as_slice()]));
        }
    }
}
