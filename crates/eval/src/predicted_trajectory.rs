//! The predicted trajectory for viewers: over the dead time by the committed sticks, then by the plan.
//!
//! Owns the trajectory as points. It repeats the prediction of the tick from the recorded values of the tick, so
//! that the tick need not record it. Nothing that flies reads it. Thread in flight: the log's, not the tick's.
//! Allocates.

use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use horizon_model::{InputFifo, Kinematic, Model};

use tello_flight::cycle::{CycleTable, ModelKind, Outcome, WithModel};

use crate::display_rounding::{PosW, every, to_thousandths};

/// Most points of a line that is drawn again and again.
const POINTS_MAX: usize = 60;

/// Steps by which a flight may correct its dead times: 0.5 s of the shortest period.
const CHANGE_MAX: usize = 100;

/// The path ahead. Both lines are empty without an estimate, the plan's without a plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PredictedTrajectory {
    /// From the estimate on, by committed sticks.
    pub committed: Vec<PosW>,
    /// After the committed sticks, by the planned sticks.
    pub plan: Vec<PosW>,
}

/// Predicts the trajectory from the sticks in transit and the plan.
#[derive(Debug)]
pub struct TrajectoryPredictor {
    model: ModelKind,
    fifo: InputFifo<{ stick::COUNT }>,
    dt_s: f64,
}

impl TrajectoryPredictor {
    /// Nothing sent so far.
    ///
    /// # Errors
    /// A dead time or the period breaks its rule.
    pub fn new(cycle: &CycleTable) -> Result<Self, SettingError> {
        let fifo = InputFifo::new(&cycle.dead_time_s, &Kinematic::INPUT, cycle.dt_s)?;
        let fifo = fifo.with_room(CHANGE_MAX).with_min_ratio(cycle.dead_time_min_ratio())?;
        Ok(Self { model: cycle.model, fifo, dt_s: cycle.dt_s })
    }

    /// The path ahead as the tick of `out` saw it; called before [`TrajectoryPredictor::note`] of the same tick.
    pub fn ahead(&self, out: &Outcome) -> PredictedTrajectory {
        self.model.with(ModelPrediction { predictor: self, out })
    }

    /// Takes note of the sticks that the tick of `out` sent; called for every tick.
    pub fn note(&mut self, out: &Outcome) {
        if let Some(change) = out.dead_time {
            self.fifo.correct(change.steps);
        }
        self.fifo.push(&out.u_sent);
    }

    fn predict<const NS: usize, const NP: usize>(
        &self,
        model: &impl Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
        out: &Outcome,
    ) -> PredictedTrajectory {
        let (Some(s_hat), Some(p)) = (out.s_hat.first_chunk::<NS>(), out.p_hat.first_chunk::<NP>())
        else {
            return PredictedTrajectory::default();
        };
        let (mut s, p) = ((*s_hat).into(), (*p).into());
        let applied = |ahead| out.outage_input.unwrap_or_else(|| self.fifo.applied(ahead));
        // The plan begins when the fastest stick would act, and its first sticks of the others are sent.
        let known = self.fifo.known_steps();
        let sent = (0..known.cast_signed()).map(applied);
        let mut path = vec![place(&model.observe(&s))];
        for u in sent.chain(out.plan.iter().map(|u| Sticks::from(*u))) {
            s = model.step(&s, &u, &p, self.dt_s);
            path.push(place(&model.observe(&s)));
        }
        let decided = horizon_model::whole(self.fifo.dead_time_steps().max());
        let turn = decided.min(path.len().saturating_sub(1));
        let has_plan = !out.plan.is_empty();
        let plan =
            if has_plan { thinned(path.get(turn..).unwrap_or_default()) } else { Vec::new() };
        path.truncate(turn + 1);
        PredictedTrajectory { committed: thinned(&path), plan }
    }
}

/// [`TrajectoryPredictor::predict`] with the model of the flight.
struct ModelPrediction<'a> {
    predictor: &'a TrajectoryPredictor,
    out: &'a Outcome,
}

impl WithModel for ModelPrediction<'_> {
    type Output = PredictedTrajectory;

    fn run<M, const NS: usize, const NP: usize, const NR: usize>(
        self,
        model: M,
    ) -> PredictedTrajectory
    where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
    {
        self.predictor.predict(&model, self.out)
    }
}

/// At most [`POINTS_MAX`] of `points`, and the last.
fn thinned(points: &[PosW]) -> Vec<PosW> {
    every(points, POINTS_MAX)
}

fn place(o: &Pose) -> PosW {
    [o[pose::X], o[pose::Y], o[pose::Z]].map(to_thousandths)
}

#[cfg(test)]
mod tests {
    use tello_flight::Start;
    use tello_io::config;

    use super::*;

    /// A predictor of three steps on every axis.
    fn predictor() -> TrajectoryPredictor {
        let (table, mission) = config::fly(None, None).unwrap();
        let mut flight = config::flight(&table, mission, Start::Grounded);
        flight.cycle.model = ModelKind::Kinematic;
        flight.cycle.dead_time_s = vec![3.0 * flight.cycle.dt_s; stick::COUNT];
        TrajectoryPredictor::new(&flight.cycle).unwrap()
    }

    fn out() -> Outcome {
        let mut out = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
        out.s_hat = vec![1.0, 2.0, 3.0, 0.0];
        out.p_hat = vec![1.0, 1.0, 1.0, 0.0];
        out
    }

    #[test]
    fn committed_sticks_lead_to_where_the_plan_begins() {
        let mut predictor = predictor();
        let dt_s = predictor.dt_s;
        let mut out = out();
        for throttle in [0.5, 1.0, -0.5] {
            out.u_sent[stick::THROTTLE] = throttle;
            predictor.note(&out);
        }
        out.plan = vec![[0.0, 0.0, 0.0, -1.0]; 2];
        let heights = |path: &[PosW]| path.iter().map(|[_, _, z]| *z).collect::<Vec<_>>();
        let after = |steps: f64| to_thousandths(3.0 + steps * dt_s);
        let PredictedTrajectory { committed, plan } = predictor.ahead(&out);
        assert_eq!(heights(&committed), [0.0, 0.5, 1.5, 1.0].map(after));
        assert_eq!(heights(&plan), [1.0, 0.0, -1.0].map(after));
    }

    #[test]
    fn in_an_outage_the_held_sticks_lead_to_where_the_plan_begins() {
        let mut predictor = predictor();
        let dt_s = predictor.dt_s;
        let mut out = out();
        out.u_sent[stick::THROTTLE] = -1.0;
        (0..3).for_each(|_| predictor.note(&out));
        for throttle in [0.0, 0.5] {
            let mut held = Sticks::zeros();
            held[stick::THROTTLE] = throttle;
            out.outage_input = Some(held);
            let last = predictor.ahead(&out).committed.pop().map(|[_, _, z]| z);
            assert_eq!(last, Some(to_thousandths(3.0 + 3.0 * throttle * dt_s)), "{throttle}");
        }
    }

    #[test]
    fn the_model_of_the_flight_leads_the_way() {
        let mut out = out();
        out.s_hat[pose::THETA] = 0.5;
        out.u_sent[stick::ROLL] = 1.0;
        let last = |model| {
            let mut predictor = TrajectoryPredictor { model, ..predictor() };
            (0..3).for_each(|_| predictor.note(&out));
            predictor.ahead(&out).committed.pop()
        };
        // Others have other states than `out`.
        let [right, published] = [ModelKind::Kinematic, ModelKind::KinematicPublished].map(last);
        assert!(right.is_some() && right != published, "{right:?}");
    }

    #[test]
    fn without_a_plan_or_an_estimate_nothing_is_made_up() {
        let predictor = predictor();
        let PredictedTrajectory { committed, plan } = predictor.ahead(&out());
        assert_eq!((committed.len(), plan.len()), (4, 0));
        let nothing = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
        assert_eq!(predictor.ahead(&nothing), PredictedTrajectory::default());
    }
}
