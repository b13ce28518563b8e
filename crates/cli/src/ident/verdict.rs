//! What a person should know before using an estimate, in words.

use horizon_model::Row;
use horizon_model::rows::pose;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tello_eval::figure;

use super::fit::Trace;
use super::report::{DelayRow, ParameterRow};

/// Root mean square below which a stick was hardly moved. 1
const EXCITATION_MIN: f64 = 0.05;

/// Autocorrelation of the observation residuals at [`WHITE_LAG_S`] above which they count as not white:
/// what is left is then dynamics that the model does not know. Residuals of transitions are estimates
/// themselves and never white.
const WHITE_MAX: f64 = 0.3;

/// Lag at which the residuals are judged, about half a time constant of the vehicle. s
const WHITE_LAG_S: f64 = 0.2;

/// Heading offset beyond which the object in the motion capture is likely defined askew. rad
const THETA_0_MAX: f64 = 0.2;

/// Part of the prior's standard deviation above which the data contain next to no information.
const PRIOR_RATIO: f64 = 0.5;

/// Standard deviation beyond which a dead time says nothing. s
const DEAD_TIME_STD_MAX_S: f64 = 0.1;

/// What the words are about.
pub(super) struct Evidence<'a> {
    pub(super) parameters: &'a [ParameterRow],
    /// Standard deviation that the prior gives each parameter; infinite without a prior.
    pub(super) prior_std: Vec<f64>,
    pub(super) inputs: &'a [Row],
    /// Root mean square of each applied input over the steps used.
    pub(super) input_rms: Vec<f64>,
    pub(super) observations: &'a [Row],
    /// Autocorrelation of the residuals of each observation row at [`WHITE_LAG_S`].
    pub(super) autocorrelation: Vec<f64>,
    pub(super) has_converged: bool,
    pub(super) delay: &'a [DelayRow],
}

impl Evidence<'_> {
    /// One sentence for each thing that is off.
    pub(super) fn sentences(&self) -> Vec<String> {
        let mut findings = Vec::new();
        let is_vague = |row: &&DelayRow| row.std_s.is_none_or(|std| std > DEAD_TIME_STD_MAX_S);
        for row in self.delay.iter().filter(is_vague) {
            findings.push(format!(
                "the dead time of {} is not determined by these logs ({:.3} s{})",
                row.sticks,
                row.dead_time_s,
                row.std_s
                    .map_or(", at the end of its range".into(), |std| format!(" +- {std:.3} s")),
            ));
        }
        if !self.has_converged {
            findings
                .push("the solver did not converge: raise map.solver.iterations_max".to_owned());
        }
        self.about_parameters(&mut findings);
        for (row, rms) in self.inputs.iter().zip(&self.input_rms) {
            if *rms < EXCITATION_MIN {
                findings.push(format!(
                    "{} was hardly moved (rms {rms:.3}): fly it more, its parameters are little \
                     more than the prior",
                    row.name
                ));
            }
        }
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
        findings
    }

    fn about_parameters(&self, findings: &mut Vec<String>) {
        for (row, prior_std) in self.parameters.iter().zip(&self.prior_std) {
            if row.std_laplace.is_nan() {
                findings.push(format!(
                    "{} has no standard deviation: the data leave some state or parameter undetermined",
                    row.name
                ));
            }
            if row.is_at_bound {
                findings.push(format!(
                    "{} = {} lies at its bound: widen map.p_lb or map.p_ub, or ask why",
                    row.name, row.value
                ));
            } else if row.std_laplace > PRIOR_RATIO * prior_std {
                findings.push(format!(
                    "{} is set by its prior: the data leave a standard deviation of {:.3}, the prior \
                     alone {prior_std:.3}",
                    row.name, row.std_laplace
                ));
            }
            if row.name == "theta_0" && row.value.abs() > THETA_0_MAX {
                findings.push(format!(
                    "theta_0 is {:.2} rad: the object's axes do not point along the drone; align them \
                     in the motion capture, or keep the value and fly gently",
                    row.value
                ));
            }
        }
    }
}

/// Autocorrelation of the observation residuals of each row at [`WHITE_LAG_S`].
pub(super) fn autocorrelation(traces: &[Trace], dt_s: f64) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few steps")]
    let lag = (WHITE_LAG_S / dt_s).round() as usize;
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

    fn evidence(parameters: &[ParameterRow]) -> Evidence<'_> {
        Evidence {
            parameters,
            prior_std: vec![1.0; parameters.len()],
            inputs: &INPUT,
            input_rms: vec![0.3],
            observations: &STATE,
            autocorrelation: vec![0.1],
            has_converged: true,
            delay: &[],
        }
    }

    #[test]
    fn nothing_is_reported_when_nothing_is_off() {
        let parameters = [row("lambda_h", 1.3, false), row("theta_0", 0.03, false)];
        assert!(evidence(&parameters).sentences().is_empty());
    }

    #[test]
    fn each_trouble_is_named() {
        let parameters = [row("lambda_h", 1.2, true), row("theta_0", -0.4, false)];
        let mut evidence = evidence(&parameters);
        evidence.input_rms[0] = 0.01;
        evidence.autocorrelation[0] = 0.9;
        evidence.prior_std = vec![1.0, 0.015];
        evidence.has_converged = false;
        let findings = evidence.sentences().join("\n");
        for word in [
            "lambda_h = 1.2 lies at",
            "theta_0 is -0.40",
            "theta_0 is set by its prior",
            "roll was hardly moved",
            "x 0.90",
            "iterations_max",
        ] {
            assert!(findings.contains(word), "{word} is not in\n{findings}");
        }
    }
}
