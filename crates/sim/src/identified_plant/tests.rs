use std::collections::BTreeMap;

use tello_eval::parameter_file::{FORMAT, ParameterEntry};

use super::*;
use crate::plant::NOMINAL;

/// A value that differs by row; dead zones stay below the half stick that the simulator accepts.
fn value(k: usize) -> f64 {
    0.1 + 0.03125 * k as f64
}

fn file(model: ModelKind) -> ParameterFile {
    let rows = model.parameters().iter().enumerate();
    let parameters: BTreeMap<_, _> = rows
        .map(|(k, row)| {
            let value = value(k);
            let unit = row.unit.to_owned();
            (
                row.name.to_owned(),
                ParameterEntry { value, std: None, lower: None, upper: None, unit },
            )
        })
        .collect();
    ParameterFile {
        format: FORMAT,
        model,
        parameters,
        dead_time_s: vec![0.3, 0.5, 0.1, 0.2],
        data: Vec::new(),
        settings: serde_json::Value::Null,
        covariance: None,
        flown: None,
        revision: "0123abc".into(),
    }
}

#[test]
fn a_file_of_another_model_is_refused_with_what_can_be_used() {
    let mut plant = NOMINAL;
    for model in ModelKind::ALL.into_iter().filter(|model| *model != ModelKind::Lagged) {
        let error = plant.take(&file(model)).unwrap_err().to_string();
        assert!(error.ends_with(&format!("fly and replay can use {}", model.name())), "{error}");
        assert_eq!(plant, NOMINAL);
    }
}

#[test]
fn a_lagged_file_replaces_the_simulated_vehicle_but_not_its_disturbance() {
    let mut plant = NOMINAL;
    plant.take(&file(ModelKind::Lagged)).unwrap();
    let axis = |gain: usize, dead_time_s, tau: usize, dead_zone: usize| AxisTable {
        gain: value(gain),
        dead_time_s,
        tau_s: value(tau),
        dead_zone: value(dead_zone),
    };
    let expected = PlantTable {
        // Roll and pitch have 0.3 and 0.5 s.
        horizontal: axis(0, 0.4, 4, 7),
        vertical: axis(1, 0.2, 5, 8),
        yaw: axis(2, 0.1, 6, 9),
        theta_0: value(3),
        accel_max_mps2: value(10),
        ..NOMINAL
    };
    assert_eq!(plant, expected);
}
