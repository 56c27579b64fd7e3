//! The studio: materials looked at, compressed and rendered in a browser, on this machine alone.
//!
//! [`serve`] answers the page in `page/` and runs its jobs. All work on materials is done by [`loden`]; here are only the
//! addresses, the rules of who may ask for what, and the list of jobs.
//!
//! # Security
//! The server listens on the loopback interface. It refuses requests that name another host or come from another origin,
//! and those that change something without the token that the page was served with. It opens files below the given
//! folders only, wherever links lead. The page may load nothing from elsewhere.

mod catalogue;
mod connections;
mod describe;
mod download;
mod extras;
mod failure;
mod folders;
mod guard;
mod images;
mod jobs;
mod page;
mod parts;
mod plots;
mod preview;
mod router;
mod scene;
mod shader;
mod surroundings;
mod tables;
mod tasks;
mod upload;

use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use loden::progress::Progress;
use loden::render::object::Object;
use loden::{Error, Result};
use tokio::net::TcpListener;

use catalogue::{Catalogue, Recent};
use folders::Folders;
use guard::Guard;
use jobs::Jobs;
use shader::Shaders;

/// What the studio shows and where it answers.
#[derive(Debug, Clone)]
pub struct Config {
    /// Files and folders of materials.
    pub materials: Vec<PathBuf>,
    /// The folder for what is made; by default the first folder of materials, else the current one.
    pub output: Option<PathBuf>,
    /// The port; 0 for any that is free.
    pub port: u16,
    /// Largest file that may be dropped on the page, in bytes.
    pub upload_limit: u64,
}

/// What all requests share.
struct Studio {
    guard: Guard,
    folders: Folders,
    catalogue: Catalogue,
    shaders: Shaders,
    /// Objects of mesh files.
    objects: Recent<Arc<Object>>,
    jobs: Jobs,
    upload_limit: u64,
}

/// Threads for requests that read files and decode images; others wait.
const READERS: usize = 8;

/// Serves the page until `progress` is cancelled, then stops its jobs. `ready` is told the address.
///
/// # Errors
/// [`Error::Parameter`] if a given file or folder does not exist; [`Error::Io`] if the port cannot be used.
pub fn serve(config: &Config, progress: &dyn Progress, ready: &mut dyn FnMut(&str)) -> Result<()> {
    let folders = Folders::new(&config.materials, config.output.as_deref())?;
    let address = (Ipv4Addr::LOCALHOST, config.port);
    let failed = |error: std::io::Error| Error::parameter("port", format!("{}: {error}", config.port));
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .max_blocking_threads(READERS)
        .enable_all()
        .build()
        .map_err(failed)?;
    let served = runtime.block_on(async {
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let port = listener.local_addr().map_err(failed)?.port();
        let studio = Arc::new(Studio {
            guard: Guard::new(port)?,
            folders,
            catalogue: Catalogue::default(),
            shaders: Shaders::new()?,
            objects: Recent::default(),
            jobs: Jobs::default(),
            upload_limit: config.upload_limit,
        });
        ready(&format!("http://127.0.0.1:{port}/"));
        connections::accept(&listener, &router::router(studio.clone()), progress).await;
        studio.jobs.stop();
        Ok(())
    });
    // what still reads files is not waited for
    runtime.shutdown_timeout(Duration::from_secs(1));
    served
}
