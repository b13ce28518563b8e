//! Our link to the drone over bad air, in both protocols: judged by what reached the drone.

use std::sync::Arc;
use std::time::Duration;

use horizon_model::rows::{Sticks, pose};
use tello_flight::gate::{Gate, GateTable};
use tello_io::clock::Clock;
use tello_io::tello::{
    Approved, DroneClient, DroneLink, DroneOrder, LinkCounters, Protocol, TelloSettings, TelloTable,
};
use tello_io::{StopSignal, Stopper};
use tello_sim::{
    AirTable, DronePhase, Emulator, MocapAddresses, Profile, ReceivedOrders, SdkVersion, SimStart,
    Truth, World,
};
use tokio::time::{interval, sleep};

/// As on real round trips: 44 ms in the median, 228 ms at worst, and worse.
const BAD: AirTable = AirTable {
    loss: 0.1,
    duplicate: 0.05,
    reorder: 0.05,
    delay_median_s: 0.022,
    delay_max_s: 0.114,
};

/// Longest time that handing over sticks may take: nothing there waits. A loaded machine may preempt
/// the thread.
const HAND_OVER_MAX: Duration = Duration::from_millis(50);

/// A drone on the floor behind `air`, and our link to it.
struct Fixture {
    emulator: Emulator,
    link: DroneLink,
    protocol: Protocol,
    /// Whether the last status reports that the drone flies.
    is_flying: Option<bool>,
    takes_sticks: bool,
    /// Longest time for which the link kept us.
    longest: Duration,
    clock: Clock,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Fixture {
    fn start(protocol: Protocol, air: AirTable, seed: u64) -> (Self, DroneClient) {
        let mut sim = tello_sim::settings(None).unwrap();
        sim.profile = Profile::Clean;
        sim.has_spread = false;
        sim.start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 };
        sim.drone.air = air;
        sim.drone.sdk = SdkVersion::V3_0;
        let any = ([127, 0, 0, 1], 0).into();
        let mocap = MocapAddresses::default();
        let emulator = Emulator::start(World::new(&sim, seed).unwrap(), any, mocap).unwrap();
        let table = TelloTable {
            protocol,
            address: emulator.drone_address().to_string(),
            local_port: 0,
            state_port: 0,
            altitude_limit_m: Some(10),
            interface: None,
        };
        let clock = Clock::start();
        let settings = TelloSettings::try_from(&table).unwrap();
        let (client, link) = DroneClient::bind(&settings, clock, false).unwrap();
        let longest = Duration::ZERO;
        let bench =
            Self { emulator, link, protocol, is_flying: None, takes_sticks: false, longest, clock };
        (bench, client)
    }

    fn approved(&self, pitch: f64) -> Approved {
        let table = GateTable { stick_max: 1.0, stale_s: 1.0 };
        let gate = Gate::new(&table, self.protocol).unwrap();
        gate.pass(&Sticks::new(0.0, pitch, 0.0, 0.0), Some(0.0))
    }

    /// Ticks at 50 Hz with `pitch` until `is_done`, at most 30 s.
    async fn tick(&mut self, pitch: f64, is_done: impl Fn(&Self, &Truth, u32) -> bool) -> Truth {
        let mut ticker = interval(Duration::from_millis(20));
        for step in 0..1_500 {
            ticker.tick().await;
            let begin = self.clock.now();
            if let Some(status) = self.link.poll_status() {
                self.is_flying = Some(status.is_flying);
                self.takes_sticks = status.takes_sticks;
            }
            self.link.send(self.approved(pitch), None);
            self.longest = self.longest.max(self.clock.now().since(begin).duration());
            let truth = self.emulator.truth();
            if is_done(self, &truth, step) {
                return truth;
            }
        }
        panic!("not within 30 s: {:?}", self.emulator.truth());
    }

    /// Takes off as the supervisor does: again every 3 s while the drone says that it stands.
    async fn take_off(&mut self) {
        self.tick(0.0, |bench, _, _| bench.is_flying == Some(false)).await;
        self.tick(0.0, |bench, truth, step| {
            if step % 150 == 0 && bench.is_flying == Some(false) {
                bench.link.order(DroneOrder::TakeOff).unwrap();
            }
            truth.phase == DronePhase::Flying && bench.is_flying == Some(true) && bench.takes_sticks
        })
        .await;
    }
}

/// Takes off, flies forward for 2 s, lands; what reached the drone.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
async fn fly(protocol: Protocol, air: AirTable, seed: u64) -> (ReceivedOrders, Arc<LinkCounters>) {
    let (mut bench, client) = Fixture::start(protocol, air, seed);
    let counters = Arc::clone(&bench.link.counters);
    let (stopper, stop): (Stopper, StopSignal) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    bench.take_off().await;
    let before = bench.emulator.truth();
    let after = bench.tick(0.4, |_, _, step| step == 100).await;
    let forward_m = after.pose[pose::X] - before.pose[pose::X];
    assert!(forward_m > 0.4, "{protocol:?} seed {seed}: {forward_m} m forward");
    // 101 ticks over 2 s; repeats between them add some.
    let arrived = after.received.sticks - before.received.sticks;
    assert!((75..=230).contains(&arrived), "{protocol:?} seed {seed}: {arrived} sticks");

    bench.link.order(DroneOrder::Land).unwrap();
    bench.tick(0.4, |_, truth, _| truth.phase == DronePhase::Grounded).await;
    bench.tick(0.4, |bench, _, _| bench.is_flying == Some(false)).await;
    stopper.stop();
    task.await.unwrap().unwrap();
    assert!(bench.longest < HAND_OVER_MAX, "the link kept us {:?}", bench.longest);
    // What was in transit may still arrive.
    sleep(Duration::from_millis(300)).await;
    let truth = bench.emulator.truth();
    assert_eq!(truth.phase, DronePhase::Grounded);
    (truth.received, counters)
}

fn check(received: ReceivedOrders, counters: &LinkCounters, name: &str) {
    assert_eq!(received.take_offs_aloft, 0, "{name}: {received:?}");
    assert!((1..=4).contains(&received.take_offs), "{name}: {received:?}");
    // What was sent before the order may overtake it or come later: 0.23 s of sticks.
    // And neutral sticks directly before each repetition of the landing.
    assert!(received.sticks_in_landing <= 12 + received.landings, "{name}: {received:?}");
    assert!(received.landings >= 1, "{name}: {received:?}");
    assert_eq!(counters.watchdog_landings.get(), 0, "{name}");
}

#[tokio::test]
async fn bad_air_costs_neither_the_flight_nor_a_second_take_off() {
    let flights =
        [(Protocol::Binary, 1), (Protocol::Binary, 2), (Protocol::Text, 3), (Protocol::Text, 4)];
    let tasks =
        flights.map(|(protocol, seed)| (protocol, seed, tokio::spawn(fly(protocol, BAD, seed))));
    for (protocol, seed, task) in tasks {
        let (received, counters) = task.await.unwrap();
        check(received, &counters, &format!("{protocol:?} seed {seed}"));
        println!("{protocol:?} seed {seed}: {received:?}");
    }
}

#[tokio::test]
async fn good_air_takes_one_take_off_and_one_order_at_a_time() {
    let clear =
        AirTable { loss: 0.0, duplicate: 0.0, reorder: 0.0, delay_median_s: 0.0, delay_max_s: 0.0 };
    for protocol in [Protocol::Binary, Protocol::Text] {
        let (received, counters) = fly(protocol, clear, 1).await;
        check(received, &counters, &format!("{protocol:?}"));
        assert_eq!((received.take_offs, received.emergency_stops), (1, 0), "{protocol:?}");
        // Neutral sticks directly before each repetition of the landing.
        assert!(received.sticks_in_landing < received.landings, "{protocol:?}: {received:?}");
        assert!(counters.acks.get() > 0, "{protocol:?}");
    }
}

#[tokio::test]
async fn an_emergency_stop_gets_through_a_bad_link_at_once() {
    for protocol in [Protocol::Binary, Protocol::Text] {
        let (mut bench, client) = Fixture::start(protocol, BAD, 5);
        let (stopper, stop) = Stopper::new();
        let task = tokio::spawn(client.run(stop));
        bench.take_off().await;
        bench.link.order(DroneOrder::EmergencyStop).unwrap();
        let is_stopped =
            |truth: &Truth| matches!(truth.phase, DronePhase::Falling | DronePhase::Grounded);
        let truth = bench.tick(0.4, |_, truth, step| is_stopped(truth) || step == 25).await;
        assert!(is_stopped(&truth), "{protocol:?}: not stopped after 0.5 s: {truth:?}");
        assert_eq!(truth.received.landings, 0, "{protocol:?}");
        bench.tick(0.4, |_, truth, step| truth.phase == DronePhase::Grounded && step > 100).await;
        stopper.stop();
        task.await.unwrap().unwrap();
        assert_eq!(bench.emulator.truth().phase, DronePhase::Grounded);
    }
}
