use super::*;
use crate::Operator;
use crate::cycle::sense::tests::{DT_NS, sighting, table};
use crate::cycle::{Inbox, TickStage, build};
use crate::time::TimeNs;

/// What a tick did, in its order.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Deed {
    Estimated,
    Planned,
    Sent,
}

#[derive(Debug, Default)]
struct Order(Vec<Deed>);

impl Watch for Order {
    fn is_late(&mut self) -> bool {
        false
    }

    fn mark(&mut self, stage: TickStage) {
        self.0.push(match stage {
            TickStage::Estimated => Deed::Estimated,
            TickStage::Planned => Deed::Planned,
        });
    }

    fn send(&mut self, _out: &Outcome) {
        self.0.push(Deed::Sent);
    }
}

/// Order and outcome of each of ten ticks; from the sixth on the operator asks for `operator`.
fn ticks(pipeline: Pipeline, operator: Operator) -> Vec<(Vec<Deed>, Outcome)> {
    let mut table = table();
    table.cycle.pipeline = pipeline;
    let mut cycle = build(&table).unwrap();
    let mut inbox = Inbox::new();
    let tick = |step: u32| {
        let now = TimeNs(i64::from(step) * DT_NS);
        inbox.open(step.into(), now);
        inbox.sightings.push(sighting(now, 0));
        if step >= 5 {
            inbox.operator = operator;
        }
        let (mut order, mut out) = (Order::default(), cycle.new_outcome());
        cycle.tick(&inbox, &mut order, &mut out);
        (order.0, out)
    };
    (0..10).map(tick).collect()
}

#[test]
fn the_lagged_pipeline_sends_first_then_plans_by_the_old_estimate_then_estimates() {
    use Deed::{Estimated, Planned, Sent};
    for (pipeline, expected) in [
        (Pipeline::SameTick, [Estimated, Planned, Sent]),
        (Pipeline::NextTick, [Sent, Planned, Estimated]),
    ] {
        let ticks = ticks(pipeline, Operator::Wait);
        for (order, _) in &ticks[2..] {
            assert_eq!(*order, expected, "{pipeline:?}");
        }
    }
}

#[test]
fn a_plan_of_the_lagged_pipeline_is_flown_in_the_next_tick() {
    let first_steered = |pipeline| {
        let ticks = ticks(pipeline, Operator::Wait);
        let planned = ticks.iter().position(|(_, out)| out.controller.is_some());
        let steered = ticks.iter().position(|(_, out)| out.u_sent.norm() > 0.0);
        planned.zip(steered).map(|(planned, steered)| steered - planned)
    };
    assert_eq!(first_steered(Pipeline::SameTick), Some(0));
    assert_eq!(first_steered(Pipeline::NextTick), Some(1));
}

#[test]
fn the_lagged_pipeline_goes_on_to_estimate_but_not_to_plan_while_it_may_not_steer() {
    let ticks = ticks(Pipeline::NextTick, Operator::Land);
    for (order, out) in &ticks[5..] {
        assert_eq!(*order, [Deed::Sent, Deed::Estimated]);
        assert!(out.estimator.is_some() && out.controller.is_none());
    }
}

#[test]
fn the_names_of_the_choices_in_files_stay() {
    // As logs before it was renamed have it.
    assert_eq!(serde_json::from_str::<Pipeline>("\"lagged\"").unwrap(), Pipeline::NextTick);
    for (pipeline, name) in [(Pipeline::SameTick, "same_tick"), (Pipeline::NextTick, "next_tick")] {
        assert_eq!(serde_json::to_value(pipeline).unwrap(), name);
    }
    for (held, name) in [(HeldObservations::Skip, "skip"), (HeldObservations::Use, "use")] {
        assert_eq!(serde_json::to_value(held).unwrap(), name);
    }
}

#[test]
fn a_correction_that_inverts_a_gain_or_turns_the_plan_is_refused() {
    let with = |row: usize, correction: f64| {
        let mut table = table();
        table.cycle.mpc.p_correction[row] = correction;
        build(&table).err().map_or_else(String::new, |error| error.key)
    };
    let mhe = table().cycle.mhe;
    let (prior, low, high) = (mhe.p_prior[0], mhe.p_lb[0], mhe.p_ub[0]);
    assert_eq!([with(0, 0.9 * (high - prior)), with(3, -0.4)], ["", ""]);
    for (row, correction) in
        [(0, 1.01 * (high - prior)), (0, -prior - 1.0), (0, -low), (3, 0.81), (3, f64::NAN)]
    {
        let key = format!("cycle.mpc.p_correction[{row}]");
        assert_eq!(with(row, correction), key, "{correction}");
    }
}
