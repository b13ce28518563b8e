//! Warnings about an estimate, in words.

use crate::figure;
use horizon_model::Row;
use horizon_model::rows::pose;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

use super::acceptance::{has_rested, sticks_of};
use super::fit::Contradiction;
use super::job::Trace;
use super::report::{DelayMinimum, DelayRow, ParameterRow};

/// Root mean square below which a stick was hardly moved. 1
pub(super) const EXCITATION_MIN: f64 = 0.05;

/// Autocorrelation of the observation residuals at [`WHITE_LAG_S`] above which they count as not white:
/// what is left is then dynamics that the model does not know. Residuals of transitions are estimates
/// themselves and never white. 1
const WHITE_MAX: f64 = 0.3;

/// Lag at which the residuals are judged, about half a time constant of the vehicle. s
const WHITE_LAG_S: f64 = 0.2;

/// Heading offset beyond which the object in the motion capture is likely defined askew. rad
const THETA_0_MAX: f64 = 0.2;

/// Fraction of the prior's standard deviation above which the data contain next to no information. 1
const PRIOR_RATIO: f64 = 0.5;

/// Whether the logs contain next to no information on a parameter with this standard deviation by Laplace's
/// approximation and by its prior alone.
pub(super) fn is_set_by_prior(std_laplace: f64, prior_std: f64) -> bool {
    std_laplace > PRIOR_RATIO * prior_std
}

/// Pieces per parameter from which their scatter counts.
pub(super) const PIECES_PER_PARAMETER: usize = 3;

/// Fewer different resamples give no distribution.
const DISTINCT_MIN: usize = 100;

/// Whether a bootstrap with `distinct` different samples of `pieces` shows how well so many `parameters` are known.
pub(super) fn is_resampled(distinct: usize, pieces: usize, parameters: usize) -> bool {
    distinct >= DISTINCT_MIN && pieces > parameters
}

/// Robust deviation of the observation residuals above which the poses are noisier than their weights say. 1
const SCATTER_MAX: f64 = 2.0;

/// Standard deviation beyond which a dead time counts as unknown. s
const DEAD_TIME_STD_MAX_S: f64 = 0.1;

/// Results of an identification that the warnings are about.
pub(super) struct IdentFindings<'a> {
    pub(super) parameters: &'a [ParameterRow],
    /// Standard deviation that the prior gives each parameter; infinite without a prior. Units of
    /// the rows
    pub(super) prior_std: Vec<f64>,
    pub(super) inputs: &'a [Row],
    /// Root mean square of each applied input over the steps used. 1
    pub(super) input_rms: Vec<f64>,
    pub(super) observations: &'a [Row],
    /// Autocorrelation of the residuals of each observation row at [`WHITE_LAG_S`]. 1
    pub(super) autocorrelation: Vec<f64>,
    /// Robust deviation of the weighted residuals of each observation row. 1
    pub(super) scatter: Vec<f64>,
    pub(super) has_converged: bool,
    pub(super) delay: &'a [DelayRow],
    /// Number of pieces.
    pub(super) pieces: usize,
    /// Different samples of the pieces in the bootstrap, if there is one.
    pub(super) resamples_distinct: Option<usize>,
    /// Number of logs that were simulated, and of those that were not.
    pub(super) simulated_and_real: [usize; 2],
    /// Logs more than half of which was left out because commands were lost.
    pub(super) mostly_lost: Vec<String>,
    /// Logs that contradict the others or themselves.
    pub(super) contradictions: &'a [Contradiction],
}

impl IdentFindings<'_> {
    /// One sentence for each thing that is off.
    pub(super) fn sentences(&self) -> Vec<String> {
        let mut findings = Vec::new();
        self.about_dead_times(&mut findings);
        self.about_pieces(&mut findings);
        if !self.has_converged {
            findings
                .push("the solver did not converge: raise map.solver.iterations_max".to_owned());
        }
        self.about_parameters(&mut findings);
        self.about_inputs(&mut findings);
        self.about_residuals(&mut findings);
        findings
    }

    fn about_dead_times(&self, findings: &mut Vec<String>) {
        for row in self.delay {
            let (sticks, dead_time_s) = (&row.sticks, row.dead_time_s);
            let why = match (row.verdict, row.std_s) {
                (DelayMinimum::Undecided, _) => {
                    "the likelihood does not decide, kept as given, intervals of its axis widened"
                }
                (DelayMinimum::EndOfRange, _) => {
                    "the cost is least at the end of its range; kept as given"
                }
                (DelayMinimum::Minimum | DelayMinimum::Zero, Some(std_s))
                    if std_s > DEAD_TIME_STD_MAX_S =>
                {
                    "too vague"
                }
                (DelayMinimum::Minimum | DelayMinimum::Zero, _) => continue,
            };
            findings.push(format!(
                "the dead time of {sticks} is not determined by these logs: {why} ({dead_time_s:.3} s)"
            ));
        }
    }

    fn about_inputs(&self, findings: &mut Vec<String>) {
        let rested = self.rested();
        for (stick, (row, rms)) in self.inputs.iter().zip(&self.input_rms).enumerate() {
            if *rms < EXCITATION_MIN && !rested.iter().any(|(sticks, _)| sticks.contains(&stick)) {
                findings.push(format!("{} was hardly moved (rms {rms:.3}): fly it more", row.name));
            }
        }
    }

    fn about_residuals(&self, findings: &mut Vec<String>) {
        let colored: Vec<String> = self
            .observations
            .iter()
            .zip(&self.autocorrelation)
            .filter(|(_, correlation)| **correlation > WHITE_MAX)
            .map(|(row, correlation)| format!("{} {correlation:.2}", row.name))
            .collect();
        if !colored.is_empty() {
            findings.push(format!(
                "residuals are not white (autocorrelation at {WHITE_LAG_S} s: {}): the model misses \
                 dynamics; trust the bootstrap, not Laplace",
                colored.join(", ")
            ));
        }
        for (row, scatter) in self.observations.iter().zip(&self.scatter) {
            if *scatter > SCATTER_MAX {
                findings.push(format!(
                    "the poses scatter {scatter:.1} times as much in {} as map.C_o assumes: lags, dead times and their \
                     intervals may be wrong; lower the weight, or improve the motion capture",
                    row.name
                ));
            }
        }
    }

    /// Sticks that rested all, and the parameters that only they show.
    fn rested(&self) -> Vec<(&'static [usize], Vec<&'static str>)> {
        let mut rested: Vec<(&'static [usize], Vec<&'static str>)> = Vec::new();
        let rows = self.parameters.iter().filter(|row| has_rested(row.name, &self.input_rms));
        for row in rows {
            let sticks = sticks_of(row.name);
            match rested.iter_mut().find(|(of, _)| *of == sticks) {
                Some((_, names)) => names.push(row.name),
                None => rested.push((sticks, vec![row.name])),
            }
        }
        rested
    }

    fn about_pieces(&self, findings: &mut Vec<String>) {
        let (pieces, parameters) = (self.pieces, self.parameters.len());
        match self.resamples_distinct {
            // Fewer pieces have no more different samples.
            Some(distinct)
                if pieces >= PIECES_PER_PARAMETER * parameters && distinct < DISTINCT_MIN =>
            {
                findings.push(format!(
                "the bootstrap has {distinct} distinct resamples: its intervals and correlations mean nothing, \
                 Laplace's are taken; ask for {DISTINCT_MIN} at least (--bootstrap 300)"
            ));
            }
            Some(distinct) if !is_resampled(distinct, pieces, parameters) => findings.push(format!(
                "the bootstrap rests on {pieces} pieces ({distinct} distinct resamples) for {parameters} \
                 parameters: its intervals and correlations mean nothing, Laplace's are taken; fly more"
            )),
            None if pieces < PIECES_PER_PARAMETER * parameters => findings.push(format!(
                "pieces: {pieces}, too few to show how they vary: the intervals assume independent residuals; fly \
                 until there are {}",
                PIECES_PER_PARAMETER * parameters
            )),
            _ => {}
        }
        let [simulated, real] = self.simulated_and_real;
        if simulated > 0 && real > 0 {
            findings.push(format!(
                "{simulated} of {} logs were simulated: the parameters are neither of the simulator nor of the drone",
                simulated + real
            ));
        }
        findings.extend(self.contradictions.iter().map(Contradiction::sentence));
        for log in &self.mostly_lost {
            findings.push(format!(
                "more than half of {log} was left out, since the drone did not follow its sticks: is the \
                 object turned (--turn), or the link bad?"
            ));
        }
    }

    fn about_parameters(&self, findings: &mut Vec<String>) {
        for (sticks, parameters) in self.rested() {
            let sticks = sticks.iter().filter_map(|stick| self.inputs.get(*stick));
            let sticks: Vec<&str> = sticks.map(|row| row.name).collect();
            let (sticks, parameters) = (sticks.join(" and "), parameters.join(", "));
            findings.push(format!("{sticks} rested, these are the prior: {parameters}"));
        }
        let names = self.contradictions.iter().flat_map(|found| &found.rows).map(|(name, _)| *name);
        let contradicted: Vec<&str> = names.collect();
        let moved = self.parameters.iter().zip(&self.prior_std);
        for (row, prior_std) in moved.filter(|(row, _)| !has_rested(row.name, &self.input_rms)) {
            if row.std_laplace.is_nan() {
                findings.push(format!(
                    "{} has no standard deviation: the data leave some state or parameter undetermined",
                    row.name
                ));
            }
            let is_theta_0 = row.name == "theta_0";
            if row.is_at_bound {
                let advice = if is_theta_0 { "align the object, or --turn" } else { "ask why" };
                findings.push(format!(
                    "{} = {:.4} lies at its bound: widen map.p_lb or map.p_ub, or {advice}",
                    row.name, row.value
                ));
            } else if is_set_by_prior(row.std_laplace, *prior_std) {
                findings.push(format!(
                    "{} is set by its prior: the data leave a standard deviation of {:.3}, the prior \
                     alone {prior_std:.3}",
                    row.name, row.std_laplace
                ));
            }
            // Between two values it is none of an object.
            if is_theta_0 && row.value.abs() > THETA_0_MAX && !contradicted.contains(&row.name) {
                findings.push(format!(
                    "theta_0 is {:.2} rad: the object's axes do not point along the drone; align them \
                     in the motion capture, or keep the value and fly gently",
                    row.value
                ));
            }
        }
    }
}

/// Robust deviation of the observation residuals of each row: their median distance from 0, which is 0.6745 of a normal
/// deviation. 1
pub(super) fn scatter(traces: &[Trace]) -> Vec<f64> {
    let of_row = |row: usize| {
        let residuals = traces.iter().flat_map(|trace| &trace.observation_residuals[row]);
        let known = residuals.filter(|residual| residual.is_finite()).map(|it| it.abs());
        let mut known: Vec<f64> = known.collect();
        known.sort_by(f64::total_cmp);
        known.get(known.len() / 2).map_or(0.0, |median| median / 0.6745)
    };
    (0..pose::COUNT).into_par_iter().map(of_row).collect()
}

/// Autocorrelation of the observation residuals of each row at [`WHITE_LAG_S`].
pub(super) fn autocorrelation(traces: &[Trace], dt_s: f64) -> Vec<f64> {
    let lag = horizon_model::steps(WHITE_LAG_S, dt_s);
    let of_row = |row: usize| {
        let pieces = traces.iter().map(|trace| trace.observation_residuals[row].as_slice());
        let pieces: Vec<&[f64]> = pieces.collect();
        figure::autocorrelation(&pieces, [lag]).pop().unwrap_or(0.0)
    };
    (0..pose::COUNT).into_par_iter().map(of_row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUT: [Row; 1] = [Row::linear("roll", "1")];
    const STATE: [Row; 1] = [Row::linear("x", "m")];

    fn row(name: &'static str, value: f64, is_at_bound: bool) -> ParameterRow {
        let (std, std_laplace, lower, upper) = (0.01, 0.01, value - 0.02, value + 0.02);
        ParameterRow { name, unit: "1", value, std, std_laplace, lower, upper, is_at_bound }
    }

    fn evidence(parameters: &[ParameterRow]) -> IdentFindings<'_> {
        IdentFindings {
            parameters,
            prior_std: vec![1.0; parameters.len()],
            inputs: &INPUT,
            input_rms: vec![0.3],
            observations: &STATE,
            autocorrelation: vec![0.1],
            scatter: vec![1.0],
            has_converged: true,
            delay: &[],
            pieces: 3 * parameters.len(),
            resamples_distinct: None,
            simulated_and_real: [0, 1],
            mostly_lost: Vec::new(),
            contradictions: &[],
        }
    }

    #[test]
    fn a_bootstrap_of_two_pieces_is_called_one() {
        let parameters = [row("lambda_h", 1.3, false)];
        let mut evidence = evidence(&parameters);
        (evidence.pieces, evidence.resamples_distinct) = (2, Some(3));
        let findings = evidence.sentences().join("\n");
        assert!(findings.contains("2 pieces (3 distinct resamples)"), "{findings}");
        (evidence.pieces, evidence.resamples_distinct) = (12, Some(40));
        assert!(evidence.sentences().join("").contains("ask for 100 at least"));
        (evidence.pieces, evidence.resamples_distinct) = (12, Some(290));
        assert!(evidence.sentences().is_empty());
        (evidence.pieces, evidence.resamples_distinct) = (2, None);
        assert!(evidence.sentences().join("").contains("pieces: 2, too few to show"));
    }

    #[test]
    fn a_dead_time_that_nothing_decides_is_named() {
        let delay = [DelayRow {
            sticks: "yaw".into(),
            dead_time_s: 0.04,
            verdict: DelayMinimum::Undecided,
            std_s: None,
            lower_s: None,
            upper_s: None,
        }];
        let mut evidence = evidence(&[]);
        evidence.delay = &delay;
        evidence.mostly_lost = vec!["a.log".into()];
        evidence.simulated_and_real = [1, 2];
        let contradictions = [Contradiction {
            log: "b.log".into(),
            is_within: false,
            rows: vec![("theta_0", -7.4), ("tau_h", 5.0)],
            has_scatter: true,
        }];
        evidence.contradictions = &contradictions;
        let findings = evidence.sentences().join("\n");
        assert!(findings.contains("1 of 3 logs were simulated"), "{findings}");
        assert!(findings.contains("yaw") && findings.contains("does not decide"), "{findings}");
        assert!(findings.contains("half of a.log"), "{findings}");
        assert!(findings.contains("b.log contradicts"), "{findings}");
        assert!(findings.contains("most in theta_0, by -7 standard"), "{findings}");
    }

    #[test]
    fn nothing_is_reported_when_nothing_is_off() {
        let parameters = [row("lambda_h", 1.3, false), row("theta_0", 0.03, false)];
        assert!(evidence(&parameters).sentences().is_empty());
    }

    #[test]
    fn an_axis_that_rested_has_one_line_and_theta_0_between_two_values_none() {
        let of = |name: &'static str| row(name, 0.5, true);
        let parameters = ["theta_0", "tau_h", "tau_v", "dead_v"].map(of);
        let mut evidence = evidence(&parameters);
        let inputs = ["roll", "pitch", "yaw", "throttle"].map(|name| Row::linear(name, "1"));
        (evidence.inputs, evidence.input_rms) = (&inputs, vec![0.3, 0.001, 0.3, 0.001]);
        let found = evidence.sentences();
        let of_throttle = found.iter().filter(|it| it.contains("_v") || it.contains("throttle"));
        let of_throttle: Vec<_> = of_throttle.collect();
        assert_eq!(of_throttle, ["throttle rested, these are the prior: tau_v, dead_v"]);
        let is_askew = |found: &[String]| found.iter().any(|it| it.contains("do not point along"));
        assert!(is_askew(&found) && found.iter().any(|it| it.starts_with("pitch was hardly")));
        let rows = vec![("theta_0", 109.0)];
        let contradictions =
            [Contradiction { log: "b".into(), is_within: false, rows, has_scatter: true }];
        evidence.contradictions = &contradictions;
        assert!(!is_askew(&evidence.sentences()));
    }

    #[test]
    fn each_trouble_is_named() {
        let parameters = [row("lambda_h", 1.2, true), row("theta_0", -0.4, false)];
        let mut evidence = evidence(&parameters);
        evidence.input_rms[0] = 0.01;
        evidence.autocorrelation[0] = 0.9;
        evidence.scatter[0] = 3.8;
        evidence.prior_std = vec![1.0, 0.015];
        evidence.has_converged = false;
        let findings = evidence.sentences().join("\n");
        for word in [
            "lambda_h = 1.2000 lies at",
            "theta_0 is -0.40",
            "theta_0 is set by its prior",
            "roll was hardly moved",
            "x 0.90",
            "3.8 times as much in x",
            "iterations_max",
        ] {
            assert!(findings.contains(word), "{word} is not in\n{findings}");
        }
    }
}
