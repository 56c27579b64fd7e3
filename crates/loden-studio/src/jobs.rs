//! Long work: jobs with progress that outlive the page which started them.

use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Instant;

use axum::http::StatusCode;
use loden::progress::Progress;
use loden::{Error, Result};
use serde::Serialize;
use serde_json::Value;

use crate::catalogue::lock;
use crate::failure::{Answer, Failure};

/// Jobs that run at a time; they share the processors.
const RUNNING: usize = 2;

/// Jobs that run or wait, at most.
const UNFINISHED: usize = 32;

/// Jobs that the list keeps.
const LISTED: usize = 100;

/// Warnings that a job keeps.
const WARNINGS: usize = 50;

/// The work of a job, which gives a result for the page.
type Run = Box<dyn FnOnce(&Job) -> Result<Value> + Send>;

/// A job before it starts.
pub(crate) struct Work {
    /// What kind of job it is, for the page.
    pub kind: &'static str,
    /// What it works on.
    pub title: String,
    /// The command line that does the same.
    pub command: String,
    /// The file or folder that it writes.
    pub output: Option<PathBuf>,
    /// The work. Its result is shown on the page.
    pub run: Run,
}

/// Where a job is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Phase {
    Queued,
    Running,
    Done,
    Failed,
    Cancelled,
}

/// A job.
pub(crate) struct Job {
    pub id: u64,
    kind: &'static str,
    title: String,
    command: String,
    pub output: Option<PathBuf>,
    cancelled: AtomicBool,
    done: AtomicU64,
    state: Mutex<State>,
    picture: Mutex<(u64, Arc<Vec<u8>>)>,
}

#[derive(Debug)]
struct State {
    phase: Phase,
    stage: String,
    task: String,
    total: u64,
    task_began: Instant,
    began: Option<Instant>,
    seconds: f64,
    warnings: VecDeque<String>,
    result: Value,
    error: Option<String>,
}

/// What the page is told of a job.
#[derive(Debug, Serialize)]
pub(crate) struct Status {
    id: u64,
    kind: &'static str,
    title: String,
    command: String,
    output: Option<String>,
    phase: Phase,
    stage: String,
    task: String,
    /// How much of the current task is done, 0 to 1.
    fraction: Option<f64>,
    /// Seconds until the current task is done, as it went so far.
    remaining_s: Option<f64>,
    seconds: f64,
    warnings: VecDeque<String>,
    result: Value,
    error: Option<String>,
    /// Counts the pictures of a job that shows some.
    pictures: u64,
}

impl Job {
    fn new(id: u64, work: &Work) -> Self {
        let state = State {
            phase: Phase::Queued,
            stage: String::new(),
            task: String::new(),
            total: 0,
            task_began: Instant::now(),
            began: None,
            seconds: 0.0,
            warnings: VecDeque::new(),
            result: Value::Null,
            error: None,
        };
        Self {
            id,
            kind: work.kind,
            title: work.title.clone(),
            command: work.command.clone(),
            output: work.output.clone(),
            cancelled: AtomicBool::new(false),
            done: AtomicU64::new(0),
            state: Mutex::new(state),
            picture: Mutex::default(),
        }
    }

    /// Asks the job to stop.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Shows a PNG file on the page.
    pub fn show(&self, png: Vec<u8>) {
        let mut picture = lock(&self.picture);
        *picture = (picture.0 + 1, Arc::new(png));
    }

    /// How many pictures were shown.
    pub fn shown(&self) -> u64 {
        lock(&self.picture).0
    }

    /// A job that never runs.
    #[cfg(test)]
    pub fn idle() -> Self {
        let run: Run = Box::new(|_| Ok(Value::Null));
        Self::new(0, &Work { kind: "test", title: String::new(), command: String::new(), output: None, run })
    }

    /// The last picture that was shown.
    pub fn picture(&self) -> Option<Arc<Vec<u8>>> {
        let picture = lock(&self.picture);
        (picture.0 > 0).then(|| picture.1.clone())
    }

    fn is_finished(&self) -> bool {
        !matches!(lock(&self.state).phase, Phase::Queued | Phase::Running)
    }

    /// Whether the job has done what it should.
    pub fn is_done(&self) -> bool {
        lock(&self.state).phase == Phase::Done
    }

    pub fn status(&self) -> Status {
        let pictures = self.shown();
        let state = lock(&self.state);
        let running = state.phase == Phase::Running;
        let done = self.done.load(Ordering::Relaxed).min(state.total);
        let fraction = (running && state.total > 0).then(|| done as f64 / state.total as f64);
        let remaining_s = fraction
            .filter(|fraction| *fraction > 0.02)
            .map(|fraction| state.task_began.elapsed().as_secs_f64() * (1.0 - fraction) / fraction);
        Status {
            id: self.id,
            kind: self.kind,
            title: self.title.clone(),
            command: self.command.clone(),
            output: self.output.as_deref().map(|path| path.display().to_string()),
            phase: state.phase,
            stage: state.stage.clone(),
            task: state.task.clone(),
            fraction,
            remaining_s,
            seconds: state.began.filter(|_| running).map_or(state.seconds, |began| began.elapsed().as_secs_f64()),
            warnings: state.warnings.clone(),
            result: state.result.clone(),
            error: state.error.clone(),
            pictures,
        }
    }

    /// Does the work and keeps how it ended. A panic ends the job, not the program.
    fn run(&self, work: Run) {
        let began = Instant::now();
        {
            let mut state = lock(&self.state);
            (state.phase, state.began) = (Phase::Running, Some(began));
        }
        let ended = match self.is_cancelled() {
            true => Ok(Err(Error::Cancelled)),
            false => catch_unwind(AssertUnwindSafe(|| work(self))),
        };
        let mut state = lock(&self.state);
        state.seconds = began.elapsed().as_secs_f64();
        match ended {
            Ok(Ok(result)) => (state.phase, state.result) = (Phase::Done, result),
            Ok(Err(Error::Cancelled)) => state.phase = Phase::Cancelled,
            Ok(Err(error)) => (state.phase, state.error) = (Phase::Failed, Some(error.to_string())),
            Err(panic) => {
                let message = panic.downcast_ref::<String>().map(String::as_str);
                let message =
                    message.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("for an unknown reason");
                (state.phase, state.error) = (Phase::Failed, Some(format!("the job broke off: {message}")));
            }
        }
    }
}

impl Progress for Job {
    fn begin(&self, name: &str, total: u64) {
        let mut state = lock(&self.state);
        (state.task, state.total, state.task_began) = (name.into(), total, Instant::now());
        self.done.store(0, Ordering::Relaxed);
    }

    fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
    }

    fn step(&self, text: &str) {
        lock(&self.state).task = text.into();
    }

    fn stage(&self, text: &str) {
        lock(&self.state).stage = text.into();
    }

    fn warn(&self, text: &str) {
        let mut state = lock(&self.state);
        if state.warnings.len() < WARNINGS {
            state.warnings.push_back(text.into());
        }
    }

    fn command(&self) -> Option<&str> {
        Some(&self.command)
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// All jobs of this run, oldest first.
#[derive(Default)]
pub(crate) struct Jobs {
    next: AtomicU64,
    all: Mutex<Vec<Arc<Job>>>,
    places: Arc<Places>,
}

/// How many jobs run.
#[derive(Default)]
struct Places {
    taken: Mutex<usize>,
    freed: Condvar,
}

impl Jobs {
    /// Starts a job, or lets it wait for others.
    pub fn start(&self, work: Work) -> Answer<Arc<Job>> {
        let mut all = lock(&self.all);
        let unfinished: Vec<&Arc<Job>> = all.iter().filter(|job| !job.is_finished()).collect();
        if unfinished.len() >= UNFINISHED {
            let problem = format!("{UNFINISHED} jobs run or wait already; cancel one or wait");
            return Err(Failure::new(StatusCode::TOO_MANY_REQUESTS, problem));
        }
        if unfinished.iter().any(|job| job.output.is_some() && job.output == work.output) {
            return Err(Failure::new(StatusCode::CONFLICT, "another job writes this file; choose another name"));
        }
        let job = Arc::new(Job::new(self.next.fetch_add(1, Ordering::Relaxed) + 1, &work));
        all.push(job.clone());
        if all.len() > LISTED
            && let Some(oldest) = all.iter().position(|job| job.is_finished())
        {
            all.remove(oldest);
        }
        let (places, running) = (self.places.clone(), job.clone());
        std::thread::spawn(move || {
            let mut taken = lock(&places.taken);
            while *taken >= RUNNING && !running.is_cancelled() {
                let waited = places.freed.wait_timeout(taken, std::time::Duration::from_millis(200));
                taken = waited.unwrap_or_else(std::sync::PoisonError::into_inner).0;
            }
            *taken += 1;
            drop(taken);
            running.run(work.run);
            *lock(&places.taken) -= 1;
            places.freed.notify_all();
        });
        Ok(job)
    }

    /// The job with this number.
    pub fn find(&self, id: u64) -> Answer<Arc<Job>> {
        let found = lock(&self.all).iter().find(|job| job.id == id).cloned();
        found.ok_or_else(|| Failure::missing(&format!("job {id}")))
    }

    /// All jobs, oldest first.
    pub fn list(&self) -> Vec<Status> {
        lock(&self.all).iter().map(|job| job.status()).collect()
    }

    /// Takes a finished job off the list.
    pub fn forget(&self, id: u64) -> Answer<()> {
        let job = self.find(id)?;
        if !job.is_finished() {
            return Err(Failure::new(StatusCode::CONFLICT, "the job is not finished; cancel it first"));
        }
        lock(&self.all).retain(|job| job.id != id);
        Ok(())
    }

    /// Cancels all jobs and waits a moment for them.
    pub fn stop(&self) {
        let all = lock(&self.all).clone();
        all.iter().for_each(|job| job.cancel());
        let began = Instant::now();
        while began.elapsed().as_secs() < 10 && all.iter().any(|job| !job.is_finished()) {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loden::progress::Task;
    use serde_json::json;

    fn work(run: impl FnOnce(&Job) -> Result<Value> + Send + 'static) -> Work {
        Work { kind: "test", title: "t".into(), command: "loden".into(), output: None, run: Box::new(run) }
    }

    fn finished(job: &Job) -> Status {
        while !job.is_finished() {
            std::thread::yield_now();
        }
        job.status()
    }

    #[test]
    fn a_job_that_panics_is_reported_and_the_next_one_runs() {
        let jobs = Jobs::default();
        let broken = jobs.start(work(|_| panic!("out of luck"))).unwrap();
        let failed = jobs.start(work(|_| Err(Error::parameter("a", "b")))).unwrap();
        let fine = jobs
            .start(work(|job| {
                job.warn("w");
                Ok(json!(7))
            }))
            .unwrap();
        let status = finished(&broken);
        assert_eq!((status.phase, status.error.as_deref()), (Phase::Failed, Some("the job broke off: out of luck")));
        assert_eq!(finished(&failed).error.as_deref(), Some("a: b"));
        let status = finished(&fine);
        assert_eq!((status.phase, status.result, status.warnings.len()), (Phase::Done, json!(7), 1));
        assert_eq!(jobs.list().len(), 3);
        jobs.forget(broken.id).unwrap();
        assert!(jobs.find(broken.id).is_err());
    }

    #[test]
    fn jobs_wait_for_a_place_and_can_be_cancelled_while_they_wait_or_run() {
        let jobs = Jobs::default();
        let endless = |job: &Job| {
            let task = Task::new(job, "turn", 4);
            task.advance(1)?;
            loop {
                task.check()?;
                std::thread::yield_now();
            }
        };
        let all: Vec<_> = (0..UNFINISHED).map(|_| jobs.start(work(endless)).unwrap()).collect();
        assert!(jobs.start(work(endless)).is_err());
        while all.iter().filter(|job| job.status().fraction == Some(0.25)).count() < RUNNING {
            std::thread::yield_now();
        }
        assert_eq!(all.iter().filter(|job| job.status().phase == Phase::Running).count(), RUNNING);
        assert!(jobs.forget(all[0].id).is_err());
        jobs.stop();
        assert!(all.iter().all(|job| finished(job).phase == Phase::Cancelled));
    }

    #[test]
    fn two_jobs_do_not_write_one_file() {
        let jobs = Jobs::default();
        let to = |name: &str| Work {
            output: Some(name.into()),
            ..work(|job| {
                loop {
                    Task::new(job, "x", 1).check()?
                }
            })
        };
        jobs.start(to("a")).unwrap();
        assert!(jobs.start(to("a")).is_err());
        assert!(jobs.start(to("b")).is_ok());
        jobs.stop();
    }
}
