//! Who may ask: this machine's own browser, on the page that this server gave it.

use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, Method, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use loden::{Error, Result};

use std::sync::Arc;

use crate::failure::Failure;
use crate::{Studio, page};

/// The header that has the token.
pub(crate) const TOKEN: &str = "x-loden-token";

/// What requests are checked against.
pub(crate) struct Guard {
    hosts: [String; 2],
    token: String,
}

impl Guard {
    /// For a server on this port, with a new token.
    pub fn new(port: u16) -> Result<Self> {
        let mut bytes = [0u8; 32];
        getrandom::fill(&mut bytes).map_err(|error| Error::parameter("token", error.to_string()))?;
        let token = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")], token })
    }

    /// What the page sends back with every request that changes something.
    pub fn token(&self) -> &str {
        &self.token
    }

    /// Says why a request is refused. A page elsewhere can make a browser send requests: to our address, which `Origin` or
    /// `Sec-Fetch-Site` reveals, or to a name of its own that it has pointed at this machine, which `Host` reveals.
    fn check(&self, method: &Method, path: &str, headers: &HeaderMap) -> std::result::Result<(), &'static str> {
        let text = |name: HeaderName| headers.get(name).map(|value| value.to_str().unwrap_or("?"));
        let host = text(header::HOST).unwrap_or_default();
        if !self.hosts.iter().any(|known| known == host) {
            return Err("the host of the request is not this server");
        }
        if let Some(origin) = text(header::ORIGIN)
            && origin.strip_prefix("http://") != Some(host)
        {
            return Err("the request comes from another origin");
        }
        let site = text(HeaderName::from_static("sec-fetch-site")).unwrap_or("none");
        // a link on another page may open the studio
        let followed = method == Method::GET && path == "/";
        if !["none", "same-origin"].contains(&site) && !followed {
            return Err("the request comes from another site");
        }
        let reads = [Method::GET, Method::HEAD].contains(method);
        if !reads && text(HeaderName::from_static(TOKEN)) != Some(&self.token) {
            return Err("the token is missing or of another run; reload the page");
        }
        Ok(())
    }
}

/// Refuses what [`Guard::check`] refuses, and tells the browser to be as strict.
pub(crate) async fn guard(State(studio): State<Arc<Studio>>, request: Request, next: Next) -> Response {
    let checked = studio.guard.check(request.method(), request.uri().path(), request.headers());
    let mut response = match checked {
        Ok(()) => next.run(request).await,
        Err(why) => Failure::refused(why).into_response(),
    };
    let headers = response.headers_mut();
    let mut set = |name: &'static str, value: &str| {
        if let Ok(value) = HeaderValue::from_str(value) {
            headers.insert(name, value);
        }
    };
    set("content-security-policy", &page::policy());
    set("x-content-type-options", "nosniff");
    set("referrer-policy", "no-referrer");
    set("cross-origin-opener-policy", "same-origin");
    set("cross-origin-resource-policy", "same-origin");
    set("cache-control", "no-store");
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn verdict(method: Method, path: &str, headers: &[(&str, &str)]) -> std::result::Result<(), &'static str> {
        let guard = Guard { hosts: ["127.0.0.1:7".into(), "localhost:7".into()], token: "secret".into() };
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.insert(HeaderName::from_bytes(name.as_bytes()).unwrap(), value.parse().unwrap());
        }
        guard.check(&method, path, &map)
    }

    #[test]
    fn only_our_own_page_may_ask_and_only_with_the_token_may_it_change_anything() {
        let host = ("host", "127.0.0.1:7");
        let (token, origin) = (("x-loden-token", "secret"), ("origin", "http://127.0.0.1:7"));
        let ok = |method, path, headers: &[_]| verdict(method, path, headers).is_ok();
        assert!(ok(Method::GET, "/api/jobs", &[host]) && ok(Method::GET, "/api/jobs", &[("host", "localhost:7")]));
        assert!(ok(Method::POST, "/api/jobs", &[host, token, origin, ("sec-fetch-site", "same-origin")]));
        assert!(ok(Method::GET, "/", &[host, ("sec-fetch-site", "cross-site")]));
        for headers in [
            vec![],
            vec![("host", "evil.example:7")],
            vec![("host", "127.0.0.1:8")],
            vec![host, ("origin", "http://evil.example")],
            vec![host, ("origin", "http://localhost:7")],
            vec![host, ("origin", "null")],
            vec![host, ("sec-fetch-site", "cross-site")],
        ] {
            assert!(!ok(Method::GET, "/api/jobs", &headers), "{headers:?}");
        }
        for headers in [vec![host, origin], vec![host, ("x-loden-token", "guess")], vec![host, ("x-loden-token", "")]] {
            assert!(!ok(Method::POST, "/api/jobs", &headers), "{headers:?}");
        }
    }
}
