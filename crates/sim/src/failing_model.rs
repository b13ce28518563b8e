//! A vehicle model that fails on demand, for tests of the reaction: its steps are NaN, for the estimator or for the
//! controller. With the feature `failing_model` only.
//!
//! It is here and not beside the tests because they are compiled without optimization.

use std::cell::Cell;

use horizon_model::rows::{Pose, Sticks, lag, motion, pose, stick};
use horizon_model::setting::SettingError;
use horizon_model::{Lagged, Model, Row, VisitSubsystems};
use nalgebra::{SMatrix, SVector};
use tello_flight::cycle::{self, FlightTable, Tick};

type State = SVector<f64, { motion::COUNT }>;
type Parameter = SVector<f64, { lag::COUNT }>;
type ByState = SMatrix<f64, { motion::COUNT }, { motion::COUNT }>;
type ByInput = SMatrix<f64, { motion::COUNT }, { stick::COUNT }>;
type ByParameter = SMatrix<f64, { motion::COUNT }, { lag::COUNT }>;

/// Which model gives NaN now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailingPart {
    /// None: the flight is that of [`Lagged`].
    Nothing,
    /// The model of the controller: it plans on [`Model::core`].
    Controller,
    /// The estimator's model.
    Estimator,
}

thread_local! {
    /// Part of the model that fails in this thread.
    pub static FAILING_PART: Cell<FailingPart> = const { Cell::new(FailingPart::Nothing) };
}

/// [`Lagged`], whose steps are NaN while it fails.
#[derive(Debug, Clone, Copy)]
struct FailingModel {
    model: Lagged,
    fails_with: FailingPart,
}

impl Model<{ motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }> for FailingModel {
    const STATE: [Row; motion::COUNT] = Lagged::STATE;
    const INPUT: [Row; stick::COUNT] = Lagged::INPUT;
    const OBSERVATION: [Row; pose::COUNT] = Lagged::OBSERVATION;
    const PARAMETER: [Row; lag::COUNT] = Lagged::PARAMETER;
    const CONTROLLABLE: usize = Lagged::CONTROLLABLE;

    fn step(&self, s: &State, u: &Sticks, p: &Parameter, dt_s: f64) -> State {
        let fails = FAILING_PART.get() == self.fails_with;
        if fails { State::repeat(f64::NAN) } else { self.model.step(s, u, p, dt_s) }
    }

    // Derivatives are those of the whole one: differences take ten times as long.
    fn subsystems(visit: &mut impl VisitSubsystems) {
        Lagged::subsystems(visit);
    }

    fn step_by_state(&self, s: &State, u: &Sticks, p: &Parameter, dt_s: f64) -> ByState {
        self.model.step_by_state(s, u, p, dt_s)
    }

    fn step_by_input(&self, s: &State, u: &Sticks, p: &Parameter, dt_s: f64) -> ByInput {
        self.model.step_by_input(s, u, p, dt_s)
    }

    fn step_by_parameter(&self, s: &State, u: &Sticks, p: &Parameter, dt_s: f64) -> ByParameter {
        self.model.step_by_parameter(s, u, p, dt_s)
    }

    fn observe(&self, s: &State) -> Pose {
        self.model.observe(s)
    }

    fn at_rest(&self, o: &Pose) -> State {
        self.model.at_rest(o)
    }

    fn moving(&self, o: &Pose, rate: &Pose, s: &State) -> State {
        self.model.moving(o, rate, s)
    }

    fn coasting(&self, s: &State, p: &Parameter) -> Pose {
        self.model.coasting(s, p)
    }

    fn core(&self) -> Self {
        Self { model: self.model.core(), fails_with: FailingPart::Controller }
    }

    fn effect(&self, u: &Sticks, p: &Parameter) -> Sticks {
        self.model.effect(u, p)
    }

    fn input_for(&self, effect: &Sticks, p: &Parameter) -> Sticks {
        self.model.input_for(effect, p)
    }
}

/// The cycle of `flight` with this model in place of [`Lagged`].
///
/// # Errors
///
/// As [`cycle::build`].
pub fn cycle(flight: &FlightTable) -> Result<Box<dyn Tick>, SettingError> {
    let model = FailingModel { model: Lagged::default(), fails_with: FailingPart::Estimator };
    cycle::build_with::<_, _, _, { motion::CONTROLLABLE }>(model, flight)
}
