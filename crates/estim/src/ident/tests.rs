//! Identification on simulated pieces: truth, elimination against a sparse factorization, Laplace, threads.

mod sparse;

use horizon_model::check::amax;
use horizon_model::rows::{Pose, Sticks, gain, pose};
use horizon_model::{Bounds, Kinematic, Model, Vector};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use super::variable_projection::{Scratch, Start, TOLERANCE_MIN};
use super::*;
use crate::levenberg::{LeastSquares, LmStop, LmTable};
use crate::loss::LossTable;
use sparse::Sparse;

type Vehicle = Ident<Kinematic, 4, 4, 4, 4>;

const DT_S: f64 = 0.02;

fn truth() -> Vector<4> {
    Vector::from([1.1, 0.5, 0.9, 0.15])
}

fn table() -> IdentTable {
    IdentTable {
        c_o: vec![30.0, 30.0, 20.0, 10.0],
        c_s: vec![2.0, 2.0, 2.0, 2.0],
        c_p: vec![0.1; 4],
        c_0: vec![0.0; 4],
        p_prior: vec![0.9, 0.6, 0.8, 0.0],
        p_lb: vec![0.1, 0.1, 0.1, -2.0],
        p_ub: vec![3.0; 4],
        observation_loss: LossTable::None {},
        transition_loss: LossTable::None {},
        curvature: Curvature::Exact,
        solver: LmTable {
            damping_start: 1e-8,
            cost_tolerance: 1e-14,
            step_tolerance: 1e-12,
            iterations_max: 100,
        },
    }
}

/// Pieces of a vehicle with the true parameter, with noise of the given size on every observation.
fn pieces(count: usize, steps: u32, noise: f64) -> Vec<Piece<4, 4>> {
    let mut runner = TestRunner::deterministic();
    let mut draw = || (-1.0..1.0_f64).new_tree(&mut runner).unwrap().current();
    let piece = |_| {
        let mut s = Pose::new(draw(), draw(), 1.0 + 0.5 * draw(), 3.0 * draw());
        let phase = 3.0 * draw();
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..steps {
            let t = f64::from(k) * DT_S + phase;
            let sticks =
                Sticks::new((3.0 * t).sin(), (4.0 * t).cos(), (5.0 * t).sin(), (2.0 * t).cos());
            o.push(Observed::full(s + Pose::from_fn(|_, _| noise * draw())));
            s = Kinematic.step(&s, &sticks, &truth(), DT_S);
            u.push(sticks);
        }
        Piece { u, o }
    };
    (0..count).map(piece).collect()
}

fn vehicle(table: &IdentTable, pieces: Vec<Piece<4, 4>>) -> Vehicle {
    Ident::new(Kinematic, &table.check::<Kinematic, 4, 4, 4, 4>().unwrap(), DT_S, pieces).unwrap()
}

fn solve(ident: &mut Vehicle) -> SolveReport {
    let report = ident.solve(&mut || false).unwrap();
    assert!(report.iterations < 100, "{report:?}");
    report
}

#[test]
fn noise_free_pieces_return_the_truth() {
    let mut table = table();
    table.c_p = vec![0.0; 4];
    for curvature in [Curvature::GaussNewton, Curvature::Exact] {
        table.curvature = curvature;
        let mut pieces = pieces(3, 60, 0.0);
        // A row that is not seen for a while is bridged by the model.
        for observed in &mut pieces[1].o[10..20] {
            observed.is_present[pose::X] = false;
            observed.o[pose::X] = f64::NAN;
        }
        let mut ident = vehicle(&table, pieces);
        let report = solve(&mut ident);
        let gap = amax(&(ident.parameter() - truth()));
        // Cost 0 to the rounding of residuals of order 1.
        assert!(gap < 1e-7, "{curvature:?}: gap {gap:e}, {report:?}");
        assert!(report.cost < 1e-12, "{report:?}");
    }
}

#[test]
fn a_bound_stops_its_row() {
    let mut table = table();
    table.p_ub[gain::LAMBDA_H] = 1.0;
    let mut ident = vehicle(&table, pieces(3, 60, 0.01));
    assert!(solve(&mut ident).cost.is_finite());
    assert_eq!(ident.parameter()[gain::LAMBDA_H].to_bits(), 1.0_f64.to_bits());
}

#[test]
fn the_elimination_is_that_of_a_general_sparse_factorization() {
    let mut table = table();
    table.observation_loss = LossTable::Huber { scale: 0.5 };
    table.transition_loss = LossTable::Tukey { scale: 9.0 };
    table.c_0 = vec![0.5, 0.0, 1.0, 0.2];
    table.p_ub[gain::LAMBDA_H] = 1.0;
    let mut pieces = pieces(4, 15, 0.05);
    pieces[2].o[3] = Observed::missing();
    pieces[2].o[7].is_present[pose::THETA] = false;
    let mut ident = vehicle(&table, pieces);
    ident.set_multiplicities(&[1, 0, 2, 1]);
    let mut exact = 0;
    for step in 0..6 {
        // The damping bounds the condition number by 1e6.
        let damping = 1e-6 * ident.linearize().unwrap().diagonal_max;
        for curvature in [Curvature::Exact, Curvature::GaussNewton] {
            let mut sparse = Sparse::default();
            let Ident { terms, p, segments, multiplicities, .. } = &ident;
            let counted = segments.iter().zip(multiplicities).filter(|(_, count)| **count > 0);
            let expected = sparse.eliminate(counted, terms, p, curvature, damping);
            let reduced = ident.eliminate(curvature, damping);
            let (Ok(mut expected), Ok(reduced)) = (expected, reduced) else {
                assert_eq!(
                    (curvature, expected.is_err(), reduced.is_err()),
                    (Curvature::Exact, true, true)
                );
                continue;
            };
            exact += u32::from(curvature == Curvature::Exact);
            ident.prior.add_to(&mut expected, &ident.p);
            for (what, gap) in [
                ("decrease", (reduced.decrease / expected.decrease - 1.0).abs()),
                (
                    "gradient",
                    amax(&(reduced.gradient - expected.gradient)) / amax(&expected.gradient),
                ),
                ("Hessian", amax(&(reduced.hessian - expected.hessian)) / amax(&expected.hessian)),
            ] {
                assert!(gap < 1e-8, "{curvature:?}, step {step}: gap {gap:e} of the {what}");
            }
            let p_step = Vector::from([0.1, -0.2, 0.05, 0.3]);
            let counts = ident.multiplicities.clone();
            let counted = ident.segments.iter_mut().zip(counts).filter(|(_, count)| *count > 0);
            let mut counted: Vec<_> = counted.map(|(segment, _)| segment).collect();
            let back_substituted = counted.iter_mut().map(|segment| {
                segment.back_substitute(&p_step);
                segment.s_candidate.clone()
            });
            let back_substituted: Vec<_> = back_substituted.collect();
            sparse.move_candidates(counted.iter_mut().map(|segment| &mut **segment), &p_step);
            for (left, right) in back_substituted.iter().zip(&counted) {
                for (left, right) in left.iter().zip(&right.s_candidate) {
                    let gap = (left - right).norm() / left.norm();
                    assert!(gap < 1e-8, "{curvature:?}, step {step}: state gap {gap:e}");
                }
            }
        }
        let _ = ident.try_step(damping).unwrap();
        ident.accept();
    }
    assert!(exact > 2, "{exact} iterates with an exact Hessian that is positive definite");
}

/// Smallest cost when `p` is held.
fn profile(ident: &Vehicle, p: Vector<4>) -> f64 {
    let mut held = ident.clone();
    held.p = p;
    held.prior.bounds = Bounds { lo: p, hi: p };
    solve(&mut held).cost
}

#[test]
fn the_states_are_reoptimized_for_a_moved_parameter() {
    let mut ident = vehicle(&table(), pieces(1, 30, 0.02));
    assert!(solve(&mut ident).cost > 0.0);
    let p = ident.parameter() + Vector::from([0.2, -0.1, 0.1, 0.3]);
    let expected = profile(&ident, p) - ident.prior.cost(&p);
    let Ident { terms, segments, .. } = &mut ident;
    for curvature in [Curvature::GaussNewton, Curvature::Exact] {
        let segment = &mut segments[0];
        segment.s_candidate.clone_from(&segment.s);
        let cost = segment.contribution(terms, &p).cost;
        let start = Start { cost, expected: f64::NAN, damping: 0.0, tolerance: TOLERANCE_MIN };
        let reoptimized = segment.reoptimize_states(
            terms,
            &p,
            curvature,
            start,
            &mut Scratch::of::<Kinematic, 4, 4, 4>(30),
        );
        assert!(cost > 1.01 * expected, "{cost} where {expected} is the least");
        // It ends when a step gains less than 1e-4, and the next one would gain far less.
        let gap = reoptimized / expected - 1.0;
        assert!(gap.abs() < 1e-4, "{curvature:?}: gap {gap:e}, {cost} before");
        let left = segment.contribution(terms, &p).cost;
        assert!(
            (left - reoptimized).abs() < 1e-12 * reoptimized,
            "{left} is left of {reoptimized}"
        );
    }
}

#[test]
fn the_information_is_the_second_derivative_of_the_profiled_cost() {
    let mut ident = vehicle(&table(), pieces(2, 30, 0.02));
    assert!(solve(&mut ident).cost > 0.0);
    let information = ident.information().unwrap();
    let p = *ident.parameter();
    // Central differences of a cost of about 10 over a step of h: rounding leaves 1e-15 / h^2, the
    // fourth derivative h^2, both below 1e-6 of the information, 10 to 1000.
    let h = 1e-4;
    for i in 0..4 {
        for j in 0..=i {
            let at = |left: f64, right: f64| {
                let mut moved = p;
                moved[i] += left * h;
                moved[j] += right * h;
                profile(&ident, moved)
            };
            let numeric =
                (at(1.0, 1.0) - at(1.0, -1.0) - at(-1.0, 1.0) + at(-1.0, -1.0)) / (4.0 * h * h);
            let scale = (information[(i, i)] * information[(j, j)]).sqrt();
            let gap = (information[(i, j)] - numeric).abs() / scale;
            assert!(gap < 1e-4, "({i}, {j}): {} and {numeric}, gap {gap:e}", information[(i, j)]);
        }
    }
    // Gauss-Newton ignores the second derivatives of the residuals: it agrees only for small residuals.
    ident.curvature = Curvature::GaussNewton;
    let gap = (ident.information().unwrap() - information).norm() / information.norm();
    assert!((1e-6..0.1).contains(&gap), "Gauss-Newton is off by {gap:e}");
}

#[test]
fn a_piece_that_counts_twice_is_the_piece_given_twice() {
    let pieces = pieces(3, 40, 0.02);
    let [a, b, c] = [0, 1, 2].map(|at: usize| pieces[at].clone());
    let mut counted = vehicle(&table(), vec![a.clone(), b, c.clone()]);
    counted.set_multiplicities(&[2, 0, 1]);
    let mut given = vehicle(&table(), vec![a.clone(), a, c]);
    let (left, right) = (solve(&mut counted), solve(&mut given));
    assert!((left.cost / right.cost - 1.0).abs() < 1e-12, "{left:?} {right:?}");
    let gap = amax(&(counted.parameter() - given.parameter()));
    assert!(gap < 1e-8, "gap {gap:e}");
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut ident = vehicle(&table(), pieces(7, 40, 0.02));
        let report = pool.install(|| solve(&mut ident));
        (
            report.cost.to_bits(),
            ident.parameter().map(f64::to_bits),
            ident.states(6)[39].map(f64::to_bits),
        )
    };
    assert_eq!(run(1), run(2));
    assert_eq!(run(1), run(3));
}

#[test]
fn a_restart_at_the_solution_stays_there() {
    let mut solved = vehicle(&table(), pieces(3, 40, 0.02));
    let first = solve(&mut solved);
    let mut again = vehicle(&table(), pieces(3, 40, 0.02));
    again.restart_at(&solved);
    let report = solve(&mut again);
    // A start adds its residuals up in another order.
    let is_as_low = report.cost <= first.cost * (1.0 + 1e-14);
    assert!(report.iterations <= 2 && is_as_low, "{report:?} after {first:?}");
}

#[test]
fn a_late_solve_leaves_its_best_iterate() {
    let mut ident = vehicle(&table(), pieces(2, 40, 0.02));
    let mut polls = 0;
    let report = ident
        .solve(&mut || {
            polls += 1;
            polls > 2
        })
        .unwrap();
    assert_eq!((report.stop, report.iterations, polls), (LmStop::Late, 2, 3));
    assert!(report.cost < report.cost_start);
}

#[test]
fn a_broken_piece_is_named() {
    let refuse = |change: &dyn Fn(&mut Vec<Piece<4, 4>>)| {
        let mut pieces = pieces(3, 10, 0.0);
        change(&mut pieces);
        let settings = table().check::<Kinematic, 4, 4, 4, 4>().unwrap();
        Ident::new(Kinematic, &settings, DT_S, pieces).unwrap_err().to_string()
    };
    assert_eq!(
        refuse(&|pieces| pieces[2].o[4].o[pose::Z] = f64::NAN),
        "observation 4 of piece 2 is not finite"
    );
    assert_eq!(
        refuse(&|pieces| pieces[1].u[8].x = f64::INFINITY),
        "input 8 of piece 1 is not finite"
    );
    assert_eq!(
        refuse(&|pieces| pieces[0].o.truncate(1)),
        "piece 0 has 1 steps; it needs at least 2"
    );
    assert_eq!(refuse(&|pieces| pieces[0].u.truncate(3)), "piece 0 has 3 inputs for 10 steps");
}

#[test]
fn a_bad_setting_is_named() {
    let refuse = |change: &dyn Fn(&mut IdentTable)| {
        let mut table = table();
        change(&mut table);
        table.check::<Kinematic, 4, 4, 4, 4>().unwrap_err().to_string()
    };
    assert_eq!(refuse(&|t| t.c_s[pose::Y] = 0.0), "C_s[1] = 0: expected 1e-6..=1e6");
    assert_eq!(refuse(&|t| t.c_0[pose::X] = -1.0), "C_0[0] = -1: expected 0 or 1e-6..=1e6");
    assert_eq!(refuse(&|t| t.p_prior[gain::LAMBDA_V] = 9.0), "p_prior[1] = 9: expected 0.1..=3.0");
    assert!(refuse(&|t| t.solver.iterations_max = 0).starts_with("solver.iterations_max = 0"));
}
