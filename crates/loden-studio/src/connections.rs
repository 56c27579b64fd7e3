//! Connections: few, and none for ever.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use loden::progress::Progress;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};

/// Connections at a time; others wait.
const CONNECTIONS: usize = 256;

/// The longest that a client may take to send the head of a request.
const HEAD: Duration = Duration::from_secs(10);

/// The longest life of a connection; browsers open another.
const LIFE: Duration = Duration::from_secs(600);

/// The largest head of a request, bytes.
const BUFFER: usize = 64 << 10;

/// Answers connections until `progress` is cancelled.
pub(crate) async fn accept(listener: &TcpListener, router: &Router, progress: &dyn Progress) {
    let free = Arc::new(Semaphore::new(CONNECTIONS));
    loop {
        let next = async {
            let permit = free.clone().acquire_owned().await;
            (permit, listener.accept().await)
        };
        let (permit, accepted) = tokio::select! {
            next = next => next,
            () = cancelled(progress) => return,
        };
        let Ok((stream, _)) = accepted else { continue };
        // pictures are sent as a whole, small answers at once
        let _ = stream.set_nodelay(true);
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let _permit = permit;
            let connection = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEAD)
                .max_buf_size(BUFFER)
                .serve_connection(TokioIo::new(stream), service);
            let _ = timeout(LIFE, connection).await;
        });
    }
}

async fn cancelled(progress: &dyn Progress) {
    while !progress.is_cancelled() {
        sleep(Duration::from_millis(100)).await;
    }
}
