//! What an edit would make of the image that the page shows, before anything is written.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use loden::codec::Decoded;
use loden::color::Encoding;
use loden::generate::{self, Rows};
use loden::import::Measured;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::images::bytes;
use crate::tasks::{Change, Where, frontal};

/// An edit that is tried.
#[derive(Deserialize)]
pub(crate) struct Try {
    material: String,
    #[serde(flatten)]
    change: Change,
    on: Where,
}

/// The front image of a material with rows after an edit. Materials without rows would have to be clustered first, which takes too long
/// here.
pub(crate) async fn preview(State(studio): State<Arc<Studio>>, Json(request): Json<Try>) -> Answer<Response> {
    blocking(move || {
        let rows = studio.rows(&request.material)?;
        let parts = generate::edit(&rows, &request.on.selection()?, &request.change.edit())?;
        let picture = frontal(&Decoded::new(Arc::new(parts))?)?;
        Ok(bytes(picture.width, picture.height, picture.to_srgb8()))
    })
    .await
}

impl Studio {
    /// A material as rows, if it has any.
    fn rows(&self, id: &str) -> Answer<Rows> {
        let opened = self.catalogue.open(&self.folders, &self.folders.find(id)?)?;
        let rows = match &opened.measured {
            Measured::Compressed(material) => Rows::new(material.parts().clone())?,
            _ => None,
        };
        rows.ok_or_else(|| Failure::new(StatusCode::BAD_REQUEST, format!("{id} has no rows")))
    }
}

/// A texel of a material.
#[derive(Deserialize)]
pub(crate) struct At {
    m: String,
    x: usize,
    y: usize,
}

/// The row of a texel: its number, its texels, and its mean colour over all directions, as in HTML.
pub(crate) async fn row(State(studio): State<Arc<Studio>>, Query(at): Query<At>) -> Answer<Json<Value>> {
    blocking(move || {
        let rows = studio.rows(&at.m)?;
        let (width, height) = (rows.meta().width, rows.meta().height);
        if at.x >= width || at.y >= height {
            return Err(Failure::missing(&format!("texel {}, {} of {}", at.x, at.y, at.m)));
        }
        let row = rows.index()[at.y * width + at.x];
        let values = rows.values(row.into());
        let mean = values.iter().sum::<glam::Vec3>() / values.len() as f32;
        let byte = |v: f32| (255.0 * Encoding::Srgb.encode(v.clamp(0.0, 1.0))).round() as u8;
        let [r, g, b] = mean.to_array().map(byte);
        let texels = rows.index().iter().filter(|other| **other == row).count();
        Ok(Json(json!({ "row": row, "texels": texels, "color": format!("{r:02x}{g:02x}{b:02x}") })))
    })
    .await
}
