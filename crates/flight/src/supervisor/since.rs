//! Limits, and for how long a condition holds.

/// Whether `value` is above `limit`, in the same unit; NaN is.
pub(super) fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

/// Time from `since_ns` to `t_ns`. s
pub(super) fn elapsed_s(since_ns: i64, t_ns: i64) -> f64 {
    t_ns.saturating_sub(since_ns) as f64 / 1e9
}

/// Whether what began at `since_ns` goes on for `for_s`.
pub(super) fn has_lasted(since_ns: Option<i64>, t_ns: i64, for_s: f64) -> bool {
    since_ns.is_some_and(|since_ns| elapsed_s(since_ns, t_ns) >= for_s)
}

/// Remembers since when `holds` is true without a break.
pub(super) fn keep_since(since_ns: &mut Option<i64>, holds: bool, t_ns: i64) {
    *since_ns = holds.then(|| since_ns.unwrap_or(t_ns));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_exceeded_above_it_and_by_nan() {
        for (value, is_above) in [(0.9, false), (1.0, false), (1.1, true), (f64::NAN, true)] {
            assert_eq!(exceeds(value, 1.0), is_above, "{value}");
        }
    }

    #[test]
    fn a_condition_lasts_from_its_first_tick_on_and_a_break_begins_it_anew() {
        let mut since_ns = None;
        let lasted = [(true, 0), (true, 400), (false, 500), (true, 600), (true, 1000)].map(
            |(holds, t_ms)| {
                let t_ns = t_ms * 1_000_000;
                keep_since(&mut since_ns, holds, t_ns);
                has_lasted(since_ns, t_ns, 0.4)
            },
        );
        assert_eq!(lasted, [false, true, false, false, true]);
        assert!((elapsed_s(1_500_000_000, 3_000_000_000) - 1.5).abs() < 1e-12);
    }
}
