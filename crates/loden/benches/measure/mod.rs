//! Time and memory of a measurement.

use std::time::Instant;

/// A result of any error.
pub type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

/// The least elapsed time and the least processor time, in seconds.
pub fn fastest(repeat: usize, mut work: impl FnMut() -> Outcome<()>) -> Outcome<(f64, f64)> {
    let (mut seconds, mut processor) = (Vec::new(), Vec::new());
    for _ in 0..repeat.max(1) {
        let (start, start_processor) = (Instant::now(), processor_seconds());
        work()?;
        seconds.push(start.elapsed().as_secs_f64());
        processor.push(processor_seconds() - start_processor);
    }
    let least = |times: &[f64]| times.iter().copied().fold(f64::INFINITY, f64::min);
    Ok((least(&seconds), least(&processor)))
}

/// Processor time of all threads so far, on Linux; 0 elsewhere.
fn processor_seconds() -> f64 {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let nanoseconds = |task: std::fs::DirEntry| {
        let text = std::fs::read_to_string(task.path().join("schedstat")).unwrap_or_default();
        text.split(' ').next().and_then(|n| n.parse::<u64>().ok()).unwrap_or(0)
    };
    tasks.map(nanoseconds).sum::<u64>() as f64 * 1e-9
}

/// Peak resident set size so far, on Linux; 0 elsewhere.
pub fn peak_rss() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|l| l.trim().trim_end_matches(" kB").parse::<u64>().ok()).map_or(0, |kib| kib * 1024)
}
