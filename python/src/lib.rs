//! The native part of the Python package `tello_ctl`.
//!
//! | file             | owns                                                        |
//! |------------------|-------------------------------------------------------------|
//! | `array.rs`       | `NumPy` arrays in and out, with checked shapes                 |
//! | `long_call.rs`   | calls that release the interpreter and heed Ctrl-C           |
//! | `expression.rs`  | the numbers with which a user's model is traced              |
//! | `model.rs`       | models: the vehicles, and traced ones                        |
//! | `sizes.rs`       | a model of run-time dimensions as one of compile-time ones   |
//! | `estimator.rs`   | moving horizon estimator                                     |
//! | `controller.rs`  | model predictive controller                                  |
//! | `identifier.rs`  | identification of any model                                  |
//! | `settings.rs`    | settings of solvers, from some of their keys                 |
//! | `simulator.rs`   | many simulated drones, step by step                          |
//! | `environment.rs` | tasks over them: observations, rewards, ends of episodes      |
//! | `logs.rs`        | logs as columns                                              |
//! | `flights.rs`     | what the program's commands do                               |
//!
//! The public interface, with its documentation, is in `tello_ctl/*.py`.

mod array;
mod controller;
mod environment;
mod estimator;
mod expression;
mod flights;
mod identifier;
mod logs;
mod long_call;
mod model;
mod settings;
mod simulator;
mod sizes;

use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    tello_ctl,
    TelloError,
    PyValueError,
    "What tello_ctl was given is wrong: an argument, a setting or a file. The message names it and the way out."
);

/// Any error of the crates below, as a Python exception with its causes, each once.
fn raised(error: impl Into<anyhow::Error>) -> PyErr {
    let error = error.into();
    let text = error.chain().skip(1).fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    });
    TelloError::new_err(text)
}

#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use super::TelloError;
    #[pymodule_export]
    use super::controller::Mpc;
    #[pymodule_export]
    use super::environment::Environments;
    #[pymodule_export]
    use super::estimator::Mhe;
    #[pymodule_export]
    use super::expression::{Expression, select};
    #[pymodule_export]
    use super::flights::{batch, defaults, fly, identify, replay, report};
    #[pymodule_export]
    use super::identifier::fit;
    #[pymodule_export]
    use super::logs::read_log;
    #[pymodule_export]
    use super::model::Model;
    #[pymodule_export]
    use super::simulator::{Controllers, Simulators};

    /// Actions in an observation of an environment.
    #[pymodule_export]
    const HISTORY: usize = super::environment::HISTORY;
    /// Numbers of an observation of an environment.
    #[pymodule_export]
    const OBSERVATIONS: usize = super::environment::OBSERVATIONS;
    /// Limit of each number of an observation of an environment.
    #[pymodule_export]
    const LARGEST: f32 = super::environment::LARGEST;
    /// Version and revision of the crates inside.
    #[pymodule_export]
    const VERSION: &str = tello_eval::VERSION;
}
