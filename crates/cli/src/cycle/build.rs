//! From tables to a cycle: the only place that knows which models exist.

use tello_control::{Mpc, Start, Supervisor, SupervisorSettings, Targets};
use tello_estim::{FilterSettings, Mhe, PoseFilter};
use tello_io::tello::Gate;
use tello_model::rows::{pose, stick};
use tello_model::setting::{SettingError, in_range};
use tello_model::{InputFifo, Kinematic, KinematicPublished, Model, Row};

use super::{Cycle, CycleTable, FlightTable, Memory, ModelKind, Tick};

/// The cycle that `table` describes, its estimator and controller set up and nothing seen yet.
///
/// # Errors
/// The first setting that breaks its rule, with its full key.
pub fn build(table: &FlightTable) -> Result<Box<dyn Tick>, SettingError> {
    match table.cycle.model {
        ModelKind::Kinematic => Ok(Box::new(with_model(Kinematic, table)?)),
        ModelKind::KinematicPublished => Ok(Box::new(with_model(KinematicPublished, table)?)),
        ModelKind::Lagged => {
            let rule = "kinematic or kinematic_published: the loop cannot fly lagged yet";
            Err(SettingError::new("cycle.model", "lagged", rule))
        }
    }
}

fn with_model<M, const NS: usize, const NP: usize>(
    model: M,
    table: &FlightTable,
) -> Result<Cycle<M, NS, NP>, SettingError>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Clone,
{
    let under = |section: &'static str| move |error: SettingError| error.under(section);
    let cycle = &table.cycle;
    let dt_s = in_range("dt_s", cycle.dt_s, 0.005..=0.1).map_err(under("cycle"))?;
    in_range("deadline_s", cycle.deadline_s, 1e-4..=0.9 * dt_s).map_err(under("cycle"))?;
    check_gate(cycle)?;
    let fifo = fifo(&cycle.dead_time_s, &M::INPUT, dt_s).map_err(under("cycle"))?;
    let filter: FilterSettings = (&cycle.filter).try_into().map_err(under("cycle.filter"))?;
    let mhe = cycle.mhe.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>();
    let mpc = cycle.mpc.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>();
    let mpc = Mpc::new(model.clone(), mpc.map_err(under("cycle.mpc"))?, dt_s);
    let supervisor: SupervisorSettings =
        (&cycle.supervisor).try_into().map_err(under("cycle.supervisor"))?;
    let mpc = mpc.map_err(under("cycle.mpc"))?;
    Ok(Cycle {
        mhe: Mhe::new(model.clone(), mhe.map_err(under("cycle.mhe"))?, dt_s),
        s_ref: vec![nalgebra::SVector::zeros(); mpc.plan().len()],
        mpc,
        model,
        dt_s,
        pipeline: cycle.pipeline,
        held: cycle.held_observations,
        filter: PoseFilter::new(filter),
        targets: Targets::new(&table.targets).map_err(under("targets"))?,
        supervisor: Supervisor::new(supervisor, table.start),
        gate: Gate::new(&cycle.gate).map_err(under("cycle.gate"))?,
        fifo,
        is_carried: table.start == Start::Carried,
        memory: Memory::default(),
    })
}

/// The FIFO of sent sticks, for dead times that the controller can plan with.
///
/// # Errors
/// As [`InputFifo::new`]; dead times that differ by more than a period.
pub(crate) fn fifo(
    dead_time_s: &[f64],
    rows: &[Row; stick::COUNT],
    dt_s: f64,
) -> Result<InputFifo<{ stick::COUNT }>, SettingError> {
    let fifo = InputFifo::new(dead_time_s, rows, dt_s)?;
    // Fast axes would be predicted with their newest input held, and oscillate.
    if fifo.horizon_steps() > fifo.known_steps() + 1 {
        let rule = "entries within one period: all axes are planned for one moment";
        return Err(SettingError::new("dead_time_s", format!("{dead_time_s:?}"), rule));
    }
    Ok(fifo)
}

/// The gate refuses what control must never ask for; within its limits control must be free, or a
/// saturated wish would turn into neutral sticks without a word.
fn check_gate(cycle: &CycleTable) -> Result<(), SettingError> {
    let CycleTable { gate, mpc, supervisor, .. } = cycle;
    let widest = mpc.u_lb.iter().chain(&mpc.u_ub).fold(0.0_f64, |widest, u| widest.max(u.abs()));
    if gate.stick_max < widest {
        let rule = format!("at least {widest}, the widest of cycle.mpc.u_lb and u_ub");
        return Err(SettingError::new("cycle.gate.stick_max", gate.stick_max, rule));
    }
    if gate.stale_s < supervisor.stale_s {
        let rule = format!("at least cycle.supervisor.stale_s = {}", supervisor.stale_s);
        return Err(SettingError::new("cycle.gate.stale_s", gate.stale_s, rule));
    }
    Ok(())
}
