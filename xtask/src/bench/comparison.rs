//! Programs measured on the same problems, and their results.
//!
//! Owns the order of the passes, the statistics and the table. The machine is shared: every program
//! makes a pass in turn, a program's time is the median over passes of the median over solves, and the
//! least of these medians stands beside it.

use std::fmt::{self, Write as _};

use anyhow::Result;

use super::Findings;

/// One solve as a program reports it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solve {
    pub(super) us: f64,
    pub(super) iterations: u32,
    /// Cost that was reached. 1
    pub(super) cost: f64,
    /// Largest entry of the projected gradient; NaN where it is not asked for.
    pub(super) kkt: f64,
}

/// One pass of a program over all problems.
type Run<'a> = Box<dyn FnMut() -> Result<Vec<Solve>> + 'a>;

/// A program that takes part.
pub(super) struct Program<'a> {
    pub(super) name: String,
    /// The ratio of our time to this program's that was aimed at.
    pub(super) goal: Option<f64>,
    pub(super) run: Run<'a>,
}

impl<'a> Program<'a> {
    /// A program without a goal.
    pub(super) fn new(
        name: impl Into<String>,
        run: impl FnMut() -> Result<Vec<Solve>> + 'a,
    ) -> Self {
        Self { name: name.into(), goal: None, run: Box::new(run) }
    }

    /// This program with a goal.
    pub(super) fn with_goal(self, goal: Option<f64>) -> Self {
        Self { goal, ..self }
    }
}

/// Times and results of a program in all of its passes.
#[derive(Debug)]
struct Measured {
    name: String,
    goal: Option<f64>,
    passes: Vec<Vec<Solve>>,
}

/// Programs on one set of problems, ours first.
#[derive(Debug)]
pub(super) struct Comparison {
    problem: String,
    /// Best known cost of each problem; empty where costs say nothing.
    best: Vec<f64>,
    measured: Vec<Measured>,
}

/// Head of the raw times.
pub(super) const RAW_HEAD: &str = "problem,program,pass,solves,median_us,p99_us,least_us\n";

impl Comparison {
    /// Lets `programs` make `repetitions` passes in turns.
    pub(super) fn run(
        problem: impl Into<String>,
        best: Vec<f64>,
        mut programs: Vec<Program<'_>>,
        repetitions: u32,
    ) -> Result<Self> {
        let mut measured: Vec<Measured> = programs
            .iter()
            .map(|Program { name, goal, .. }| Measured {
                name: name.clone(),
                goal: *goal,
                passes: Vec::new(),
            })
            .collect();
        for _ in 0..repetitions {
            for (program, measured) in programs.iter_mut().zip(&mut measured) {
                measured.passes.push((program.run)()?);
            }
        }
        Ok(Self { problem: problem.into(), best, measured })
    }

    /// Lines of the raw file.
    fn raw(&self) -> Result<String, fmt::Error> {
        let mut text = String::new();
        for Measured { name, passes, .. } in &self.measured {
            for (i, pass) in passes.iter().enumerate() {
                let us = sorted(pass.iter().map(|solve| solve.us));
                let [median, p99, least] = [0.5, 0.99, 0.0].map(|fraction| quantile(&us, fraction));
                let (problem, count) = (&self.problem, us.len());
                writeln!(
                    text,
                    "\"{problem}\",\"{name}\",{i},{count},{median:.3},{p99:.3},{least:.3}"
                )?;
            }
        }
        Ok(text)
    }

    /// Lines of the table.
    fn rows(&self) -> Result<String, fmt::Error> {
        let mut text = String::new();
        let ours = self.measured.first().map_or(f64::NAN, Measured::median_us);
        for (i, measured) in self.measured.iter().enumerate() {
            let ratio = ours / measured.median_us();
            let goal = measured.goal.map_or_else(String::new, |goal| {
                let verdict = if ratio <= goal { "met" } else { "**missed**" };
                format!("{goal} {verdict}")
            });
            let ratio = if i == 0 { String::new() } else { format!("{ratio:.4}") };
            let gaps = sorted(measured.gaps(&self.best));
            writeln!(
                text,
                "| {} | {} | {:.2} | {:.2} | {:.2} | {ratio} | {goal} | {:.2} | {} | {} | {} |",
                if i == 0 { &self.problem } else { "" },
                measured.name,
                measured.median_us(),
                measured.least_us(),
                measured.p99_us(),
                measured.iterations(),
                exponent(quantile(&gaps, 0.5)),
                exponent(quantile(&gaps, 1.0)),
                exponent(measured.kkt()),
            )?;
        }
        Ok(text)
    }
}

impl Measured {
    /// The quantile `fraction` of every pass, ascending. us
    fn of_passes(&self, fraction: f64) -> Vec<f64> {
        sorted(
            self.passes
                .iter()
                .map(|pass| quantile(&sorted(pass.iter().map(|solve| solve.us)), fraction)),
        )
    }

    fn median_us(&self) -> f64 {
        quantile(&self.of_passes(0.5), 0.5)
    }

    fn least_us(&self) -> f64 {
        quantile(&self.of_passes(0.5), 0.0)
    }

    fn p99_us(&self) -> f64 {
        quantile(&self.of_passes(0.99), 0.5)
    }

    /// Passes repeat each other but for their time: the last stands for all.
    fn last(&self) -> &[Solve] {
        self.passes.last().map_or(&[], Vec::as_slice)
    }

    fn iterations(&self) -> f64 {
        let sum: u32 = self.last().iter().map(|solve| solve.iterations).sum();
        f64::from(sum) / self.last().len() as f64
    }

    /// How much more each solve costs than the best known solution, relative to it.
    fn gaps(&self, best: &[f64]) -> impl Iterator<Item = f64> {
        self.last().iter().zip(best).map(|(solve, best)| (solve.cost - best) / best.abs())
    }

    fn kkt(&self) -> f64 {
        quantile(&sorted(self.last().iter().map(|solve| solve.kkt)), 1.0)
    }
}

/// Table and raw times of several comparisons.
///
/// # Errors
/// None in practice: texts take what is written to them.
pub(super) fn findings(comparisons: &[Comparison]) -> Result<Findings, fmt::Error> {
    let mut table = "| problem | program | median us | least us | p99 us | ours / this | goal \
                     | iterations | cost gap | largest | KKT |\n|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_owned();
    let mut raw = String::new();
    for comparison in comparisons {
        table.push_str(&comparison.rows()?);
        raw.push_str(&comparison.raw()?);
    }
    Ok(Findings { table, raw })
}

/// Values in ascending order.
pub(super) fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The `fraction` quantile of `values`, NaN of none.
pub(super) fn quantile(values: &[f64], fraction: f64) -> f64 {
    tello_eval::quantile(values, fraction).unwrap_or(f64::NAN)
}

/// A small number, or nothing where there is none.
fn exponent(value: f64) -> String {
    if value.is_nan() { String::new() } else { format!("{value:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A program that takes these times in its passes, all solves alike. us
    fn program(name: &str, times_us: &'static [f64], cost: f64) -> Program<'static> {
        let mut times_us = times_us.iter();
        Program::new(name, move || {
            let us = *times_us.next().expect("a time per pass");
            Ok(vec![Solve { us, iterations: 2, cost, kkt: f64::NAN }; 3])
        })
    }

    fn rows(goal: f64) -> String {
        let peer = program("peer", &[40.0, 20.0, 60.0], 2.5).with_goal(Some(goal));
        let ours = program("ours", &[2.0, 8.0, 4.0], 2.0);
        Comparison::run("square", vec![2.0; 3], vec![ours, peer], 3).unwrap().rows().unwrap()
    }

    #[test]
    fn the_median_over_passes_is_compared_and_the_least_stands_beside_it() {
        let ours = "| square | ours | 4.00 | 2.00 | 4.00 |  |  | 2.00 | 0.0e0 | 0.0e0 |  |";
        let peer =
            "|  | peer | 40.00 | 20.00 | 40.00 | 0.1000 | 0.1 met | 2.00 | 2.5e-1 | 2.5e-1 |  |";
        assert_eq!(rows(0.1).lines().collect::<Vec<_>>(), [ours, peer]);
        assert!(rows(0.09).contains("| 0.09 **missed** |"));
    }

    #[test]
    fn raw_times_have_a_line_for_each_pass() {
        let ours = program("ours", &[2.0, 8.0], 2.0);
        let raw = Comparison::run("square", Vec::new(), vec![ours], 2).unwrap().raw().unwrap();
        let lines = [
            "\"square\",\"ours\",0,3,2.000,2.000,2.000",
            "\"square\",\"ours\",1,3,8.000,8.000,8.000",
        ];
        assert_eq!(raw.lines().collect::<Vec<_>>(), lines);
    }
}
