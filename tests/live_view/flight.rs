//! The program with a live page, the drone that it flies, and watchers of the page that are no browsers.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::{self, sleep};
use std::time::Duration;

use serde_json::Value;
use tello_io::clock::Clock;
use tello_io::log::LogReader;
use tello_sim::{DronePhase, Emulator};
use tokio_tungstenite::tungstenite::{Message, WebSocket, client};

use crate::rig;

/// How long anything may take: other tests run beside.
const TEST_TIMEOUT_S: f64 = 60.0;

/// The program, and the drone that it flies.
pub(crate) struct Flight {
    pub(crate) emulator: Emulator,
    program: Child,
    folder: PathBuf,
    /// Where the page is, and what lets give orders.
    pub(crate) address: String,
    pub(crate) token: String,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Flight {
    /// Starts a flight with a live page on a free port.
    pub(crate) fn start(name: &str) -> Self {
        Self::start_with(name, true)
    }

    /// Starts a flight with a live page on a free port, or without one and without an address.
    pub(crate) fn start_with(name: &str, has_page: bool) -> Self {
        let (folder, emulator) = rig::start(&format!("live-view-{name}"), |relay| relay);
        let mut program = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
            .args(["fly", "--yes", "--config", "fly.json", "--log", "flight.mcap"])
            .args(if has_page { &["--view", "127.0.0.1:0"][..] } else { &[] })
            .current_dir(&folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines =
            BufReader::new(program.stderr.take().unwrap()).lines().map_while(Result::ok);
        let mut page = "/#".to_owned();
        if has_page {
            let address = |line: String| line.strip_prefix("view http://").map(str::to_owned);
            page = lines.find_map(address).unwrap();
        }
        thread::spawn(move || lines.for_each(drop));
        let (address, token) = page.split_once("/#").unwrap();
        let (address, token) = (address.to_owned(), token.to_owned());
        Self { emulator, program, folder, address, token }
    }

    /// Waits until the drone is in `phase`.
    pub(crate) fn wait_for(&self, phase: DronePhase) {
        let clock = Clock::start();
        while clock.now().seconds() < TEST_TIMEOUT_S {
            if self.emulator.truth().phase == phase {
                return;
            }
            sleep(Duration::from_millis(5));
        }
        panic!("not {phase:?} within {TEST_TIMEOUT_S} s: {:?}", self.emulator.truth());
    }

    /// The program ends, and its log is whole.
    pub(crate) fn ends(mut self) -> PathBuf {
        self.program.wait().unwrap();
        let path = self.folder.join("flight.mcap");
        let mut log = LogReader::open(&path).unwrap();
        while log.next_message().unwrap().is_some() {}
        assert!(log.ending().unwrap().is_complete(), "the log is torn");
        path
    }
}

impl Drop for Flight {
    fn drop(&mut self) {
        // After a failure; else it has ended.
        self.program.kill().ok();
        self.program.wait().ok();
    }
}

/// Somebody who watches a flight.
pub(crate) struct Watcher {
    socket: WebSocket<TcpStream>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Watcher {
    pub(crate) fn open(flight: &Flight) -> Self {
        Self::try_open(&flight.address).unwrap()
    }

    /// `None` where nobody answers, or nobody more is let in.
    pub(crate) fn try_open(address: &str) -> Option<Self> {
        let stream = TcpStream::connect(address).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs_f64(TEST_TIMEOUT_S))).ok()?;
        let (socket, _) = client(format!("ws://{address}/live"), stream).ok()?;
        Some(Self { socket })
    }

    pub(crate) fn says(&mut self, message: &Value) {
        self.socket.send(Message::text(message.to_string())).unwrap();
    }

    /// Says it though nobody may listen any more.
    pub(crate) fn says_bytes(&mut self, text: &str) {
        self.socket.send(Message::text(text)).ok();
    }

    /// The next message about `what`; others are passed over.
    pub(crate) fn hears(&mut self, what: &str) -> Value {
        loop {
            if let Message::Text(text) = self.socket.read().unwrap() {
                let mut message: Value = serde_json::from_str(&text).unwrap();
                if let Some(message) = message.get_mut(what) {
                    return message.take();
                }
            }
        }
    }

    /// The first facts of which `is_so` holds.
    pub(crate) fn until(&mut self, what: &str, is_so: impl Fn(&Value) -> bool) -> Value {
        let clock = Clock::start();
        loop {
            let facts = self.hears("facts");
            if is_so(&facts) {
                return facts;
            }
            assert!(clock.now().seconds() < TEST_TIMEOUT_S, "never {what}: {facts}");
        }
    }

    /// The server ends the connection.
    pub(crate) fn leaves_by_force(mut self) {
        assert!(self.reads_to_the_end(), "still connected");
    }

    /// Reads for a while; whether the connection ends.
    pub(crate) fn reads_to_the_end(&mut self) -> bool {
        (0..1_000).any(|_| matches!(self.socket.read(), Err(_) | Ok(Message::Close(_))))
    }

    /// The end of the flight is reported, and then the connection is.
    pub(crate) fn hears_the_end(&mut self) {
        let mut last = Vec::new();
        while let Ok(message) = self.socket.read() {
            if let Message::Text(text) = message {
                last = vec![text.to_string()];
            }
        }
        assert_eq!(last, ["\"over\""]);
    }
}
