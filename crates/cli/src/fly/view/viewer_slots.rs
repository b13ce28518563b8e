//! Places of watchers.
//!
//! Owns how many may watch, and that nobody who only looks keeps out one who may give orders. Whoever finds all
//! places of lookers taken still comes in for a moment, to show the token.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{oneshot, watch};
use tokio::time::timeout;

/// Watchers at a time who only look, and as many who may give orders.
const WATCHERS: usize = 8;

/// More who have not shown the token yet.
const NEWCOMERS: usize = 4;

/// How long a newcomer has to show it.
const WELCOME: Duration = Duration::from_secs(2);

/// All places.
#[derive(Debug, Default)]
pub(super) struct Gallery {
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
    kind: Kind,
    /// Dropped, it shows him out.
    _stays: oneshot::Sender<()>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Looks for as long as he likes.
    Looker,
    /// May give orders.
    Seated,
    /// Has to show the token.
    Newcomer,
}

/// One place. Dropped, it is free.
#[derive(Debug)]
pub(super) struct Admission {
    gallery: Arc<Gallery>,
    number: u64,
}

impl Gallery {
    /// A place, and what [`Admission::is_over`] waits for.
    pub(super) fn enter(self: &Arc<Self>) -> (Admission, oneshot::Receiver<()>) {
        let mut members = self.lock();
        let kind =
            if members.count(Kind::Looker) < WATCHERS { Kind::Looker } else { Kind::Newcomer };
        if kind == Kind::Newcomer && members.count(kind) >= NEWCOMERS {
            let oldest = members.list.iter().position(|member| member.kind == kind);
            oldest.map(|at| members.list.remove(at));
        }
        members.newest += 1;
        let number = members.newest;
        let (stays, goes) = oneshot::channel();
        members.list.push(Member { number, kind, _stays: stays });
        self.count.send_replace(members.list.len());
        drop(members);
        (Admission { gallery: Arc::clone(self), number }, goes)
    }

    /// Waits until nobody is left.
    pub(super) async fn is_empty(&self) {
        // The sender lives as long as `self`.
        self.count.subscribe().wait_for(|count| *count == 0).await.ok();
    }

    fn lock(&self) -> MutexGuard<'_, Members> {
        self.members.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Members {
    fn count(&self, kind: Kind) -> usize {
        self.list.iter().filter(|member| member.kind == kind).count()
    }

    fn find(&mut self, number: u64) -> Option<&mut Member> {
        self.list.iter_mut().find(|member| member.number == number)
    }
}

impl Admission {
    /// The token was right: whether there is room for one more who may give orders.
    pub(super) fn sit(&self) -> bool {
        let mut members = self.gallery.lock();
        let has_room = members.count(Kind::Seated) < WATCHERS;
        match members.find(self.number) {
            Some(member) if has_room => {
                member.kind = Kind::Seated;
                true
            }
            _ => false,
        }
    }

    /// Whether he may give orders.
    pub(super) fn is_seated(&self) -> bool {
        self.kind() == Some(Kind::Seated)
    }

    /// Waits until somebody else needs the place; for ever if nobody does.
    pub(super) async fn is_over(&self, goes: oneshot::Receiver<()>) {
        let evicted = async {
            goes.await.ok();
        };
        let mut evicted = std::pin::pin!(evicted);
        let is_evicted = timeout(WELCOME, &mut evicted).await.is_ok();
        if !is_evicted && self.kind() != Some(Kind::Newcomer) {
            evicted.await;
        }
    }

    fn kind(&self) -> Option<Kind> {
        self.gallery.lock().find(self.number).map(|member| member.kind)
    }
}

impl Drop for Admission {
    fn drop(&mut self) {
        let mut members = self.gallery.lock();
        members.list.retain(|member| member.number != self.number);
        self.gallery.count.send_replace(members.list.len());
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
    fn who_has_the_token_finds_a_place_among_any_number_of_lookers() {
        let gallery = Arc::new(Gallery::default());
        let mut lookers: Vec<_> = (0..WATCHERS).map(|_| gallery.enter()).collect();
        let (holder, mut holder_goes) = gallery.enter();
        assert!(holder.sit() && holder.is_seated());
        let crowd: Vec<_> = (0..3 * NEWCOMERS).map(|_| gallery.enter()).collect();
        assert_eq!(gallery.lock().list.len(), WATCHERS + 1 + NEWCOMERS);
        assert!(!crowd[0].0.sit(), "shown out already");
        // Those who were here first are not disturbed.
        let stays = Err(oneshot::error::TryRecvError::Empty);
        assert_eq!(holder_goes.try_recv(), stays);
        assert!(lookers.iter_mut().all(|(_, goes)| goes.try_recv() == stays));
        drop((lookers, holder, crowd));
        block_on(gallery.is_empty());
    }

    #[test]
    fn a_newcomer_without_the_token_is_shown_out_and_a_looker_stays() {
        let gallery = Arc::new(Gallery::default());
        let mut lookers: Vec<_> = (0..WATCHERS).map(|_| gallery.enter()).collect();
        let (looker, looker_goes) = lookers.remove(0);
        let (newcomer, goes) = gallery.enter();
        block_on(async {
            newcomer.is_over(goes).await;
            let stays = timeout(WELCOME * 2, looker.is_over(looker_goes)).await;
            assert!(stays.is_err(), "a looker was shown out");
        });
    }

    #[test]
    fn seats_are_bounded() {
        let gallery = Arc::new(Gallery::default());
        let places: Vec<_> = (0..WATCHERS + 2).map(|_| gallery.enter()).collect();
        let seated = places.iter().filter(|(place, _)| place.sit()).count();
        assert_eq!(seated, WATCHERS);
    }
}
