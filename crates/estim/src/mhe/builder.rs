//! Settings of the estimator from code: defaults, and one method for each that is set.

use horizon_model::Model;
use horizon_model::setting::SettingError;

use super::{MheSettings, MheTable};
use crate::arrival_cost::ArrivalTable;
use crate::builder::{fit_setters, wide};
use crate::levenberg::LmTable;
use crate::loss::LossTable;

/// Builder of [`MheSettings`], from [`MheSettings::builder`].
///
/// | setting              | default                                                   |
/// |----------------------|-----------------------------------------------------------|
/// | [`Self::window_steps`] | 30                                                      |
/// | [`Self::c_o`]        | 1 for each row                                            |
/// | [`Self::c_s`]        | 1 for each row                                            |
/// | [`Self::c_p`]        | 0.1 for each row                                          |
/// | [`Self::bounds`]     | hardly any, within the domain of each row                 |
/// | [`Self::losses`]     | least squares                                             |
/// | [`Self::arrival`]    | carried, `C_0` 1 for each row, forgotten in 60 s          |
/// | [`Self::solver`]     | [`LmTable::default`] with `damping_start` 0: an information that is carried for minutes grows, and a damping relative to it would hold back the parameter |
#[derive(Debug, Clone)]
pub struct MheBuilder<const NS: usize, const NO: usize, const NP: usize> {
    table: MheTable,
    bounds: Option<([f64; NP], [f64; NP])>,
}

impl<const NS: usize, const NO: usize, const NP: usize> MheSettings<NS, NO, NP> {
    /// Settings with this expected parameter, everything else by default.
    ///
    /// ```
    /// use horizon_estim::{Mhe, MheSettings};
    /// use horizon_model::Kinematic;
    ///
    /// let settings = MheSettings::builder([1.0, 0.5, 1.0, 0.0])
    ///     .window_steps(20)
    ///     .c_o([100.0; 4])
    ///     .bounds([0.1, 0.1, 0.1, -0.5], [3.0, 3.0, 3.0, 0.5])
    ///     .build(&Kinematic)?;
    /// let mhe = Mhe::new(Kinematic, settings, 0.02)?;
    /// assert!(!mhe.is_started());
    /// # Ok::<(), horizon_model::setting::SettingError>(())
    /// ```
    pub fn builder(p_prior: [f64; NP]) -> MheBuilder<NS, NO, NP> {
        let table = MheTable {
            window_steps: 30,
            c_o: vec![1.0; NO],
            c_s: vec![1.0; NS],
            c_p: vec![0.1; NP],
            p_prior: p_prior.into(),
            p_lb: Vec::new(),
            p_ub: Vec::new(),
            observation_loss: LossTable::None {},
            transition_loss: LossTable::None {},
            arrival: ArrivalTable::Carried { c_0: vec![1.0; NS], forget_s: 60.0 },
            shift_prior: false,
            solver: LmTable { damping_start: 0.0, ..LmTable::default() },
        };
        MheBuilder { table, bounds: None }
    }
}

impl<const NS: usize, const NO: usize, const NP: usize> MheBuilder<NS, NO, NP> {
    fit_setters!(MheSettings<NS, NO, NP>);

    /// Length of the window. steps, 2..=200
    #[must_use]
    pub fn window_steps(mut self, window_steps: usize) -> Self {
        self.table.window_steps = window_steps;
        self
    }

    /// What becomes of a step that leaves the window.
    #[must_use]
    pub fn arrival(mut self, arrival: ArrivalTable) -> Self {
        self.table.arrival = arrival;
        self
    }

    /// Whether each solution becomes the prior of the next window, see [`MheTable::shift_prior`].
    #[must_use]
    pub fn shift_prior(mut self, shift_prior: bool) -> Self {
        self.table.shift_prior = shift_prior;
        self
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;

    use super::*;

    #[test]
    fn a_builder_is_the_table_with_defaults() {
        let prior = [1.0, 0.5, 1.0, 0.0];
        let builder = MheSettings::builder(prior)
            .window_steps(20)
            .c_o([100.0; 4])
            .c_s([3.0; 4])
            .c_p([0.2; 4])
            .bounds([-2.0; 4], [2.0; 4])
            .losses(LossTable::Huber { scale: 2.0 }, LossTable::None {})
            .arrival(ArrivalTable::Fixed)
            .shift_prior(true);
        let table = MheTable {
            window_steps: 20,
            c_o: vec![100.0; 4],
            c_s: vec![3.0; 4],
            c_p: vec![0.2; 4],
            p_prior: prior.into(),
            p_lb: vec![-2.0; 4],
            p_ub: vec![2.0; 4],
            observation_loss: LossTable::Huber { scale: 2.0 },
            transition_loss: LossTable::None {},
            arrival: ArrivalTable::Fixed,
            shift_prior: true,
            solver: LmTable { damping_start: 0.0, ..LmTable::default() },
        };
        let settings = builder.clone().build(&Kinematic).unwrap();
        assert_eq!(settings, table.check::<Kinematic, 4, 4, 4, 4>().unwrap());
        let refusal = builder.window_steps(1).build(&Kinematic).unwrap_err();
        assert_eq!(refusal.to_string(), "window_steps = 1: expected 2..=200");
        let defaults = MheSettings::builder(prior).build(&Kinematic).unwrap();
        assert_eq!(defaults.window_steps, 30);
    }
}
