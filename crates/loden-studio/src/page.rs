//! The built page, which is part of the program.

use std::sync::{Arc, OnceLock};

use axum::extract::{Path, State};
use axum::http::header;
use axum::response::{Html, IntoResponse, Response};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest, Sha256};

use crate::Studio;
use crate::failure::{Answer, Failure};

/// A file of the built page, which the build script collects.
macro_rules! built {
    ($name:literal) => {
        include_str!(concat!(env!("OUT_DIR"), "/", $name))
    };
}

const INDEX: &str = built!("index.html");

/// The other files: name, type, content.
const FILES: &[(&str, &str, &str)] = &[
    ("app.js", "text/javascript", built!("app.js")),
    ("app.css", "text/css", built!("app.css")),
    ("three.js", "text/javascript", built!("three.js")),
    ("three.webgpu.js", "text/javascript", built!("three.webgpu.js")),
    ("three.tsl.js", "text/javascript", built!("three.tsl.js")),
    ("icon.svg", "image/svg+xml", built!("icon.svg")),
];

/// Where the page has the token.
const PLACE: &str = "{TOKEN}";

/// The page itself, with its token.
pub(crate) async fn index(State(studio): State<Arc<Studio>>) -> Html<String> {
    Html(INDEX.replace(PLACE, studio.guard.token()))
}

/// A file of the page.
pub(crate) async fn file(Path(name): Path<String>) -> Answer<Response> {
    let found = FILES.iter().find(|(known, ..)| *known == name);
    let (_, kind, content) = found.ok_or_else(|| Failure::missing("such file"))?;
    let kind = format!("{kind}; charset=utf-8");
    Ok(([(header::CONTENT_TYPE, kind)], *content).into_response())
}

/// The content security policy: everything from this server; of scripts in the page itself only the import map, by its hash.
pub(crate) fn policy() -> String {
    static HASH: OnceLock<String> = OnceLock::new();
    let hash = HASH.get_or_init(|| {
        let map = INDEX.split("<script type=\"importmap\">").nth(1).and_then(|rest| rest.split("</script>").next());
        STANDARD.encode(Sha256::digest(map.unwrap_or_default()))
    });
    format!(
        "default-src 'none'; script-src 'self' 'sha256-{hash}'; style-src 'self'; img-src 'self' blob: data:; \
         connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_a_place_for_the_token_and_asks_no_other_machine() {
        assert_eq!(INDEX.matches(PLACE).count(), 1);
        assert_eq!(INDEX.matches("<script type=\"importmap\">").count(), 1);
        for (name, _, text) in FILES.iter().filter(|(name, ..)| !name.starts_with("three")) {
            // names of XML vocabularies are no requests
            let text = text.replace("http://www.w3.org/", "");
            assert!(!text.contains("http://") && !text.contains("https://"), "{name} names another machine");
        }
        assert!(!policy().contains("unsafe"));
    }
}
