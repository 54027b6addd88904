//! A headless Chromium that is asked, over its debugging pipe, what a page's document holds while its script runs, and what it draws. Its `--dump-dom` would
//! not do: that tells the document of the moment of loading, before the first look has come, and with `--virtual-time-budget` a page's clock stands for as long
//! as its stream of events is open.

use crate::{Folder, RECOVERY_LIMIT, STOP_LIMIT, wait_for};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Cursor, Write};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

/// How Chromium is started: root has no sandbox, the station's shared memory is left to the station, and the pipe is at the file descriptors 3 and 4.
const FLAGS: [&str; 8] = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-proxy-server",
    "--password-store=basic",
    "--window-size=1280,1400",
    "--remote-debugging-pipe",
];
/// Contrast of text that people with poor sight can read (WCAG 2.2, 1.4.3).
const LEAST_CONTRAST: f64 = 4.5;

/// Whether there is a browser; if not, that is said.
pub fn has_chromium() -> bool {
    let mut command = Command::new("chromium");
    let status = command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    let has = status.is_ok_and(|status| status.success());
    if !has {
        eprintln!("NOT TRIED: the page in a browser needs Chromium: sudo apt-get install chromium fonts-dejavu-core");
    }
    has
}

/// A browser that shows a page.
#[derive(Debug)]
pub struct Browser {
    child: Child,
    /// Its file descriptor 3: it ends when this is closed.
    asks: Option<ChildStdin>,
    /// What it writes to its file descriptor 4.
    answers: Receiver<Value>,
    /// The page that it shows, once there is one.
    session: Option<String>,
    asked: u64,
    /// What went wrong in the page: exceptions of its script, and what its policy forbids.
    pub faults: Vec<String>,
    folder: Folder,
}

impl Browser {
    /// Opens a page.
    pub fn open(name: &str, url: &str) -> Browser {
        let folder = Folder::new(&format!("browser-{name}"));
        let said = std::fs::File::create(folder.path("said")).expect("a file for what the browser says");
        let mut command = Command::new("sh");
        let mut child = command
            .args(["-c", "exec chromium \"$@\" 3<&0 4>&1 </dev/null >/dev/null", "sh"])
            .args(FLAGS)
            .arg(format!("--user-data-dir={}", folder.path("profile")))
            .arg("about:blank") // the token goes through the pipe: others can read a command line
            .env("HOME", folder.as_path())
            .env_remove("XDG_CONFIG_HOME")
            .env_remove("XDG_CACHE_HOME")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(said)
            .spawn()
            .expect("a shell");
        let (asks, pipe) = (child.stdin.take(), child.stdout.take().expect("it is piped"));
        let (sender, answers) = channel();
        std::thread::spawn(move || {
            // Messages of JSON, each with a zero byte behind it.
            for message in BufReader::new(pipe).split(0).map_while(Result::ok) {
                let Ok(value) = serde_json::from_slice::<Value>(&message) else { continue };
                if sender.send(value).is_err() {
                    return;
                }
            }
        });
        let mut browser = Browser { child, asks, answers, session: None, asked: 0, faults: Vec::new(), folder };
        let target = browser.ask("Target.createTarget", json!({ "url": "about:blank" }));
        let attached = browser.ask("Target.attachToTarget", json!({ "targetId": target["targetId"], "flatten": true }));
        browser.session = attached["sessionId"].as_str().map(str::to_string);
        for method in ["Page.enable", "Runtime.enable", "Log.enable", "Page.bringToFront"] {
            browser.ask(method, json!({}));
        }
        browser.ask("Emulation.setFocusEmulationEnabled", json!({ "enabled": true }));
        browser.ask("Page.navigate", json!({ "url": url }));
        browser
    }

    /// Asks for something; an error if it is refused, as it is while one page gives way to the next.
    fn try_ask(&mut self, method: &str, parameters: Value) -> Result<Value, String> {
        self.asked += 1;
        let mut request = json!({ "id": self.asked, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            request["sessionId"] = json!(session);
        }
        let pipe = self.asks.as_mut().ok_or("the pipe is closed")?;
        pipe.write_all(format!("{request}\0").as_bytes()).map_err(|error| error.to_string())?;
        let end = Instant::now() + RECOVERY_LIMIT;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            let mut message = self.answers.recv_timeout(left).map_err(|error| error.to_string())?;
            if message["id"] == self.asked {
                let refused = message["error"]["message"].as_str().map(str::to_string);
                return refused.map_or_else(|| Ok(message["result"].take()), Err);
            }
            self.note(&message);
        }
    }

    /// Asks for something that is not refused.
    pub fn ask(&mut self, method: &str, parameters: Value) -> Value {
        let answer = self.try_ask(method, parameters);
        answer.unwrap_or_else(|error| panic!("{method}: {error}\n{}", self.folder.read("said")))
    }

    /// Keeps an event that tells of something wrong.
    fn note(&mut self, event: &Value) {
        let is_fault = match event["method"].as_str() {
            Some("Runtime.exceptionThrown") => true,
            Some("Log.entryAdded") => event["params"]["entry"]["source"] == "security",
            _ => false,
        };
        if is_fault {
            self.faults.push(event["params"].to_string());
        }
    }

    /// What an expression gives in the page; `None` if the page is not there yet.
    pub fn evaluate(&mut self, expression: &str) -> Option<Value> {
        let parameters = json!({ "expression": expression, "returnByValue": true });
        let mut answer = self.try_ask("Runtime.evaluate", parameters).ok()?;
        answer["exceptionDetails"].is_null().then(|| answer["result"]["value"].take())
    }

    /// Waits until an expression gives what is looked for.
    pub fn wait<T>(&mut self, what: &str, expression: &str, found: impl Fn(&Value) -> Option<T>) -> T {
        let mut last = Value::Null;
        let it = wait_for(RECOVERY_LIMIT, || {
            last = self.evaluate(expression)?;
            found(&last)
        });
        it.unwrap_or_else(|| {
            panic!("the page does not show {what}, but {last}\nfaults: {:?}\n{}", self.faults, self.folder.read("said"))
        })
    }

    /// Takes a picture of the whole page: its size and the number of its colours.
    pub fn screenshot(&mut self) -> ([u32; 2], u64) {
        let answer = self.ask("Page.captureScreenshot", json!({ "format": "png" }));
        let file = STANDARD.decode(answer["data"].as_str().unwrap_or_default()).expect("base64");
        let mut reader = png::Decoder::new(Cursor::new(file)).read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut pixels).expect("its pixels");
        assert_eq!(info.bit_depth, png::BitDepth::Eight);
        let colours: BTreeSet<&[u8]> = pixels[..info.buffer_size()].chunks_exact(info.color_type.samples()).collect();
        ([info.width, info.height], colours.len() as u64)
    }

    /// Sees that every text can be read on a medium by a light or a dark look. `texts` gives a list of kinds, each with its colour and that of its ground; the first
    /// is the page itself, of whose ground this gives the luminance.
    pub fn assert_readable(&mut self, media: &str, scheme: &str, texts: &str) -> f64 {
        let feature = json!({ "name": "prefers-color-scheme", "value": scheme });
        self.ask("Emulation.setEmulatedMedia", json!({ "media": media, "features": [feature] }));
        let texts = self.evaluate(texts).expect("texts of every kind");
        for text in texts.as_array().expect("a list") {
            let (one, other) = (luminance(&text[1]) + 0.05, luminance(&text[2]) + 0.05);
            let contrast = one.max(other) / one.min(other);
            assert!(contrast >= LEAST_CONTRAST, "{media} {scheme}: {text} has a contrast of {contrast:.1}");
        }
        luminance(&texts[0][2])
    }

    /// Presses a key and lets it go; `text` is what it types.
    pub fn press(&mut self, key: &str, number: u32, text: &str) {
        let down = if text.is_empty() { "rawKeyDown" } else { "keyDown" };
        for (kind, text) in [(down, text), ("keyUp", "")] {
            let event = json!({ "type": kind, "key": key, "code": key, "windowsVirtualKeyCode": number, "text": text });
            self.ask("Input.dispatchKeyEvent", event);
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        drop(self.asks.take());
        if wait_for(STOP_LIMIT, || self.child.try_wait().ok().flatten()).is_none() {
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Relative luminance of a colour of three channels of 0 to 255 (WCAG 2.2).
fn luminance(colour: &Value) -> f64 {
    let linear = |channel: usize| {
        let share = colour[channel].as_f64().expect("a channel") / 255.0;
        if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
    };
    0.2126 * linear(0) + 0.7152 * linear(1) + 0.0722 * linear(2)
}
