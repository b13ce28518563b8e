//! The runs that are counted: fixed problems without files, random numbers or clock.

use anyhow::Result;
use clap::ValueEnum;
use horizon_control::InputCost;
use horizon_estim::{Ident, IdentSettings, Observed, Piece};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Model};

use crate::bench::mhe;
use crate::bench::mpc::{self, Case, DT_S};

/// Parameter of the vehicle that is simulated.
const P: [f64; 4] = [1.29, 0.445, 0.994, 0.033];

/// Horizon of the controller. steps
const HORIZON_STEPS: usize = 50;

/// Work for `cargo xtask instructions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Kind of problem.
    kind: Kind,
    /// How long, in units of the run.
    length: u32,
}

/// A solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Kind {
    /// Moving horizon estimator, window 30, 100 updates.
    Mhe,
    /// Controller, horizon 50, 50 solves on the way to a pose.
    Mpc,
    /// Identification over 8 pieces of 100 steps.
    Ident,
}

impl Kind {
    pub(super) const ALL: [Self; 3] = [Self::Mhe, Self::Mpc, Self::Ident];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Mhe => "mhe",
            Self::Mpc => "mpc",
            Self::Ident => "ident",
        }
    }
}

/// Solves.
///
/// # Errors
/// A solve that fails.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    match arguments.kind {
        Kind::Mhe => mhe(100 * arguments.length),
        Kind::Mpc => mpc(50 * arguments.length),
        Kind::Ident => (0..arguments.length).try_for_each(|_| ident()),
    }
}

/// Inputs and observed poses of a vehicle that swings from side to side, with errors of centimetres.
fn steps(count: u32) -> impl Iterator<Item = (Sticks, Pose)> {
    let mut s = Pose::new(0.0, 0.0, 1.0, 3.0);
    (0..count).map(move |k| {
        let t = f64::from(k) * DT_S;
        let u = Sticks::new(0.5 * t.sin(), 0.4 * t.cos(), 0.3, 0.2 * (2.0 * t).sin());
        s = Kinematic.step(&s, &u, &P.into(), DT_S);
        (u, s + Pose::repeat(f64::from(k * 7919 % 101) * 1e-4))
    })
}

fn mhe(updates: u32) -> Result<()> {
    let mut mhe = mhe::estimator(30)?;
    mhe.start(&Pose::new(0.0, 0.0, 1.0, 3.0))?;
    for (u, o) in steps(updates) {
        anyhow::ensure!(mhe.update(&u, &Observed::full(o), &mut || false)?.cost.is_finite());
    }
    Ok(())
}

fn mpc(ticks: u32) -> Result<()> {
    let mut mpc = mpc::controller(HORIZON_STEPS, InputCost::Absolute, 1e-9)?;
    let mut s_0 = Pose::new(0.0, 0.0, 0.9, 0.5);
    for _ in 0..ticks {
        let s_ref = s_0 + Pose::new(0.2, 0.15, 0.1, -0.13);
        let case = Case { p: P.into(), u_before: Sticks::zeros(), s_0, s_ref };
        mpc.shift();
        anyhow::ensure!(mpc::solve(&mut mpc, &case, &[s_ref; HORIZON_STEPS])?.has_new_plan());
        s_0 = Kinematic.step(&s_0, &mpc.plan()[0], &P.into(), DT_S);
    }
    Ok(())
}

fn ident() -> Result<()> {
    let settings = IdentSettings::builder([0.9, 0.6, 0.9, 0.0])
        .c_o([3.0, 3.0, 2.0, 0.3])
        .c_s([1.0, 1.0, 0.1, 0.3])
        .c_p([1.0; 4])
        .bounds([0.1, 0.1, 0.1, -3.0], [10.0, 10.0, 10.0, 3.0])
        .solver(mhe::solver(1e-8))
        .build(&Kinematic)?;
    let all: Vec<(Sticks, Pose)> = steps(800).collect();
    let pieces = all.chunks(100).map(|piece| Piece {
        u: piece.iter().map(|(u, _)| *u).collect(),
        o: piece.iter().map(|(_, o)| Observed::full(*o)).collect(),
    });
    let mut ident = Ident::new(Kinematic, &settings, DT_S, pieces.collect())?;
    ident.start();
    anyhow::ensure!(ident.solve(&mut || false)?.cost.is_finite());
    Ok(())
}
