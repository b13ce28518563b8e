//! The search for the dead times of all groups at once.

use horizon_model::Model;
use horizon_model::check::maximum;
use nalgebra::SVector;

use super::descent::Descent;
use super::{
    DelayError, DelayInfluence, DelayProfile, DelaySettings, DelaySpread, DelayVerdict, Flights,
    ProfilePoint,
};
use crate::bootstrap::NORMAL_HALF_WIDTH;
use crate::ident::Ident;
use crate::levenberg::Stop;

/// Half the 95 % point of chi squared with one degree of freedom: what chance adds to half the sum of
/// squares, in units of the residual variance, which counts as 1 at least.
const CHANCE: f64 = 1.92;

/// A scan ends where the cost is this many times [`CHANCE`] above its least.
pub(super) const FAR: f64 = 100.0;

/// Cost tolerance while the range is scanned: enough to see where the minimum is.
pub(super) const ROUGH: f64 = 1e-3;

/// Cost tolerance elsewhere: what a wrong dead time adds is a small part of the cost.
pub(super) const EXACT: f64 = 1e-7;

/// Fewer pieces cannot tell how they vary.
const PIECES_MIN: f64 = 10.0;

/// Profile of one group and where it is least.
pub(super) struct Found {
    /// Candidates and their cost above the least, as in [`DelayProfile::curve`].
    pub(super) curve: Vec<ProfilePoint>,
    /// s
    pub(super) at_s: f64,
}

/// Uncertainty of a dead time that has a minimum.
type Known<const NP: usize> = (DelaySpread, DelayInfluence<NP>);

/// The last step of a group.
#[derive(Debug, Clone, Copy)]
struct Before {
    step_s: f64,
    /// Gradient where it began.
    gradient: f64,
    /// How long the next one may be.
    longest_s: f64,
}

/// Why a search goes no further.
pub(super) enum Halt {
    Late,
    Error(DelayError),
}

impl<E: Into<DelayError>> From<E> for Halt {
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
    pub(super) dead_time_s: &'a mut SVector<f64, NU>,
    pub(super) settings: &'a DelaySettings,
    /// Whether the search has to end.
    pub(super) is_late: &'a mut dyn FnMut() -> bool,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    pub(super) fn run(&mut self) -> Result<Vec<DelayProfile<NP>>, Halt> {
        // A start beyond the range begins at its end.
        for row in self.groups.iter().copied().flatten() {
            self.dead_time_s[*row] = self.dead_time_s[*row].min(self.settings.dead_time_max_s);
        }
        let start_s = *self.dead_time_s;
        self.solve()?;
        let start = self.ident.clone();
        let mut descent = self.descend()?;
        if (descent.is_vain() || self.ident.is_extreme()) && self.start_from_prior(descent.cost)? {
            descent = self.descend()?;
        }
        let is_vain = descent.is_vain();
        let Descent { found, mut cost, .. } = descent;
        let mut middle = self.ident.clone();
        let mut profiles = Vec::with_capacity(found.len());
        for (group, Found { curve, at_s }) in found.into_iter().enumerate() {
            let rows = self.groups[group].to_vec();
            let (mut spread, mut verdict) = self.spread(group, at_s, cost, &middle)?;
            let mut dead_time_s = at_s;
            let chance = self.chance(cost);
            let [left, right] = rises(&curve, at_s).map(|rise| rise > chance);
            let is_decided = match verdict {
                DelayVerdict::Minimum => left && right,
                DelayVerdict::EndOfRange => left || right,
                DelayVerdict::Undecided => false,
            };
            if !is_decided || is_vain {
                (spread, verdict) = (None, DelayVerdict::Undecided);
            }
            if verdict == DelayVerdict::Undecided {
                if is_vain {
                    self.ident.restart_at(&start);
                }
                dead_time_s = rows.first().map_or(at_s, |row| start_s[*row]);
                self.put(group, dead_time_s);
                cost = self.solve()?;
                middle.restart_at(self.ident);
            }
            let (spread, influence) = spread.unzip();
            profiles.push(DelayProfile { rows, curve, dead_time_s, spread, influence, verdict });
        }
        self.solve()?;
        Ok(profiles)
    }

    /// Gradients of the profile of each group by ascending dead time, from its start, where `start` is solved, down and
    /// up to the ends of the range or until it costs more than `far` above its least. All groups move at once.
    pub(super) fn scan(
        &mut self,
        start: &Ident<M, NS, NU, NO, NP>,
        far: f64,
    ) -> Result<Vec<Vec<(f64, f64)>>, Halt> {
        let DelaySettings { dead_time_max_s, grid_s, .. } = *self.settings;
        let of_group = |group: &&[usize]| group.first().map_or(0.0, |row| self.dead_time_s[*row]);
        let starts_s: Vec<f64> = self.groups.iter().map(of_group).collect();
        let at_start = starts_s.iter().copied().zip(self.gradients());
        let mut points: Vec<Vec<(f64, f64)>> = at_start.map(|point| vec![point]).collect();
        for step_s in [-grid_s, grid_s] {
            self.ident.restart_at(start);
            // Cost above that of the start, and the least of them; none where it goes no further.
            let mut costs = vec![Some((0.0, 0.0_f64)); points.len()];
            let next_s = |last_s: f64| (last_s + step_s).clamp(0.0, dead_time_max_s);
            loop {
                for (group, points) in points.iter().enumerate() {
                    let last_s = points.last().map_or(0.0, |(last_s, _)| *last_s);
                    let has_place = (next_s(last_s) - last_s).abs() > 0.1 * grid_s;
                    costs[group] = costs[group].filter(|_| has_place);
                    let is_moving = costs[group].is_some();
                    self.put(group, if is_moving { next_s(last_s) } else { starts_s[group] });
                }
                if costs.iter().all(Option::is_none) {
                    break;
                }
                self.solve_to(|of_settings| of_settings.max(ROUGH))?;
                let groups = points.iter_mut().zip(&mut costs);
                for ((points, cost), gradient) in groups.zip(self.gradients()) {
                    let (Some((above, least)), Some((last_s, last))) =
                        (*cost, points.last().copied())
                    else {
                        continue;
                    };
                    let at_s = next_s(last_s);
                    let above = above + 0.5 * (last + gradient) * (at_s - last_s);
                    *cost = (above < least + far).then_some((above, least.min(above)));
                    points.push((at_s, gradient));
                }
            }
            if step_s < 0.0 {
                for points in &mut points {
                    points.reverse();
                }
            }
        }
        Ok(points)
    }

    /// Newton's steps of every group with a curvature of its own, updated along the secant. A gradient that
    /// changes its sign halves the longest step: at a kink there is no curvature to rely on. Returns the cost.
    pub(super) fn refine(&mut self, minima: &mut [LocalMinimum]) -> Result<f64, Halt> {
        let DelaySettings { dead_time_max_s, grid_s, tolerance_s, rounds } = *self.settings;
        let enough_s = 0.1 * tolerance_s;
        let mut before =
            vec![Before { step_s: 0.0, gradient: 0.0, longest_s: 0.5 * grid_s }; minima.len()];
        let mut round = 0;
        loop {
            for (group, minimum) in minima.iter().enumerate() {
                self.put(group, minimum.at_s);
            }
            let cost = self.solve()?;
            for ((minimum, before), gradient) in
                minima.iter_mut().zip(&mut before).zip(self.gradients())
            {
                let Some(curvature) = &mut minimum.curvature else { continue };
                if before.gradient * gradient < 0.0 {
                    before.longest_s = 0.5 * before.step_s.abs();
                }
                let secant = (gradient - before.gradient) / before.step_s;
                // Over a tiny step it is all rounding.
                if secant > 0.0 && before.step_s.abs() > enough_s {
                    *curvature = secant;
                }
                let step_s = (-gradient / *curvature).clamp(-before.longest_s, before.longest_s);
                before.step_s = (minimum.at_s + step_s).clamp(0.0, dead_time_max_s) - minimum.at_s;
                before.gradient = gradient;
            }
            let has_arrived = before.iter().all(|before| before.step_s.abs() < enough_s);
            if has_arrived || round == rounds {
                return Ok(cost);
            }
            for (minimum, before) in minima.iter_mut().zip(&before) {
                minimum.at_s += before.step_s;
            }
            round += 1;
        }
    }

    /// Uncertainty of the dead time of one group, all groups being solved at theirs in `middle` with cost `cost`,
    /// which is the iterate before and after.
    fn spread(
        &mut self,
        group: usize,
        at_s: f64,
        cost: f64,
        middle: &Ident<M, NS, NU, NO, NP>,
    ) -> Result<(Option<Known<NP>>, DelayVerdict), Halt> {
        let width_s = self.flights.dt_s;
        if at_s < width_s || at_s > self.settings.dead_time_max_s - width_s {
            return Ok((None, DelayVerdict::EndOfRange));
        }
        self.put(group, at_s - width_s);
        let left = self.solve()?;
        let left_pieces = self.ident.piece_costs();
        let left_parameter = *self.ident.parameter();
        self.ident.restart_at(middle);
        self.put(group, at_s + width_s);
        let right = self.solve()?;
        let right_pieces = self.ident.piece_costs();
        let parameter_by_dead_time = (self.ident.parameter() - left_parameter) / (2.0 * width_s);
        self.put(group, at_s);
        self.ident.restart_at(middle);
        let curvature = (left - 2.0 * cost + right) / (width_s * width_s);
        if curvature.is_nan() || curvature <= 0.0 {
            return Ok((None, DelayVerdict::Undecided));
        }
        let gradients = left_pieces.iter().zip(&right_pieces).map(|(l, r)| 0.5 * (r - l) / width_s);
        let gradients: Vec<f64> = gradients.collect();
        let counted = gradients.iter().zip(self.ident.multiplicities());
        let scatter: f64 =
            counted.map(|(gradient, count)| f64::from(*count) * gradient * gradient).sum();
        let variance = 2.0 * cost / self.ident.degrees_of_freedom();
        let std_white_s = (variance / curvature).sqrt();
        let pieces: f64 = self.ident.multiplicities().iter().map(|count| f64::from(*count)).sum();
        let mut std_s = scatter.sqrt() / curvature;
        if pieces < PIECES_MIN {
            // A residual variance below 1 is of weights that are too small: it must not narrow the interval.
            let least_s = (variance.max(1.0) / curvature).sqrt();
            std_s = (std_s * (pieces / (pieces - 1.0).max(1.0)).sqrt()).max(least_s);
        }
        let half_s = NORMAL_HALF_WIDTH * std_s;
        let (lower_s, upper_s) = ((at_s - half_s).max(0.0), at_s + half_s);
        let spread = DelaySpread { std_s, std_white_s, lower_s, upper_s };
        let by_piece_s = gradients.iter().map(|gradient| -gradient / curvature).collect();
        let influence =
            DelayInfluence { by_piece_s, parameter_by_dead_time, information: curvature };
        Ok((Some((spread, influence)), DelayVerdict::Minimum))
    }

    /// What chance adds to the profile of a dead time where the least cost is `cost`.
    pub(super) fn chance(&self, cost: f64) -> f64 {
        CHANCE * (2.0 * cost / self.ident.degrees_of_freedom()).max(1.0)
    }

    /// Gives the rows of a group their dead time.
    pub(super) fn put(&mut self, group: usize, at_s: f64) {
        for row in self.groups[group] {
            self.dead_time_s[*row] = at_s;
        }
    }

    /// The least cost at the present dead times.
    pub(super) fn solve(&mut self) -> Result<f64, Halt> {
        self.solve_to(|of_settings| of_settings.min(EXACT))
    }

    /// Solves as [`Search::solve`] does, with a cost tolerance that depends on that of the settings.
    pub(super) fn solve_to(&mut self, cost_tolerance: fn(f64) -> f64) -> Result<f64, Halt> {
        for (piece, u) in self.flights.inputs(self.dead_time_s).iter().enumerate() {
            self.ident.set_inputs(piece, u)?;
        }
        let report = self.ident.solve_near(cost_tolerance, &mut *self.is_late)?;
        if report.stop == Stop::Late { Err(Halt::Late) } else { Ok(report.cost) }
    }

    /// Gradient of the profile of each group at the present dead times, which are solved.
    pub(super) fn gradients(&self) -> Vec<f64> {
        let mut by_row = SVector::<f64, NU>::zeros();
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

/// How far `curve` rises to the left and to the right of `at_s`. Its costs are finite: a solve whose cost is not,
/// fails.
fn rises(curve: &[ProfilePoint], at_s: f64) -> [f64; 2] {
    let highest = |is_there: fn(f64, f64) -> bool| {
        let there = curve.iter().filter(|point| is_there(point.dead_time_s, at_s));
        there.map(|point| point.cost).fold(0.0, maximum)
    };
    [highest(|s, at_s| s < at_s), highest(|s, at_s| s > at_s)]
}

/// Lowest point of a curve of gradients, from candidate to candidate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LocalMinimum {
    pub(super) at_s: f64,
    /// Second derivative there; `None` at an end of the range, which is not left any more.
    curvature: Option<f64>,
}

/// Profile from the `gradients` at ascending candidates: the costs above the least, at the candidates and at the
/// minimum between them, and where it is.
pub(super) fn integrate(
    candidates_s: &[f64],
    gradients: &[f64],
) -> (Vec<ProfilePoint>, LocalMinimum) {
    let mut cost = 0.0;
    let first_s = candidates_s.first().copied().unwrap_or(0.0);
    let mut curve = vec![ProfilePoint { dead_time_s: first_s, cost }];
    for (at_s, gradient) in candidates_s.windows(2).zip(gradients.windows(2)) {
        let [left_s, right_s] = *at_s else { continue };
        let [left, right] = *gradient else { continue };
        cost += 0.5 * (left + right) * (right_s - left_s);
        curve.push(ProfilePoint { dead_time_s: right_s, cost });
    }
    let mut best = 0;
    for (i, point) in curve.iter().enumerate() {
        if point.cost < curve[best].cost {
            best = i;
        }
    }
    let ProfilePoint { dead_time_s: best_s, cost: least } = curve[best];
    // The gradient vanishes between the best candidate and the neighbour it points down to.
    let neighbour = if gradients[best] < 0.0 { Some(best + 1) } else { best.checked_sub(1) };
    let next = neighbour.and_then(|at| candidates_s.get(at).zip(gradients.get(at)));
    let minimum = next.and_then(|(other_s, other)| {
        let curvature = (other - gradients[best]) / (other_s - best_s);
        let at_s = best_s - gradients[best] / curvature;
        (curvature > 0.0).then_some(LocalMinimum { at_s, curvature: Some(curvature) })
    });
    let least = match minimum {
        Some(LocalMinimum { at_s, .. }) if at_s.total_cmp(&best_s).is_ne() => {
            let least = least + 0.5 * gradients[best] * (at_s - best_s);
            let point = ProfilePoint { dead_time_s: at_s, cost: least };
            curve.insert(if at_s > best_s { best + 1 } else { best }, point);
            least
        }
        _ => least,
    };
    for point in &mut curve {
        point.cost -= least;
    }
    (curve, minimum.unwrap_or(LocalMinimum { at_s: best_s, curvature: None }))
}

#[cfg(test)]
mod tests;
