//! Work beside the interpreter: on a pool of threads, without holding the interpreter, stopped by Ctrl-C, with progress.
//!
//! The calling thread waits, and now and then attaches to the interpreter to look for signals and to tell the progress. The threads that work know
//! nothing of Python. They are a pool of our own and not rayon's global one: after a fork (`multiprocessing`, data loaders) the threads of the parent
//! are gone, and whoever handed work to them would wait for ever. A process that finds itself forked makes a new pool.

use crate::errors::PythonError;
use diopter::expose::ProgressReporter;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often signals are looked for and progress is told.
const TICK: Duration = Duration::from_millis(50);
/// More than any machine has; each takes memory for its stack.
const MOST_THREADS: usize = 1024;

/// Threads when a call does not say; 0: one a core.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Pools of this process by their number of threads.
struct Pools {
    process: u32,
    pools: Vec<(usize, Arc<ThreadPool>)>,
}

static POOLS: Mutex<Pools> = Mutex::new(Pools { process: 0, pools: Vec::new() });

fn checked(threads: Option<usize>) -> Result<usize, PythonError> {
    match threads {
        None => Ok(THREADS.load(Ordering::Relaxed)),
        Some(n) if (1..=MOST_THREADS).contains(&n) => Ok(n),
        Some(n) => Err(PythonError::value("threads", n.to_string(), format!("1 to {MOST_THREADS}, or None for one a core"))),
    }
}

/// The number of threads of calls that do not say; None: one a core. The results do not depend on it.
#[pyfunction]
#[pyo3(signature = (threads=None))]
pub fn set_threads(threads: Option<usize>) -> PyResult<()> {
    THREADS.store(if threads.is_none() { 0 } else { checked(threads)? }, Ordering::Relaxed);
    Ok(())
}

fn pool(threads: Option<usize>) -> Result<Arc<ThreadPool>, PythonError> {
    let wanted = checked(threads)?;
    let mut held = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
    if held.process != std::process::id() {
        // The threads of these are another process's: they cannot be ended from here.
        held.pools.drain(..).for_each(std::mem::forget);
        held.process = std::process::id();
    }
    if let Some((_, pool)) = held.pools.iter().find(|(n, _)| *n == wanted) {
        return Ok(pool.clone());
    }
    let pool = ThreadPoolBuilder::new().num_threads(wanted).thread_name(|i| format!("diopter-{i}")).build();
    let pool = Arc::new(
        pool.map_err(|e| PythonError::value("threads", wanted.to_string(), format!("as many as the system gives: {e}")))?,
    );
    held.pools.push((wanted, pool.clone()));
    Ok(pool)
}

/// Runs something long. `progress` is called with the fraction that is done (0 to 1), on the calling thread; what it raises stops the work, as
/// Ctrl-C does; with 1 when all is done.
pub fn run<T: Send>(
    py: Python<'_>,
    threads: Option<usize>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&ProgressReporter) -> T + Send,
) -> PyResult<T> {
    let pool = pool(threads)?;
    let progress: Option<Py<PyAny>> = progress.map(|p| p.clone().unbind());
    let (cancel, done) = (AtomicBool::new(false), AtomicU64::new(0f64.to_bits()));
    py.detach(|| {
        std::thread::scope(|scope| {
            let (send, receive) = mpsc::channel();
            let worker = scope.spawn(|| {
                let send = send;
                let watch =
                    ProgressReporter { cancel: &cancel, progress: &|part: f64| done.store(part.to_bits(), Ordering::Relaxed) };
                // Nobody listens any more only if the waiting thread is gone, too.
                let _ = send.send(pool.install(|| work(&watch)));
            });
            let mut failed = None;
            let mut told = 0.0;
            let result = loop {
                match receive.recv_timeout(TICK) {
                    Ok(result) => break result,
                    Err(RecvTimeoutError::Disconnected) => match worker.join() {
                        Err(panic) => std::panic::resume_unwind(panic),
                        Ok(()) => unreachable!("work that ended well has sent its result"),
                    },
                    Err(RecvTimeoutError::Timeout) if failed.is_some() => {}
                    Err(RecvTimeoutError::Timeout) => {
                        let part = f64::from_bits(done.load(Ordering::Relaxed));
                        let looked = Python::attach(|py| {
                            py.check_signals()?;
                            if let Some(progress) = progress.as_ref().filter(|_| part != told) {
                                progress.call1(py, (part,))?;
                            }
                            Ok::<(), PyErr>(())
                        });
                        told = part;
                        if let Err(e) = looked {
                            cancel.store(true, Ordering::Relaxed);
                            failed = Some(e);
                        }
                    }
                }
            };
            if let (None, Some(progress)) = (&failed, &progress) {
                Python::attach(|py| progress.call1(py, (1.0,)))?;
            }
            failed.map_or(Ok(result), Err)
        })
    })
}
