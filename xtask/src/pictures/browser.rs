//! A headless Chromium, driven through two pipes. Messages are JSON, each ended by a zero byte.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use anyhow::{Context, Result, bail, ensure};
use serde_json::{Value, json};

/// A window.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) is_dark: bool,
}

pub(super) struct Browser {
    program: Child,
    orders: File,
    answers: BufReader<File>,
    calls: u64,
}

/// The session of an open page.
pub(super) struct Page(String);

impl Browser {
    /// Starts a Chromium whose files go to `folder`.
    pub(super) fn start(folder: &Path) -> Result<Self> {
        let chromium = std::env::var_os("TELLO_CHROMIUM").unwrap_or_else(|| "chromium".into());
        let [orders, answers] = ["orders", "answers"].map(|name| folder.join(name));
        for pipe in [&orders, &answers] {
            if pipe.exists() {
                fs::remove_file(pipe)?;
            }
            crate::package::output(Command::new("mkfifo").arg(pipe))?;
        }
        // The shell gives the browser the pipes as the descriptors 3 and 4, where it expects them.
        let program = Command::new("sh")
            .args(["-c", r#"in=$1 out=$2; shift 2; exec "$@" 3<"$in" 4>"$out""#, "sh"])
            .args([&orders, &answers])
            .arg(chromium)
            .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic"])
            .args(["--no-first-run", "--disable-background-networking", "--disable-sync"])
            .args(["--disable-component-update", "--disable-dev-shm-usage", "--hide-scrollbars"])
            .arg("--remote-debugging-pipe")
            .arg(format!("--user-data-dir={}", folder.join("browser").display()))
            .arg("about:blank")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let orders = File::options().write(true).open(orders)?;
        let answers = BufReader::new(File::open(answers)?);
        Ok(Self { program, orders, answers, calls: 0 })
    }

    /// Opens a page in a window of its own.
    pub(super) fn open(&mut self, address: &str, view: View) -> Result<Page> {
        let target = self.call(None, "Target.createTarget", &json!({ "url": "about:blank" }))?;
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let attached = self.call(None, "Target.attachToTarget", &attach)?;
        let session = attached["sessionId"].as_str().context("no session")?.to_owned();
        let size = json!({ "width": view.width, "height": view.height, "deviceScaleFactor": 1,
            "mobile": view.width < 600 });
        self.call(Some(&session), "Emulation.setDeviceMetricsOverride", &size)?;
        let scheme = if view.is_dark { "dark" } else { "light" };
        let scheme = json!({ "features": [{ "name": "prefers-color-scheme", "value": scheme }] });
        self.call(Some(&session), "Emulation.setEmulatedMedia", &scheme)?;
        self.call(Some(&session), "Page.navigate", &json!({ "url": address }))?;
        Ok(Page(session))
    }

    /// Runs a script in the page.
    pub(super) fn evaluate(&mut self, page: &Page, script: &str) -> Result<()> {
        let expression = json!({ "expression": script });
        let result = self.call(Some(&page.0), "Runtime.evaluate", &expression)?;
        ensure!(result.get("exceptionDetails").is_none(), "{script}: {result}");
        Ok(())
    }

    /// What the window shows, as a PNG file.
    pub(super) fn picture(&mut self, page: &Page, to: &Path) -> Result<()> {
        let format = json!({ "format": "png" });
        let picture = self.call(Some(&page.0), "Page.captureScreenshot", &format)?;
        let bytes = decoded(picture["data"].as_str().context("no picture")?)?;
        Ok(fs::write(to, bytes)?)
    }

    /// The answer to a call; events on the way are dropped.
    fn call(&mut self, session: Option<&str>, method: &str, parameters: &Value) -> Result<Value> {
        self.calls += 1;
        let mut call = json!({ "id": self.calls, "method": method, "params": parameters });
        if let Some(session) = session {
            call["sessionId"] = session.into();
        }
        self.orders.write_all(format!("{call}\0").as_bytes())?;
        loop {
            let mut message = Vec::new();
            self.answers.read_until(0, &mut message)?;
            ensure!(message.pop() == Some(0), "the browser has ended");
            let mut message: Value = serde_json::from_slice(&message)?;
            if message["id"] != self.calls {
                continue;
            }
            if let Some(error) = message.get("error") {
                bail!("{method}: {error}");
            }
            return Ok(message["result"].take());
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // It may have ended by itself; nothing is left to do then.
        if self.program.kill().is_ok() {
            self.program.wait().ok();
        }
    }
}

/// Bytes of a text in base64.
fn decoded(text: &str) -> Result<Vec<u8>> {
    const DIGITS: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3);
    let (mut bits, mut count) = (0u32, 0);
    for digit in text.bytes().take_while(|digit| *digit != b'=') {
        let value = DIGITS.iter().position(|other| *other == digit).context("no base64")?;
        bits = bits << 6 | u32::try_from(value)?;
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push(u8::try_from(bits >> count & 0xff)?);
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_decoded() {
        for (text, bytes) in [("", ""), ("TWE=", "Ma"), ("TWFu", "Man"), ("TWFuTQ==", "ManM")] {
            assert_eq!(decoded(text).unwrap(), bytes.as_bytes());
        }
        assert!(decoded("T*").is_err());
    }
}
