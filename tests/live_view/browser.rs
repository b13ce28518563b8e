//! A headless Chromium, driven by its `DevTools` protocol.

use std::io::{BufRead, BufReader};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::{self, sleep};
use std::time::Duration;

use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::{Message, WebSocket, client};

use crate::chromium;

/// Tries of [`Browser::until`], and the time between two.
const TRIES: u32 = 300;
const BETWEEN: Duration = Duration::from_millis(100);

/// Keeps every canvas where its pixels can be read at once: otherwise each reading takes a busy machine seconds.
const READABLE: &str = r"(() => {
  const getContext = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return getContext.call(this, kind, { willReadFrequently: true, ...options });
  };
})()";

/// A browser with one page.
pub(crate) struct Browser {
    program: Child,
    socket: WebSocket<TcpStream>,
    session: Option<String>,
    calls: u64,
    complaints: Vec<String>,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Browser {
    /// Starts one, if there is one.
    pub(crate) fn start(name: &str) -> Option<Self> {
        let chromium = chromium::find()?;
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        std::fs::remove_dir_all(&folder).ok();
        let mut program = Command::new(chromium)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"])
            .args(["--no-first-run", "--disable-background-networking", "--disable-sync"])
            .args(["--disable-component-update", "--disable-dev-shm-usage"])
            .args(["--window-size=1200,1000", "--remote-debugging-port=0"])
            .arg(format!("--user-data-dir={}", folder.display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines =
            BufReader::new(program.stderr.take().unwrap()).lines().map_while(Result::ok);
        let url =
            lines.find_map(|line| line.strip_prefix("DevTools listening on ").map(str::to_owned));
        thread::spawn(move || lines.for_each(drop));
        let url = url.unwrap();
        let address = url.trim_start_matches("ws://").split('/').next().unwrap();
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_mins(1))).unwrap();
        let (socket, _) = client(url.as_str(), stream).unwrap();
        let mut browser = Self { program, socket, session: None, calls: 0, complaints: Vec::new() };
        let page = browser.call("Target.createTarget", &json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": page["targetId"], "flatten": true });
        let session = browser.call("Target.attachToTarget", &attach);
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Runtime", "Log", "Page"] {
            browser.call(&format!("{domain}.enable"), &json!({}));
        }
        browser.call("Page.addScriptToEvaluateOnNewDocument", &json!({ "source": READABLE }));
        Some(browser)
    }

    /// The answer to a call; complaints of the page on the way are kept.
    fn call(&mut self, method: &str, parameters: &Value) -> Value {
        self.calls += 1;
        let mut call = json!({ "id": self.calls, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            call["sessionId"] = session.as_str().into();
        }
        self.socket.send(Message::text(call.to_string())).unwrap();
        loop {
            let Message::Text(text) = self.socket.read().unwrap() else { continue };
            let mut message: Value = serde_json::from_str(&text).unwrap();
            if message["id"] == self.calls {
                assert!(message.get("error").is_none(), "{method}: {message}");
                return message["result"].take();
            }
            if let Some("Runtime.exceptionThrown" | "Runtime.consoleAPICalled" | "Log.entryAdded") =
                message["method"].as_str()
            {
                self.complaints.push(message.to_string());
            }
        }
    }

    pub(crate) fn opens(&mut self, url: &str) {
        // Another fragment alone would not load the page again.
        self.call("Page.navigate", &json!({ "url": "about:blank" }));
        self.call("Page.navigate", &json!({ "url": url }));
    }

    /// A screen of this size, in the light or the dark colour scheme.
    pub(crate) fn emulates(&mut self, width: u32, height: u32, is_dark: bool) {
        let screen = json!({
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600
        });
        self.call("Emulation.setDeviceMetricsOverride", &screen);
        let scheme = if is_dark { "dark" } else { "light" };
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.call("Emulation.setEmulatedMedia", &json!({ "features": features }));
    }

    /// Value of an expression in the page.
    pub(crate) fn evaluates(&mut self, expression: &str) -> Value {
        let call = json!({ "expression": expression, "returnByValue": true });
        self.call("Runtime.evaluate", &call)["result"]["value"].take()
    }

    /// Waits until an expression is true in the page.
    pub(crate) fn until(&mut self, expression: &str) {
        for _ in 0..TRIES {
            if self.evaluates(expression) == true {
                return;
            }
            sleep(BETWEEN);
        }
        let text = self.evaluates("document.body.innerText");
        let missing = self.evaluates("JSON.stringify(window.missing)");
        panic!("never {expression}:\nmissing {missing}\n{text}\n{:?}", self.complaints);
    }

    /// A key that goes down, or comes up.
    pub(crate) fn key(&mut self, key: &str, is_down: bool) {
        let (code, number, text) = match key {
            "Tab" => (key, 9, ""),
            "Enter" => (key, 13, "\r"),
            " " => ("Space", 32, " "),
            "Escape" => (key, 27, ""),
            "ArrowLeft" => (key, 37, ""),
            "ArrowRight" => (key, 39, ""),
            _ => (key, 0, key),
        };
        let event = json!({
            "type": if is_down { "keyDown" } else { "keyUp" }, "key": key, "code": code,
            "windowsVirtualKeyCode": number, "text": if is_down { text } else { "" }
        });
        self.call("Input.dispatchKeyEvent", &event);
    }

    /// A short press of a key.
    pub(crate) fn presses(&mut self, key: &str) {
        self.key(key, true);
        self.key(key, false);
    }

    /// Goes on by Tab to the first element of which `is_it`, an expression of `e`, holds. Each element on the way shows
    /// that it has the focus, and a part of it is in the window.
    pub(crate) fn tabs_to(&mut self, is_it: &str) {
        for _ in 0..60 {
            self.presses("Tab");
            let seen = self.evaluates(&format!(
                "(() => {{ const e = document.activeElement; const box = e.getBoundingClientRect(); \
                 return [{is_it}, e === document.body || (getComputedStyle(e).outlineStyle !== 'none' && \
                 box.bottom > 0 && box.top < innerHeight), e.outerHTML.slice(0, 80)]; }})()"
            ));
            assert_eq!(seen[1], true, "no visible focus: {seen}");
            if seen[0] == true {
                return;
            }
        }
        panic!("Tab never comes to {is_it}");
    }

    /// A click of the mouse at the middle of an element.
    pub(crate) fn clicks(&mut self, id: &str) {
        let middle = self.evaluates(&format!(
            "(() => {{ const element = document.getElementById('{id}'); \
             element.scrollIntoView({{ block: 'center' }}); \
             const {{ x, y, width, height }} = element.getBoundingClientRect(); \
             return [x + width / 2, y + height / 2]; }})()"
        ));
        let [x, y] = [0, 1].map(|axis| middle[axis].as_f64().unwrap());
        for kind in ["mousePressed", "mouseReleased"] {
            let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "clickCount": 1 });
            self.call("Input.dispatchMouseEvent", &event);
        }
    }

    /// Errors, warnings and messages of the page so far, but for the connection that the end of the
    /// flight refuses.
    pub(crate) fn complaints(&self) -> Vec<String> {
        let is_ours = |text: &&String| text.contains("ERR_CONNECTION_REFUSED");
        self.complaints.iter().filter(|text| !is_ours(text)).cloned().collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        self.program.kill().ok();
        self.program.wait().ok();
    }
}
