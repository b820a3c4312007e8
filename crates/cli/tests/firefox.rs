//! Firefox as a browser of tests, over WebDriver BiDi. It draws in 3-D only on a display, which
//! `Xvfb` gives it, with Mesa's software renderer.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::{Value, json};

use crate::bench::Bench;
use crate::report_browser::{Window, write_base64};

/// Settings of the profile: 3-D drawing without a graphics card, the light theme, and no requests
/// of the browser itself.
const SETTINGS: &str = "user_pref(\"webgl.force-enabled\", true);
user_pref(\"gfx.webrender.software\", true);
user_pref(\"gfx.x11-egl.force-enabled\", true);
user_pref(\"layout.css.prefers-color-scheme.content-override\", 1);
user_pref(\"datareporting.policy.dataSubmissionEnabled\", false);
user_pref(\"network.captive-portal-service.enabled\", false);
user_pref(\"network.connectivity-service.enabled\", false);
user_pref(\"browser.safebrowsing.malware.enabled\", false);
user_pref(\"app.update.enabled\", false);
";

/// Longest time for one answer.
const PATIENCE: Duration = Duration::from_secs(120);

/// A browser on a display of its own.
pub struct Firefox {
    display: Child,
    child: Child,
    socket: BufReader<TcpStream>,
    context: String,
    last_id: u64,
    /// Everything that the browser reported besides answers.
    events: Vec<Value>,
}

impl Firefox {
    /// Starts Firefox; says so and returns `None` if it or the display is not installed.
    pub fn start(bench: &Bench) -> Option<Firefox> {
        let is_there = |name: &str, flag: &str| Command::new(name).arg(flag).output().is_ok();
        if !is_there("firefox-esr", "--version") || !is_there("Xvfb", "-help") {
            eprintln!("skipped: there is no Firefox; install it with `apt install firefox-esr xvfb`");
            return None;
        }
        let mut display = Command::new("timeout")
            .args(["1200", "Xvfb", "-displayfd", "1", "-nolisten", "tcp", "-screen", "0", "1600x1400x24"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut number = String::new();
        BufReader::new(display.stdout.take().unwrap()).read_line(&mut number).unwrap();
        let profile = bench.path("firefox");
        std::fs::create_dir(&profile).unwrap();
        std::fs::write(profile.join("user.js"), SETTINGS).unwrap();
        // `timeout` ends a browser that hangs.
        let mut child = Command::new("timeout")
            .args(["1200", "firefox-esr", "--no-remote", "--remote-debugging-port", "0", "--profile"])
            .arg(&profile)
            .env("HOME", &profile)
            .env("DISPLAY", format!(":{}", number.trim()))
            .env("LIBGL_ALWAYS_SOFTWARE", "1")
            .env_remove("WAYLAND_DISPLAY")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let address = lines.find_map(|line| Some(line.unwrap().split_once("ws://")?.1.to_string())).unwrap();
        // What Firefox says later must not fill the pipe.
        std::thread::spawn(move || lines.for_each(drop));
        let stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut socket = BufReader::new(stream);
        let request = format!(
            "GET /session HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        );
        socket.get_mut().write_all(request.as_bytes()).unwrap();
        let head: Vec<String> =
            socket.by_ref().lines().map(Result::unwrap).take_while(|line| !line.is_empty()).collect();
        assert!(head[0].contains("101"), "{head:?}");
        let context = String::new();
        let mut browser = Firefox { display, child, socket, context, last_id: 0, events: Vec::new() };
        browser.call("session.new", json!({ "capabilities": {} }));
        let events = ["log.entryAdded", "network.beforeRequestSent"];
        browser.call("session.subscribe", json!({ "events": events }));
        let tree = browser.call("browsingContext.getTree", json!({}));
        browser.context = tree["contexts"][0]["context"].as_str().unwrap().to_string();
        Some(browser)
    }

    fn call(&mut self, method: &str, params: impl Into<Value>) -> Value {
        let params: Value = params.into();
        self.last_id += 1;
        self.send(&json!({ "id": self.last_id, "method": method, "params": params })).unwrap();
        loop {
            let answer = self.next();
            if answer["id"] == self.last_id {
                assert_eq!(answer["type"], "success", "{method}: {answer}");
                return answer["result"].clone();
            }
            self.events.push(answer);
        }
    }

    /// Sends a message as one frame of WebSocket (RFC 6455), whose bytes a client masks.
    fn send(&mut self, message: &Value) -> std::io::Result<()> {
        const MASK: [u8; 4] = [1, 2, 3, 4];
        let text = message.to_string();
        let mut frame = vec![0x81, 0x80 | 127];
        frame.extend((text.len() as u64).to_be_bytes());
        if let Ok(length) = u16::try_from(text.len()) {
            frame.truncate(1);
            // The shortest form is the only valid one.
            match length {
                ..126 => frame.push(0x80 | length as u8),
                _ => frame.extend([&[0x80 | 126][..], &length.to_be_bytes()].concat()),
            }
        }
        frame.extend(MASK);
        frame.extend(text.bytes().zip(MASK.iter().cycle()).map(|(byte, mask)| byte ^ mask));
        self.socket.get_mut().write_all(&frame)
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        self.socket.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// Reads a message, which can have several frames.
    fn next(&mut self) -> Value {
        let mut message = Vec::new();
        loop {
            let [first, second] = self.bytes();
            let length = match second & 0x7f {
                126 => u64::from(u16::from_be_bytes(self.bytes())),
                127 => u64::from_be_bytes(self.bytes()),
                length => u64::from(length),
            };
            let start = message.len();
            message.resize(start + length as usize, 0);
            self.socket.read_exact(&mut message[start..]).unwrap();
            match first & 0x0f {
                0 | 1 if first & 0x80 != 0 => return serde_json::from_slice(&message).unwrap(),
                0 | 1 => {}
                // Pings need no answer within a test.
                9 => message.truncate(start),
                code => panic!("the browser sent a frame of kind {code}"),
            }
        }
    }
}

impl Window for Firefox {
    fn open(&mut self, path: &Path, [width, height]: [u32; 2], theme: &str) -> Vec<String> {
        let viewport = json!({ "width": width, "height": height });
        let context = self.context.clone();
        self.call("browsingContext.setViewport", json!({ "context": context, "viewport": viewport }));
        self.events.clear();
        let url = format!("file://{}", path.display());
        let how = json!({ "context": context, "url": url, "wait": "complete" });
        self.call("browsingContext.navigate", how);
        if theme == "dark" {
            // The browser asks for the light theme, and the box in the page is for the other one.
            self.evaluate("document.getElementById('theme').click()");
        }
        let problem = |event: &Value| match event["method"].as_str().unwrap_or_default() {
            "log.entryAdded" => Some(event.to_string()),
            "network.beforeRequestSent" => {
                let request = event["params"]["request"]["url"].as_str().unwrap();
                let is_own = request == url || request.starts_with("data:");
                (!is_own).then(|| format!("request for {request}"))
            }
            _ => None,
        };
        self.events.iter().filter_map(problem).collect()
    }

    fn evaluate(&mut self, script: &str) -> Value {
        let expression = format!("(async () => JSON.stringify(await ({script})))()");
        let target = json!({ "context": self.context });
        let how = json!({ "expression": expression, "target": target, "awaitPromise": true });
        let found = self.call("script.evaluate", how);
        assert_eq!(found["type"], "success", "{script}: {found}");
        found["result"]["value"].as_str().map_or(Value::Null, |text| serde_json::from_str(text).unwrap())
    }

    fn wait(&mut self, script: &str) -> Value {
        self.evaluate(script)
    }

    fn screenshot(&mut self, file: &Path) {
        let how = json!({ "context": self.context, "origin": "document" });
        let shot = self.call("browsingContext.captureScreenshot", how);
        write_base64(shot["data"].as_str().unwrap(), file);
    }
}

impl Drop for Firefox {
    fn drop(&mut self) {
        let _ = self.send(&json!({ "id": 0, "method": "browser.close", "params": {} }));
        let began = Instant::now();
        while began.elapsed() < Duration::from_secs(10) && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(50));
        }
        for child in [&mut self.child, &mut self.display] {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}
