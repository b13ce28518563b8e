//! The thesis' relay and Tracker's object stream, read for every object that they have.

#![deny(clippy::indexing_slicing)]

use super::axes::Placement;
use super::body::matrix_of_angles;
use super::lines::Lines;
use super::object_stream::Block;
use super::protocol::{Head, Name, Protocol, Taker};
use super::source::SourceError;
use super::{ViconCounters, parse_line};
use crate::clock::SpanNs;

/// The lines of a relay.
#[derive(Debug, Default)]
pub(super) struct RelayBodies {
    lines: Lines,
}

impl Protocol for RelayBodies {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &ViconCounters,
        taker: &mut dyn Taker,
    ) -> Result<(), SourceError> {
        self.lines.push(bytes, |line| {
            counters.messages.count();
            let Some(read) = line.and_then(|line| parse_line(line).ok()) else {
                counters.malformed.count();
                return;
            };
            // The relay's reader keeps the heading of a rotation alone.
            let at = read.pose.map(|at| {
                let [x, y, z, theta] = at.into();
                Placement { pos: [x, y, z], matrix: matrix_of_angles([0.0, 0.0, theta]) }
            });
            taker.body(Name { text: Some(read.object), id: None }, at.as_ref());
            let (number, rate_hz) = (read.frame, read.rate_hz);
            taker.frame(Head { number, rate_hz, latency: SpanNs(0), is_whole: false });
        });
        Ok(())
    }

    fn restart(&mut self) {
        self.lines = Lines::default();
    }
}

/// The blocks of an object stream.
#[derive(Debug)]
pub(super) struct BlockBodies {
    rate_hz: f64,
}

impl BlockBodies {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { rate_hz }
    }
}

impl Protocol for BlockBodies {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &ViconCounters,
        taker: &mut dyn Taker,
    ) -> Result<(), SourceError> {
        counters.messages.count();
        let Ok(block) = Block::parse(bytes) else {
            counters.malformed.count();
            return Ok(());
        };
        for body in block.objects() {
            let Ok(body) = body else {
                counters.malformed.count();
                continue;
            };
            let name = String::from_utf8_lossy(body.name);
            let at = Placement { pos: body.pos_w, matrix: matrix_of_angles(body.angles) };
            taker.body(Name { text: Some(&name), id: None }, Some(&at));
        }
        let (number, rate_hz) = (block.frame.into(), self.rate_hz);
        taker.frame(Head { number, rate_hz, latency: SpanNs(0), is_whole: false });
        Ok(())
    }

    fn restart(&mut self) {}
}
