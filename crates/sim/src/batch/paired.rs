//! Two controllers on the same seeds: what differs, and how sure that is.
//!
//! Owns the paired differences. Both flew the same vehicles, starts, gusts and faults, so that the
//! difference within a seed shows more than two tables side by side. A flight without finish counts
//! the time limit, as in the table: a controller that fails must not gain by it.

use std::fmt::{self, Display, Formatter};

use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::metrics::Score;
use tello_eval::{Centre, interval, quantile};

use super::flight::FlightRow;
use super::table::{Batch, LINES, is_valid};

/// Two batches over the same seeds, and their differences by the true pose.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Comparison {
    /// Names of the two batches, for people: those of their settings files.
    pub names: [String; 2],
    /// Figures of the batch with the settings of `--config`.
    pub config: Batch,
    /// Figures of the batch with the settings of `--against`.
    pub against: Batch,
    /// Differences, `config` minus `against`.
    pub paired: Vec<Paired>,
}

/// The difference of one figure over the seeds in which both flights have it; times they always have.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Paired {
    /// Name of the compared figure, as in the table of a batch.
    pub figure: &'static str,
    /// Unit of the figure and of the difference, 1 for a ratio.
    pub unit: &'static str,
    /// Seeds in which both have it.
    pub pairs: usize,
    /// Seeds in which one of the two lacks it and which do not count.
    pub dropped: usize,
    /// Median of the differences; of `within_valid_distance` their mean. In `unit`
    pub difference: f64,
    /// 95 % interval of it by the bootstrap. In `unit`
    pub interval: [f64; 2],
}

/// A figure of a flight and how its differences are summed up.
type Figure = (&'static str, &'static str, fn(&FlightRow) -> Option<f64>, Centre);

const FIGURES: [Figure; 7] = [
    ("finish_s", "s", |row| Some(time_s(row, |score| score.metrics.finish_s)), Centre::Median),
    ("since_entry_s", "s", |row| Some(time_s(row, |score| score.since_entry_s)), Centre::Median),
    ("distance_median_m", "m", |row| Some(score(row)?.metrics.distance_median_m), Centre::Median),
    ("distance_p95_m", "m", |row| Some(score(row)?.metrics.distance_p95_m), Centre::Median),
    ("distance_max_m", "m", |row| Some(score(row)?.metrics.distance_max_m), Centre::Median),
    (
        "within_valid_distance",
        "1",
        |row| Some(f64::from(u8::from(score(row).is_some_and(is_valid)))),
        Centre::Mean,
    ),
    ("overshoot_m", "m", |row| quantile(&score(row)?.overshoots_m, 0.5), Centre::Median),
];

fn score(row: &FlightRow) -> Option<&Score> {
    row.by_truth.as_ref()
}

fn time_s(row: &FlightRow, pick: fn(&Score) -> Option<f64>) -> f64 {
    score(row).and_then(pick).unwrap_or(row.time_limit_s)
}

impl Comparison {
    /// Compares two batches over the same seeds; `seed` is that of the bootstrap.
    pub fn of(names: [String; 2], config: Batch, against: Batch, seed: u64) -> Self {
        let difference = |(figure, unit, pick, centre): Figure| {
            let pairs = config.flights.iter().zip(&against.flights);
            let mut differences: Vec<f64> =
                pairs.filter_map(|(ours, theirs)| Some(pick(ours)? - pick(theirs)?)).collect();
            differences.sort_by(f64::total_cmp);
            Some(Paired {
                figure,
                unit,
                pairs: differences.len(),
                dropped: config.flights.len() - differences.len(),
                difference: centre.of(&differences)?,
                interval: interval(&differences, centre, seed)?,
            })
        };
        let paired = FIGURES.into_iter().filter_map(difference).collect();
        Self { names, config, against, paired }
    }
}

impl Display for Comparison {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { names: [ours, theirs], config, against, paired } = self;
        for (name, batch) in [(ours, config), (theirs, against)] {
            writeln!(f, "{name}")?;
            batch.write_counts(f)?;
        }
        if let (Some(config), Some(against)) = (&config.by_truth, &against.by_truth) {
            writeln!(f, "{:<18} {ours:>9} {theirs:>12}", "by truth")?;
            let [wide, wider] = [ours.chars().count().max(9), theirs.chars().count().max(12)];
            for (name, unit, digits, pick) in LINES {
                if let (Some(config), Some(against)) = (pick(config), pick(against)) {
                    writeln!(
                        f,
                        "{name:<18} {config:>wide$.digits$} {against:>wider$.digits$}  {unit}"
                    )?;
                }
            }
        }
        writeln!(
            f,
            "{ours} minus {theirs}, seed by seed: median (within: mean) and its 95 % interval"
        )?;
        for row in paired {
            let Paired { figure, unit, pairs, dropped, difference, interval: [low, high] } = row;
            write!(
                f,
                "{figure:<22} {difference:>+9.4} [{low:+.4}, {high:+.4}]  {unit}, {pairs} pairs"
            )?;
            if *dropped > 0 {
                write!(f, ", {dropped} dropped")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::Flown;

    #[test]
    fn a_flight_that_fails_counts_as_the_time_limit_and_is_not_left_out() {
        let finished = Flown::example(Some(20.0), 0.2);
        let mut unbegun = Flown::example(None, 0.2);
        unbegun.row.by_truth = None;
        let batch = |flown: [&Flown; 3]| Batch::of(&flown.map(Clone::clone));
        let unfinished = Flown::example(None, 0.2);
        let compared = Comparison::of(
            ["a.json", "b.json"].map(Into::into),
            batch([&unfinished, &unbegun, &finished]),
            batch([&finished, &finished, &unfinished]),
            1,
        );
        let row = |figure| compared.paired.iter().find(|row| row.figure == figure).unwrap();
        for figure in ["finish_s", "since_entry_s"] {
            // 100 s more, 100 s more, 100 s less.
            let Paired { pairs, dropped, difference, .. } = *row(figure);
            assert_eq!((pairs, dropped, difference), (3, 0, 100.0), "{figure}");
        }
        let Paired { pairs, dropped, .. } = *row("distance_median_m");
        assert_eq!((pairs, dropped), (2, 1));
        assert!(compared.to_string().contains("m, 2 pairs, 1 dropped"), "{compared}");
        assert!(compared.to_string().contains("a.json minus b.json"), "{compared}");
    }

    #[test]
    fn equal_flights_differ_by_exactly_nothing() {
        assert_eq!(interval(&[0.0; 12], Centre::Median, 1), Some([0.0; 2]));
        assert_eq!(interval(&[0.0; 12], Centre::Mean, 1), Some([0.0; 2]));
        assert_eq!(interval(&[], Centre::Median, 1), None);
    }

    #[test]
    fn the_interval_of_a_mean_is_that_of_theory() {
        // 400 values with mean 0.5 and deviation 1/sqrt(12): 1.96 standard errors are 0.0283. The
        // bootstrap of 2000 resamples knows them to 5 %.
        let values: Vec<f64> = (0..400).map(|k| (f64::from(k) + 0.5) / 400.0).collect();
        let [low, high] = interval(&values, Centre::Mean, 3).unwrap();
        assert!((low - (0.5 - 0.0283)).abs() < 0.003, "{low}");
        assert!((high - (0.5 + 0.0283)).abs() < 0.003, "{high}");
        assert_eq!(Some([low, high]), interval(&values, Centre::Mean, 3));
        assert_ne!(Some([low, high]), interval(&values, Centre::Mean, 4));
    }
}
