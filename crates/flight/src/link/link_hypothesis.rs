//! One hypothesis of the test: the motion under one state of the link, horizontally, in heading and in height.

use horizon_estim::Observed;
use horizon_model::rows::{Sticks, lag, pose, stick};
use nalgebra::{SVector, Vector2};

use super::axis::{AxisCommand, AxisFilter};
use super::horizontal::{Horizontal, HorizontalCommand};
use super::{LinkState, Tables};
use crate::commanded::{commanded_w_mps, excess};

/// Velocities that the sticks command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Commanded {
    /// `c`: velocity along the floor, world frame. m/s
    vel_w_mps: Vector2<f64>,
    /// Turn. rad/s
    omega_radps: f64,
    /// Climb. m/s
    climb_mps: f64,
}

/// Velocities that the sticks command in one period, and their derivatives by time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Commands {
    horizontal: HorizontalCommand,
    turn: AxisCommand,
    climb: AxisCommand,
}

/// The motion under one state of the link.
#[derive(Debug, Clone)]
pub(super) struct LinkHypothesis {
    pub(super) state: LinkState,
    pub(super) horizontal: Horizontal,
    /// Filter of the horizontal motion for the dead time. `None`: `horizontal` finds it.
    pub(super) dead_time: Option<Horizontal>,
    /// `None`: the heading is not used.
    pub(super) turn: Option<AxisFilter>,
    /// The height, for the dead time of the throttle. `None`: it is that of the others.
    pub(super) height: Option<AxisFilter>,
    /// Velocities that are commanded while a command is held.
    held: Commanded,
}

impl LinkHypothesis {
    /// The motion while the link is up, from the pose `observed` on.
    pub(super) fn start(tables: &Tables, observed: &Observed<{ pose::COUNT }>) -> Self {
        let (link, o) = (&tables.link, &observed.o);
        let pos_w = Vector2::new(o[pose::X], o[pose::Y]);
        Self {
            state: LinkState::Up,
            horizontal: Horizontal::new(link, pos_w),
            dead_time: tables.dead_time.as_ref().map(|table| Horizontal::new(table, pos_w)),
            turn: link.turn.map(|own| AxisFilter::new(link, own.noise(link), o[pose::THETA])),
            height: link.height.map(|own| AxisFilter::new(link, own.noise(), o[pose::Z])),
            held: Commanded::default(),
        }
    }

    /// Moves through a period in which `sent` was commanded.
    pub(super) fn predict(
        &mut self,
        tables: &Tables,
        sent: &Commands,
        p: &SVector<f64, { lag::COUNT }>,
        dt_s: f64,
    ) {
        let commands = match self.state {
            LinkState::Up => *sent,
            LinkState::Released => Commands::default(),
            LinkState::Held => self.held.constant(),
        };
        self.horizontal.predict(&tables.link, &commands.horizontal, p, dt_s);
        if let (Some(filter), Some(table)) = (&mut self.dead_time, &tables.dead_time) {
            filter.predict(table, &commands.horizontal, p, dt_s);
        }
        if let Some(turn) = &mut self.turn {
            turn.predict(&tables.link, commands.turn, p[lag::TAU_A], dt_s);
        }
        if let Some(height) = &mut self.height {
            height.predict(&tables.link, commands.climb, p[lag::TAU_V], dt_s);
        }
    }

    /// Log likelihood of what was seen, up to a constant.
    pub(super) fn correct(
        &mut self,
        tables: &Tables,
        observed: &Observed<{ pose::COUNT }>,
        dt_s: f64,
    ) -> f64 {
        let log_likelihood = self.horizontal.correct(&tables.link, observed);
        if let (Some(filter), Some(table)) = (&mut self.dead_time, &tables.dead_time) {
            filter.correct(table, observed);
            filter.keep_to(&self.horizontal);
        }
        let seen = |row: usize| observed.is_present[row].then(|| observed.o[row]);
        let correct = |axis: &mut Option<AxisFilter>, row| {
            axis.as_mut().map(|axis| axis.correct(&tables.link, seen(row), dt_s))
        };
        correct(&mut self.height, pose::Z);
        let turn = correct(&mut self.turn, pose::THETA);
        log_likelihood + turn.unwrap_or(0.0)
    }

    pub(super) fn correct_dead_time(&mut self, longer_s: &Sticks) {
        self.horizontal.correct_dead_time(longer_s[stick::PITCH]);
        if let Some(filter) = &mut self.dead_time {
            filter.correct_dead_time(longer_s[stick::PITCH]);
        }
        if let Some(turn) = &mut self.turn {
            turn.correct_dead_time(longer_s[stick::YAW]);
        }
        if let Some(height) = &mut self.height {
            height.correct_dead_time(longer_s[stick::THROTTLE]);
        }
    }

    /// The motion if the link changes to `state` now, `held` being commanded.
    pub(super) fn changed_to(&self, state: LinkState, held: Commanded) -> Self {
        Self { state, held, ..self.clone() }
    }
}

impl Commanded {
    /// Velocities that `u_applied` command, heading for `theta_rad`, with the parameter `p`.
    pub(super) fn of(u_applied: &Sticks, theta_rad: f64, p: &SVector<f64, { lag::COUNT }>) -> Self {
        let psi_rad = theta_rad + p[lag::THETA_0];
        Self {
            vel_w_mps: commanded_w_mps(u_applied, psi_rad, p[lag::LAMBDA_H], p[lag::DEAD_H]),
            omega_radps: p[lag::LAMBDA_A] * excess(u_applied[stick::YAW], p[lag::DEAD_A]),
            climb_mps: p[lag::LAMBDA_V] * excess(u_applied[stick::THROTTLE], p[lag::DEAD_V]),
        }
    }

    fn constant(self) -> Commands {
        self.after(self, 1.0)
    }

    /// The commands of a period of `dt_s` before which `before` was commanded.
    pub(super) fn after(self, before: Self, dt_s: f64) -> Commands {
        Commands {
            horizontal: HorizontalCommand {
                commanded_w_mps: self.vel_w_mps,
                rate_w_mps2: (self.vel_w_mps - before.vel_w_mps) / dt_s,
            },
            turn: AxisCommand {
                asked: self.omega_radps,
                rate: (self.omega_radps - before.omega_radps) / dt_s,
            },
            climb: AxisCommand {
                asked: self.climb_mps,
                rate: (self.climb_mps - before.climb_mps) / dt_s,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::{Motion, Pose};
    use horizon_model::{Lagged, Model};

    use super::super::tests::{parameter, table};
    use super::*;

    const DT_S: f64 = 0.02;

    fn full(stick: usize, u: f64) -> Sticks {
        let mut u_applied = Sticks::zeros();
        u_applied[stick] = u;
        u_applied
    }

    /// Evidence of a second of flight by `u_applied` for the link in `state`, `held` being commanded.
    fn log_likelihood(state: LinkState, u_applied: &Sticks, held: Commanded) -> f64 {
        let (tables, p, model) =
            (Tables { link: table(), dead_time: None }, parameter(), Lagged::default());
        let mut s = model.at_rest(&Pose::new(0.3, -0.2, 1.0, 0.4));
        let seen = |s: &Motion| Observed::full(model.observe(s));
        let mut hypothesis = LinkHypothesis::start(&tables, &seen(&s)).changed_to(state, held);
        let commanded = Commanded::of(u_applied, 0.4, &p);
        let mut sum = 0.0;
        for _ in 0..50 {
            s = model.step(&s, u_applied, &p, DT_S);
            hypothesis.predict(&tables, &commanded.constant(), &p, DT_S);
            sum += hypothesis.correct(&tables, &seen(&s), DT_S);
        }
        sum
    }

    #[test]
    fn sticks_ask_for_what_the_vehicle_does_at_last() {
        let (p, model) = (parameter(), Lagged::default());
        for (stick, u) in [stick::ROLL, stick::PITCH, stick::YAW, stick::THROTTLE]
            .into_iter()
            .flat_map(|stick| [0.5, -0.5].map(|u| (stick, u)))
        {
            let u_applied = full(stick, u);
            let commanded = Commanded::of(&u_applied, 0.4, &p);
            let mut s = model.at_rest(&Pose::new(0.0, 0.0, 1.0, 0.4));
            for _ in 0..2000 {
                s = model.step(&s, &u_applied, &p, DT_S);
            }
            let next = model.step(&s, &u_applied, &p, DT_S);
            let rate = (model.observe(&next) - model.observe(&s)) / DT_S;
            let off = [
                rate[pose::X] - commanded.vel_w_mps.x,
                rate[pose::Y] - commanded.vel_w_mps.y,
                rate[pose::Z] - commanded.climb_mps,
                rate[pose::THETA] - commanded.omega_radps,
            ];
            // The model rounds its dead zone.
            assert!(off.iter().all(|off| off.abs() < 1e-4), "stick {stick}: {off:?}");
        }
    }

    #[test]
    fn commands_change_by_the_difference_to_the_period_before() {
        let p = parameter();
        let (before, now) = (Commanded::default(), Commanded::of(&Sticks::repeat(0.5), 0.4, &p));
        let Commands { horizontal, turn, climb } = now.after(before, DT_S);
        assert_eq!(horizontal.commanded_w_mps, now.vel_w_mps);
        assert_eq!(horizontal.rate_w_mps2, now.vel_w_mps / DT_S);
        assert_eq!(turn, AxisCommand { asked: now.omega_radps, rate: now.omega_radps / DT_S });
        assert_eq!(climb, AxisCommand { asked: now.climb_mps, rate: now.climb_mps / DT_S });
        assert_eq!(now.constant(), now.after(now, 0.1));
    }

    #[test]
    fn motion_by_the_sticks_speaks_for_a_link_that_is_up_or_holds_them() {
        for stick in [stick::ROLL, stick::PITCH, stick::YAW] {
            let u_applied = full(stick, 0.6);
            let [same, other] =
                [u_applied, -u_applied].map(|u| Commanded::of(&u, 0.4, &parameter()));
            let up = log_likelihood(LinkState::Up, &u_applied, other);
            let released = log_likelihood(LinkState::Released, &u_applied, other);
            let held = log_likelihood(LinkState::Held, &u_applied, same);
            let held_other = log_likelihood(LinkState::Held, &u_applied, other);
            assert!(up > released + 1.0 && up > held_other + 1.0, "stick {stick}");
            assert!((up - held).abs() < 1e-9, "stick {stick}: {up} {held}");
        }
    }
}
