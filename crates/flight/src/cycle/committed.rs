//! Inputs of a plan that are sent already.
//!
//! Owns from which stage on each stick is free: dead times differ between axes.

use horizon_control::MpcSettings;
use horizon_model::rows::{Sticks, stick};
use horizon_model::whole;

/// Steps of a plan in which each axis is already decided, with these dead times in steps.
pub(super) fn given_steps(dead_time_steps: &Sticks) -> [usize; stick::COUNT] {
    let shortest = whole(dead_time_steps.min());
    std::array::from_fn(|axis| whole(dead_time_steps[axis]) - shortest)
}

/// Committed inputs of a plan by axis. Corrections of the dead times change the differences between axes: throttle and
/// yaw have their own, and none falls below its least one (`dead_time_min_ratio`).
#[derive(Debug, Clone, Copy)]
pub(super) struct Committed {
    /// Dead time of each axis. steps
    pub(super) dead_time_steps: Sticks,
    /// Most of [`given_steps`]. steps
    pub(super) steps_max: usize,
    /// [`given_steps`], to the nearest begin of a stage.
    pub(super) given_steps: [usize; stick::COUNT],
    /// First step of the last stage that is given; none of an axis without given steps.
    pub(super) last_given_steps: [usize; stick::COUNT],
    /// Stages of the first step that is not given, and of the one after it.
    pub(super) open_stages: [[usize; 2]; stick::COUNT],
    /// Fraction of a step by which the dead time exceeds whole steps. 1
    pub(super) fraction: Sticks,
    /// Stages in which some axis is decided.
    pub(super) given_stages: usize,
}

impl Committed {
    pub(super) fn new<const NS: usize>(
        dead_time_steps: &Sticks,
        settings: &MpcSettings<NS, { stick::COUNT }>,
    ) -> Self {
        let steps = given_steps(dead_time_steps);
        let given_steps = steps.map(|step| settings.nearest_boundary(step));
        let begin_of = |stage: usize| -> usize {
            settings.stage_steps().iter().take(stage).map(|steps| *steps as usize).sum()
        };
        let last_given_steps =
            given_steps.map(|step| begin_of(settings.stage_of(step.saturating_sub(1))));
        let open_stages =
            given_steps.map(|step| [step, step + 1].map(|step| settings.stage_of(step)));
        Self {
            dead_time_steps: *dead_time_steps,
            steps_max: steps.into_iter().max().unwrap_or(0),
            given_steps,
            last_given_steps,
            open_stages,
            fraction: dead_time_steps.map(f64::fract),
            given_stages: open_stages.into_iter().map(|[open, _]| open).max().unwrap_or(0),
        }
    }

    /// Most of `given_steps`.
    pub(super) fn given_steps_max(&self) -> usize {
        self.given_steps.into_iter().max().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;

    use super::*;

    /// Stages of 1, 1, 4, 4 and 2 steps.
    fn settings() -> MpcSettings<4, { stick::COUNT }> {
        MpcSettings::builder(12).stages(&[(2, 1), (2, 4), (1, 2)]).build(&Kinematic).unwrap()
    }

    #[test]
    fn each_axis_is_decided_as_much_longer_as_it_acts_later() {
        let dead_time_steps = Sticks::new(9.5, 9.0, 2.25, 4.75);
        assert_eq!(given_steps(&dead_time_steps), [7, 7, 0, 2]);
        assert_eq!(given_steps(&Sticks::repeat(3.9)), [0; stick::COUNT]);
        let committed = Committed::new(&dead_time_steps, &settings());
        assert_eq!(
            (committed.steps_max, committed.fraction),
            (7, Sticks::new(0.5, 0.0, 0.25, 0.75))
        );
    }

    #[test]
    fn a_stage_is_given_or_free_as_a_whole() {
        let settings = settings();
        let begins: Vec<usize> = (0..=12).filter(|step| settings.is_boundary(*step)).collect();
        let committed =
            |steps: f64| Committed::new(&Sticks::new(steps, steps, 0.0, 0.0), &settings);
        for steps in 0..=12_u32 {
            let found = committed(f64::from(steps));
            let [given, .., throttle] = found.given_steps;
            let off = begins.iter().map(|begin| begin.abs_diff(steps as usize)).min();
            assert_eq!(Some(given.abs_diff(steps as usize)), off, "{steps}: {begins:?}");
            assert!(begins.contains(&given) && throttle == 0);
            let [[open, next], ..] = found.open_stages;
            assert_eq!((open, next), (settings.stage_of(given), settings.stage_of(given + 1)));
            assert_eq!((found.given_stages, found.given_steps_max()), (open, given));
        }
    }
}
