use horizon_model::rows::{Motion, Pose, stick};
use horizon_model::{Lagged, Model};

use super::*;

const DT_S: f64 = 0.02;

pub(crate) fn table() -> LinkTable {
    LinkTable {
        sd_position_m: 0.012,
        sd_disturbance_mps: 0.07,
        decay_s: 1.2,
        sd_gain: 0.15,
        sd_heading_rad: 0.15,
        sd_dead_time_s: 0.06,
        sd_rate: 0.2,
        adapt_s: 30.0,
        dead_time_adapt_s: Some(100.0),
        outage_evidence: 10.0,
        return_evidence: 5.0,
        forget_s: 10.0,
        dead_time_change_s: 0.0,
        dead_time_min_ratio: 0.5,
        outage_stick_max: Some(0.4),
        dead_time: Some(DeadTimeTable { sd_position_m: 0.004, adapt_s: 1000.0 }),
        turn: Some(TurnTable { sd_theta_rad: 0.03, sd_disturbance_radps: 0.2, decay_s: 0.5 }),
        height: Some(HeightTable {
            sd_z_m: 0.01,
            sd_disturbance_mps: 0.05,
            decay_s: 1.2,
            adapt_s: 300.0,
        }),
    }
}

/// The vehicle of the real flights, as identified.
pub(crate) fn parameter() -> SVector<f64, { lag::COUNT }> {
    SVector::from([2.0, 0.89, 1.4, -0.05, 0.63, 0.25, 0.12, 0.07, 0.12, 0.08, 1.04])
}

impl LinkMonitor {
    /// Error of the dead time of yaw by the filter of the heading. s
    pub(crate) fn yaw_dead_time_error_s(&self) -> Option<f64> {
        Some(self.test.as_ref()?.present.turn.as_ref()?.dead_time_error().mean_s)
    }
}

/// A monitor beside a vehicle that is the model.
struct Flight {
    monitor: LinkMonitor,
    s: Motion,
    step: usize,
    /// Error of the observed heading. rad
    turned_rad: f64,
}

impl Flight {
    fn new() -> Self {
        let settings = LinkSettings::try_from(&table()).unwrap();
        let s = Lagged::default().at_rest(&Pose::new(0.5, -0.2, 1.0, 0.4));
        let mut flight =
            Self { monitor: LinkMonitor::new(&settings, DT_S), s, step: 0, turned_rad: 0.0 };
        flight.fly(1, 0.0, true);
        flight
    }

    /// Flies `steps` with `pitch`, which the vehicle receives or not; the decision of every step.
    fn fly(&mut self, steps: usize, pitch: f64, is_heard: bool) -> Vec<LinkDecision> {
        self.fly_as(steps, pitch, if is_heard { pitch } else { 0.0 })
    }

    /// Flies `steps` with `pitch` sent and `pitch_real` applied; the decision of every step.
    fn fly_as(&mut self, steps: usize, pitch: f64, pitch_real: f64) -> Vec<LinkDecision> {
        self.fly_with(stick::PITCH, steps, pitch, pitch_real)
    }

    /// As [`Flight::fly_as`], with the stick `axis`.
    fn fly_with(&mut self, axis: usize, steps: usize, sent: f64, real: f64) -> Vec<LinkDecision> {
        let (mut u, mut u_real) = (Sticks::zeros(), Sticks::zeros());
        u[axis] = sent;
        u_real[axis] = real;
        (0..steps)
            .map(|_| {
                self.s = Lagged::default().step(&self.s, &u_real, &parameter(), DT_S);
                self.step += 1;
                let mut o = Lagged::default().observe(&self.s);
                // 1 mm of noise that repeats every seven steps.
                o[pose::X] += 5e-4 * ((self.step * 3 % 7) as f64 - 3.0);
                o[pose::THETA] = horizon_model::angle::wrap(o[pose::THETA] + self.turned_rad);
                self.monitor.update(&u, &Observed::full(o), &parameter())
            })
            .collect()
    }
}

#[test]
fn an_outage_and_its_end_are_found_with_their_moments() {
    let mut flight = Flight::new();
    assert!(flight.fly(200, 0.3, true).iter().all(|decision| !decision.state.is_down()));
    for (is_heard, steps_max) in [(false, 40), (true, 40)] {
        let decisions = flight.fly(100, 0.3, is_heard);
        let found = decisions.iter().position(|decision| decision.has_changed).unwrap();
        let LinkDecision { state, onset_steps, .. } = decisions[found];
        let is_down = state.is_down();
        println!("heard {is_heard}: found after {} steps, onset {onset_steps}", found + 1);
        assert_eq!(is_down, !is_heard);
        assert!(found < steps_max, "{found}");
        // A tenth of a second of noise before the change may look like it.
        assert!((found + 1).abs_diff(onset_steps as usize) <= 5, "{found}, {onset_steps}");
        assert_eq!(decisions.iter().filter(|decision| decision.has_changed).count(), 1);
        assert!(decisions[found..].iter().all(|decision| decision.state.is_down() == is_down));
    }
}

/// What the monitor finds of the dead time after 20 s of changing pitch that acts `late_steps` after it was expected
/// to.
fn delayed(late_steps: i32) -> DeadTimeError {
    let mut flight = Flight::new();
    let pitch = |k: i32| {
        let t_s = f64::from(k) * DT_S;
        0.3 * (3.0 * t_s).sin() + 0.25 * (8.0 * t_s).sin()
    };
    for k in 0..1000 {
        flight.fly_as(1, pitch(k), pitch(k - late_steps));
    }
    flight.monitor.dead_time_errors().unwrap().horizontal
}

#[test]
fn an_error_of_the_dead_time_is_found() {
    for late_steps in [-4, -2, 0, 2, 4] {
        let error = delayed(late_steps);
        let late_s = f64::from(late_steps) * DT_S;
        println!("{late_s} s: {error:?}");
        assert!(
            (error.mean_s - late_s).abs() < 0.003 + 0.12 * late_s.abs(),
            "{late_s} s: {error:?}"
        );
        assert!(error.sd_s < 0.6 * table().sd_dead_time_s, "{error:?}");
    }
}

#[test]
fn a_dead_time_far_from_the_link_s_starts_again_from_it() {
    let mut flight = Flight::new();
    flight.fly(100, 0.3, true);
    let [before, after] = [0.0, 0.5].map(|longer_s| {
        let hypothesis = &mut flight.monitor.test.as_mut().unwrap().present;
        hypothesis.dead_time.as_mut().unwrap().correct_dead_time(longer_s);
        flight.fly(1, 0.3, true);
        let hypothesis = &flight.monitor.test.as_ref().unwrap().present;
        hypothesis.dead_time.as_ref() == Some(&hypothesis.horizontal)
    });
    assert_eq!((before, after), (false, true));
}

#[test]
fn an_outage_is_no_delay() {
    let mut flight = Flight::new();
    assert!(flight.monitor.dead_time_errors().is_some());
    flight.fly(100, 0.3, true);
    let before = flight.monitor.dead_time_errors().unwrap().horizontal;
    // From the first doubt on there is no answer, and what the outage looked like is forgotten with it.
    let silent = (0..40).filter(|_| {
        flight.fly(1, 0.3, false);
        flight.monitor.dead_time_errors().is_none()
    });
    assert!(silent.count() > 20);
    flight.fly(40, 0.3, true);
    let after = flight.monitor.dead_time_errors().unwrap().horizontal;
    assert!((after.mean_s - before.mean_s).abs() < 0.01, "{before:?}, {after:?}");
}

#[test]
fn a_held_command_is_distinguished_from_a_released_one() {
    let mut flight = Flight::new();
    assert!(flight.fly(200, 0.4, true).iter().all(|decision| decision.state == LinkState::Up));
    // The drone goes on with 0.4 while it is ordered to brake.
    let mut held = Vec::new();
    for _ in 0..80 {
        held.extend(flight.fly_as(1, -0.4, 0.4));
    }
    let found = held.iter().position(|decision| decision.has_changed).unwrap();
    assert!(found < 50, "{found}");
    assert_eq!(held[found].state, LinkState::Held);
    assert!((found + 1).abs_diff(held[found].onset_steps as usize) <= 8, "{:?}", held[found]);
    assert!(held[found..].iter().all(|decision| decision.state == LinkState::Held));
    let back = flight.fly(100, -0.4, true);
    assert_eq!(back.last().unwrap().state, LinkState::Up);
}

#[test]
fn a_turn_shows_an_outage_and_its_end() {
    let mut flight = Flight::new();
    let up = flight.fly_with(stick::YAW, 400, 0.5, 0.5);
    assert!(up.iter().all(|decision| decision.state == LinkState::Up));
    let lost = flight.fly_with(stick::YAW, 150, 0.5, 0.0);
    let found = lost.iter().position(|decision| decision.has_changed).unwrap();
    println!("outage after {} steps, onset {}", found + 1, lost[found].onset_steps);
    assert!(found < 100 && lost[found].state == LinkState::Released, "{:?}", lost[found]);
    assert!((found + 1).abs_diff(lost[found].onset_steps as usize) <= 5, "{:?}", lost[found]);
    let back = flight.fly_with(stick::YAW, 100, 0.5, 0.5);
    let found = back.iter().position(|decision| decision.has_changed).unwrap();
    println!("end after {} steps", found + 1);
    assert!(found < 40 && back[99].state == LinkState::Up, "{found} {:?}", back[99]);
    // The drone goes on turning while it is ordered to turn back.
    let held = flight.fly_with(stick::YAW, 60, -0.5, 0.5);
    assert!(held.iter().any(|decision| decision.state == LinkState::Held), "{:?}", held[59]);
}

#[test]
fn an_outage_of_the_horizontal_sticks_ends_with_a_turn() {
    let mut flight = Flight::new();
    flight.fly(100, 0.3, true);
    assert!(flight.fly(60, 0.3, false).iter().any(|decision| decision.state.is_down()));
    let rest = flight.fly(100, 0.0, false);
    assert!(rest.iter().all(|decision| decision.state.is_down()), "the sticks rest");
    let turn = flight.fly_with(stick::YAW, 50, 0.4, 0.4);
    let found = turn.iter().position(|decision| !decision.state.is_down()).unwrap();
    assert!(found < 40, "{found}");
}

#[test]
fn a_wrong_heading_is_no_evidence() {
    // A small turn for as long is a turn to this filter; the outlier filter before it holds the short ones.
    for (turned_rad, longest) in [(0.4, 10), (-1.3, 60), (2.0, 60), (3.1, 60)] {
        let mut flight = Flight::new();
        for k in 0..40 {
            // As long as rigid bodies were seen turned, 5 to 60 steps, and right in between.
            let is_turned = k % 2 == 1;
            flight.turned_rad = if is_turned { turned_rad } else { 0.0 };
            let steps = if is_turned { [5, 10, longest][k % 3] } else { 100 };
            let decisions = flight.fly_with(stick::YAW, steps, 0.2, 0.2);
            assert!(
                decisions.iter().all(|decision| !decision.state.is_down()),
                "{turned_rad}, {k}"
            );
        }
    }
}

#[test]
fn without_its_settings_the_heading_shows_nothing() {
    let mut flight = Flight::new();
    let settings = LinkSettings::try_from(&LinkTable { turn: None, ..table() }).unwrap();
    flight.monitor = LinkMonitor::new(&settings, DT_S);
    flight.fly(100, 0.0, true);
    let decisions = flight.fly_with(stick::YAW, 100, 0.5, 0.0);
    let (first, last) = (decisions[0].score, decisions[99].score);
    assert!((first + table().outage_evidence).abs() < 1e-9, "{first}");
    assert!((first - last).abs() < 1e-12, "{first} {last}");
}

#[test]
fn the_score_is_positive_exactly_while_the_link_is_down() {
    let mut flight = Flight::new();
    let mut decisions = flight.fly(100, 0.3, true);
    decisions.extend(flight.fly(100, 0.3, false));
    decisions.extend(flight.fly(100, 0.3, true));
    assert!(decisions.iter().any(|decision| decision.state.is_down()));
    for decision in decisions {
        assert_eq!(decision.score > 0.0, decision.state.is_down(), "{decision:?}");
        assert_eq!(decision.onset_steps > 0, decision.has_changed, "{decision:?}");
    }
}

#[test]
fn sticks_in_the_dead_zone_say_nothing_and_an_outage_fades() {
    let mut flight = Flight::new();
    let quiet = flight.fly(500, 0.06, true);
    for decision in &quiet {
        assert!((decision.score + table().outage_evidence).abs() < 1e-12, "{decision:?}");
    }
    flight.fly(100, 0.3, true);
    assert!(flight.fly(60, 0.3, false).iter().any(|decision| decision.state.is_down()));
    // The vehicle comes to rest, the outage goes on.
    let decisions = flight.fly(700, 0.0, false);
    let faded = decisions.iter().position(|decision| !decision.state.is_down()).unwrap();
    // Evidence that was left when the sticks were released shifts it by a second.
    let faded_s = faded as f64 * DT_S;
    assert!((faded_s - table().forget_s).abs() < 1.0, "{faded_s} s");
}

#[test]
fn an_outage_that_every_probe_confirms_lasts_long() {
    let mut flight = Flight::new();
    flight.fly(100, 0.3, true);
    assert!(flight.fly(60, 0.3, false).iter().any(|decision| decision.state.is_down()));
    for probe in 0..30 {
        let sign = if probe % 2 == 0 { 1.0 } else { -1.0 };
        let decisions = flight.fly(50, 0.25 * sign, false);
        assert!(decisions.iter().all(|decision| decision.state.is_down()), "probe {probe}");
    }
    let decisions = flight.fly(100, 0.25, true);
    let found = decisions.iter().position(|decision| !decision.state.is_down()).unwrap();
    assert!(found < 50, "{found} steps");
}

#[test]
fn missing_rows_are_no_evidence() {
    let mut monitor = LinkMonitor::new(&LinkSettings::try_from(&table()).unwrap(), DT_S);
    let u = Sticks::repeat(0.5);
    let mut observed = Observed::missing();
    observed.o = Pose::repeat(f64::NAN);
    // Neither before the first pose nor after it.
    for o in [observed, Observed::full(Pose::zeros()), observed, observed, observed] {
        let decision = monitor.update(&u, &o, &parameter());
        assert!((decision.score + table().outage_evidence).abs() < 1e-12, "{decision:?}");
    }
    let seen = monitor.update(&u, &Observed::full(Pose::zeros()), &parameter());
    assert!(seen.score > -table().outage_evidence, "{seen:?}");
}

#[test]
fn the_direction_of_flight_is_the_heading_and_its_offset() {
    let mut p = parameter();
    p[lag::THETA_0] = 1.5;
    let settings = LinkSettings::try_from(&table()).unwrap();
    let mut monitor = LinkMonitor::new(&settings, DT_S);
    let mut s = Lagged::default().at_rest(&Pose::new(0.5, -0.2, 1.0, 0.4));
    for k in 0..200 {
        let mut u = Sticks::zeros();
        u[stick::PITCH] = if k < 5 { 0.0 } else { 0.3 };
        s = Lagged::default().step(&s, &u, &p, DT_S);
        let decision = monitor.update(&u, &Observed::full(Lagged::default().observe(&s)), &p);
        assert!(!decision.state.is_down(), "{k}: {decision:?}");
    }
}
