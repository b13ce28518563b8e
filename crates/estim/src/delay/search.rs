//! The search for the dead times of all groups at once.

use horizon_model::{Model, Vector};

use super::descent::Descent;
use super::profile::{LocalMinimum, plausible_s, risen_at_s, rises};
use super::{
    DelayError, DelayInfluence, DelayProfile, DelaySettings, DelaySpread, DelayVerdict, Flights,
    ProfilePoint, UndecidedDelay,
};
use crate::bootstrap::{NORMAL_HALF_WIDTH, interval_variance};
use crate::ident::Ident;
use crate::levenberg::LmStop;

/// Half the 95 % point of chi squared with one degree of freedom: a rise of a profile by more than this many residual
/// variances is no effect of chance (likelihood ratio test). 1
const CHI2_95_HALF: f64 = 1.92;

/// A scan of a profile ends where its cost is this many significant rises above its least. 1
pub(super) const SCAN_END_FACTOR: f64 = 100.0;

/// Relative cost tolerance of the solves of a scan: enough to see where the minimum is. 1
pub(super) const COST_TOLERANCE_SCAN: f64 = 1e-3;

/// Relative cost tolerance of the other solves: a wrong dead time adds only a small part to the cost. 1
pub(super) const COST_TOLERANCE_SOLVE: f64 = 1e-7;

/// Number of pieces below which their scatter is too uncertain for a standard deviation of its own. 1
const PIECES_MIN: f64 = 10.0;

/// Profile of one group and its minimum.
pub(super) struct GroupProfile {
    /// Candidates and their cost above the least, as in [`DelayProfile::curve`].
    pub(super) curve: Vec<ProfilePoint>,
    /// Dead time of least cost. s
    pub(super) at_s: f64,
}

/// Uncertainty of a dead time that has a minimum.
struct DeadTimeUncertainty<const NP: usize> {
    spread: DelaySpread,
    /// `None` at zero, where the dead time does not follow the pieces.
    influence: Option<DelayInfluence<NP>>,
}

/// An identification solved at the present dead times.
struct Solved<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    ident: Ident<M, NS, NU, NO, NP>,
    /// Cost of the solution. 1
    cost: f64,
}

/// The last Newton step of a group.
#[derive(Debug, Clone, Copy)]
struct NewtonHistory {
    step_s: f64,
    /// Gradient where the step began. 1/s
    gradient: f64,
    /// Longest next step. s
    step_max_s: f64,
}

/// Why a search ends without a result.
pub(super) enum SearchStop {
    Late,
    Error(DelayError),
}

impl<E: Into<DelayError>> From<E> for SearchStop {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// A search at its present dead times.
pub(super) struct Search<'a, M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
{
    /// What was sent and observed.
    pub(super) flights: &'a Flights<'a, NU, NO>,
    /// The identification, solved at the present dead times.
    pub(super) ident: &'a mut Ident<M, NS, NU, NO, NP>,
    /// Input rows that have one dead time in common.
    pub(super) groups: &'a [&'a [usize]],
    /// Present dead time of each input row. s, >= 0
    pub(super) dead_time_s: &'a mut Vector<NU>,
    pub(super) settings: &'a DelaySettings,
    /// Whether the search has to end.
    pub(super) is_late: &'a mut dyn FnMut() -> bool,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Searches the dead times and judges them; `dead_time_s` and `ident` are left at those found.
    pub(super) fn run(&mut self) -> Result<Vec<DelayProfile<NP>>, SearchStop> {
        // A start beyond the range begins at its end.
        for row in self.groups.iter().copied().flatten() {
            self.dead_time_s[*row] = self.dead_time_s[*row].min(self.settings.dead_time_max_s);
        }
        let starts_s: Vec<f64> =
            (0..self.groups.len()).map(|group| self.dead_time_of(group)).collect();
        let start_cost = self.solve()?;
        let start = self.ident.clone();
        let descent = self.descend(start_cost)?;
        let descent = self.restart_if_diverged(descent)?;
        let diverged_from = descent.has_diverged().then_some(&start);
        let mut solved = Solved { ident: self.ident.clone(), cost: descent.cost };
        let mut judged = Vec::with_capacity(descent.profiles.len());
        for (group, profile) in descent.profiles.into_iter().enumerate() {
            let start_s = starts_s[group];
            judged.push(self.judge_group(group, profile, start_s, diverged_from, &mut solved)?);
        }
        self.solve()?;
        Ok(judged)
    }

    /// Descends once more from the prior after a descent that diverged or ended at an extreme parameter, if a solve
    /// from the prior costs less.
    fn restart_if_diverged(&mut self, descent: Descent) -> Result<Descent, SearchStop> {
        let is_suspect = descent.has_diverged() || self.ident.is_extreme();
        if !(is_suspect && self.start_from_prior(descent.cost)?) {
            return Ok(descent);
        }
        let start_cost = self.solve()?;
        self.descend(start_cost)
    }

    /// Judges the minimum of a group's profile. Without a minimum the group returns to `start_s`, which is solved in
    /// `solved`, after a descent that diverged from the iterate `diverged_from`.
    fn judge_group(
        &mut self,
        group: usize,
        profile: GroupProfile,
        start_s: f64,
        diverged_from: Option<&Ident<M, NS, NU, NO, NP>>,
        solved: &mut Solved<M, NS, NU, NO, NP>,
    ) -> Result<DelayProfile<NP>, SearchStop> {
        let (uncertainty, verdict) = match diverged_from {
            Some(_) => (None, DelayVerdict::Undecided),
            None => self.decide(group, &profile, solved)?,
        };
        let GroupProfile { curve, at_s: lowest_s } = profile;
        let mut dead_time_s = lowest_s;
        if !matches!(verdict, DelayVerdict::Minimum | DelayVerdict::Zero) {
            if let Some(start) = diverged_from {
                self.ident.restart_at(start);
            }
            dead_time_s = start_s;
            self.set_dead_time(group, dead_time_s);
            solved.cost = self.solve()?;
            solved.ident.restart_at(self.ident);
        }
        let is_open = matches!(verdict, DelayVerdict::Undecided | DelayVerdict::Zero);
        let undecided = is_open.then(|| {
            let ends_s = plausible_s(&curve, lowest_s, self.significant_rise(solved.cost));
            let farthest_s =
                ends_s.map(|end_s| (end_s - dead_time_s).abs()).into_iter().fold(0.0, f64::max);
            self.undecided(group, dead_time_s, farthest_s / NORMAL_HALF_WIDTH, solved)
        });
        let undecided = undecided.transpose()?;
        let (spread, influence) = uncertainty.map(|of| (of.spread, of.influence)).unzip();
        let (rows, influence) = (self.groups[group].to_vec(), influence.flatten());
        Ok(DelayProfile { rows, curve, dead_time_s, spread, influence, undecided, verdict })
    }

    /// Effect of a dead time `at_s` that the profile knows to `std_s` only, by solves one period to either side, as far
    /// as that is not negative; `solved` as in [`Search::uncertainty`].
    fn undecided(
        &mut self,
        group: usize,
        at_s: f64,
        std_s: f64,
        Solved { ident: solved, .. }: &Solved<M, NS, NU, NO, NP>,
    ) -> Result<UndecidedDelay<NP>, SearchStop> {
        let [left_s, right_s] = [(at_s - self.flights.dt_s).max(0.0), at_s + self.flights.dt_s];
        let [left, right] = [left_s, right_s].map(|at_s| {
            self.set_dead_time(group, at_s);
            let solve = self.solve().map(|_| *self.ident.parameter());
            self.ident.restart_at(solved);
            solve
        });
        self.set_dead_time(group, at_s);
        let parameter_by_dead_time = (right? - left?) / (right_s - left_s);
        Ok(UndecidedDelay { std_s, parameter_by_dead_time })
    }

    /// Verdict on the minimum of a group's profile, and its uncertainty if there is a minimum; `solved` as in
    /// [`Search::uncertainty`].
    fn decide(
        &mut self,
        group: usize,
        profile: &GroupProfile,
        solved: &Solved<M, NS, NU, NO, NP>,
    ) -> Result<(Option<DeadTimeUncertainty<NP>>, DelayVerdict), SearchStop> {
        let GroupProfile { curve, at_s } = profile;
        let (mut uncertainty, verdict) = self.uncertainty(group, *at_s, solved)?;
        let significant = self.significant_rise(solved.cost);
        let [left, right] = rises(curve, *at_s).map(|rise| rise > significant);
        let is_decided = match verdict {
            DelayVerdict::Minimum => left && right,
            DelayVerdict::Zero => right,
            DelayVerdict::EndOfRange => left,
            DelayVerdict::Undecided => false,
        };
        if verdict == DelayVerdict::Zero {
            let upper_s = risen_at_s(curve, *at_s, significant);
            let std_s = (upper_s - at_s) / NORMAL_HALF_WIDTH;
            let spread = DelaySpread { std_s, std_white_s: std_s, lower_s: 0.0, upper_s };
            uncertainty = Some(DeadTimeUncertainty { spread, influence: None });
        }
        Ok(if is_decided { (uncertainty, verdict) } else { (None, DelayVerdict::Undecided) })
    }

    /// Newton steps of every group from `minima`, each with a curvature of its own that is updated by the secant. Where
    /// a gradient changes its sign, half the step becomes the longest: at a nonsmooth point the curvature means
    /// nothing. Returns the cost.
    pub(super) fn refine(&mut self, minima: &mut [LocalMinimum]) -> Result<f64, SearchStop> {
        let DelaySettings { dead_time_max_s, grid_s, tolerance_s, rounds } = *self.settings;
        let enough_s = 0.1 * tolerance_s;
        let first = NewtonHistory { step_s: 0.0, gradient: 0.0, step_max_s: 0.5 * grid_s };
        let mut history = vec![first; minima.len()];
        let mut round = 0;
        loop {
            for (group, minimum) in minima.iter().enumerate() {
                self.set_dead_time(group, minimum.at_s);
            }
            let cost = self.solve()?;
            for ((minimum, last), gradient) in
                minima.iter_mut().zip(&mut history).zip(self.gradients())
            {
                let Some(curvature) = &mut minimum.curvature else { continue };
                if last.gradient * gradient < 0.0 {
                    last.step_max_s = 0.5 * last.step_s.abs();
                }
                let secant = (gradient - last.gradient) / last.step_s;
                // The secant over a tiny step is lost in rounding.
                if secant > 0.0 && last.step_s.abs() > enough_s {
                    *curvature = secant;
                }
                let step_s = (-gradient / *curvature).clamp(-last.step_max_s, last.step_max_s);
                last.step_s = (minimum.at_s + step_s).clamp(0.0, dead_time_max_s) - minimum.at_s;
                last.gradient = gradient;
            }
            let has_arrived = history.iter().all(|last| last.step_s.abs() < enough_s);
            if has_arrived || round == rounds {
                return Ok(cost);
            }
            for (minimum, last) in minima.iter_mut().zip(&history) {
                minimum.at_s += last.step_s;
            }
            round += 1;
        }
    }

    /// Uncertainty of the dead time `at_s` of one group by solves one period to either side. In `solved` all groups
    /// are solved at their dead times; this is the iterate before and after.
    fn uncertainty(
        &mut self,
        group: usize,
        at_s: f64,
        solved: &Solved<M, NS, NU, NO, NP>,
    ) -> Result<(Option<DeadTimeUncertainty<NP>>, DelayVerdict), SearchStop> {
        let width_s = self.flights.dt_s;
        if at_s < width_s {
            return Ok((None, DelayVerdict::Zero));
        }
        if at_s > self.settings.dead_time_max_s - width_s {
            return Ok((None, DelayVerdict::EndOfRange));
        }
        let Solved { ident: solved, cost } = solved;
        self.set_dead_time(group, at_s - width_s);
        let left = self.solve()?;
        let left_pieces = self.ident.piece_costs();
        let left_parameter = *self.ident.parameter();
        self.ident.restart_at(solved);
        self.set_dead_time(group, at_s + width_s);
        let right = self.solve()?;
        let right_pieces = self.ident.piece_costs();
        let parameter_by_dead_time = (self.ident.parameter() - left_parameter) / (2.0 * width_s);
        self.set_dead_time(group, at_s);
        self.ident.restart_at(solved);
        let curvature = (left - 2.0 * *cost + right) / (width_s * width_s);
        if curvature.is_nan() || curvature <= 0.0 {
            return Ok((None, DelayVerdict::Undecided));
        }
        let gradients = left_pieces.iter().zip(&right_pieces).map(|(l, r)| 0.5 * (r - l) / width_s);
        let gradients: Vec<f64> = gradients.collect();
        let counted = gradients.iter().zip(self.ident.multiplicities());
        let scatter: f64 =
            counted.map(|(gradient, count)| f64::from(*count) * gradient * gradient).sum();
        let variance = 2.0 * *cost / self.ident.degrees_of_freedom();
        let std_white_s = (variance / curvature).sqrt();
        let pieces: f64 = self.ident.multiplicities().iter().map(|count| f64::from(*count)).sum();
        let mut std_s = scatter.sqrt() / curvature;
        if pieces < PIECES_MIN {
            let least_s = (interval_variance(variance) / curvature).sqrt();
            std_s = (std_s * (pieces / (pieces - 1.0).max(1.0)).sqrt()).max(least_s);
        }
        let half_s = NORMAL_HALF_WIDTH * std_s;
        let (lower_s, upper_s) = ((at_s - half_s).max(0.0), at_s + half_s);
        let spread = DelaySpread { std_s, std_white_s, lower_s, upper_s };
        let by_piece_s = gradients.iter().map(|gradient| -gradient / curvature).collect();
        let influence =
            Some(DelayInfluence { by_piece_s, parameter_by_dead_time, information: curvature });
        Ok((Some(DeadTimeUncertainty { spread, influence }), DelayVerdict::Minimum))
    }

    /// Rise of a profile above its least cost `cost` that is no effect of chance. 1
    pub(super) fn significant_rise(&self, cost: f64) -> f64 {
        CHI2_95_HALF * interval_variance(2.0 * cost / self.ident.degrees_of_freedom())
    }

    /// Present dead time of a group. s
    pub(super) fn dead_time_of(&self, group: usize) -> f64 {
        self.groups[group].first().map_or(0.0, |row| self.dead_time_s[*row])
    }

    /// Sets the dead time of the rows of a group.
    pub(super) fn set_dead_time(&mut self, group: usize, at_s: f64) {
        for row in self.groups[group] {
            self.dead_time_s[*row] = at_s;
        }
    }

    /// The least cost at the present dead times.
    pub(super) fn solve(&mut self) -> Result<f64, SearchStop> {
        self.solve_to(|of_settings| of_settings.min(COST_TOLERANCE_SOLVE))
    }

    /// The least cost at the present dead times, within a tolerance that depends on that of the settings.
    pub(super) fn solve_to(&mut self, cost_tolerance: fn(f64) -> f64) -> Result<f64, SearchStop> {
        for (piece, u) in self.flights.inputs(self.dead_time_s).iter().enumerate() {
            self.ident.set_inputs(piece, u)?;
        }
        let report = self.ident.solve_near(cost_tolerance, &mut *self.is_late)?;
        if report.stop == LmStop::Late { Err(SearchStop::Late) } else { Ok(report.cost) }
    }

    /// Gradient of the profile of each group at the present dead times, which are solved.
    pub(super) fn gradients(&self) -> Vec<f64> {
        let mut by_row = Vector::<NU>::zeros();
        let by_dead_time = self.flights.inputs_by_dead_time(self.dead_time_s);
        for (piece, (inputs, count)) in
            by_dead_time.iter().zip(self.ident.multiplicities()).enumerate()
        {
            for (cost_by_input, input_by_dead_time) in
                self.ident.input_gradient(piece).iter().zip(inputs)
            {
                by_row += cost_by_input.component_mul(input_by_dead_time) * f64::from(*count);
            }
        }
        self.groups.iter().map(|rows| rows.iter().map(|row| by_row[*row]).sum()).collect()
    }
}

#[cfg(test)]
mod tests;
