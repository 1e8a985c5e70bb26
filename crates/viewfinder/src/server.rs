//! HTTP and WebSockets: the page, its data, and what goes to and fro while it is open.

use crate::catalog;
use crate::frame::Frame;
use crate::guard::{Guard, Rate};
use crate::lock::lock;
use crate::point_image::{Of, PointImages};
use crate::pointer;
use crate::problem::Problem;
use crate::protocol::{self, Command, LARGEST_MESSAGE};
use crate::session::Session;
use axum::Router;
use axum::body::Body;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::extract::{Path, RawQuery, Request, State};
use axum::http::header::{self, HeaderValue};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::serve::ListenerExt;
use serde_json::{Value, json};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::sync::watch;
use tokio::time::timeout;

/// Pages that are open at once, at most.
const MOST_PAGES: usize = 16;
/// Messages of a page: so many a second, so many at once.
const MESSAGES_A_SECOND: f64 = 240.0;
const MESSAGES_AT_ONCE: f64 = 480.0;
/// Messages that were too many before a page is cut off.
const MOST_TOO_MANY: u32 = 20_000;
/// A page that takes nothing for so long is gone.
const GONE: Duration = Duration::from_secs(20);

/// The files of the page.
const FILES: [(&str, &str, &str); 11] = [
    ("index.html", "text/html; charset=utf-8", include_str!("../web/index.html")),
    ("style.css", "text/css; charset=utf-8", include_str!("../web/style.css")),
    ("app.js", "text/javascript; charset=utf-8", include_str!("../web/app.js")),
    ("link.js", "text/javascript; charset=utf-8", include_str!("../web/link.js")),
    ("finder.js", "text/javascript; charset=utf-8", include_str!("../web/finder.js")),
    ("dials.js", "text/javascript; charset=utf-8", include_str!("../web/dials.js")),
    ("drive.js", "text/javascript; charset=utf-8", include_str!("../web/drive.js")),
    ("point.js", "text/javascript; charset=utf-8", include_str!("../web/point.js")),
    ("panels.js", "text/javascript; charset=utf-8", include_str!("../web/panels.js")),
    ("texts.js", "text/javascript; charset=utf-8", include_str!("../web/texts.js")),
    ("icon.svg", "image/svg+xml", include_str!("../web/icon.svg")),
];

/// Nothing of a page comes from elsewhere, and nothing is embedded elsewhere. Styles are set by scripts on elements, which needs no exception.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What requests are answered with.
struct Server {
    session: Arc<Session>,
    guard: Guard,
    pages: AtomicUsize,
    point_images: Arc<PointImages>,
    ending: watch::Receiver<bool>,
}

/// Answers requests until `ending` says so.
pub async fn serve(
    listener: TcpListener,
    session: Arc<Session>,
    guard: Guard,
    ending: watch::Receiver<bool>,
) -> std::io::Result<()> {
    let mut ends = ending.clone();
    let server = Arc::new(Server { session, guard, pages: AtomicUsize::new(0), point_images: Arc::default(), ending });
    let router = Router::new()
        .route("/", get(index))
        .route("/ws", get(socket))
        .route("/api/catalog", get(catalog_json))
        .route("/api/lens.svg", get(lens_drawing))
        .route("/api/point.json", get(point_json))
        .route("/film/{id}/{file}", get(film))
        .route("/{file}", get(page_file))
        .layer(middleware::from_fn_with_state(server.clone(), guarded))
        .with_state(server);
    let ended = async move {
        let _ = ends.wait_for(|ends| *ends).await;
    };
    // A frame does not wait for the page to acknowledge the state sent before it (Nagle's algorithm).
    let listener = listener.tap_io(|stream| {
        let _ = stream.set_nodelay(true);
    });
    tokio::select! {
        served = axum::serve(listener, router) => served,
        () = ended => {
            // Pages are told that this is the end before their sockets close.
            tokio::time::sleep(Duration::from_millis(150)).await;
            Ok(())
        }
    }
}

fn text(status: StatusCode, body: impl Into<Body>) -> Response {
    let mut response = Response::new(body.into());
    *response.status_mut() = status;
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static("text/plain; charset=utf-8"));
    response
}

fn of_type(kind: &'static str, body: impl Into<Body>) -> Response {
    let mut response = Response::new(body.into());
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    response
}

fn problem(status: StatusCode, problem: &Problem) -> Response {
    let mut response = of_type("application/json", json!({ "problem": problem }).to_string());
    *response.status_mut() = status;
    response
}

/// Checks every request before anything looks at it, and tells browsers what the answer may be used for.
async fn guarded(State(server): State<Arc<Server>>, request: Request, next: Next) -> Response {
    let opens = request.uri().path() == "/" && token_of(request.uri().query()).is_some();
    let refused = server.guard.check_origin(request.headers()).and_then(|()| match opens {
        // The address with the token, which gives the cookie.
        true => Ok(()),
        false => server.guard.check_token(request.headers()),
    });
    let mut response = match refused {
        Err(refused) => text(refused.status(), format!("{refused}\n")),
        Ok(()) if request.method() != Method::GET && request.method() != Method::HEAD => {
            text(StatusCode::METHOD_NOT_ALLOWED, "expected GET\n")
        }
        Ok(()) => next.run(request).await,
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

/// The token of an address.
fn token_of(query: Option<&str>) -> Option<&str> {
    parameter(query, "token")
}

/// A parameter of an address, as it is written.
fn parameter<'a>(query: Option<&'a str>, name: &str) -> Option<&'a str> {
    query?.split('&').filter_map(|p| p.split_once('=')).find(|(n, _)| *n == name).map(|(_, value)| value)
}

async fn index(State(server): State<Arc<Server>>, RawQuery(query): RawQuery) -> Response {
    let Some(token) = token_of(query.as_deref()) else { return page("index.html") };
    if !server.guard.knows(token) {
        let refused = crate::guard::Refused::Token;
        return text(refused.status(), format!("{refused}\n"));
    }
    // From here on a cookie, so that the token stands in no address that is shown or kept.
    let mut response = text(StatusCode::SEE_OTHER, "");
    let headers = response.headers_mut();
    headers.insert(header::LOCATION, HeaderValue::from_static("/"));
    if let Ok(cookie) = HeaderValue::from_str(&server.guard.cookie()) {
        headers.insert(header::SET_COOKIE, cookie);
    }
    response
}

fn page(name: &str) -> Response {
    match FILES.iter().find(|f| f.0 == name) {
        Some((_, kind, body)) => of_type(kind, *body),
        None => text(StatusCode::NOT_FOUND, "there is no such page\n"),
    }
}

async fn page_file(Path(file): Path<String>) -> Response {
    page(&file)
}

/// Runs what takes milliseconds apart from the thread that answers everybody.
async fn apart<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Option<T> {
    tokio::task::spawn_blocking(work).await.ok()
}

async fn catalog_json(State(server): State<Arc<Server>>) -> Response {
    let session = server.session.clone();
    match apart(move || catalog::catalog(&session.folders).to_string()).await {
        Some(json) => of_type("application/json", json),
        None => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// `?name=NAME`: an embedded lens; without, the one of the camera as it stands, `&at=X,Y` with the rays of a place of the picture.
async fn lens_drawing(State(server): State<Arc<Server>>, RawQuery(query): RawQuery) -> Response {
    if let Some(name) = parameter(query.as_deref(), "name").map(str::to_owned) {
        return match apart(move || catalog::drawing_of(&name)).await {
            Some(Ok(svg)) => of_type("image/svg+xml", svg),
            Some(Err(e)) => problem(StatusCode::NOT_FOUND, &e.into()),
            None => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
        };
    }
    let place = place_of(query.as_deref());
    let live = lock(&server.session.live).clone();
    let drawn = match live {
        Some(live) => apart(move || catalog::drawing(&live, place.and_then(|p| pointer::field_at(&live, p)))).await.flatten(),
        None => None,
    };
    match drawn {
        Some(svg) => of_type("image/svg+xml", svg),
        // A pinhole has no section: an answer like any other, which a browser does not report as an error.
        None => StatusCode::NO_CONTENT.into_response(),
    }
}

/// A place of the picture in an address: `at=X,Y`, 0 to 1 across and down.
fn place_of(query: Option<&str>) -> Option<[f64; 2]> {
    let (x, y) = parameter(query, "at")?.split_once(',')?;
    Some([x.parse().ok()?, y.parse().ok()?]).filter(|p: &[f64; 2]| p.iter().all(|v| (0.0..=1.0).contains(v)))
}

/// `?at=X,Y`: MTF and spot of the latest frame's lens at a place of the picture, for a point in focus; `&of=subject` for one at the distance of what is there.
async fn point_json(State(server): State<Arc<Server>>, RawQuery(query): RawQuery) -> Response {
    let query = query.as_deref();
    let of = match parameter(query, "of") {
        None | Some("focus") => Some(Of::Focus),
        Some("subject") => Some(Of::Subject),
        Some(_) => None,
    };
    let (Some(place), Some(of)) = (place_of(query), of) else {
        let expected = "at=X,Y with 0 to 1 across and down, and of=focus or of=subject";
        return problem(StatusCode::BAD_REQUEST, &Problem::new("point", query.unwrap_or(""), expected));
    };
    let Some(live) = lock(&server.session.live).clone() else {
        return StatusCode::NO_CONTENT.into_response();
    };
    let images = server.point_images.clone();
    match apart(move || serde_json::to_string(&images.at(&live, place, of))).await {
        Some(Ok(json)) => of_type("application/json", json),
        _ => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// A file of a picture that was taken: `jpg`, `dng`, `exr`, `toml` or `thumbnail.jpg`.
async fn film(State(server): State<Arc<Server>>, Path((id, file)): Path<(u64, String)>) -> Response {
    let Some(path) = server.session.darkroom.file(id, &file) else {
        return text(StatusCode::NOT_FOUND, "there is no such picture\n");
    };
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let Some(Ok(bytes)) = apart(move || std::fs::read(path)).await else {
        return text(StatusCode::NOT_FOUND, "this picture cannot be read\n");
    };
    let kind = match file.as_str() {
        "jpg" | "thumbnail.jpg" => "image/jpeg",
        "dng" => "image/x-adobe-dng",
        "exr" => "image/x-exr",
        _ => "text/plain; charset=utf-8",
    };
    let mut response = of_type(kind, bytes);
    if let Ok(value) = HeaderValue::from_str(&format!("inline; filename=\"{name}\"")) {
        response.headers_mut().insert(header::CONTENT_DISPOSITION, value);
    }
    response
}

async fn socket(State(server): State<Arc<Server>>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    // What a browser opens a socket with names the page it is of. Programs send none, and need the header of the token.
    let browser = headers.contains_key(header::ORIGIN) || headers.contains_key(crate::guard::TOKEN_HEADER);
    if !browser {
        return text(StatusCode::FORBIDDEN, "Origin: expected a page of this server\n");
    }
    if server.pages.fetch_add(1, Ordering::Relaxed) >= MOST_PAGES {
        server.pages.fetch_sub(1, Ordering::Relaxed);
        return text(StatusCode::TOO_MANY_REQUESTS, "too many pages are open: close some\n");
    }
    let open = OpenPage(server);
    upgrade.max_message_size(LARGEST_MESSAGE).max_frame_size(LARGEST_MESSAGE).on_upgrade(move |socket| async move {
        serve_socket(socket, &open.0).await;
        drop(open);
    })
}

/// Counts a page while it is open.
struct OpenPage(Arc<Server>);

impl Drop for OpenPage {
    fn drop(&mut self) {
        self.0.pages.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Talks to a page until it goes. One frame at a time is under way: the next is sent when the page has shown it, and is then the latest there is.
async fn serve_socket(mut socket: WebSocket, server: &Arc<Server>) {
    let session = &server.session;
    let mut states = session.state.subscribe();
    let mut frames = session.frames.subscribe();
    let mut ending = server.ending.clone();
    // What is known already goes to a new page, too.
    states.mark_changed();
    frames.mark_changed();
    let mut rate = Rate::new(MESSAGES_A_SECOND, MESSAGES_AT_ONCE, Instant::now());
    let mut problems = Rate::new(20.0, 100.0, Instant::now());
    let (mut too_many, mut under_way) = (0u32, None::<u64>);
    loop {
        let message = tokio::select! {
            _ = ending.changed() => {
                let _ = timeout(Duration::from_millis(100), socket.send(Message::Close(None))).await;
                return;
            }
            received = socket.recv() => {
                let Some(Ok(received)) = received else { return };
                let text = match received {
                    Message::Text(text) => text,
                    Message::Close(_) => return,
                    // Pages send text only; pings are answered by the library.
                    Message::Binary(_) => "binary message".into(),
                    Message::Ping(_) | Message::Pong(_) => continue,
                };
                // What a frame is waiting for is bounded by the frames that were sent.
                let acknowledges = under_way.is_some() && text.starts_with("{\"do\":\"ack\"");
                if !acknowledges && !rate.passes(Instant::now()) {
                    too_many += 1;
                    if too_many > MOST_TOO_MANY {
                        return;
                    }
                    continue;
                }
                match obey(session, &text, &mut under_way).await {
                    Ok(None) => continue,
                    Ok(Some(reply)) => Message::Text(reply.to_string().into()),
                    // Answers to a flood of nonsense are bounded like the flood.
                    Err(_) if !problems.passes(Instant::now()) => continue,
                    Err(problem) => Message::Text(json!({ "kind": "problem", "problem": problem }).to_string().into()),
                }
            }
            changed = states.changed() => {
                if changed.is_err() { return }
                let state = states.borrow_and_update().clone();
                Message::Text(state.as_ref().into())
            }
            changed = frames.changed(), if under_way.is_none() => {
                if changed.is_err() { return }
                let frame: Option<Arc<Frame>> = frames.borrow_and_update().clone();
                let Some(frame) = frame else { continue };
                under_way = Some(frame.number);
                Message::Binary(frame.bytes.clone().into())
            }
        };
        match timeout(GONE, socket.send(message)).await {
            Ok(Ok(())) => {}
            _ => return,
        }
    }
}

/// Does what a page asks for; the answer goes to this page alone.
async fn obey(session: &Arc<Session>, text: &str, under_way: &mut Option<u64>) -> Result<Option<Value>, Problem> {
    match protocol::parse(text)? {
        Command::Ack { frame } => {
            if *under_way == Some(frame) {
                *under_way = None;
                session.shown_frame.fetch_max(frame, Ordering::Relaxed);
            }
        }
        Command::Probe { at } => {
            let Some(live) = lock(&session.live).clone() else { return Ok(None) };
            return Ok(apart(move || pointer::numbers(&live, at)).await);
        }
        Command::Set { shot } => session.set(&shot)?,
        Command::Reset {} => session.reset()?,
        Command::Focus { at } => session.focus(at)?,
        Command::White { at } => session.white(at)?,
        Command::Move { how, by } => session.move_camera(how, by)?,
        Command::Shoot { series, timer_s: None } => {
            session.shoot(series)?;
        }
        Command::Shoot { series, timer_s: Some(seconds) } => session.shoot_after(seconds, series, Instant::now())?,
        Command::CancelTimer {} => session.cancel_timer(),
        Command::CancelSeries { id } => {
            session.darkroom.cancel_series(id);
            session.publish();
        }
        Command::Cancel { id } => {
            session.darkroom.cancel(id);
            session.publish();
        }
        Command::Discard { id } => {
            session.darkroom.discard(id);
            session.publish();
        }
    }
    Ok(None)
}
