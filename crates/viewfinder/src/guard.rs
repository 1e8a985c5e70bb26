//! Who may talk to the server: whoever has the token, from a page of this very address.
//!
//! A page of another site can make a browser send requests to 127.0.0.1, and by DNS rebinding (a name that first resolves to the attacker's server and
//! then to 127.0.0.1) it can even read the answers as those of its own origin. Such requests carry the attacker's name in `Host` or `Origin`: only
//! names of the loopback with our port are let through. Other users of the machine, whose programs can send any header, lack the token.
//! Source: Jackson et al. 2007, "Protecting browsers from DNS rebinding attacks" (CCS); RFC 6455 §10.2 (WebSockets know no same-origin policy).

use axum::http::header::{COOKIE, HOST, ORIGIN};
use axum::http::{HeaderMap, StatusCode};
use std::time::Instant;

/// Header by which programs that are no browsers send the token.
pub const TOKEN_HEADER: &str = "x-diopter-token";

/// Bytes of a token: what cannot be guessed.
const TOKEN_BYTES: usize = 16;

/// The token and the port of a server.
#[derive(Clone, Debug)]
pub struct Guard {
    token: String,
    port: u16,
}

/// Why a request is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// Another name than the loopback's.
    #[error("Host: expected 127.0.0.1 or localhost with the port of this server")]
    Host,
    /// A page of another origin.
    #[error("Origin: expected a page of this server")]
    Origin,
    /// No token, or another one.
    #[error("token: expected the address that `diopter viewfinder` printed, with its token")]
    Token,
}

impl Refused {
    /// HTTP's word for it.
    pub fn status(self) -> StatusCode {
        match self {
            Refused::Host => StatusCode::MISDIRECTED_REQUEST,
            Refused::Origin | Refused::Token => StatusCode::FORBIDDEN,
        }
    }
}

impl Guard {
    /// A new random token for a port. Fails where the system has no random numbers.
    pub fn new(port: u16) -> std::io::Result<Guard> {
        let mut bytes = [0u8; TOKEN_BYTES];
        getrandom::fill(&mut bytes).map_err(|e| std::io::Error::other(e.to_string()))?;
        Ok(Guard { token: bytes.iter().map(|b| format!("{b:02x}")).collect(), port })
    }

    /// The address that opens the viewfinder.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.port, self.token)
    }

    /// Name of the cookie. Cookies know no ports: two viewfinders on one machine each have theirs.
    pub fn cookie_name(&self) -> String {
        format!("diopter-{}", self.port)
    }

    /// The cookie that stands for the token from now on: for scripts of no page, for no other site, until the browser is closed.
    pub fn cookie(&self) -> String {
        format!("{}={}; Path=/; HttpOnly; SameSite=Strict", self.cookie_name(), self.token)
    }

    /// Whether a token is the right one, in a time that does not tell how much of it is.
    pub fn knows(&self, token: &str) -> bool {
        let same = token.bytes().zip(self.token.bytes()).fold(0, |differing, (a, b)| differing | (a ^ b));
        same == 0 && token.len() == self.token.len()
    }

    /// Checks where a request comes from: every one, before anything else is looked at. Fails unless `Host` is the loopback's with this port, and `Origin`, where there
    /// is one, is the same.
    pub fn check_origin(&self, headers: &HeaderMap) -> Result<(), Refused> {
        let mut hosts = headers.get_all(HOST).iter();
        let (Some(host), None) = (hosts.next(), hosts.next()) else { return Err(Refused::Host) };
        let host = host.to_str().map_err(|_| Refused::Host)?;
        if !self.hosts().iter().any(|h| h.eq_ignore_ascii_case(host)) {
            return Err(Refused::Host);
        }
        for origin in headers.get_all(ORIGIN) {
            let origin = origin.to_str().map_err(|_| Refused::Origin)?;
            let of = origin.strip_prefix("http://").ok_or(Refused::Origin)?;
            if !of.eq_ignore_ascii_case(host) {
                return Err(Refused::Origin);
            }
        }
        Ok(())
    }

    /// Checks that a request has the token, as a cookie or a header. Fails where it has none or another.
    pub fn check_token(&self, headers: &HeaderMap) -> Result<(), Refused> {
        let name = self.cookie_name();
        let cookies = headers.get_all(COOKIE).iter().filter_map(|c| c.to_str().ok()).flat_map(|c| c.split(';'));
        let of_cookies = cookies.filter_map(|c| c.trim().split_once('=')).filter(|(n, _)| *n == name).map(|(_, token)| token);
        let of_header = headers.get(TOKEN_HEADER).and_then(|t| t.to_str().ok());
        match of_header.into_iter().chain(of_cookies).any(|token| self.knows(token)) {
            true => Ok(()),
            false => Err(Refused::Token),
        }
    }

    fn hosts(&self) -> [String; 3] {
        ["127.0.0.1", "localhost", "[::1]"].map(|name| match self.port {
            // Browsers leave out the port that http has anyway.
            80 => name.to_owned(),
            port => format!("{name}:{port}"),
        })
    }
}

/// Lets so many messages a second through, and bursts of some seconds' worth (a token bucket).
#[derive(Clone, Debug)]
pub struct Rate {
    a_second: f64,
    most: f64,
    left: f64,
    at: Instant,
}

impl Rate {
    /// `a_second` messages on average, `most` at once; `now`: when it begins.
    pub fn new(a_second: f64, most: f64, now: Instant) -> Rate {
        Rate { a_second, most, left: most, at: now }
    }

    /// Whether one more may pass.
    pub fn passes(&mut self, now: Instant) -> bool {
        let elapsed = now.saturating_duration_since(self.at).as_secs_f64();
        (self.left, self.at) = ((self.left + elapsed * self.a_second).min(self.most), now);
        let passes = self.left >= 1.0;
        if passes {
            self.left -= 1.0;
        }
        passes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;
    use std::time::Duration;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let mut map = HeaderMap::new();
        for (name, value) in pairs {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        map
    }

    #[test]
    fn only_the_loopback_and_its_own_pages_pass() {
        let guard = Guard::new(4242).unwrap();
        for (pairs, answer) in [
            (&[("host", "127.0.0.1:4242")][..], Ok(())),
            (&[("host", "LocalHost:4242"), ("origin", "http://localhost:4242")], Ok(())),
            (&[("host", "[::1]:4242")], Ok(())),
            (&[], Err(Refused::Host)),
            (&[("host", "127.0.0.1")], Err(Refused::Host)),
            (&[("host", "127.0.0.1:4243")], Err(Refused::Host)),
            (&[("host", "evil.example:4242")], Err(Refused::Host)),
            (&[("host", "127.0.0.1.evil.example:4242")], Err(Refused::Host)),
            (&[("host", "127.0.0.1:4242"), ("host", "evil.example")], Err(Refused::Host)),
            (&[("host", "127.0.0.1:4242"), ("origin", "http://evil.example")], Err(Refused::Origin)),
            (&[("host", "127.0.0.1:4242"), ("origin", "http://127.0.0.1:8080")], Err(Refused::Origin)),
            (&[("host", "127.0.0.1:4242"), ("origin", "https://127.0.0.1:4242")], Err(Refused::Origin)),
            (&[("host", "127.0.0.1:4242"), ("origin", "null")], Err(Refused::Origin)),
        ] {
            assert_eq!(guard.check_origin(&headers(pairs)), answer, "{pairs:?}");
        }
    }

    #[test]
    fn the_token_comes_as_cookie_or_header() {
        let guard = Guard::new(4242).unwrap();
        let token = guard.token.clone();
        assert_eq!(token.len(), 2 * TOKEN_BYTES);
        assert_ne!(token, Guard::new(4242).unwrap().token);
        let cookie = |value: &str| headers(&[("cookie", value)]);
        assert!(guard.check_token(&cookie(&format!("a=b; diopter-4242={token}"))).is_ok());
        assert!(guard.check_token(&headers(&[(TOKEN_HEADER, &token)])).is_ok());
        for wrong in [
            HeaderMap::new(),
            cookie("diopter-4242="),
            cookie(&format!("diopter-4243={token}")),
            cookie(&format!("diopter-4242={}", &token[1..])),
            cookie(&format!("diopter-4242={token}0")),
            headers(&[(TOKEN_HEADER, "0123")]),
        ] {
            assert_eq!(guard.check_token(&wrong), Err(Refused::Token), "{wrong:?}");
        }
    }

    #[test]
    fn rates_are_bounded_and_recover() {
        let start = Instant::now();
        let mut rate = Rate::new(10.0, 5.0, start);
        let passed = |rate: &mut Rate, at: Instant| (0..20).filter(|_| rate.passes(at)).count();
        assert_eq!(passed(&mut rate, start), 5);
        assert_eq!(passed(&mut rate, start + Duration::from_millis(200)), 2);
        assert_eq!(passed(&mut rate, start + Duration::from_secs(60)), 5);
    }
}
