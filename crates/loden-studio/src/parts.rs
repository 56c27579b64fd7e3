//! What a compressed material consists of, as pictures.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use loden::btf::{Rect, SampleType};
use loden::codec::CompressedBtf;
use loden::codec::parts::{Numbers, PlaneKind};
use loden::import::Measured;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::Studio;
use crate::failure::{Answer, Failure, blocking};
use crate::images::{Which, bytes};

/// The planes of a material.
pub(crate) async fn list(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Json<Value>> {
    blocking(move || {
        let material = studio.compressed(&which.m)?;
        let planes = material.parts().recipe().planes.iter().map(|plane| match plane.kind {
            PlaneKind::Index { rows } => json!({ "name": plane.name, "rows": rows }),
            PlaneKind::Numbers { count, .. } => json!({ "name": plane.name, "count": count }),
        });
        Ok(Json(planes.collect()))
    })
    .await
}

/// Numbers of a plane.
#[derive(Deserialize)]
pub(crate) struct One {
    m: String,
    plane: usize,
    #[serde(default)]
    view: usize,
    #[serde(default)]
    component: usize,
}

/// One number per texel as an image: of an index plane its low byte as red and its high byte as green, of other planes a grey:
/// bytes as they are, other numbers around 128 for 0, so that the largest is 255 or the lowest 1.
pub(crate) async fn image(State(studio): State<Arc<Studio>>, Query(one): Query<One>) -> Answer<Response> {
    blocking(move || {
        let material = studio.compressed(&one.m)?;
        let (parts, meta) = (material.parts(), material.meta());
        let missing = || Failure::missing(&format!("component {} of plane {}", one.component, one.plane));
        let spec = parts.recipe().planes.get(one.plane).ok_or_else(missing)?;
        let numbers = parts.plane(one.plane, one.view, Rect::whole(meta))?;
        let content = match (&numbers, spec.kind) {
            (Numbers::Index(rows), _) => {
                rows.iter().flat_map(|row| [row.to_le_bytes()[0], row.to_le_bytes()[1], 0]).collect()
            }
            (numbers, PlaneKind::Numbers { count, .. }) if one.component < count => {
                let all = numbers.to_f32();
                let own: Vec<f32> = all.iter().skip(one.component).step_by(count).copied().collect();
                // 8-bit numbers have an offset of their own
                let is_byte = numbers.sample_type() == Some(SampleType::U8);
                if is_byte { own.iter().flat_map(|value| [*value as u8; 3]).collect() } else { grey(&own) }
            }
            _ => return Err(missing()),
        };
        Ok(bytes(meta.width, meta.height, content))
    })
    .await
}

/// For each texel of a rearranged material the texel of the sample that it copies: column and row as 16-bit numbers. A header has the
/// size of the result.
pub(crate) async fn origins(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Response> {
    blocking(move || {
        let material = studio.compressed(&which.m)?;
        let map = material.source_map().ok_or_else(|| Failure::missing(&format!("map of sources of {}", which.m)))?;
        let numbers = map.sources.iter().flat_map(|source| [source.x, source.y]);
        let content = numbers.flat_map(u16::to_le_bytes).collect();
        Ok(bytes(map.width, map.height, content))
    })
    .await
}

fn grey(values: &[f32]) -> Vec<u8> {
    let most = values.iter().fold(f32::MIN_POSITIVE, |most, value| most.max(value.abs()));
    values.iter().flat_map(|value| [(128.0 + 127.0 * value / most).round() as u8; 3]).collect()
}

impl Studio {
    fn compressed(&self, id: &str) -> Answer<Arc<CompressedBtf>> {
        let opened = self.catalogue.open(&self.folders, &self.folders.find(id)?)?;
        match &opened.measured {
            Measured::Compressed(material) => Ok(material.clone()),
            _ => Err(Failure::new(StatusCode::BAD_REQUEST, format!("{id} is not compressed"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::grey;

    #[test]
    fn zero_is_the_middle_and_signs_differ() {
        assert_eq!(grey(&[0.0, 2.0, -1.0, -2.0]).iter().step_by(3).copied().collect::<Vec<_>>(), [128, 255, 65, 1]);
        assert_eq!(grey(&[0.0, 0.0]), [128; 6]);
    }
}
