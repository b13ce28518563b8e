//! Settings of an identification from code: defaults, and one method for each that is set.

use horizon_model::Model;
use horizon_model::setting::SettingError;

use super::settings::{IdentSettings, IdentTable};
use crate::builder::{fit_setters, wide};
use crate::levenberg::LmTable;
use crate::loss::LossTable;
use crate::residual::Curvature;

/// Builder of [`IdentSettings`], from [`IdentSettings::builder`].
///
/// | setting              | default                                      |
/// |----------------------|----------------------------------------------|
/// | [`Self::c_o`]        | 1 for each row                               |
/// | [`Self::c_s`]        | 1 for each row                               |
/// | [`Self::c_p`]        | 0: the data alone                            |
/// | [`Self::c_0`]        | 0: the first state of a piece is free        |
/// | [`Self::bounds`]     | hardly any, within the domain of each row    |
/// | [`Self::losses`]     | least squares                                |
/// | [`Self::curvature`]  | [`Curvature::Exact`]                         |
/// | [`Self::solver`]     | [`LmTable::default`]                         |
#[derive(Debug, Clone)]
pub struct IdentBuilder<const NS: usize, const NO: usize, const NP: usize> {
    table: IdentTable,
    bounds: Option<([f64; NP], [f64; NP])>,
}

impl<const NS: usize, const NO: usize, const NP: usize> IdentSettings<NS, NO, NP> {
    /// Settings that start from this parameter, everything else by default.
    ///
    /// ```
    /// use horizon_estim::IdentSettings;
    /// use horizon_model::Kinematic;
    ///
    /// let settings = IdentSettings::builder([1.0, 0.5, 1.0, 0.0]).c_o([100.0; 4]).build(&Kinematic);
    /// assert!(settings.is_ok());
    /// ```
    pub fn builder(p_prior: [f64; NP]) -> IdentBuilder<NS, NO, NP> {
        let table = IdentTable {
            c_o: vec![1.0; NO],
            c_s: vec![1.0; NS],
            c_p: vec![0.0; NP],
            c_0: vec![0.0; NS],
            p_prior: p_prior.into(),
            p_lb: Vec::new(),
            p_ub: Vec::new(),
            observation_loss: LossTable::None {},
            transition_loss: LossTable::None {},
            curvature: Curvature::Exact,
            solver: LmTable::default(),
        };
        IdentBuilder { table, bounds: None }
    }
}

impl<const NS: usize, const NO: usize, const NP: usize> IdentBuilder<NS, NO, NP> {
    fit_setters!(IdentSettings<NS, NO, NP>);

    /// Weight of each piece's first state against rest. 1 / unit of the row, 0 or 1e-6..=1e6
    #[must_use]
    pub fn c_0(mut self, c_0: [f64; NS]) -> Self {
        self.table.c_0 = c_0.into();
        self
    }

    /// Which second derivatives of the cost are used.
    #[must_use]
    pub fn curvature(mut self, curvature: Curvature) -> Self {
        self.table.curvature = curvature;
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
        let builder = IdentSettings::builder(prior)
            .c_o([100.0; 4])
            .c_s([3.0; 4])
            .c_p([0.2; 4])
            .c_0([0.3; 4])
            .bounds([-2.0; 4], [2.0; 4])
            .losses(LossTable::Huber { scale: 2.0 }, LossTable::Tukey { scale: 9.0 })
            .curvature(Curvature::Reweighted);
        let table = IdentTable {
            c_o: vec![100.0; 4],
            c_s: vec![3.0; 4],
            c_p: vec![0.2; 4],
            c_0: vec![0.3; 4],
            p_prior: prior.into(),
            p_lb: vec![-2.0; 4],
            p_ub: vec![2.0; 4],
            observation_loss: LossTable::Huber { scale: 2.0 },
            transition_loss: LossTable::Tukey { scale: 9.0 },
            curvature: Curvature::Reweighted,
            solver: LmTable::default(),
        };
        let settings = builder.clone().build(&Kinematic).unwrap();
        assert_eq!(settings, table.check::<Kinematic, 4, 4, 4, 4>().unwrap());
        let refusal = builder.c_s([0.0; 4]).build(&Kinematic).unwrap_err();
        assert_eq!(refusal.to_string(), "C_s[0] = 0: expected 1e-6..=1e6");
    }
}
