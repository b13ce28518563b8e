//! The self-test as a table for people.

use std::fmt::{self, Display, Formatter};

use super::{FLIGHT_STEPS, FLIGHTS, SelfTest, Source};
use crate::DT_S;

impl Display for SelfTest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let seconds = FLIGHT_STEPS as f64 * DT_S;
        match self.source {
            Source::ByHand => {
                let runs = self.runs;
                write!(f, "{runs} runs of {FLIGHTS} simulated flights of {seconds:.0} s")?;
            }
            Source::Automatic => {
                write!(f, "{} runs of one automatic flight", self.runs)?;
            }
        }
        writeln!(f, ", {} refused", self.refused)?;
        writeln!(
            f,
            "{:<22} {:>9} {:>9} {:>10} {:>9} {:>9} {:>8}",
            "first run:", "truth", "estimate", "mean error", "rms", "claimed", "in 95 %"
        )?;
        for row in &self.rows {
            writeln!(
                f,
                "{:<22} {:>9.4} {:>9.4} {:>10.4} {:>9.4} {:>9} {:>6} %",
                row.name,
                row.truth,
                row.estimate,
                row.error_mean,
                row.error_rms,
                or_dash(row.std_mean, 4),
                or_dash(row.coverage.map(|part| 100.0 * part), 0)
            )?;
        }
        writeln!(f, "in 95 % intervals: {:.1} % of all", 100.0 * self.coverage)?;
        for (flown, by) in self.flown.iter().flatten().zip(["built-in", "identified"]) {
            writeln!(f, "with {by} parameters: {flown}")?;
        }
        writeln!(f, "{}", if self.is_passed { "passed" } else { "FAILED" })
    }
}

/// A number with so many decimals; a dash if there is none.
fn or_dash(number: Option<f64>, decimals: usize) -> String {
    number
        .filter(|number| number.is_finite())
        .map_or_else(|| "-".to_owned(), |number| format!("{number:.decimals$}"))
}
