//! From tables to a cycle.

use horizon_control::{Mpc, MpcTable};
use horizon_estim::Mhe;
use horizon_model::InputFifo;
use horizon_model::rows::{Sticks, pose, stick};
use horizon_model::setting::{SettingError, in_range};
use nalgebra::SVector;

use super::baseline::check_correction;
use super::committed::given_steps;
use super::dead_time::DeadTime;
use super::hand_over::HandOver;
use super::immobility::Immobility;
use super::impact::Impact;
use super::link::Link;
use super::mission_checks;
use super::planning::{Planner, StickBounds};
use super::pose_plausibility::Plausibility;
use super::progress::Progress;
use super::standing_start::StandingStart;
use super::walls::Walls;
use super::worst_case::WorstCase;
use super::{Cycle, CycleTable, DT_S, FlightTable, Memory, ModelKind, Tick, Vehicle, WithModel};
use crate::gate::Gate;
use crate::{
    FilterSettings, LinkMonitor, LinkSettings, LinkTable, Mission, MonitorSettings, Monitors,
    PoseFilter, Room, Start, Supervisor, SupervisorSettings,
};

/// The cycle that `table` describes, its estimator and controller set up and nothing seen yet. Allocates all that its
/// ticks need.
///
/// # Errors
/// The first setting that breaks its rule, with its full key.
pub fn build(table: &FlightTable) -> Result<Box<dyn Tick>, SettingError> {
    table.cycle.model.with(Build(table))
}

struct Build<'a>(&'a FlightTable);

impl WithModel for Build<'_> {
    type Output = Result<Box<dyn Tick>, SettingError>;

    fn run<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize>(
        self,
        model: M,
    ) -> Self::Output {
        build_with::<M, NS, NP, NR>(model, self.0)
    }
}

/// The cycle that `table` describes, but with `model` in place of the one that it names: for a model that settings
/// cannot name. `NR` is the model's [`horizon_model::Model::CONTROLLABLE`]. A log of such a flight does not replay.
///
/// # Errors
/// The first setting that breaks its rule, with its full key.
pub fn build_with<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize>(
    model: M,
    table: &FlightTable,
) -> Result<Box<dyn Tick>, SettingError> {
    Ok(Box::new(cycle::<M, NS, NP, NR>(model, table)?))
}

pub(super) fn cycle<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize>(
    model: M,
    table: &FlightTable,
) -> Result<Cycle<M, NS, NP, NR>, SettingError> {
    let under = |section: &'static str| move |error: SettingError| error.under(section);
    let cycle = &table.cycle;
    let dt_s = cycle.dt_s;
    let is_ours = (dt_s - DT_S).abs() <= 1e-9;
    if !is_ours {
        let rule = format!("{DT_S}: limits of the monitors count ticks of this length");
        return Err(SettingError::new("dt_s", dt_s, rule).under("cycle"));
    }
    in_range("deadline_s", cycle.deadline_s, 1e-4..=0.9 * dt_s).map_err(under("cycle"))?;
    let fifo = InputFifo::new(&cycle.dead_time_s, &M::INPUT, dt_s).map_err(under("cycle"))?;
    let link = link(cycle, dt_s, M::NAME)?;
    let fifo = fifo.with_room(link.as_ref().map_or(0, Link::capacity_steps));
    let fifo = fifo.with_min_ratio(cycle.dead_time_min_ratio()).map_err(under("cycle.link"))?;
    let filter: FilterSettings = (&cycle.filter).try_into().map_err(under("cycle.filter"))?;
    let mhe = cycle.mhe.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>();
    let mhe = Mhe::new(model, mhe.map_err(under("cycle.mhe"))?, dt_s)?;
    let supervisor: SupervisorSettings =
        (&cycle.supervisor).try_into().map_err(under("cycle.supervisor"))?;
    check_gate(cycle)?;
    let walls = walls(cycle).map_err(under("cycle"))?;
    let monitors: MonitorSettings =
        (&cycle.monitors).try_into().map_err(under("cycle.monitors"))?;
    Ok(Cycle {
        link,
        planner: planner(&model, (cycle, walls), &fifo, mhe.p_hat(), dt_s)
            .map_err(under("cycle.mpc"))?,
        worst_case: WorstCase::new(*mhe.p_hat()),
        mhe,
        model,
        dt_s,
        pipeline: cycle.pipeline,
        held: cycle.held_observations,
        uses_measurement_time: cycle.uses_measurement_time,
        filter: PoseFilter::new(filter),
        plausibility: Plausibility::default(),
        jump_rad: cycle.supervisor.jump_rad,
        mission: mission(table, dt_s)?,
        monitors: Monitors::new(&monitors, dt_s),
        progress: Progress::default(),
        immobility: Immobility::default(),
        impact: Impact::new(),
        standing_start: StandingStart::new(cycle.standing).map_err(under("cycle.standing"))?,
        supervisor: Supervisor::new(supervisor, table.start),
        hand_over: HandOver::default(),
        gate: Gate::new(&cycle.gate, table.protocol).map_err(under("cycle.gate"))?,
        fifo,
        is_dry_run: table.start == Start::Carried,
        memory: Memory::default(),
    })
}

/// The mission, if it fits room, obstacles and vehicle.
fn mission(table: &FlightTable, dt_s: f64) -> Result<Mission, SettingError> {
    let mission = Mission::new(&table.mission, dt_s).map_err(|error| error.under("mission"))?;
    let misfits = mission_checks::misfits(&table.mission, &mission, &table.cycle)?;
    misfits.into_iter().next().map_or(Ok(mission), Err)
}

/// The controller of what takes effect, with the bounds of the sticks seen through the expected
/// parameter.
fn planner<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize>(
    model: &M,
    (cycle, walls): (&CycleTable, Option<Walls>),
    fifo: &InputFifo<{ stick::COUNT }>,
    p_prior: &SVector<f64, NP>,
    dt_s: f64,
) -> Result<Planner<M, NS, NP, NR>, SettingError> {
    let (settings, baseline) = cycle.mpc.check::<M, NS, NP>()?;
    check_correction::<M, NS, NP>(cycle)?;
    let bounds = StickBounds { lower: *settings.u_lb(), upper: *settings.u_ub() };
    let effect = |u: &Sticks| model.effect(u, p_prior).as_slice().to_vec();
    let (u_lb, u_ub) = (effect(&bounds.lower), effect(&bounds.upper));
    let by_effect = MpcTable { u_lb, u_ub, ..cycle.mpc.mpc() };
    let mut settings = by_effect.check::<M, NS, { stick::COUNT }, { pose::COUNT }, NP>()?;
    let given_steps = given_steps(fifo.nominal_steps());
    let given_max = given_steps_max(cycle.link.as_ref(), fifo, dt_s);
    if settings.horizon_steps() <= given_max {
        let rule = format!(
            "above {given_max}, the steps between the shortest and the longest of cycle.dead_time_s as they may be \
            corrected (cycle.link)"
        );
        return Err(SettingError::new("horizon_steps", settings.horizon_steps(), rule));
    }
    // What is sent now is the first open step of each axis, or lies between that and the next one.
    for step in given_steps.into_iter().flat_map(|given| [given, given + 1]) {
        settings.begin_stage_at(step);
    }
    let settings = settings.with_constraints(walls.as_ref().map_or(0, Walls::count));
    let mpc = Mpc::new(model.core(), settings, dt_s)?;
    let planner = Planner::new(*model, (mpc, baseline), bounds, fifo, dt_s);
    Ok(planner.with_walls(walls))
}

/// Bound of the steps between the shortest and the longest dead time, corrections included.
fn given_steps_max(
    link: Option<&LinkTable>,
    fifo: &InputFifo<{ stick::COUNT }>,
    dt_s: f64,
) -> usize {
    let (longest, shortest) = (fifo.longest_steps(), fifo.known_steps());
    let apart = link.filter(|link| link.height.is_some() && link.dead_time_change_s > 0.0);
    // Axes that are corrected alike keep their distance.
    apart.map_or(longest - shortest, |link| longest + DeadTime::steps_of(link, dt_s) as usize)
}

/// What the plan knows of room and obstacles.
fn walls(cycle: &CycleTable) -> Result<Option<Walls>, SettingError> {
    let room = cycle.supervisor.room.as_ref().map(Room::try_from).transpose();
    let room = room.map_err(|error| error.under("supervisor.room"))?;
    Walls::new(cycle.mpc.walls.as_ref(), room, &cycle.obstacles)
}

fn link(cycle: &CycleTable, dt_s: f64, model: &str) -> Result<Option<Link>, SettingError> {
    let Some(table) = &cycle.link else { return Ok(None) };
    if cycle.model != ModelKind::Lagged {
        let rule = "null: the link monitor needs the model lagged";
        return Err(SettingError::new("cycle.link", format!("settings for {model}"), rule));
    }
    let settings = LinkSettings::try_from(table).map_err(|error| error.under("cycle.link"))?;
    let monitor = LinkMonitor::new(&settings, dt_s);
    // Checked with the FIFO: one entry an axis.
    let dead_time_s = Sticks::from_iterator(cycle.dead_time_s.iter().copied());
    let dead_time = DeadTime::new(table, &dead_time_s, dt_s);
    let window_steps = cycle.mhe.window_steps().map_err(|error| error.under("cycle.mhe"))?;
    let stick_max = table.outage_stick_max.unwrap_or(cycle.gate.stick_max);
    Ok(Some(Link::new(monitor, dead_time, stick_max, window_steps, dt_s)))
}

/// The gate refuses what control must never ask for; within its limits control must be free, or a
/// saturated proposal would silently become neutral sticks.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::sense::tests::table;

    /// The key of the first setting that is refused after `change`; empty if none is.
    fn refused(change: impl FnOnce(&mut CycleTable)) -> String {
        let mut table = table();
        change(&mut table.cycle);
        build(&table).err().map_or_else(String::new, |error| error.key)
    }

    #[test]
    fn the_deadline_lies_within_nine_tenths_of_the_one_period() {
        let with =
            |dt_s, deadline_s| refused(|cycle| (cycle.dt_s, cycle.deadline_s) = (dt_s, deadline_s));
        assert_eq!(with(0.02, 0.9 * 0.02), "");
        assert_eq!(with(0.02, (0.9 * 0.02_f64).next_up()), "cycle.deadline_s");
        assert_eq!(with(0.02, 1e-4_f64.next_down()), "cycle.deadline_s");
        for dt_s in [0.01, 0.021, 0.0, f64::NAN] {
            assert_eq!(with(dt_s, 1e-3), "cycle.dt_s", "{dt_s} s");
        }
    }

    #[test]
    fn a_window_that_is_too_long_is_refused_before_anything_is_as_long() {
        let with = |steps| refused(|cycle| cycle.mhe.window_steps = steps);
        assert_eq!([with(200), with(usize::MAX / 64)], ["", "cycle.mhe.window_steps"]);
    }

    #[test]
    fn the_gate_lets_through_all_that_control_may_ask_for() {
        let with = |stick_max, u_lb: f64, u_ub: f64| {
            refused(|cycle| {
                cycle.gate.stick_max = stick_max;
                cycle.mpc.u_lb[stick::YAW] = u_lb;
                cycle.mpc.u_ub[stick::YAW] = u_ub;
                for axis in [stick::ROLL, stick::PITCH, stick::THROTTLE] {
                    (cycle.mpc.u_lb[axis], cycle.mpc.u_ub[axis]) = (-0.5, 0.5);
                }
            })
        };
        assert_eq!(with(0.75, -0.75, 0.75), "");
        assert_eq!(with(0.75_f64.next_down(), -0.75, 0.5), "cycle.gate.stick_max");
        assert_eq!(with(0.75_f64.next_down(), -0.5, 0.75), "cycle.gate.stick_max");
    }

    #[test]
    fn the_gate_is_not_stricter_about_the_age_of_a_pose_than_the_supervisor() {
        let with = |gate_s, supervisor_s| {
            refused(|cycle| {
                (cycle.gate.stale_s, cycle.supervisor.stale_s) = (gate_s, supervisor_s);
            })
        };
        assert_eq!(with(0.5, 0.5), "");
        assert_eq!(with(0.5, 0.5_f64.next_up()), "cycle.gate.stale_s");
    }

    #[test]
    fn the_horizon_is_longer_than_the_spread_of_the_dead_times() {
        let with = |horizon_steps, change_s, is_apart| {
            refused(|cycle| {
                (cycle.mpc.horizon_steps, cycle.mpc.stages) = (horizon_steps, Vec::new());
                if let Some(link) = &mut cycle.link {
                    link.dead_time_change_s = change_s;
                    link.height = link.height.filter(|_| is_apart);
                }
            })
        };
        // 0.34 s to roll and pitch, 0.04 s to yaw: 15 periods. Corrections of all axes alike keep them.
        for (change_s, is_apart) in [(0.3, false), (0.0, true)] {
            assert_eq!(with(16, change_s, is_apart), "");
            assert_eq!(with(15, change_s, is_apart), "cycle.mpc.horizon_steps");
        }
        // 17 periods to roll and pitch, and 15 of their correction.
        assert_eq!(with(33, 0.3, true), "");
        assert_eq!(with(32, 0.3, true), "cycle.mpc.horizon_steps");
    }

    #[test]
    fn a_link_monitor_needs_the_model_it_predicts_with() {
        let without = refused(|cycle| cycle.model = ModelKind::Kinematic);
        assert_eq!(without, "cycle.link");
    }
}
