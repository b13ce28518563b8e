//! A person before a terminal of their own, in which the program runs.

use std::fs::{self, File};
use std::io::{Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, sleep};
use std::time::Duration;

use nix::poll::{PollFd, PollFlags, poll};
use nix::pty::{Winsize, openpty};
use nix::sys::termios::{FlowArg, LocalFlags, tcflow, tcgetattr};
use tello_sim::{Profile, SimTable};

pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_tello-ctl");

/// How long a flight may take to show something. The simulated drone is up after 6 s.
const TEST_TIMEOUT: Duration = Duration::from_secs(40);

/// A key is repeated this often by a terminal.
const REPEAT: Duration = Duration::from_millis(30);

/// Lines and columns of the terminal.
const SIZE: [u16; 2] = [24, 80];

/// Held while a program starts.
static STARTING: Mutex<()> = Mutex::new(());

/// The program on a terminal of its own, and the person before it.
pub(crate) struct Person {
    program: Child,
    keyboard: File,
    screen: Arc<Mutex<Vec<u8>>>,
    /// Whether somebody looks at the screen.
    looks: Arc<AtomicBool>,
    /// The program's side, to look at its mode.
    terminal: OwnedFd,
    pub(crate) log: PathBuf,
}

impl Person {
    /// Starts a simulated flight.
    pub(crate) fn start(name: &str) -> Self {
        Self::start_in(name, &[], |_| {})
    }

    /// The same with more arguments and other settings of the simulator.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn start_in(
        name: &str,
        arguments: &[&str],
        change: impl FnOnce(&mut SimTable),
    ) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("by-hand-{name}"));
        fs::remove_dir_all(&folder).ok();
        fs::create_dir_all(&folder).unwrap();
        let mut sim = SimTable { profile: Profile::Clean, ..tello_sim::settings(None).unwrap() };
        change(&mut sim);
        fs::write(folder.join("sim.json"), serde_json::to_string(&sim).unwrap()).unwrap();
        Self::fly_in(&folder, &[&["--sim", "--sim-config", "sim.json"], arguments].concat())
    }

    /// Starts a flight with the files of `folder`.
    pub(crate) fn fly_in(folder: &Path, arguments: &[&str]) -> Self {
        Self::run_in(folder, &[&[PROGRAM, "fly", "--log", "flight.mcap"], arguments].concat())
    }

    /// Runs the command `words`.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn run_in(folder: &Path, words: &[&str]) -> Self {
        // Handles of `openpty` survive into every child that starts meanwhile; copies do not. A child
        // that held this side would keep the terminal open when the person closes it.
        let alone = STARTING.lock().unwrap();
        let [ws_row, ws_col] = SIZE;
        let size = Winsize { ws_row, ws_col, ws_xpixel: 0, ws_ypixel: 0 };
        let pty = openpty(Some(&size), None).unwrap();
        let keyboard = File::from(pty.master.try_clone().unwrap());
        let terminal = pty.slave.try_clone().unwrap();
        drop(pty);
        let end = || Stdio::from(terminal.try_clone().unwrap());
        // A session of its own with the terminal in control: Ctrl-C is then the kernel's, as in life.
        let program = Command::new("setsid")
            .args(["--ctty", "--wait"])
            .args(words)
            .current_dir(folder)
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .unwrap();
        drop(alone);
        let screen = Arc::new(Mutex::new(Vec::new()));
        let looks = Arc::new(AtomicBool::new(true));
        let mut glass = keyboard.try_clone().unwrap();
        let (seen, goes_on) = (Arc::clone(&screen), Arc::clone(&looks));
        thread::spawn(move || {
            let mut bytes = [0; 4096];
            while goes_on.load(Ordering::Relaxed) {
                let mut files = [PollFd::new(glass.as_fd(), PollFlags::POLLIN)];
                if poll(&mut files, 50_u16) == Ok(1) {
                    let count = glass.read(&mut bytes).unwrap_or(0);
                    seen.lock().unwrap().extend_from_slice(&bytes[..count]);
                }
            }
        });
        let log = folder.join("flight.mcap");
        Self { program, keyboard, screen, looks, terminal, log }
    }

    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn screen(&self) -> String {
        String::from_utf8_lossy(&self.screen.lock().unwrap()).into_owned()
    }

    /// The terminal after all that was written to it.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn glass(&self) -> vt100::Screen {
        let [rows, columns] = SIZE;
        let mut terminal = vt100::Parser::new(rows, columns, 0);
        terminal.process(&self.screen.lock().unwrap());
        terminal.screen().clone()
    }

    /// Waits until the picture shows `text`.
    #[expect(clippy::panic, reason = "a test may panic")]
    pub(crate) fn sees_drawn(&self, text: &str) -> vt100::Screen {
        for _ in 0..TEST_TIMEOUT.as_millis() / 100 {
            let glass = self.glass();
            if glass.contents().contains(text) {
                return glass;
            }
            sleep(Duration::from_millis(100));
        }
        panic!("never saw `{text}`:\n{}", self.glass().contents());
    }

    /// Waits until the screen shows `text`.
    #[expect(clippy::panic, reason = "a test may panic")]
    pub(crate) fn sees(&self, text: &str) {
        for _ in 0..TEST_TIMEOUT.as_millis() / 50 {
            if self.screen().contains(text) {
                return;
            }
            sleep(Duration::from_millis(50));
        }
        panic!("never saw `{text}`:\n{}", self.screen());
    }

    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn types(&mut self, bytes: &[u8]) {
        self.keyboard.write_all(bytes).unwrap();
    }

    /// Holds a key as a terminal does that knows no releases, once it repeats.
    pub(crate) fn holds(&mut self, key: u8, time: Duration) {
        for _ in 0..time.as_millis() / REPEAT.as_millis() {
            self.types(&[key]);
            sleep(REPEAT);
        }
    }

    /// Speaks the kitty keyboard protocol: a key of this code moves, 1 pressed, 2 repeated, 3 released.
    pub(crate) fn moves(&mut self, key: u8, motion: u8) {
        self.types(format!("\x1b[{key};1:{motion}u").as_bytes());
    }

    /// Answers that it does.
    pub(crate) fn speaks_kitty(&mut self) {
        self.sees("\x1b[?u");
        self.types(b"\x1b[?0u");
        self.sees("\x1b[>15u");
    }

    /// Repeats a key that was pressed.
    pub(crate) fn repeats(&mut self, key: u8, time: Duration) {
        for _ in 0..time.as_millis() / REPEAT.as_millis() {
            self.moves(key, 2);
            sleep(REPEAT);
        }
    }

    /// Whether the terminal shows what is typed.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn has_echo(&self) -> bool {
        tcgetattr(self.terminal.as_fd()).unwrap().local_flags.contains(LocalFlags::ECHO)
    }

    /// Closes the window: nobody holds this side of the terminal any more.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn closes(&mut self) {
        self.looks.store(false, Ordering::Relaxed);
        sleep(Duration::from_millis(200));
        self.keyboard = File::open("/dev/null").unwrap();
        self.terminal = self.keyboard.try_clone().unwrap().into();
    }

    /// Holds the terminal up: what is written to it waits.
    #[expect(clippy::unwrap_used, reason = "a test may panic")]
    pub(crate) fn hangs(&self) {
        tcflow(self.terminal.as_fd(), FlowArg::TCOOFF).unwrap();
    }

    /// Waits for the program's end.
    #[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
    pub(crate) fn ends(&mut self) -> ExitStatus {
        for _ in 0..TEST_TIMEOUT.as_millis() / 50 {
            if let Some(status) = self.program.try_wait().unwrap() {
                return status;
            }
            sleep(Duration::from_millis(50));
        }
        panic!("it does not end:\n{}", self.screen());
    }
}

impl Drop for Person {
    fn drop(&mut self) {
        self.looks.store(false, Ordering::Relaxed);
        // Over already, unless the test failed.
        self.program.kill().ok();
        self.program.wait().ok();
    }
}
