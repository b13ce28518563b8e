//! Slots of viewers, by role.
//!
//! Owns how many connections each role may have. Viewers cannot take the slots of operators: a connection that finds
//! all slots of viewers taken is pending for a moment, in which it can show the token.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::{oneshot, watch};
use tokio::time::timeout;

/// Largest number of viewers that only look; as many operators.
const VIEWERS_MAX: usize = 8;

/// Largest number of pending connections beside viewers and operators.
const PENDING_MAX: usize = 4;

/// Time for a pending viewer to show the token.
const PENDING_TIME: Duration = Duration::from_secs(2);

/// All slots.
#[derive(Debug, Default)]
pub(super) struct ViewerSlots {
    members: Mutex<Members>,
    count: watch::Sender<usize>,
}

#[derive(Debug, Default)]
struct Members {
    newest: u64,
    /// The oldest first.
    list: Vec<Member>,
}

#[derive(Debug)]
struct Member {
    number: u64,
    role: Role,
    /// Dropping it ends the connection.
    _stays: oneshot::Sender<()>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    /// Only looks, without a limit in time.
    Viewer,
    /// May give orders.
    Operator,
    /// Has [`PENDING_TIME`] to show the token.
    Pending,
}

/// One slot, free again when this is dropped.
#[derive(Debug)]
pub(super) struct ViewerSlot {
    slots: Arc<ViewerSlots>,
    number: u64,
}

impl ViewerSlots {
    /// A slot, and what [`ViewerSlot::is_over`] waits for.
    pub(super) fn enter(self: &Arc<Self>) -> (ViewerSlot, oneshot::Receiver<()>) {
        let mut members = self.members.lock();
        let role =
            if members.count(Role::Viewer) < VIEWERS_MAX { Role::Viewer } else { Role::Pending };
        if role == Role::Pending && members.count(role) >= PENDING_MAX {
            let oldest = members.list.iter().position(|member| member.role == role);
            oldest.map(|at| members.list.remove(at));
        }
        members.newest += 1;
        let number = members.newest;
        let (stays, goes) = oneshot::channel();
        members.list.push(Member { number, role, _stays: stays });
        self.count.send_replace(members.list.len());
        drop(members);
        (ViewerSlot { slots: Arc::clone(self), number }, goes)
    }

    /// Waits until every slot is free.
    pub(super) async fn is_empty(&self) {
        // The sender lives as long as `self`.
        self.count.subscribe().wait_for(|count| *count == 0).await.ok();
    }
}

impl Members {
    fn count(&self, role: Role) -> usize {
        self.list.iter().filter(|member| member.role == role).count()
    }

    fn find(&mut self, number: u64) -> Option<&mut Member> {
        self.list.iter_mut().find(|member| member.number == number)
    }
}

impl ViewerSlot {
    /// Makes a viewer with the right token an operator; whether there is a slot for one more.
    pub(super) fn become_operator(&self) -> bool {
        let mut members = self.slots.members.lock();
        let has_room = members.count(Role::Operator) < VIEWERS_MAX;
        match members.find(self.number) {
            Some(member) if has_room => {
                member.role = Role::Operator;
                true
            }
            _ => false,
        }
    }

    /// Whether the viewer may give orders.
    pub(super) fn is_operator(&self) -> bool {
        self.role() == Some(Role::Operator)
    }

    /// Waits until the slot is given to another connection or, if it is pending, its time is over.
    pub(super) async fn is_over(&self, goes: oneshot::Receiver<()>) {
        let evicted = async {
            goes.await.ok();
        };
        let mut evicted = std::pin::pin!(evicted);
        let is_evicted = timeout(PENDING_TIME, &mut evicted).await.is_ok();
        if !is_evicted && self.role() != Some(Role::Pending) {
            evicted.await;
        }
    }

    fn role(&self) -> Option<Role> {
        self.slots.members.lock().find(self.number).map(|member| member.role)
    }
}

impl Drop for ViewerSlot {
    fn drop(&mut self) {
        let mut members = self.slots.members.lock();
        members.list.retain(|member| member.number != self.number);
        self.slots.count.send_replace(members.list.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block_on<F: Future>(future: F) -> F::Output {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        runtime.block_on(future)
    }

    #[test]
    fn a_viewer_with_the_token_finds_a_slot_among_any_number_of_viewers() {
        let slots = Arc::new(ViewerSlots::default());
        let mut viewers: Vec<_> = (0..VIEWERS_MAX).map(|_| slots.enter()).collect();
        let (holder, mut holder_goes) = slots.enter();
        assert!(holder.become_operator() && holder.is_operator());
        let crowd: Vec<_> = (0..3 * PENDING_MAX).map(|_| slots.enter()).collect();
        assert_eq!(slots.members.lock().list.len(), VIEWERS_MAX + 1 + PENDING_MAX);
        assert!(!crowd[0].0.become_operator(), "disconnected already");
        // Those who were here first are not disturbed.
        let stays = Err(oneshot::error::TryRecvError::Empty);
        assert_eq!(holder_goes.try_recv(), stays);
        assert!(viewers.iter_mut().all(|(_, goes)| goes.try_recv() == stays));
        drop((viewers, holder, crowd));
        block_on(slots.is_empty());
    }

    #[test]
    fn a_pending_viewer_without_the_token_is_disconnected_and_a_viewer_stays() {
        let slots = Arc::new(ViewerSlots::default());
        let mut viewers: Vec<_> = (0..VIEWERS_MAX).map(|_| slots.enter()).collect();
        let (viewer, viewer_goes) = viewers.remove(0);
        let (pending, goes) = slots.enter();
        block_on(async {
            pending.is_over(goes).await;
            // It came before the pending one.
            let stays = timeout(PENDING_TIME / 4, viewer.is_over(viewer_goes)).await;
            assert!(stays.is_err(), "a viewer was disconnected");
        });
    }

    #[test]
    fn operators_are_bounded() {
        let slots = Arc::new(ViewerSlots::default());
        let entered: Vec<_> = (0..VIEWERS_MAX + 2).map(|_| slots.enter()).collect();
        let operators = entered.iter().filter(|(slot, _)| slot.become_operator()).count();
        assert_eq!(operators, VIEWERS_MAX);
    }
}
