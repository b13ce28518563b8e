//! The assembled derivatives of a plan: trajectory Jacobian and Hessians, entry by entry, against differences.

use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Motion, motion};
use horizon_model::{HessianKind, HessianRequest, Matrix, Vector, differences};

use super::expansion::{At, Inputs, STAGES, plans};
use super::*;

const COUNT: usize = 4 * STAGES;
type Hessian = Matrix<COUNT, COUNT>;

/// Derivatives of `s_1 .. s_N` by all inputs.
type ByInputs = Matrix<{ motion::COUNT * STAGES }, COUNT>;

/// Derivatives of the states by differences of the roll-out.
fn states_by_inputs(at: &mut At) -> ByInputs {
    let u = at.u;
    let cell = std::cell::RefCell::new(at);
    let states = |u: &Inputs| {
        let mut at = cell.borrow_mut();
        at.cost(u, RollOut::States);
        Vector::from_iterator(at.mpc.trial.s.iter().flat_map(|s| s.iter()).copied())
    };
    differences::jacobian(states, &u)
}

/// The Hessian of the quadratic model by its values: `2 h_ij = q(e_i + e_j) - q(e_i) - q(e_j)` with `q(d) = d' H d`.
fn assembled(at: &mut At, kind: Option<HessianKind>) -> Hessian {
    const LENGTH: f64 = 0.1;
    let unit = |i: usize| Inputs::from_fn(|row, _| if row == i { LENGTH } else { 0.0 });
    let mut curved = |du: &Inputs| {
        let gain = at.gain(du, kind);
        2.0 * (gain.descent - gain.decrease) / (LENGTH * LENGTH)
    };
    let alone: Vec<f64> = (0..COUNT).map(|i| curved(&unit(i))).collect();
    Hessian::from_fn(|i, j| 0.5 * (curved(&(unit(i) + unit(j))) - alone[i] - alone[j]))
}

#[test]
fn the_trajectory_jacobian_meets_its_numeric_twin() {
    for mut at in plans() {
        let numeric = states_by_inputs(&mut at);
        for column in 0..COUNT {
            let mut ds = Vector::zeros();
            for (k, stage) in at.mpc.expansion.stages.iter().enumerate() {
                let du = Sticks::from_fn(|i, _| if 4 * k + i == column { 1.0 } else { 0.0 });
                ds = stage.next(&ds, &du);
                let numeric = numeric.column(column).into_owned();
                let numeric = numeric.fixed_rows::<{ motion::COUNT }>(motion::COUNT * k);
                let gap = amax(&(ds - numeric.fixed_rows::<{ motion::CONTROLLABLE }>(0)));
                assert!(gap < 1e-8, "gap {gap:e} of stage {k} by input {column}");
                let others = motion::COUNT - motion::CONTROLLABLE;
                let moved = amax(&numeric.rows(motion::CONTROLLABLE, others).into_owned());
                assert!(moved <= 0.0, "{moved:e}: a row that no input moves");
            }
        }
    }
}

#[test]
fn the_assembled_hessian_meets_its_numeric_twin() {
    for mut at in plans() {
        let (u, theta) = (at.u, at.s_0[motion::THETA]);
        let hessian = assembled(&mut at, Some(HessianKind::Exact));
        let cell = std::cell::RefCell::new(&mut at);
        let gradient = |u: &Inputs| cell.borrow_mut().gradient(u);
        let gap = amax(&(hessian - differences::jacobian(gradient, &u)));
        let scale = amax(&hessian);
        assert!(gap < 1e-6 * scale, "gap {gap:e} beside {scale} at theta = {theta}");
    }
}

#[test]
fn the_convexified_hessian_adds_that_of_each_stage_along_the_trajectory() {
    let mut added = 0.0_f64;
    for mut at in plans() {
        let theta = at.s_0[motion::THETA];
        let numeric = states_by_inputs(&mut at);
        let mut expected = assembled(&mut at, None);
        let convex = assembled(&mut at, Some(HessianKind::Convexified));
        let least = (convex - expected).symmetric_eigenvalues().min();
        let scale = amax(&convex);
        assert!(least > -1e-9 * scale, "{least} at theta = {theta}");
        added = maximum(added, amax(&(convex - expected)) / scale);

        let p = &indefinite::P.into();
        for k in 0..STAGES {
            let mut w = Motion::zeros();
            w.fixed_rows_mut::<{ motion::CONTROLLABLE }>(0).copy_from(&at.mpc.expansion.costate[k]);
            let s = k.checked_sub(1).map_or(at.s_0, |before| at.mpc.plan.s[before]);
            let (s, u, dt_s, w) = (&s, &at.mpc.plan.u[k], at.mpc.stage_s[k], &w);
            let model = at.mpc.model;
            let by_input = &model.step_by_input(s, u, p, dt_s);
            let kind = HessianKind::Convexified;
            let request = HessianRequest { s, u, p, dt_s, by_input, w, kind };
            let second = model.hessian_by_input(&request).unwrap();
            let mut by_s = Matrix::<{ motion::COUNT }, COUNT>::zeros();
            if let Some(before) = k.checked_sub(1) {
                let rows = numeric.fixed_rows::<{ motion::COUNT }>(motion::COUNT * before);
                by_s.copy_from(&rows);
            }
            let by_u = Matrix::<4, COUNT>::from_fn(|i, j| f64::from(4 * k + i == j));
            let mixed = by_u.transpose() * second.by_input_state * by_s;
            expected += by_s.transpose() * second.by_state * by_s
                + by_u.transpose() * second.by_input * by_u
                + mixed
                + mixed.transpose();
        }
        let gap = amax(&(convex - expected));
        assert!(gap < 1e-7 * scale, "gap {gap:e} beside {scale} at theta = {theta}");
    }
    assert!(added > 0.01, "{added}: nothing to convexify");
}

#[test]
fn the_riccati_recursion_takes_the_newton_step_of_the_assembled_hessian() {
    let mut exact = 0;
    for mut at in plans() {
        for kind in [HessianKind::Exact, HessianKind::Convexified] {
            let hessian = assembled(&mut at, Some(kind));
            let u = at.u;
            let gradient = at.gradient(&u);
            let Some(factors) = hessian.cholesky() else {
                assert_eq!(kind, HessianKind::Exact);
                continue;
            };
            exact += u32::from(kind == HessianKind::Exact);
            let expected = factors.solve(&-gradient);
            let step = at.newton_step(kind);
            let gap = amax(&(step - expected)) / amax(&expected);
            assert!(gap < 1e-8, "{kind:?}: gap {gap:e}, {step} beside {expected}");
        }
    }
    assert!(exact > 0, "every exact Hessian is indefinite");
}
