//! One viewer: what is sent to it, and what it may send.
//!
//! Owns the messages of the socket, both ways, as JSON. A viewer gets the newest facts that its connection can
//! take, never a queue of old ones; its messages are read however slowly it reads, and a viewer that sends too much
//! is disconnected.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use axum::body::Bytes;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use futures_util::stream::{SplitSink, SplitStream};
use futures_util::{SinkExt, StreamExt};
use serde::{Deserialize, Serialize};
use tello_eval::display_rounding::PosW;
use tello_eval::telemetry::{FlightHeader, Telemetry};
use tello_io::clock::{SpanNs, TimeNs};
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};

use super::orders::{OrderRight, PageOrder};
use super::server::Shown;
use super::viewer_slots::ViewerSlot;

/// Longest message of a viewer. bytes
pub(super) const MESSAGE_BYTES_MAX: usize = 1024;

/// Most messages in a second. A page sends a message when a person presses a button, and its browser
/// answers the ping behind each facts.
const MESSAGES_MAX: u32 = 60;
const SECOND: SpanNs = SpanNs::from_ms(1_000);

/// Answers in transit to one viewer.
const ANSWERS: usize = 32;

/// Telemetry in transit to one viewer: more would be old when they arrive.
const FACTS_IN_TRANSIT_MAX: u32 = 4;

/// Longest time that a viewer may take to receive a message, or be silent.
const VIEWER_TIMEOUT: SpanNs = SpanNs::from_ms(5_000);

/// Timeout of a viewer that may give orders: it may hold the drone, and be gone silently.
const OPERATOR_TIMEOUT: SpanNs = SpanNs::from_ms(1_500);

/// Longest time between two pings.
const PING_EVERY: Duration = Duration::from_millis(500);

/// Time for a viewer that is disconnected to receive the reason.
const CLOSE_TIME: Duration = Duration::from_secs(1);

const NOT_ADMITTED: &str =
    "this page may only look: open it by the address that the program printed";

/// Message of a viewer.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum FromViewer {
    /// The right to give orders.
    Token(String),
    /// An order.
    Order(PageOrder),
}

/// Message to a viewer.
#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum ToViewer<'a> {
    /// At first: what stays the same, where the vehicle has been, and how old the facts are that come next.
    Briefing { briefing: &'a FlightHeader, trail: &'a [PosW], age_s: f64 },
    /// Again and again.
    Facts(&'a Telemetry),
    /// After a token: whether orders are taken.
    Access { may_order: bool },
    /// After an order: whether it was handed on, else why not.
    Answer { order: PageOrder, refusal: Option<String> },
    /// The flight is over.
    Over,
}

impl ToViewer<'_> {
    fn message(&self) -> Option<Message> {
        serde_json::to_string(self).ok().map(Message::text)
    }
}

/// One connection.
pub(super) struct ViewerConnection<'a> {
    shown: &'a Arc<Shown>,
    slot: &'a ViewerSlot,
    /// Pings sent so far.
    sent: AtomicU32,
    /// Pings answered so far.
    answered: watch::Sender<u32>,
}

impl<'a> ViewerConnection<'a> {
    pub(super) fn new(shown: &'a Arc<Shown>, slot: &'a ViewerSlot) -> Self {
        Self { shown, slot, sent: AtomicU32::new(0), answered: watch::Sender::new(0) }
    }

    /// Shows and listens until either side has enough.
    pub(super) async fn attend(self, socket: WebSocket) {
        let (out, from) = socket.split();
        let (answer_to, answers) = mpsc::channel(ANSWERS);
        // Side by side: the messages of a viewer that reads slowly are taken all the same.
        tokio::select! {
            () = self.listen(from, answer_to) => {}
            () = self.write(out, answers) => {}
        }
    }

    /// Reads and answers the viewer's messages; ends with the connection, or if they are too many or wrong.
    async fn listen(&self, mut from: SplitStream<WebSocket>, answer_to: mpsc::Sender<Message>) {
        let mut right: Option<OrderRight> = None;
        let mut allowance = Allowance::new(self.shown.clock.now());
        let why = loop {
            let Some(Ok(message)) = from.next().await else { break None };
            if !allowance.allows(self.shown.clock.now()) {
                break Some("too many messages");
            }
            match message {
                Message::Text(text) => {
                    let Some(answer) = self.receive(&text, &mut right) else {
                        break Some("not a message of the page");
                    };
                    // An answer to a viewer that does not read is dropped; its order counts all the same.
                    answer.message().and_then(|answer| answer_to.try_send(answer).ok());
                }
                Message::Binary(_) => break Some("not a message of the page"),
                Message::Pong(_) => {
                    let sent = self.sent.load(Ordering::Relaxed);
                    self.answered.send_if_modified(|answered| count_answer(answered, sent));
                }
                Message::Ping(_) => {}
                Message::Close(_) => break None,
            }
        };
        // The right to order ends here and not with the close frame.
        drop(right);
        if let Some(why) = why {
            let frame = CloseFrame { code: close_code::POLICY, reason: why.into() };
            answer_to.try_send(Message::Close(Some(frame))).ok();
            timeout(CLOSE_TIME, answer_to.closed()).await.ok();
        }
    }

    /// The answer to what was received; `None` if it made no sense.
    fn receive(
        &self,
        text: &Utf8Bytes,
        right: &mut Option<OrderRight>,
    ) -> Option<ToViewer<'static>> {
        Some(match serde_json::from_str(text.as_str()).ok()? {
            FromViewer::Token(token) => {
                let authorize =
                    || self.shown.access.authorize(&token).filter(|_| self.slot.become_operator());
                *right = right.take().or_else(authorize);
                ToViewer::Access { may_order: right.is_some() }
            }
            FromViewer::Order(order) => {
                let refusal = match right {
                    Some(right) => right.order(order).err().map(|busy| busy.to_string()),
                    None => Some(NOT_ADMITTED.to_owned()),
                };
                ToViewer::Answer { order, refusal }
            }
        })
    }

    /// Sends the newest facts until the viewer is gone or the flight is over.
    async fn write(
        &self,
        mut out: SplitSink<WebSocket, Message>,
        mut answers: mpsc::Receiver<Message>,
    ) {
        let Shown { briefing, facts, is_over, .. } = &**self.shown;
        let (mut facts, mut is_over) = (facts.clone(), is_over.clone());
        let mut answered = self.answered.subscribe();
        // The log's thread may end before the flight: orders are taken all the same.
        let mut goes_on = true;
        let trail = facts.borrow().trail.clone();
        let now = || self.shown.clock.now();
        let age_s = (now().since(TimeNs(0)).seconds() - facts.borrow().t_s).max(0.0);
        let mut is_there =
            self.report(&mut out, &ToViewer::Briefing { briefing, trail: &trail, age_s }).await;
        let mut pings = Pings::new(now());
        facts.mark_changed();
        while is_there {
            pings.receive(*answered.borrow_and_update(), now());
            let in_transit = pings.in_transit();
            let left = SpanNs(self.time_limit().0 - now().since(pings.answered_at).0);
            is_there = tokio::select! {
                biased;
                // An error: the flight is gone altogether.
                _ = is_over.changed() => {
                    let newest = Arc::clone(&facts.borrow());
                    let is_there = self.report(&mut out, &ToViewer::Facts(&newest)).await
                        && self.report(&mut out, &ToViewer::Over).await;
                    if is_there {
                        self.send(&mut out, Message::Close(None)).await;
                    }
                    false
                }
                message = answers.recv() => match message {
                    Some(message) => {
                        let is_last = matches!(message, Message::Close(_));
                        self.send(&mut out, message).await && !is_last
                    }
                    None => false,
                },
                () = sleep(left.duration()), if in_transit > 0 => false,
                changed = facts.changed(), if goes_on && in_transit < FACTS_IN_TRANSIT_MAX => {
                    goes_on = changed.is_ok();
                    let newest = Arc::clone(&facts.borrow_and_update());
                    self.report(&mut out, &ToViewer::Facts(&newest)).await
                        && self.ping(&mut out, &mut pings).await
                }
                answer = answered.changed(), if in_transit > 0 => answer.is_ok(),
                // A viewer without news is asked all the same: one that is gone must not hold the drone.
                () = sleep(PING_EVERY), if in_transit == 0 => {
                    self.ping(&mut out, &mut pings).await
                }
            };
        }
    }

    fn time_limit(&self) -> SpanNs {
        if self.slot.is_operator() { OPERATOR_TIMEOUT } else { VIEWER_TIMEOUT }
    }

    async fn report(
        &self,
        out: &mut SplitSink<WebSocket, Message>,
        message: &ToViewer<'_>,
    ) -> bool {
        match message.message() {
            Some(message) => self.send(out, message).await,
            None => true,
        }
    }

    async fn ping(&self, out: &mut SplitSink<WebSocket, Message>, pings: &mut Pings) -> bool {
        pings.sent = pings.sent.wrapping_add(1);
        self.sent.store(pings.sent, Ordering::Relaxed);
        self.send(out, Message::Ping(Bytes::new())).await
    }

    /// Whether the viewer takes it.
    async fn send(&self, out: &mut SplitSink<WebSocket, Message>, message: Message) -> bool {
        let sent = timeout(self.time_limit().duration(), out.send(message)).await;
        sent.is_ok_and(|sent| sent.is_ok())
    }
}

/// Counts a pong of a viewer that has answered so many of the pings sent; whether it is an answer. A pong that nothing
/// asked for is permitted (RFC 6455, 5.5.3) and answers nothing.
fn count_answer(answered: &mut u32, sent: u32) -> bool {
    let is_answer = *answered != sent;
    *answered = answered.wrapping_add(u32::from(is_answer));
    is_answer
}

/// Pings to a viewer, one after each message of facts, and its answers.
#[derive(Debug)]
struct Pings {
    sent: u32,
    answered: u32,
    /// Time of the newest answer, or the newest at which none was awaited.
    answered_at: TimeNs,
}

impl Pings {
    fn new(now: TimeNs) -> Self {
        Self { sent: 0, answered: 0, answered_at: now }
    }

    /// Takes the number of answers so far.
    fn receive(&mut self, answered: u32, now: TimeNs) {
        if answered != self.answered || answered == self.sent {
            (self.answered, self.answered_at) = (answered, now);
        }
    }

    /// Pings without an answer so far.
    fn in_transit(&self) -> u32 {
        self.sent.wrapping_sub(self.answered)
    }
}

/// Number of messages that a viewer may still send in this second.
#[derive(Debug)]
struct Allowance {
    since: TimeNs,
    count: u32,
}

impl Allowance {
    fn new(now: TimeNs) -> Self {
        Self { since: now, count: 0 }
    }

    /// Counts a message; whether it is still allowed.
    fn allows(&mut self, now: TimeNs) -> bool {
        if now.since(self.since) >= SECOND {
            *self = Self::new(now);
        }
        self.count += 1;
        self.count <= MESSAGES_MAX
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_of_the_page_are_parsed_and_others_refused() {
        let parsed = |text: &str| serde_json::from_str::<FromViewer>(text).ok();
        assert_eq!(
            parsed(r#"{"order":"emergency_stop"}"#),
            Some(FromViewer::Order(PageOrder::EmergencyStop))
        );
        assert_eq!(parsed(r#"{"token":"x"}"#), Some(FromViewer::Token("x".to_owned())));
        for bad in ["", "land", r#"{"order":"fly_away"}"#, r#"{"order":"land","token":"x"}"#, "[]"]
        {
            assert_eq!(parsed(bad), None, "{bad}");
        }
    }

    #[test]
    fn an_answer_to_nothing_does_not_count() {
        let mut answered = 0;
        for (sent, expected) in [(0, 0), (0, 0), (1, 1), (1, 1), (3, 2), (3, 3), (3, 3)] {
            count_answer(&mut answered, sent);
            assert_eq!(answered, expected);
        }
    }

    #[test]
    fn so_many_messages_a_second_and_no_more() {
        let mut allowance = Allowance::new(TimeNs(0));
        let allowed = (0..1000).filter(|ms| allowance.allows(TimeNs(ms * 1_000))).count();
        assert_eq!(allowed, usize::try_from(MESSAGES_MAX).unwrap());
        assert!(allowance.allows(TimeNs(0).after(SECOND)));
    }
}
