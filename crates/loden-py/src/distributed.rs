//! Compression by many processes: the tasks of workers, and the algorithm that waits for them.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use loden::Error;
use loden::btf::BtfSource;
use loden::codec::{Finish, lossless};
use loden::job::{self, ShardPlan};
use loden::params::Given;
use loden::stages::files::Waiting;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::errors::raise;
use crate::jobs::{check_output, given, goal, memory, to_python};
use crate::work::{How, run};

/// Adds the class to the module.
pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<Job>()?;
    module.add_function(wrap_pyfunction!(plan, module)?)
}

/// Begins a job in the new folder `job`: see `loden.distributed.compress`.
#[pyfunction]
#[pyo3(name = "_plan", signature = (source, output, job, *, tasks, method, quality = None, max_error = None, max_bytes = None,
    lossless = None, measure = true, memory = None, overwrite = false, **params))]
#[expect(clippy::too_many_arguments, reason = "keyword arguments of a Python function")]
fn plan(
    py: Python<'_>,
    source: PathBuf,
    output: PathBuf,
    job: PathBuf,
    tasks: usize,
    method: &str,
    quality: Option<u8>,
    max_error: Option<f64>,
    max_bytes: Option<u64>,
    lossless: Option<&str>,
    measure: bool,
    memory: Option<&Bound<'_, PyAny>>,
    overwrite: bool,
    params: Option<&Bound<'_, PyDict>>,
) -> PyResult<()> {
    check_output(py, &output, overwrite)?;
    let goal = goal(py, quality, max_error, max_bytes)?;
    let (params, memory) = (given(params)?, self::memory(py, memory)?);
    run(py, &How::default(), |progress| {
        let lossless = lossless.map(lossless::by_name).transpose()?;
        let source = job::open_btf(&source, &Given::default(), progress)?;
        let finish = Finish { measure, lossless };
        ShardPlan::new(source.as_ref(), &output, method, params, goal, finish, tasks, memory)?.write(&job)
    })
}

/// A compression by many processes that share the folder `folder`.
#[pyclass(module = "loden._loden", name = "_Job")]
pub(crate) struct Job {
    folder: PathBuf,
    plan: ShardPlan,
    source: Arc<dyn BtfSource>,
}

#[pymethods]
impl Job {
    #[new]
    fn new(py: Python<'_>, folder: PathBuf) -> PyResult<Self> {
        let opened = py.detach(|| {
            let plan = ShardPlan::read(&folder)?;
            Ok((plan.open()?, plan))
        });
        let (source, plan) = opened.map_err(|error: Error| raise(py, &error))?;
        Ok(Self { folder, plan, source })
    }

    /// Runs one task of a stage and writes its result into the folder.
    #[pyo3(signature = (stage, task, *, threads = None))]
    fn run(&self, py: Python<'_>, stage: usize, task: usize, threads: Option<usize>) -> PyResult<()> {
        run(py, &How::threads(threads), |progress| {
            job::run_shard(&self.folder, &self.plan, self.source.as_ref(), [stage, task], progress)
        })
    }

    /// Runs the algorithm and writes the file. Calls `wait(stage, kernel, missing)` for each stage, with the numbers of the
    /// tasks that have no result, until it returns true: then all of them have one.
    #[pyo3(signature = (wait, *, progress = None, threads = None))]
    fn compress<'py>(
        &self,
        py: Python<'py>,
        wait: Py<PyAny>,
        progress: Option<Py<PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let raised = Mutex::new(None);
        let ready = |waiting: &Waiting| {
            Python::attach(|py| {
                wait.call1(py, (waiting.stage, &waiting.kernel, waiting.missing.clone()))?.extract::<bool>(py)
            })
        };
        let done = run(py, &How { progress, threads }, |progress| {
            let waiting = |waiting: &Waiting| loop {
                match ready(waiting) {
                    Ok(true) => return Ok(()),
                    Ok(false) if !progress.is_cancelled() => {}
                    Ok(false) => return Err(Error::Cancelled),
                    Err(error) => {
                        if let Ok(mut raised) = raised.lock() {
                            *raised = Some(error);
                        }
                        return Err(Error::Cancelled);
                    }
                }
            };
            self.plan.compress(&self.folder, false, &waiting, progress)
        });
        match raised.into_inner().ok().flatten() {
            Some(error) => Err(error),
            None => to_python(py, &done?),
        }
    }
}
