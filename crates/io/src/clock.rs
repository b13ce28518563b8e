//! Time: monotonic stamps and the ticker of the loop.
