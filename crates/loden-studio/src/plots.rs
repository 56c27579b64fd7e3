//! Plots of reflectance, drawn by the library.

use std::sync::Arc;

use axum::extract::{Path, RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use loden::plot::{self, NamedMaterial};
use loden::progress::Silent;

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::images::{encoded, png_of};

/// Materials in one plot.
const MOST: usize = 6;

/// Polar angles of the light in plots, degrees.
const LIGHTS: [f32; 3] = [15.0, 45.0, 75.0];

/// A plot of some materials, `?m=A&m=B`: `polar` and `albedo` as SVG, `hemisphere` and `spheres` as PNG.
pub(crate) async fn plot(
    State(studio): State<Arc<Studio>>,
    Path(kind): Path<String>,
    RawQuery(query): RawQuery,
) -> Answer<Response> {
    blocking(move || {
        let ids = names(&query.unwrap_or_default())?;
        let brdfs = ids.iter().map(|id| studio.brdf(id)).collect::<Answer<Vec<_>>>()?;
        let named: Vec<NamedMaterial> = brdfs.iter().map(|(name, brdf)| (name.as_str(), &**brdf as _)).collect();
        let first = named.first().ok_or_else(|| Failure::missing("material in the query"))?.1;
        Ok(match kind.as_str() {
            "polar" => svg(plot::polar(&named, &LIGHTS)),
            "albedo" => svg(plot::albedo(&named)),
            "hemisphere" => png_of(encoded(&plot::hemisphere(first, &LIGHTS, 220))?),
            "spheres" => {
                let materials: Vec<_> = named.iter().map(|(_, material)| *material).collect();
                png_of(encoded(&plot::spheres(&materials, 260, 3, &Silent)?)?)
            }
            other => return Err(Failure::missing(&format!("plot {other:?}"))),
        })
    })
    .await
}

fn names(query: &str) -> Answer<Vec<String>> {
    let wrong = |_| Failure::new(StatusCode::BAD_REQUEST, "the query cannot be read");
    let uri = format!("/?{query}").parse().map_err(wrong)?;
    let pairs: axum::extract::Query<Vec<(String, String)>> = axum::extract::Query::try_from_uri(&uri)
        .map_err(|_| Failure::new(StatusCode::BAD_REQUEST, "the query cannot be read"))?;
    let ids: Vec<String> = pairs.0.into_iter().filter(|(name, _)| name == "m").map(|(_, id)| id).collect();
    if ids.len() <= MOST {
        return Ok(ids);
    }
    Err(Failure::new(
        StatusCode::BAD_REQUEST,
        format!("found {} materials, at most {MOST} are drawn together", ids.len()),
    ))
}

fn svg(text: String) -> Response {
    ([(header::CONTENT_TYPE, "image/svg+xml")], text).into_response()
}
