//! Solves that would end at parameters far from the truth, by a wrong dead time or by states as noisy as their
//! observations.

use std::borrow::Cow;

use horizon_estim::{
    DelaySettings, DelayTable, DelayVerdict, Flights, Ident, IdentSettings, Observed, Piece,
    Recording, Span,
};
use horizon_model::Model;
use nalgebra::SVector;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::normal;

const DT_S: f64 = 0.05;
const GAIN_MPS: f64 = 0.9;
const TAU_S: f64 = 0.3;

/// A position driven by a velocity with lag, by Euler's steps: a lag below `dt / 2` is unstable, and none is forbidden.
/// State x, v; parameter gain, tau.
#[derive(Debug, Clone, Copy)]
struct Euler;

impl Model<2, 1, 1, 2> for Euler {
    fn step(
        &self,
        s: &SVector<f64, 2>,
        u: &SVector<f64, 1>,
        p: &SVector<f64, 2>,
        dt_s: f64,
    ) -> SVector<f64, 2> {
        let v = s.y + (p.x * u.x - s.y) / p.y * dt_s;
        SVector::from([s.x + v * dt_s, v])
    }

    fn observe(&self, s: &SVector<f64, 2>) -> SVector<f64, 1> {
        SVector::from([s.x])
    }

    fn at_rest(&self, o: &SVector<f64, 1>) -> SVector<f64, 2> {
        SVector::from([o.x, 0.0])
    }
}

#[test]
fn a_dead_time_is_found_from_one_at_which_the_parameter_ends_far_off() {
    let p = SVector::from([GAIN_MPS, TAU_S]);
    for (dead_time_s, start_s, tau_lb) in
        [(0.55, 0.3, -1e9), (0.45, 0.1, -1e9), (0.05, 0.3, 0.01), (0.1, 0.5, 0.01)]
    {
        let u = (0..300).map(|k| SVector::from([if k / 25 % 2 == 0 { 0.4 } else { -0.4 }]));
        let mut recording = Recording { u: u.collect(), o: Vec::new() };
        let mut s = SVector::<f64, 2>::zeros();
        for (k, applied) in recording.applied(&[dead_time_s].into(), DT_S).iter().enumerate() {
            let error_m = 0.001 * (7.3 * k as f64).sin();
            recording.o.push(Observed::full(SVector::from([s.x + error_m])));
            s = Euler.step(&s, applied, &p, DT_S);
        }
        let spans = [Span { recording: 0, steps: 0..300 }];
        let flights = Flights { recordings: &[Cow::Owned(recording)], spans: &spans, dt_s: DT_S };
        let settings = IdentSettings::builder([1.0, 0.5]).c_o([1e3]).c_s([10.0; 2]);
        let settings = settings.bounds([-1e9, tau_lb], [1e9; 2]).build(&Euler).unwrap();
        let mut found_s = SVector::from([start_s]);
        let mut ident = Ident::new(Euler, &settings, DT_S, flights.pieces(&found_s)).unwrap();
        let table =
            DelayTable { dead_time_max_s: 0.6, grid_s: 0.05, tolerance_s: 0.001, rounds: 20 };
        let delay = DelaySettings::try_from(&table).unwrap();
        let profiles =
            flights.search(&mut ident, &[&[0]], &mut found_s, &delay, &mut || false).unwrap();
        let verdict = profiles.unwrap()[0].verdict;
        let is_found = (found_s.x - dead_time_s).abs() < 0.002 && verdict == DelayVerdict::Minimum;
        assert!(is_found, "{dead_time_s} s from {start_s} s: {found_s}, {verdict:?}");
        assert!((ident.parameter() - p).norm() < 0.005, "{}", ident.parameter());
    }
}

#[test]
fn a_parameter_is_found_from_its_prior_where_positions_follow_velocities_nearly_exactly() {
    let mut generator = ChaCha8Rng::seed_from_u64(1);
    let p = SVector::from([GAIN_MPS, TAU_S]);
    let pieces = (0..12).map(|_| {
        let mut piece = Piece { u: Vec::new(), o: Vec::new() };
        let (mut s, mut u) = (SVector::<f64, 2>::zeros(), SVector::zeros());
        for k in 0..200 {
            if k % 10 == 0 {
                u = SVector::from([0.5 * normal(&mut generator)]);
            }
            let seen_m = s.x + 0.01 * normal(&mut generator);
            piece.o.push(Observed::full(SVector::from([seen_m])));
            piece.u.push(u);
            s = Euler.step(&s, &u, &p, DT_S);
            s.y += 0.02 * normal(&mut generator);
        }
        piece
    });
    let pieces = pieces.collect();
    let settings = IdentSettings::builder([1.0, 0.5]).c_o([100.0]).c_s([DT_S / 1e-5, DT_S / 0.02]);
    let settings = settings.build(&Euler).unwrap();
    let mut ident = Ident::new(Euler, &settings, DT_S, pieces).unwrap();
    let report = ident.solve(&mut || false).unwrap();
    let is_near = (ident.parameter() - p).norm() < 0.05;
    assert!(report.is_converged() && is_near, "{report:?}, {}", ident.parameter());
}
