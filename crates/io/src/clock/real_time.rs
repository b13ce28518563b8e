//! Real-time scheduling for the threads of a flight, where the machine permits it.

use nix::errno::Errno;
use nix::sched::{CpuSet, sched_setaffinity};
use nix::sys::mman::{MlockAllFlags, mlockall};
use nix::unistd::Pid;
use thiserror::Error;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// Task of a thread in a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Reads the motion capture.
    Mocap,
    /// Estimates and plans.
    Control,
    /// Talks to the drone: it levels the sticks and lands when control hangs, busy or not.
    Sender,
    /// Lands when the sender hangs.
    Guardian,
}

impl Role {
    /// Above every ordinary thread, below the kernel's own real-time threads (50 and more), and a thread
    /// that watches above the one that it watches. A source that floods must not take the processor from those who fly.
    fn fifo_priority(self) -> u8 {
        match self {
            Self::Mocap => 39,
            Self::Control => 40,
            Self::Sender => 45,
            Self::Guardian => 48,
        }
    }
}

/// Why the loop runs with ordinary timing, and the command that would change it.
#[derive(Debug, Error)]
pub enum RealTimeWarning {
    /// The thread stays among the ordinary ones.
    #[error(
        "no real-time priority ({0}): ticks may be late by milliseconds under load; permit it with \
         `sudo setcap cap_sys_nice,cap_ipc_lock,cap_sys_resource+ep $(command -v tello-ctl)`"
    )]
    Priority(thread_priority::Error),
    /// Memory may be paged out.
    #[error(
        "memory is not locked ({0}): a page read from disk may delay a tick; permit it with \
         `sudo setcap cap_sys_nice,cap_ipc_lock,cap_sys_resource+ep $(command -v tello-ctl)`"
    )]
    Memory(Errno),
    /// The thread goes on from core to core.
    #[error(
        "not bound to core {core} ({reason}): `nproc` counts the cores, from 0; real_time.core = null \
         lets the system choose"
    )]
    Core {
        /// The core as configured.
        core: usize,
        /// The system's answer.
        reason: Errno,
    },
}

/// Moves the calling thread to the `SCHED_FIFO` priority of `role`: 39 for the motion capture, 40 for control, 45 for
/// the sender, 48 for the guardian. Threads that it starts afterwards have the same.
///
/// # Errors
/// The system refuses: the thread stays among the ordinary ones.
pub fn request_priority(role: Role) -> Result<(), RealTimeWarning> {
    let priority = ThreadPriorityValue::try_from(role.fifo_priority())
        .map_or(ThreadPriority::Min, ThreadPriority::Crossplatform);
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    set_thread_priority_and_policy(thread_native_id(), priority, policy)
        .map_err(RealTimeWarning::Priority)
}

/// Moves the calling thread to the priority of control and, if one is named, to `core`, and locks the memory
/// that the process has now.
///
/// Call it when everything is allocated. Returns one warning for each request that was refused;
/// the loop works without, with more jitter.
pub fn request_real_time(core: Option<usize>) -> Vec<RealTimeWarning> {
    let prioritized = request_priority(Role::Control);
    // Not MCL_FUTURE: with a small lock limit it turns a later allocation into an abort.
    let locked = mlockall(MlockAllFlags::MCL_CURRENT);
    let bound = core.map_or(Ok(()), bind_to);
    let refused = [prioritized.err(), locked.err().map(RealTimeWarning::Memory), bound.err()];
    refused.into_iter().flatten().collect()
}

/// Keeps the calling thread on `core`.
fn bind_to(core: usize) -> Result<(), RealTimeWarning> {
    let mut cores = CpuSet::new();
    let bound = cores.set(core).and_then(|()| sched_setaffinity(Pid::from_raw(0), &cores));
    bound.map_err(|reason| RealTimeWarning::Core { core, reason })
}

#[cfg(test)]
mod tests {
    use thread_priority::thread_schedule_policy;

    use super::*;

    #[test]
    fn the_request_is_granted_or_states_how_to_permit_it() {
        // In a thread of its own: the priority must not stick to the test runner.
        let outcome = std::thread::spawn(|| (request_real_time(None), thread_schedule_policy()));
        let (warnings, policy) = outcome.join().unwrap();
        let is_fifo =
            policy.unwrap() == ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
        let is_refused = warnings.iter().any(|w| matches!(w, RealTimeWarning::Priority(_)));
        assert_eq!(is_fifo, !is_refused, "{warnings:?}");
        for warning in &warnings {
            assert!(warning.to_string().contains("sudo setcap cap_sys_nice"), "{warning}");
        }
    }

    #[test]
    fn a_core_that_is_there_is_taken_and_one_that_is_not_is_named() {
        let bound = std::thread::spawn(|| {
            request_real_time(Some(0));
            nix::sched::sched_getaffinity(Pid::from_raw(0)).unwrap()
        });
        let cores = bound.join().unwrap();
        assert!(cores.is_set(0).unwrap() && !cores.is_set(1).unwrap(), "{cores:?}");
        let warnings = std::thread::spawn(|| request_real_time(Some(100_000))).join().unwrap();
        let warning = warnings.iter().map(ToString::to_string).find(|text| text.contains("100000"));
        assert!(warning.is_some_and(|text| text.contains("real_time.core")), "{warnings:?}");
    }
}
