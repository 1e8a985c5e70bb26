//! The server as a browser, a program and an attacker see it: HTTP and WebSockets over plain sockets.

use diopter::quantity::Size;
use diopter::shot::ShotFile;
use diopter_viewfinder::{Options, serve};
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Where a viewfinder is.
struct At {
    port: u16,
    token: String,
}

/// Runs a test against a viewfinder of a small chart; it must end when it is told to.
fn with_viewfinder(test: impl FnOnce(&At)) {
    let mut shot = ShotFile::default();
    shot.scene.file = Some("color-chart".into());
    shot.render.size = Some(Size { width: 24, height: 16 });
    shot.render.spp = Some(1);
    let stop = AtomicBool::new(false);
    let options = Options { shot, folders: vec![], port: 0, stop: &stop, now: || "2026:01:01 00:00:00".into() };
    std::thread::scope(|threads| {
        let (ready, address) = mpsc::channel::<String>();
        let served = threads.spawn(|| serve(&options, move |at| ready.send(at.to_owned()).unwrap(), &mut |_| ()));
        let address = address.recv_timeout(Duration::from_secs(180)).expect("an address");
        let (port, token) = address.strip_prefix("http://127.0.0.1:").unwrap().split_once("/?token=").unwrap();
        let at = At { port: port.parse().unwrap(), token: token.to_owned() };
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| test(&at)));
        stop.store(true, Ordering::Relaxed);
        let begun = Instant::now();
        served.join().unwrap().unwrap();
        assert!(begun.elapsed() < Duration::from_secs(30), "it ends slowly");
        if let Err(e) = done {
            std::panic::resume_unwind(e);
        }
    });
}

impl At {
    fn open(&self) -> TcpStream {
        let socket = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(180))).unwrap();
        socket
    }

    fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}", self.port)
    }

    fn cookie(&self) -> String {
        format!("Cookie: diopter-{}={}", self.port, self.token)
    }

    /// Status, head and body of an answer.
    fn ask(&self, line: &str, headers: &[&str]) -> (u16, String, Vec<u8>) {
        let mut socket = self.open();
        write!(socket, "{line} HTTP/1.1\r\nConnection: close\r\n").unwrap();
        headers.iter().for_each(|h| write!(socket, "{h}\r\n").unwrap());
        write!(socket, "\r\n").unwrap();
        let mut answer = Vec::new();
        socket.read_to_end(&mut answer).unwrap();
        let end = answer.windows(4).position(|w| w == b"\r\n\r\n").expect("a head");
        let head = String::from_utf8_lossy(&answer[..end]).into_owned();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        (status, head, answer[end + 4..].to_vec())
    }

    fn get(&self, path: &str, headers: &[&str]) -> u16 {
        self.ask(&format!("GET {path}"), headers).0
    }
}

/// A WebSocket, as a browser has it.
struct Page(TcpStream, Option<Value>);

enum Heard {
    Text(Value),
    Frame(Value),
    Closed,
}

impl Page {
    fn open(at: &At) -> Page {
        let origin = format!("Origin: http://127.0.0.1:{}", at.port);
        Page::try_open(at, &[&at.host(), &at.cookie(), &origin]).expect("a socket")
    }

    /// The socket, or the status of the refusal.
    fn try_open(at: &At, headers: &[&str]) -> Result<Page, u16> {
        let mut socket = at.open();
        write!(socket, "GET /ws HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n").unwrap();
        write!(socket, "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n").unwrap();
        headers.iter().for_each(|h| write!(socket, "{h}\r\n").unwrap());
        write!(socket, "\r\n").unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            socket.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        match String::from_utf8_lossy(&head).split(' ').nth(1).unwrap().parse().unwrap() {
            101 => Ok(Page(socket, None)),
            status => Err(status),
        }
    }

    /// Sends a message of a kind (1 text, 2 binary); false once the other end has closed.
    fn send_raw(&mut self, kind: u8, body: &[u8]) -> bool {
        let mut message = vec![0x80 | kind];
        match body.len() {
            n @ 0..=125 => message.push(0x80 | n as u8),
            n @ 126..=65_535 => {
                message.push(0x80 | 126);
                message.extend((n as u16).to_be_bytes());
            }
            n => {
                message.push(0x80 | 127);
                message.extend((n as u64).to_be_bytes());
            }
        }
        let mask = [1, 2, 3, 4];
        message.extend(mask);
        message.extend(body.iter().enumerate().map(|(i, b)| b ^ mask[i % 4]));
        self.0.write_all(&message).is_ok()
    }

    fn send(&mut self, command: Value) {
        assert!(self.send_raw(1, command.to_string().as_bytes()));
    }

    fn hear(&mut self) -> Heard {
        let mut exactly = |n: usize| {
            let mut bytes = vec![0; n];
            self.0.read_exact(&mut bytes).map(|()| bytes)
        };
        loop {
            let Ok(start) = exactly(2) else { return Heard::Closed };
            let length = match start[1] {
                126 => u16::from_be_bytes(exactly(2).unwrap().try_into().unwrap()).into(),
                127 => u64::from_be_bytes(exactly(8).unwrap().try_into().unwrap()),
                n => n.into(),
            };
            let Ok(body) = exactly(length as usize) else { return Heard::Closed };
            match start[0] & 0xf {
                1 => return Heard::Text(serde_json::from_slice(&body).unwrap()),
                2 => {
                    assert_eq!(&body[..4], b"DVF1");
                    let length = u32::from_le_bytes(body[4..8].try_into().unwrap()) as usize;
                    let header: Value = serde_json::from_slice(&body[8..8 + length]).unwrap();
                    self.send(json!({ "do": "ack", "frame": header["frame"] }));
                    return Heard::Frame(header);
                }
                8 => return Heard::Closed,
                _ => {}
            }
        }
    }

    /// Listens until a text has a property.
    fn until(&mut self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(180) {
            match self.hear() {
                Heard::Text(text) if is(&text) => return text,
                Heard::Closed => panic!("closed before: {what}"),
                // A frame may come before the state that belongs to it.
                Heard::Frame(header) => self.1 = Some(header),
                _ => {}
            }
        }
        panic!("never heard: {what}")
    }

    /// Listens until a frame has a property.
    fn frame(&mut self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        if let Some(header) = self.1.take().filter(&is) {
            return header;
        }
        while begun.elapsed() < Duration::from_secs(180) {
            match self.hear() {
                Heard::Frame(header) if is(&header) => return header,
                Heard::Closed => panic!("closed before: {what}"),
                _ => {}
            }
        }
        panic!("no frame: {what}")
    }
}

#[test]
fn who_lacks_the_token_or_comes_from_elsewhere_is_refused() {
    with_viewfinder(|at| {
        let (host, cookie) = (at.host(), at.cookie());
        // The address that is printed gives a cookie and leads to the page.
        let (status, head, _) = at.ask(&format!("GET /?token={}", at.token), &[&host]);
        assert!(status == 303 && head.to_lowercase().contains("location: /\r\n"), "{head}");
        let set = head.lines().find(|l| l.to_lowercase().starts_with("set-cookie")).unwrap();
        assert!(set.contains("HttpOnly") && set.contains("SameSite=Strict"), "{set}");
        let (status, head, body) = at.ask("GET /", &[&host, &cookie]);
        assert!(status == 200 && String::from_utf8_lossy(&body).contains("app.js"));
        assert!(head.to_lowercase().contains("content-security-policy: default-src 'none'"), "{head}");
        assert_eq!(at.get("/app.js", &[&host, &format!("X-Diopter-Token: {}", at.token)]), 200);
        // Without it nothing is told, not even what there is.
        for path in ["/", "/app.js", "/api/catalog", "/film/1/dng", "/nowhere", "/?token=0123", "/?token="] {
            assert_eq!(at.get(path, &[&host]), 403, "{path}");
        }
        let wrong = format!("Cookie: diopter-{}={}", at.port, "0".repeat(32));
        assert_eq!(at.get("/", &[&host, &wrong]), 403);
        // A name that resolves to this machine, and pages of other origins.
        for other in ["Host: evil.example".to_owned(), format!("Host: evil.example:{}", at.port), "Host: 127.0.0.1:1".into()] {
            assert_eq!(at.get("/", &[&other, &cookie]), 421, "{other}");
            assert_eq!(at.get(&format!("/?token={}", at.token), &[&other]), 421, "{other}");
        }
        assert_eq!(at.get("/", &[&host, &cookie, "Origin: http://evil.example"]), 403);
        // Paths and methods.
        for path in ["/../Cargo.toml", "/%2e%2e/Cargo.toml", "/film/1/../../x", "/film/x/dng", "/style.css/.."] {
            assert!([400, 404].contains(&at.get(path, &[&host, &cookie])), "{path}");
        }
        assert_eq!(at.ask("POST /", &[&host, &cookie, "Content-Length: 0"]).0, 405);
        // Sockets likewise.
        let origin = format!("Origin: http://127.0.0.1:{}", at.port);
        let refused = |headers: &[&str]| Page::try_open(at, headers).err();
        assert_eq!(refused(&[&host, &origin]), Some(403));
        assert_eq!(refused(&[&host, &cookie, "Origin: http://evil.example"]), Some(403));
        assert_eq!(refused(&[&host, &cookie]), Some(403));
        assert_eq!(refused(&["Host: evil.example", &cookie, &origin]), Some(421));
        assert_eq!(refused(&[&host, &cookie, &origin]), None);
    });
}

#[test]
fn malformed_messages_are_survived_and_answered() {
    with_viewfinder(|at| {
        let mut page = Page::open(at);
        page.send(json!({ "do": "set", "shot": { "exposure": { "aperture": "wide" } } }));
        let problem = page.until("a problem", |m| m["kind"] == "problem");
        assert_eq!(problem["problem"]["place"], "exposure.aperture", "{problem}");
        assert!(problem["problem"]["expected"].as_str().unwrap().contains("f/2.8"), "{problem}");
        // A flood of nonsense, from a page that does not read the answers.
        let mut flood = Page::open(at);
        for k in 0..10_000u32 {
            let noise: Vec<u8> = (0..k % 97).map(|i| (i.wrapping_mul(k.wrapping_mul(2_654_435_761)) >> 13) as u8).collect();
            let sent = match k % 4 {
                0 => flood.send_raw(1, String::from_utf8_lossy(&noise).as_bytes()),
                1 => flood.send_raw(2, &noise),
                2 => flood.send_raw(1, format!("{{\"do\": \"set\", \"shot\": {k}}}").as_bytes()),
                _ => flood.send_raw(1, b"{\"do\": \"focus\", \"at\": [2, \"x\"]}"),
            };
            if !sent {
                break;
            }
        }
        drop(flood);
        // Text that is no UTF-8, and more than a message may be, end their page alone.
        let mut bad = Page::open(at);
        bad.send_raw(1, &[0xff, 0xfe, 0x80]);
        let mut long = Page::open(at);
        long.send_raw(1, &vec![b' '; 1 << 20]);
        for page in [&mut bad, &mut long] {
            while !matches!(page.hear(), Heard::Closed) {}
        }
        // The first page works on.
        page.send(json!({ "do": "set", "shot": { "exposure": { "iso": 800 } } }));
        page.until("the ISO speed", |m| m["kind"] == "state" && m["facts"]["exposure"]["iso"] == 800.0);
        page.send(json!({ "do": "probe", "at": [0.5, 0.5] }));
        let numbers = page.until("numbers", |m| m["kind"] == "probe");
        assert!(numbers["dn"].as_u64().is_some() && numbers["electrons"].is_object(), "{numbers}");
    });
}

#[test]
fn all_pages_see_the_same_camera() {
    with_viewfinder(|at| {
        let (mut one, mut two) = (Page::open(at), Page::open(at));
        one.frame("the first", |_| true);
        let first = two.frame("the first", |h| h["done"] == true);
        two.send(json!({ "do": "set", "shot": { "exposure": { "aperture": "f/2" } } }));
        one.until("the aperture", |m| m["kind"] == "state" && m["shot"]["exposure"]["aperture"] == "f/2");
        let version = first["version"].as_u64().unwrap() + 1;
        one.frame("the new picture", |h| h["version"] == version && h["done"] == true);
        two.frame("the new picture", |h| h["version"] == version && h["done"] == true);
        // A page that is opened later, or again, sees it as well.
        let mut three = Page::open(at);
        three.frame("the picture", |h| h["version"] == version);
        // What the command line would refuse is refused in its words, for all to see, and nothing changes.
        three.send(json!({ "do": "set", "shot": { "scene": { "file": "still-lifes" } } }));
        let state = one.until("the problem", |m| m["kind"] == "state" && !m["problem"].is_null());
        assert_eq!(state["problem"]["problem"]["hint"], "did you mean \"still-life\"?", "{state}");
        assert_eq!(state["shot"]["scene"]["file"], "color-chart");
        // A file that nobody named on the command line.
        three.send(json!({ "do": "set", "shot": { "scene": { "file": "/etc/hostname" } } }));
        let problem = three.until("a problem", |m| m["kind"] == "problem");
        assert_eq!(problem["problem"]["place"], "scene", "{problem}");
    });
}

#[test]
fn a_picture_is_taken_and_fetched() {
    with_viewfinder(|at| {
        let mut page = Page::open(at);
        page.frame("the first", |_| true);
        page.send(json!({ "do": "shoot" }));
        let state = page.until("the picture", |m| m["kind"] == "state" && m["film"].as_array().is_some_and(|f| !f.is_empty()));
        assert!(state["film"][0]["command"].as_str().unwrap().starts_with("diopter shoot photo-0001.toml"), "{state}");
        let (host, cookie) = (at.host(), at.cookie());
        for (kind, start) in [("dng", &b"II"[..]), ("jpg", &[0xff, 0xd8]), ("exr", &[0x76, 0x2f]), ("toml", b"[scene]")] {
            let (status, head, body) = at.ask(&format!("GET /film/1/{kind}"), &[&host, &cookie]);
            assert!(status == 200 && body.starts_with(start), "{kind}: {head}");
        }
        assert_eq!(at.get("/film/2/dng", &[&host, &cookie]), 404);
        assert_eq!(at.get("/api/lens.svg", &[&host, &cookie]), 200);
        page.send(json!({ "do": "discard", "id": 1 }));
        page.until("an empty film", |m| m["kind"] == "state" && m["film"].as_array().is_some_and(|f| f.is_empty()));
        assert_eq!(at.get("/film/1/dng", &[&host, &cookie]), 404);
    });
}

#[test]
fn a_series_is_taken_behind_the_self_timer() {
    with_viewfinder(|at| {
        let mut page = Page::open(at);
        page.frame("the first", |_| true);
        // Cancelled, it takes nothing.
        page.send(json!({ "do": "shoot", "timer_s": 60 }));
        page.until("the self-timer", |m| m["kind"] == "state" && m["timer"]["seconds"] == 60.0);
        page.send(json!({ "do": "shoot", "timer_s": 2 }));
        let problem = page.until("a problem", |m| m["kind"] == "problem");
        assert_eq!(problem["problem"]["place"], "self-timer", "{problem}");
        page.send(json!({ "do": "cancel-timer" }));
        page.until("no self-timer", |m| m["kind"] == "state" && m["timer"].is_null());
        let bracket = json!({ "kind": "bracket", "count": 3, "step_ev": 1 });
        page.send(json!({ "do": "shoot", "series": bracket, "timer_s": 0.2 }));
        let all = |m: &Value| m["kind"] == "state" && m["film"].as_array().is_some_and(|f| f.len() == 3);
        let state = page.until("three pictures", all);
        for (k, ev) in [-1.0, 0.0, 1.0].iter().enumerate() {
            let differs = state["film"][k]["series"]["differs"]["ev"].as_f64().unwrap();
            assert!((differs - ev).abs() < 1e-9 && state["film"][k]["id"] == k + 1, "{state}");
        }
        // What is wrong is answered, and queues nothing.
        for series in [
            json!({ "kind": "bracket", "count": 1, "step_ev": 1 }),
            json!({ "kind": "focus", "count": 3, "near_m": 0 }),
            json!("all"),
        ] {
            page.send(json!({ "do": "shoot", "series": series }));
            page.until("a problem", |m| m["kind"] == "problem");
        }
        page.send(json!({ "do": "cancel-series", "id": 77 }));
        page.send(json!({ "do": "discard", "id": 1 }));
        let film = |m: &Value| m["kind"] == "state" && m["film"].as_array().is_some_and(|f| f.len() == 2);
        let state = page.until("two pictures", film);
        assert_eq!(state["queue"]["jobs"], json!([]));
    });
}

#[test]
fn the_image_of_a_point_is_told() {
    with_viewfinder(|at| {
        let (host, cookie) = (at.host(), at.cookie());
        let mut page = Page::open(at);
        page.frame("the first", |_| true);
        page.send(
            json!({ "do": "set", "shot": { "camera": { "lens": "tessar-50mm-f2.8" }, "exposure": { "aperture": "f/8" } } }),
        );
        page.until("the lens", |m| m["kind"] == "state" && m["facts"]["exposure"]["f_number"] == 8.0);
        page.frame("its frame", |h| h["version"].as_u64() > Some(1));
        let ask = |query: &str| {
            let (status, _, body) = at.ask(&format!("GET /api/point.json{query}"), &[&host, &cookie]);
            (status, serde_json::from_slice::<Value>(&body).unwrap_or_default())
        };
        let (status, image) = ask("?at=0.5,0.5");
        assert!(status == 200 && image["missing"].is_null(), "{image}");
        let mtf = image["mtf"].as_array().unwrap();
        assert_eq!(mtf.iter().map(|c| c["frequency"].as_f64().unwrap()).collect::<Vec<_>>(), [10.0, 20.0, 30.0, 50.0]);
        assert!(mtf.iter().all(|c| (0.0..=1.0).contains(&c["sagittal"].as_f64().unwrap())), "{image}");
        // f/8: 1.22 λ N, a little more for the lens drawn out to a near chart.
        let airy = image["airy_um"].as_f64().unwrap();
        assert!(image["spot"].as_array().unwrap().len() == 3 && (5.5..7.0).contains(&airy), "{airy}");
        // The same again, and what is not in focus.
        assert_eq!(ask("?at=0.5,0.5").1, image);
        assert_eq!(ask("?at=0.9,0.1&of=subject").0, 200);
        for wrong in ["", "?at=2,0", "?at=0.5", "?at=x,y", "?at=nan,0", "?at=0.5,0.5&of=all"] {
            assert_eq!(ask(wrong).0, 400, "{wrong}");
        }
        assert_eq!(at.get("/api/point.json?at=0.5,0.5", &[&host]), 403);
    });
}

#[test]
fn what_cannot_be_begun_with_is_told_at_once() {
    let stop = AtomicBool::new(false);
    let mut shot = ShotFile::default();
    shot.scene.file = Some("still-lifes".into());
    let options = Options { shot, folders: vec![], port: 0, stop: &stop, now: String::new };
    let error = serve(&options, |_| panic!("it is ready"), &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("did you mean \"still-life\""), "{error}");
}
