//! Inputs of a plan that are sent already.
//!
//! Owns from which stage on each stick is free: dead times differ between axes.

use horizon_control::MpcSettings;
use horizon_model::rows::{Sticks, stick};

/// Steps of a plan in which each axis is already decided, with these dead times in steps.
pub(super) fn given_steps(dead_time_steps: &Sticks) -> [usize; stick::COUNT] {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0..=500")]
    let whole = |steps: f64| steps as usize;
    let shortest = whole(dead_time_steps.min());
    std::array::from_fn(|axis| whole(dead_time_steps[axis]) - shortest)
}

/// Committed inputs of a plan by axis. Corrections of the dead times change the differences between axes: throttle and
/// yaw have their own, and none falls below its least one (`dead_time_min_ratio`).
#[derive(Debug, Clone, Copy)]
pub(super) struct Committed {
    pub(super) dead_time_steps: Sticks,
    /// Most of [`given_steps`].
    pub(super) steps_max: usize,
    /// [`given_steps`], to the nearest begin of a stage.
    pub(super) given_steps: [usize; stick::COUNT],
    /// Stages of the first step that is not given, and of the one after it.
    pub(super) open_stages: [[usize; 2]; stick::COUNT],
    /// Part of a step by which the dead time exceeds whole steps.
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
        let open_stages =
            given_steps.map(|step| [step, step + 1].map(|step| settings.stage_of(step)));
        Self {
            dead_time_steps: *dead_time_steps,
            steps_max: steps.into_iter().max().unwrap_or(0),
            given_steps,
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
