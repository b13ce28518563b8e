//! Rows of vectors: name, unit, topology and domain.
//!
//! Owns no values: settings, logs and messages look up here what an entry of a vector is.

/// Name, unit and topology of one row of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Name in logs, settings and messages, as in `docs/notation.md`.
    pub name: &'static str,
    /// SI unit; `"1"` for a ratio.
    pub unit: &'static str,
    /// Whether values that differ by 2 pi mean the same.
    pub is_angle: bool,
    /// Where values make sense.
    pub domain: Domain,
}

/// Values that a row can take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// Every finite number.
    Real,
    /// Above zero.
    Positive,
    /// From zero up to, but not including, one.
    Fraction,
}

impl Row {
    /// A row on the real line without a name: the default of a [`Model`](crate::Model) that names nothing.
    pub const UNNAMED: Self = Self::linear("unnamed", "1");

    /// A row on the real line.
    pub const fn linear(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, is_angle: false, domain: Domain::Real }
    }

    /// A row that is positive by its nature.
    pub const fn positive(name: &'static str, unit: &'static str) -> Self {
        Self { domain: Domain::Positive, ..Self::linear(name, unit) }
    }

    /// A ratio in `[0, 1)`.
    pub const fn fraction(name: &'static str) -> Self {
        Self { domain: Domain::Fraction, ..Self::linear(name, "1") }
    }

    /// A row on the circle, in radians.
    pub const fn angle(name: &'static str) -> Self {
        Self { is_angle: true, ..Self::linear(name, "rad") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_of_row_has_its_topology_domain_and_unit() {
        for (row, name, unit, is_angle, domain) in [
            (Row::linear("x", "m"), "x", "m", false, Domain::Real),
            (Row::positive("tau_h", "s"), "tau_h", "s", false, Domain::Positive),
            (Row::fraction("dead_h"), "dead_h", "1", false, Domain::Fraction),
            (Row::angle("theta"), "theta", "rad", true, Domain::Real),
            (Row::UNNAMED, "unnamed", "1", false, Domain::Real),
        ] {
            assert_eq!(row, Row { name, unit, is_angle, domain });
        }
    }
}
