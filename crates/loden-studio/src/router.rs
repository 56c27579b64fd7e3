//! Which address is answered by what.

use std::sync::Arc;

use axum::extract::{DefaultBodyLimit, Path, Query, State};
use axum::middleware::from_fn_with_state;
use axum::response::Response;
use axum::routing::{delete, get, post};
use axum::{Json, Router};
use serde_json::{Value, json};

use crate::catalogue::key;
use crate::failure::{Answer, Failure, blocking};
use crate::images::{Which, png_of};
use crate::jobs::Status;
use crate::tasks::Request;
use crate::{
    Studio, describe, download, extras, guard, images, page, parts, plots, preview, scene, shader, surroundings,
    tables, upload,
};

/// The largest request that is not a file, bytes.
const BODY: usize = 256 << 10;

/// All addresses.
pub(crate) fn router(studio: Arc<Studio>) -> Router {
    let api = Router::new()
        .route("/materials", get(materials))
        .route("/material", get(material))
        .route("/thumbnail", get(images::thumbnail))
        .route("/image", get(images::image))
        .route("/between", get(images::between))
        .route("/difference", get(images::difference))
        .route("/texel", get(images::texel))
        .route("/parts", get(parts::list))
        .route("/origins", get(parts::origins))
        .route("/part", get(parts::image))
        .route("/plot/{kind}", get(plots::plot))
        .route("/lobe", get(plots::lobe))
        .route("/tables", get(tables::tables))
        .route("/extras", get(extras::list))
        .route("/lights", get(surroundings::lights))
        .route("/backdrop", get(surroundings::backdrop))
        .route("/preview", post(preview::preview))
        .route("/row", get(preview::row))
        .route("/object", get(scene::object))
        .route("/mesh", get(scene::mesh))
        .route("/three", get(shader::make))
        .route("/single", get(shader::single))
        .route("/file", get(download::material))
        .route("/scene", post(scene::file))
        .route("/jobs", get(jobs).post(start))
        .route("/jobs/{id}", delete(forget))
        .route("/jobs/{id}/cancel", post(cancel))
        .route("/jobs/{id}/picture", get(picture))
        .route("/jobs/{id}/download", get(download::result))
        .layer(DefaultBodyLimit::max(BODY))
        .route("/upload", post(upload::upload).layer(DefaultBodyLimit::disable()));
    Router::new()
        .route("/", get(page::index))
        .route("/{file}", get(page::file))
        .route("/three/{name}/{file}", get(shader::file))
        .nest("/api", api)
        .fallback(|| async { Failure::missing("such page") })
        .layer(from_fn_with_state(studio.clone(), guard::guard))
        .with_state(studio)
}

async fn materials(State(studio): State<Arc<Studio>>) -> Answer<Json<Value>> {
    blocking(move || {
        let places: Vec<String> = studio.folders.places().map(|(_, place)| place.name()).collect();
        let output = studio.folders.output().display().to_string();
        let list = studio.catalogue.list(&studio.folders);
        Ok(Json(json!({ "materials": list, "places": places, "output": output, "upload_limit": studio.upload_limit })))
    })
    .await
}

async fn material(State(studio): State<Arc<Studio>>, Query(which): Query<Which>) -> Answer<Json<Value>> {
    blocking(move || {
        let path = studio.folders.find(&which.m)?;
        let opened = studio.catalogue.open(&studio.folders, &path)?;
        Ok(Json(describe::whole(&which.m, &path, &key(&path)?, &opened)))
    })
    .await
}

async fn jobs(State(studio): State<Arc<Studio>>) -> Json<Vec<Status>> {
    Json(studio.jobs.list())
}

async fn start(State(studio): State<Arc<Studio>>, Json(request): Json<Request>) -> Answer<Json<Status>> {
    blocking(move || {
        let work = request.work(&studio)?;
        Ok(Json(studio.jobs.start(work)?.status()))
    })
    .await
}

async fn cancel(State(studio): State<Arc<Studio>>, Path(id): Path<u64>) -> Answer<Json<Status>> {
    let job = studio.jobs.find(id)?;
    job.cancel();
    Ok(Json(job.status()))
}

async fn forget(State(studio): State<Arc<Studio>>, Path(id): Path<u64>) -> Answer<Json<Value>> {
    studio.jobs.forget(id)?;
    Ok(Json(json!({})))
}

/// The latest picture of a job.
async fn picture(State(studio): State<Arc<Studio>>, Path(id): Path<u64>) -> Answer<Response> {
    let picture = studio.jobs.find(id)?.picture();
    let picture = picture.ok_or_else(|| Failure::missing(&format!("picture of job {id}")))?;
    Ok(png_of((*picture).clone()))
}
