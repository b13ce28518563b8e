//! How soon lost commands are noticed in flight, and how often wrongly: in simulated flights, where the
//! truth is known, and in real ones, beside what is found afterwards with both sides of a moment known.

use std::f64::consts::PI;

use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks, lag, pose, stick};
use horizon_model::{InputFifo, Kinematic, Model};
use nalgebra::SVector;
use tello_eval::outage::{OutageSettings, OutageTable, lost_commands};
use tello_eval::smooth::smooth;
use tello_flight::{Acceptance, LinkDecision, LinkMonitor, LinkSettings, PoseFilter};
use tello_io::config;
use tello_sim::command_link::CommandLink;
use tello_sim::mocap::Mocap;
use tello_sim::plant::{NOMINAL, Plant, PlantParams, PlantTable, Velocity};
use tello_sim::random::{Purpose, Random};
use tello_sim::{ManualFlight, MocapReport, Profile};

use crate::recorded;
use crate::support;
use recorded::{DT_S, dead_time_s, logs, p_prior, setting};

/// Two minutes. steps
const STEPS: usize = 6000;
/// Velocity that a change of the link must have made before it is due to be noticed. m/s
const DUE_MPS: f64 = 0.3;
/// Time from there to a decision in time. s
const IN_TIME_S: f64 = 0.6;

/// The monitor that flies.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn monitor() -> LinkMonitor {
    let table = config::fly(None, None).unwrap().0.cycle.link.unwrap();
    LinkMonitor::new(&LinkSettings::try_from(&table).unwrap(), DT_S)
}

/// The filter of the flight before the monitor.
struct Eyes(PoseFilter);

impl Eyes {
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    fn new() -> Self {
        let table = config::fly(None, None).unwrap().0.cycle.filter;
        Self(PoseFilter::new((&table).try_into().unwrap()))
    }

    fn look(&mut self, raw: Option<&Pose>) -> Observed<{ pose::COUNT }> {
        let filtered = self.0.update(raw);
        let mut is_present = [filtered.position == Acceptance::Accepted; pose::COUNT];
        is_present[pose::THETA] = filtered.heading == Acceptance::Accepted;
        filtered.o.map_or_else(Observed::missing, |o| Observed { o, is_present })
    }
}

/// The nominal vehicle of the simulator, as in the settings of the monitor.
fn of_settings() -> SVector<f64, { lag::COUNT }> {
    let PlantTable { horizontal, vertical, yaw, theta_0, accel_max_mps2, .. } = NOMINAL;
    let mut p = SVector::zeros();
    p[lag::LAMBDA_H] = horizontal.gain;
    p[lag::LAMBDA_V] = vertical.gain;
    p[lag::LAMBDA_A] = yaw.gain;
    p[lag::THETA_0] = theta_0;
    p[lag::TAU_H] = horizontal.tau_s;
    p[lag::TAU_V] = vertical.tau_s;
    p[lag::TAU_A] = yaw.tau_s;
    p[lag::DEAD_H] = horizontal.dead_zone;
    p[lag::DEAD_V] = vertical.dead_zone;
    p[lag::DEAD_A] = yaw.dead_zone;
    p[lag::A_MAX] = accel_max_mps2;
    p
}

/// The FIFO of that vehicle.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fifo() -> InputFifo<{ stick::COUNT }> {
    let mut dead_time_s = Sticks::repeat(NOMINAL.horizontal.dead_time_s);
    dead_time_s[stick::YAW] = NOMINAL.yaw.dead_time_s;
    dead_time_s[stick::THROTTLE] = NOMINAL.vertical.dead_time_s;
    InputFifo::new(dead_time_s.as_slice(), &Kinematic::INPUT, DT_S).unwrap()
}

/// Roll or pitch held for a while and let go at once, as a square is flown by hand.
fn held_sticks(seed: u64) -> Vec<Sticks> {
    let mut random = Random::new(seed, Purpose::Pilot);
    let (mut u, mut left_s) = (Sticks::zeros(), 0.0);
    let next = |_| {
        left_s -= DT_S;
        if left_s <= 0.0 {
            left_s = random.between(0.6, 2.5);
            u = Sticks::zeros();
            let axis = if random.chance(0.5) { stick::ROLL } else { stick::PITCH };
            let sign = if random.chance(0.5) { 1.0 } else { -1.0 };
            u[axis] = sign * if random.chance(0.75) { random.between(0.1, 0.5) } else { 0.0 };
        }
        u
    };
    (0..STEPS).map(next).collect()
}

/// How changes of the link in one direction were noticed.
#[derive(Debug, Default)]
struct Tally {
    due: usize,
    /// From when it was due, for those noticed before the next change. s
    delays_s: Vec<f64>,
}

impl Tally {
    fn fraction_in_time(&self) -> f64 {
        let in_time = self.delays_s.iter().filter(|delay_s| **delay_s <= IN_TIME_S).count();
        in_time as f64 / self.due as f64
    }
}

/// Results of simulated flights.
#[derive(Debug, Default)]
struct Outcome {
    steps: usize,
    false_alarms: usize,
    outages: Tally,
    returns: Tally,
}

impl Outcome {
    fn print(&self, name: &str) {
        let minutes = self.steps as f64 * DT_S / 60.0;
        println!("{name}: {minutes:.0} min, {} false alarms", self.false_alarms);
        let tallies = [("outages", &self.outages), ("returns", &self.returns)];
        for (what, tally) in tallies.into_iter().filter(|(_, tally)| tally.due > 0) {
            let mut delays_s = tally.delays_s.clone();
            delays_s.sort_by(f64::total_cmp);
            let (fraction, median_s) = (tally.fraction_in_time(), delays_s.get(delays_s.len() / 2));
            println!("  {what}: {} due, {fraction:.3} in time, median {median_s:.2?} s", tally.due);
        }
    }
}

/// The vehicle as it would fly if the link had not changed.
struct Unchanged {
    vehicle: Plant,
    link_is_up: bool,
    /// Whether there is a decision to be changed.
    is_judged: bool,
    due_at: Option<usize>,
    is_noticed: bool,
}

/// Flies `u_sent` and watches.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn watch(params: &PlantParams, profile: Profile, seed: u64, u_sent: &[Sticks], sum: &mut Outcome) {
    let start = Pose::new(0.0, 0.0, 1.6, 0.0);
    let mut plant = Plant::new(*params, start, Velocity::default(), seed).unwrap();
    let (mut mocap, mut link) = (Mocap::new(profile, seed), CommandLink::new(profile, seed));
    let (mut eyes, mut monitor, mut fifo) = (Eyes::new(), monitor(), fifo());
    let mut unchanged: Option<Unchanged> = None;
    let (mut link_was_up, mut lost_at) = (true, None);
    sum.steps += u_sent.len();
    for (k, u) in u_sent.iter().enumerate() {
        let report = mocap.observe(plant.pose());
        let raw = if let MocapReport::Pose(o) = report { Some(o) } else { None };
        let decision = monitor.update(&fifo.applied(-1), &eyes.look(raw.as_ref()), &of_settings());
        if let Some(unchanged) = &mut unchanged {
            let tally = if link_was_up { &mut sum.returns } else { &mut sum.outages };
            unchanged.judge(k, &decision, &plant, tally);
        }
        // An outage that has just ended may still be noticed: its commands act on for a dead time.
        let recent = decision.onset_steps as usize + 50;
        let is_false = lost_at.is_none_or(|lost_at| lost_at + recent < k);
        sum.false_alarms +=
            usize::from(decision.has_changed && decision.state.is_down() && is_false);

        let link_is_up = link.step();
        if link_is_up != link_was_up {
            unchanged = Some(Unchanged {
                vehicle: plant.clone(),
                link_is_up: link_was_up,
                is_judged: link_was_up || decision.state.is_down(),
                due_at: None,
                is_noticed: false,
            });
        }
        lost_at = if link_is_up { lost_at } else { Some(k) };
        link_was_up = link_is_up;
        fifo.push(u);
        plant.step(u, link_is_up);
        if let Some(unchanged) = &mut unchanged {
            unchanged.vehicle.step(u, unchanged.link_is_up);
        }
    }
}

impl Unchanged {
    fn judge(&mut self, k: usize, decision: &LinkDecision, real: &Plant, tally: &mut Tally) {
        let (v, v_real) = (self.vehicle.velocity(), real.velocity());
        let gap_mps = (v.x_mps - v_real.x_mps).hypot(v.y_mps - v_real.y_mps);
        if self.due_at.is_none() && self.is_judged && gap_mps > DUE_MPS {
            self.due_at = Some(k);
            tally.due += 1;
        }
        if let Some(due_at) = self.due_at
            && !self.is_noticed
            && decision.state.is_down() == self.link_is_up
        {
            self.is_noticed = true;
            tally.delays_s.push((k - due_at) as f64 * DT_S);
        }
    }
}

/// Watches a manual flight and one with held sticks for each of `seeds`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn watch_both(
    vehicle: impl Fn(u64) -> PlantParams,
    profile: Profile,
    seeds: std::ops::RangeInclusive<u64>,
) -> Outcome {
    let mut sum = Outcome::default();
    for seed in seeds {
        let params = vehicle(seed);
        let manual = ManualFlight::fly(&params, profile, seed, STEPS).unwrap();
        watch(&params, profile, seed, &manual.u_sent, &mut sum);
        watch(&params, profile, seed, &held_sticks(seed), &mut sum);
    }
    sum
}

/// A vehicle that differs from that of the settings as flights differ.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn drawn(seed: u64) -> PlantParams {
    let params = PlantParams::try_from(NOMINAL).unwrap();
    params.draw(&mut Random::new(seed, Purpose::Vehicle))
}

#[test]
fn changes_of_the_link_are_noticed_in_time() {
    let sum = watch_both(drawn, Profile::Outages, 101..=105);
    sum.print("outages");
    assert!(sum.outages.due > 30 && sum.returns.due > 20, "{sum:?}");
    for tally in [&sum.outages, &sum.returns] {
        assert!(tally.fraction_in_time() >= 0.9, "{}", tally.fraction_in_time());
    }
    assert!(sum.false_alarms <= 1, "{} false alarms in 20 min", sum.false_alarms);
}

#[test]
fn a_link_that_holds_is_no_outage() {
    let sum = watch_both(drawn, Profile::GoodDay, 101..=105);
    sum.print("good day");
    // Less than one in 10 minutes.
    assert!(sum.false_alarms <= 1, "{} false alarms in 20 min", sum.false_alarms);
}

/// A change of the vehicle that its monitor does not know.
type Change = (&'static str, fn(&mut PlantTable));

#[test]
fn a_vehicle_that_is_not_that_of_the_settings_raises_no_alarm() {
    let changes: [Change; 9] = [
        ("gain x 0.7", |plant| plant.horizontal.gain *= 0.7),
        ("gain x 1.3", |plant| plant.horizontal.gain *= 1.3),
        ("dead time - 0.1 s", |plant| plant.horizontal.dead_time_s -= 0.1),
        ("dead time + 0.1 s", |plant| plant.horizontal.dead_time_s += 0.1),
        ("lag x 0.7", |plant| plant.horizontal.tau_s *= 0.7),
        ("lag x 1.4", |plant| plant.horizontal.tau_s *= 1.4),
        ("theta_0 - 0.3 rad", |plant| plant.theta_0 -= 0.3),
        ("theta_0 + 0.3 rad", |plant| plant.theta_0 += 0.3),
        ("disturbance 0.08 m/s", |plant| plant.disturbance_h_mps = 0.08),
    ];
    let mut false_alarms = 0;
    for (name, change) in changes {
        let mut plant = NOMINAL;
        change(&mut plant);
        let params = PlantParams::try_from(plant).unwrap();
        let sum = watch_both(|_| params, Profile::GoodDay, 101..=101);
        sum.print(name);
        false_alarms += sum.false_alarms;
    }
    assert!(false_alarms <= 3, "{false_alarms} false alarms in 36 min");
}

/// Steps of real flights.
#[derive(Debug, Default)]
struct Agreement {
    steps: usize,
    lost: usize,
    /// Called down, lost and not.
    found: usize,
    wrong: usize,
    alarms: usize,
    /// Alarms with no lost step within a second of the time that they claim.
    alone: usize,
    /// From the beginning of an outage to the decision. s
    delays_s: Vec<f64>,
    unnoticed: usize,
}

impl Agreement {
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    fn add(&mut self, recording: &Recording<4, 4>, is_raw: bool) {
        let applied = recording.applied(&dead_time_s(), DT_S);
        let track = smooth(&recording.o, DT_S);
        let outage = OutageSettings::try_from(&setting::<OutageTable>("lost_commands")).unwrap();
        let is_lost = lost_commands(&outage, &applied, &track, DT_S);

        let (mut eyes, mut monitor) = (Eyes::new(), monitor());
        let (mut u_applied, mut before) = (Sticks::zeros(), None);
        let mut decisions = Vec::with_capacity(applied.len());
        for (o, u) in recording.o.iter().zip(&applied) {
            let raw = o.is_present[pose::X].then_some(o.o);
            // A repeated pose of the motion capture is a stall: nothing was seen.
            let seen = raw.filter(|_| before != raw);
            before = raw;
            let observed = if is_raw { eyes.look(seen.as_ref()) } else { *o };
            decisions.push(monitor.update(&u_applied, &observed, &p_prior()));
            u_applied = *u;
        }
        self.count(&is_lost, &decisions);
    }

    fn count(&mut self, is_lost: &[bool], decisions: &[LinkDecision]) {
        let last = is_lost.len();
        self.steps += last;
        for (k, (is_lost_now, decision)) in is_lost.iter().zip(decisions).enumerate() {
            self.lost += usize::from(*is_lost_now);
            self.found += usize::from(*is_lost_now && decision.state.is_down());
            self.wrong += usize::from(!is_lost_now && decision.state.is_down());
            if decision.has_changed && decision.state.is_down() {
                let from = k.saturating_sub(decision.onset_steps as usize + 50);
                let is_near = is_lost[from..(k + 50).min(last)].contains(&true);
                self.alarms += 1;
                self.alone += usize::from(!is_near);
            }
        }
        let mut from = 0;
        for run in is_lost.chunk_by(|left, right| left == right) {
            if run.first() == Some(&true) {
                match decisions[from..from + run.len()].iter().position(|v| v.state.is_down()) {
                    Some(steps) => self.delays_s.push(steps as f64 * DT_S),
                    None => self.unnoticed += 1,
                }
            }
            from += run.len();
        }
    }

    fn recall(&self) -> f64 {
        self.found as f64 / self.lost as f64
    }

    fn wrong_fraction(&self) -> f64 {
        self.wrong as f64 / (self.steps - self.lost) as f64
    }
}

#[test]
fn verdicts_in_real_flights_agree_with_what_is_found_afterwards() {
    // Recall and fraction of the other steps called down, with a margin of a fifth of what was measured.
    // Neither side is the truth: the outages found afterwards miss a third of those simulated.
    for (folder, prefix, turn_rad, is_raw, recall_min, wrong_max) in [
        ("thesis/ident/raw", "", 0.0, true, 0.45, 0.05),
        ("thesis/manual/raw", "", PI, true, 0.25, 0.03),
        ("thesis/squares", "", 0.0, false, 0.4, 0.04),
        ("thesis/closed_loop", "square", 0.0, false, 0.55, 0.04),
    ] {
        let Some(path) = support::data(folder) else { return };
        let mut sum = Agreement::default();
        for log in logs(&path, prefix) {
            sum.add(&recorded::read(&log, turn_rad), is_raw);
        }
        sum.delays_s.sort_by(f64::total_cmp);
        println!(
            "{folder}: {:.0} s, lost {:.3}, recall {:.2}, wrong {:.3}, {} of {} outages unnoticed, \
             median delay {:.2?} s, {} of {} alarms alone",
            sum.steps as f64 * DT_S,
            sum.lost as f64 / sum.steps as f64,
            sum.recall(),
            sum.wrong_fraction(),
            sum.unnoticed,
            sum.unnoticed + sum.delays_s.len(),
            sum.delays_s.get(sum.delays_s.len() / 2),
            sum.alone,
            sum.alarms,
        );
        assert!(sum.recall() > recall_min, "{folder}: {}", sum.recall());
        assert!(sum.wrong_fraction() < wrong_max, "{folder}: {}", sum.wrong_fraction());
    }
}
