//! The vehicle models that settings can name.
//!
//! Owns the only list of them. Code that works with the named model, whichever it is, is a [`WithModel`]: the sizes of
//! a model are types, so each of them is compiled for each use.

use horizon_model::rows::{motion, pose, stick};
use horizon_model::{Kinematic, KinematicPublished, Lagged, Model, Row};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Name of a vehicle model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelKind {
    /// Thesis equation 4.1: sticks are scaled velocities.
    Kinematic,
    /// What the published program computes instead: the baseline.
    KinematicPublished,
    /// Dead zone, velocity lag and acceleration limit: what real flights show.
    Lagged,
}

/// A model of the vehicle: its inputs are the sticks, its observations are poses.
pub trait Vehicle<const NS: usize, const NP: usize>:
    Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static
{
}

impl<M, const NS: usize, const NP: usize> Vehicle<NS, NP> for M where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static
{
}

/// A computation for any vehicle model.
pub trait WithModel {
    /// Result of the computation.
    type Output;

    /// The result for `model`, of whose states the first `NR` are controllable ([`Model::CONTROLLABLE`]).
    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, model: M) -> Self::Output
    where
        M: Vehicle<NS, NP>;
}

impl ModelKind {
    /// Every vehicle model.
    pub const ALL: [Self; 3] = [Self::Kinematic, Self::KinematicPublished, Self::Lagged];

    /// Runs `task` with the model of this name.
    pub fn with<T: WithModel>(self, task: T) -> T::Output {
        match self {
            Self::Kinematic => task.run::<_, _, _, { pose::COUNT }>(Kinematic),
            Self::KinematicPublished => task.run::<_, _, _, { pose::COUNT }>(KinematicPublished),
            Self::Lagged => task.run::<_, _, _, { motion::CONTROLLABLE }>(Lagged::default()),
        }
    }

    /// Name in settings and logs.
    pub fn name(self) -> &'static str {
        self.with(Described).0
    }

    /// Rows of the parameter, with their units.
    pub fn parameters(self) -> &'static [Row] {
        self.with(Described).1
    }
}

struct Described;

impl WithModel for Described {
    type Output = (&'static str, &'static [Row]);

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(self, _model: M) -> Self::Output
    where
        M: Vehicle<NS, NP>,
    {
        (M::NAME, &M::PARAMETER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Controllable;

    impl WithModel for Controllable {
        type Output = (usize, usize);

        fn run<M, const NS: usize, const NP: usize, const NR: usize>(
            self,
            _model: M,
        ) -> Self::Output
        where
            M: Vehicle<NS, NP>,
        {
            (NR, M::CONTROLLABLE)
        }
    }

    #[test]
    fn a_file_names_each_model_as_it_names_itself_and_its_sizes_are_its_own() {
        for kind in ModelKind::ALL {
            assert_eq!(serde_json::to_string(&kind).unwrap(), format!("\"{}\"", kind.name()));
            let (ours, own) = kind.with(Controllable);
            assert_eq!(ours, own, "{kind:?}");
        }
    }
}
