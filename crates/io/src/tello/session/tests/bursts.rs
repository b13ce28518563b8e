//! LANDs that only a burst adds are left out: other tests are about those every 0.5 s.

/// Times of the newest LAND, and of the newest one that is no addition of a burst. ms
#[derive(Default)]
pub(super) struct Landings {
    newest_ms: Option<i64>,
    kept_ms: Option<i64>,
}

impl Landings {
    /// Whether the LAND of `now_ms` is one of those every 0.5 s, or repeats one that the socket refused.
    pub(super) fn keep(&mut self, now_ms: i64) -> bool {
        let is_next = self.newest_ms.replace(now_ms) == Some(now_ms - 20);
        let is_added = is_next && self.kept_ms.is_some_and(|kept_ms| now_ms - kept_ms < 500);
        self.kept_ms = if is_added { self.kept_ms } else { Some(now_ms) };
        !is_added
    }
}
