//! Images of materials as bytes for a canvas: RGB, three bytes a texel, the size in a header.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, State};
use axum::http::header;
use axum::response::{IntoResponse, Response};
use glam::Vec3;
use loden::btf::{BtfMeta, BtfSource, Rect, Texels};
use loden::color::Encoding;
use loden::direction::from_angles;
use loden::import::Measured;
use loden::job;
use loden::material::TabulatedBrdf;
use loden::picture::Picture;
use loden::plot;
use loden::progress::Silent;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::Studio;
use crate::catalogue::{key, lock};
use crate::failure::{Answer, Failure, blocking};

/// Pixels per side of a thumbnail, at most.
const THUMBNAIL: usize = 256;

/// One measured image.
#[derive(Deserialize)]
pub(crate) struct One {
    m: String,
    #[serde(default)]
    view: usize,
    light: usize,
}

/// The image of a pair, as its stored values are displayed: of 8-bit sRGB exactly these.
pub(crate) async fn image(State(studio): State<Arc<Studio>>, Query(one): Query<One>) -> Answer<Response> {
    blocking(move || {
        let source = studio.images(&one.m)?;
        let meta = source.meta();
        check(meta, one.view, one.light)?;
        let texels = source.image(one.view, one.light)?;
        Ok(bytes(meta.width, meta.height, displayed(meta, &texels)))
    })
    .await
}

/// An image between measured directions.
#[derive(Deserialize)]
pub(crate) struct Between {
    m: String,
    /// Polar angle and azimuth in degrees.
    light: Angles,
    view: Angles,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(try_from = "String")]
struct Angles([f32; 2]);

impl TryFrom<String> for Angles {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let numbers: Option<Vec<f32>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some([theta, phi]) if (0.0..=90.0).contains(theta) && phi.is_finite() => Ok(Self([*theta, *phi])),
            _ => Err(format!("found {text:?}, expected a polar angle of 0 to 90 degrees and an azimuth")),
        }
    }
}

impl Angles {
    fn direction(self) -> Vec3 {
        let Self([theta, phi]) = self;
        from_angles(theta.to_radians(), phi.to_radians())
    }
}

/// The image for any directions.
pub(crate) async fn between(State(studio): State<Arc<Studio>>, Query(one): Query<Between>) -> Answer<Response> {
    blocking(move || {
        let source = studio.images(&one.m)?;
        let material = studio.catalogue.material(&studio.folders, &studio.folders.find(&one.m)?)?;
        let (width, height) = (source.meta().width, source.meta().height);
        let picture = job::photograph(&*material, width, height, one.light.direction(), one.view.direction())?;
        Ok(bytes(width, height, picture.to_srgb8()))
    })
    .await
}

/// An image of an original beside that of a compressed material.
#[derive(Deserialize)]
pub(crate) struct Two {
    m: String,
    with: String,
    #[serde(default)]
    view: usize,
    light: usize,
}

/// The difference of two images by [`job::error_picture`]; headers have its mean and its largest value.
pub(crate) async fn difference(State(studio): State<Arc<Studio>>, Query(two): Query<Two>) -> Answer<Response> {
    blocking(move || {
        let (a, b) = (studio.images(&two.m)?, studio.images(&two.with)?);
        let meta = a.meta();
        check(meta, two.view, two.light)?;
        check(b.meta(), two.view, two.light)?;
        let (first, second) = (a.image(two.view, two.light)?, b.image(two.view, two.light)?);
        let (first, second) = (first.to_f32(), second.to_f32());
        if first.len() != second.len() {
            return Err(Failure::new(axum::http::StatusCode::BAD_REQUEST, "the images have different sizes"));
        }
        let errors = first.iter().zip(&*second).map(|(a, b)| f64::from((a - b.clamp(0.0, 1.0)).abs()));
        let (sum, largest) = errors.fold((0.0, 0.0f64), |(sum, largest), error| (sum + error, largest.max(error)));
        let picture = job::error_picture(meta, &first, &second);
        let mut response = bytes(meta.width, meta.height, picture.to_srgb8());
        for (name, value) in [("x-mean", sum / first.len() as f64), ("x-largest", largest)] {
            if let Ok(value) = format!("{value:.6}").parse() {
                response.headers_mut().insert(name, value);
            }
        }
        Ok(response)
    })
    .await
}

/// A texel, and the pair around which its values are shown.
#[derive(Deserialize)]
pub(crate) struct At {
    m: String,
    #[serde(default)]
    view: usize,
    light: usize,
    x: usize,
    y: usize,
}

/// The values of one texel as they are stored: for this pair, and from this view under all its lights.
pub(crate) async fn texel(State(studio): State<Arc<Studio>>, Query(at): Query<At>) -> Answer<Json<Value>> {
    blocking(move || {
        let source = studio.images(&at.m)?;
        let meta = source.meta();
        check(meta, at.view, at.light)?;
        let lights: Vec<usize> = match meta.lights.seen_from() {
            None => (0..meta.lights.len()).collect(),
            // the lights of a list that have this view
            Some(views) => {
                let here = views.directions()[at.light];
                (0..meta.lights.len()).filter(|k| views.directions()[*k].distance(here) < 1e-4).collect()
            }
        };
        let mut values = vec![0.0; 3 * lights.len()];
        source.read(&[at.view], &lights, Rect { x: at.x, y: at.y, width: 1, height: 1 }, &mut values)?;
        source.release(at.view);
        let shown = job::stored_picture(&BtfMeta { width: lights.len(), height: 1, ..meta.clone() }, &values);
        let own = lights.iter().position(|light| *light == at.light).unwrap_or(0);
        Ok(Json(json!({
            "value": values[3 * own..3 * own + 3], "lights": lights,
            "values": values.as_chunks::<3>().0, "shown": shown.to_srgb8().as_chunks::<3>().0,
        })))
    })
    .await
}

/// A material.
#[derive(Deserialize)]
pub(crate) struct Which {
    pub m: String,
}

/// A small picture of a material: an image of a BTF lit from the side, a sphere of a BRDF.
pub(crate) async fn thumbnail(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Response> {
    blocking(move || {
        let path = studio.folders.find(&which.m)?;
        let key = key(&path)?;
        let known = lock(&studio.catalogue.thumbnails).get(&key).cloned();
        let png = match known {
            Some(png) => png,
            None => {
                let opened = studio.catalogue.open(&studio.folders, &path)?;
                let made = Arc::new(encoded(&small(&opened.measured)?)?);
                lock(&studio.catalogue.thumbnails).insert(key, made.clone());
                made
            }
        };
        Ok(png_of((*png).clone()))
    })
    .await
}

fn small(measured: &Measured) -> Answer<Picture> {
    let source = match measured.clone().images() {
        Err(brdf) => return Ok(plot::spheres(&[&*brdf], THUMBNAIL, 1, &Silent)?),
        Ok(source) => source,
    };
    let meta = source.meta();
    let (view, light) = meta.nearest_pair(from_angles(0.6, 2.1), Vec3::Z);
    let picture = job::stored_picture(meta, &source.image(view, light)?.to_f32());
    let side = THUMBNAIL.min(meta.width).min(meta.height);
    let rgb = (0..side * side).map(|i| picture.at(i % side, i / side)).collect();
    Ok(Picture { width: side, height: side, rgb })
}

/// The content of a PNG file.
pub(crate) fn encoded(picture: &Picture) -> Answer<Vec<u8>> {
    let failed = |error: &dyn std::fmt::Display| {
        Failure::new(axum::http::StatusCode::UNPROCESSABLE_ENTITY, format!("the picture cannot be encoded: {error}"))
    };
    picture.to_png().map_err(|error| failed(&error))
}

/// An answer that is a PNG file.
pub(crate) fn png_of(png: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, "image/png")], png).into_response()
}

impl Studio {
    /// The images of a material with this name.
    pub fn images(&self, id: &str) -> Answer<Arc<dyn BtfSource>> {
        let opened = self.catalogue.open(&self.folders, &self.folders.find(id)?)?;
        let wrong =
            |_| Failure::new(axum::http::StatusCode::BAD_REQUEST, format!("{id} holds a BRDF, which has no images"));
        opened.measured.clone().images().map_err(wrong)
    }

    /// A BRDF for plots: of a BTF the average over its texels.
    pub fn brdf(&self, id: &str) -> Answer<(String, Arc<dyn loden::material::Brdf>)> {
        let opened = self.catalogue.open(&self.folders, &self.folders.find(id)?)?;
        let brdf = match opened.measured.clone().images() {
            Err(brdf) => brdf,
            Ok(btf) => Arc::new(TabulatedBrdf::average(&*btf, loden::direction::Scheme::Triangles, &Silent)?),
        };
        Ok((opened.label.clone(), brdf))
    }
}

fn check(meta: &BtfMeta, view: usize, light: usize) -> Answer<()> {
    if view < meta.views.len() && light < meta.lights.len() {
        return Ok(());
    }
    Err(Failure::missing(&format!("image for view {view} and light {light}")))
}

/// The values of an image as they are displayed.
fn displayed(meta: &BtfMeta, texels: &Texels) -> Vec<u8> {
    match texels {
        Texels::U8(values) if meta.encoding == Encoding::Srgb => values.to_vec(),
        other => job::stored_picture(meta, &other.to_f32()).to_srgb8(),
    }
}

/// An answer that is an image: RGB, row by row.
pub(crate) fn bytes(width: usize, height: usize, content: Vec<u8>) -> Response {
    let headers = [("content-type", "application/octet-stream".to_owned()), ("x-size", format!("{width}x{height}"))];
    (headers, content).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;
    use loden::btf::{Cosine, SampleType};
    use loden::direction::DirectionSet;

    #[test]
    fn bytes_of_srgb_are_shown_as_they_are_and_others_as_the_library_shows_them() {
        let set = DirectionSet::normal();
        let meta = |encoding, sample_type| BtfMeta {
            width: 16,
            height: 16,
            views: set.clone(),
            lights: set.clone(),
            encoding,
            cosine: Cosine::Included,
            sample_type,
        };
        let values: Vec<u8> = (0..768).map(|i| (i % 256) as u8).collect();
        let stored = Texels::U8(values.clone().into());
        let srgb = meta(Encoding::Srgb, SampleType::U8);
        assert_eq!(displayed(&srgb, &stored), values);
        assert_eq!(job::stored_picture(&srgb, &stored.to_f32()).to_srgb8(), values);
        let linear = meta(Encoding::Linear, SampleType::U8);
        assert_eq!(displayed(&linear, &stored)[128], 188);
    }
}
