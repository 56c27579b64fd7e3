//! Plots of reflectance, drawn by the library.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use axum::Json;
use axum::extract::{Path, RawQuery, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use glam::Vec2;
use loden::color::luminance;
use loden::direction::{HalfDifference, from_angles};
use loden::material::Brdf;
use loden::picture::Picture;
use loden::plot::{self, NamedMaterial};
use loden::progress::Silent;
use serde_json::{Value, json};

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::images::{encoded, png_of};

/// Materials in one plot.
const MOST: usize = 6;

/// Polar angles of the light in plots, degrees.
const LIGHTS: [f32; 3] = [15.0, 45.0, 75.0];

/// Directions of a lobe: polar angles, azimuths around; the largest polar angle in degrees, beyond which small errors of what was measured
/// are divided by small cosines.
const LOBE: [usize; 2] = [25, 60];
const LOBE_DEGREES: f32 = 84.0;

/// Pixels per side of an image slice: one for each degree.
const SLICE: usize = 90;

/// A plot of some materials, `?m=A&m=B`: `polar` and `albedo` as SVG, `hemisphere`, `spheres` and `slice` as PNG.
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
            "slice" => png_of(encoded(&slices(&named))?),
            other => return Err(Failure::missing(&format!("plot {other:?}"))),
        })
    })
    .await
}

/// Image slices beside each other: theta_h to the right, theta_d upwards, phi_d 90 degrees, as `loden convert` writes them; f pi, so that
/// white diffuse is 1.
fn slices(materials: &[NamedMaterial]) -> Picture {
    let width = SLICE * materials.len();
    let pixel = |i: usize| {
        let (x, y) = (i % width, i / width);
        let (theta_h, theta_d) = ((x % SLICE) as f32 + 0.5, SLICE as f32 - 0.5 - y as f32);
        let wh = from_angles(theta_h.to_radians(), 0.0);
        let wd = from_angles(theta_d.to_radians(), FRAC_PI_2);
        let (wi, wo) = HalfDifference { wh, wd }.directions();
        materials[x / SLICE].1.eval(Vec2::ZERO, wi, wo) * PI
    };
    Picture { width, height: SLICE, rgb: (0..width * SLICE).map(pixel).collect() }
}

/// The lobes of some materials for a light, `?m=A&m=B&theta=45`: cube roots of the luminance of f, for each polar angle of the view all
/// azimuths; the light comes from azimuth 180 degrees.
pub(crate) async fn lobe(State(studio): State<Arc<Studio>>, RawQuery(query): RawQuery) -> Answer<Json<Value>> {
    blocking(move || {
        let query = query.unwrap_or_default();
        let theta =
            pairs(&query)?.into_iter().find(|(name, _)| name == "theta").and_then(|(_, text)| text.parse().ok());
        let wrong = || Failure::new(StatusCode::BAD_REQUEST, "expected theta, a polar angle of 0 to 90 degrees");
        let theta: f32 = theta.filter(|theta| (0.0..=90.0).contains(theta)).ok_or_else(wrong)?;
        let brdfs = names(&query)?.iter().map(|id| studio.brdf(id)).collect::<Answer<Vec<_>>>()?;
        let lobes: Vec<Value> =
            brdfs.iter().map(|(name, brdf)| json!({ "name": name, "values": radii(&**brdf, theta) })).collect();
        Ok(Json(json!({ "most": LOBE_DEGREES, "thetas": LOBE[0], "phis": LOBE[1], "lobes": lobes })))
    })
    .await
}

fn radii(brdf: &dyn Brdf, theta_degrees: f32) -> Vec<f32> {
    let [thetas, phis] = LOBE;
    // at 90 degrees nothing is measured
    let wi = from_angles(theta_degrees.min(89.0).to_radians(), PI);
    let radius = |i: usize| {
        let theta = (LOBE_DEGREES * (i / phis) as f32 / (thetas - 1) as f32).to_radians();
        let wo = from_angles(theta, TAU * (i % phis) as f32 / phis as f32);
        luminance(brdf.eval(Vec2::ZERO, wi, wo).to_array()).max(0.0).cbrt()
    };
    (0..thetas * phis).map(radius).collect()
}

fn pairs(query: &str) -> Answer<Vec<(String, String)>> {
    let wrong = || Failure::new(StatusCode::BAD_REQUEST, "the query cannot be read");
    let uri = format!("/?{query}").parse().map_err(|_| wrong())?;
    Ok(axum::extract::Query::<Vec<(String, String)>>::try_from_uri(&uri).map_err(|_| wrong())?.0)
}

fn names(query: &str) -> Answer<Vec<String>> {
    let ids: Vec<String> = pairs(query)?.into_iter().filter(|(name, _)| name == "m").map(|(_, id)| id).collect();
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
