//! Prints the cost of the exact plan of a transport problem, and the seconds and memory that it took.
//!
//! The problem is a file of little-endian 64-bit floats: the numbers of sources and targets, the masses of both, and the
//! costs, source by source. With a third argument `points D`, points of D coordinates follow the masses instead, and costs
//! are squared distances.

use std::time::Instant;
use std::{env, fs};

use loden::generate::transport;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let bytes = fs::read(arguments.first().ok_or("a file is expected")?)?;
    let mut numbers = bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap_or_default()));
    let mut count = || numbers.next().map(|v| v as usize).ok_or("the file is empty");
    let (n, m) = (count()?, count()?);
    let rest: Vec<f64> = numbers.collect();
    let (a, b, values) = (&rest[..n], &rest[n..n + m], &rest[n + m..]);
    let d: Option<usize> = arguments.get(2).map(|d| d.parse()).transpose()?;
    let point = |d: usize, k: usize| &values[k * d..][..d];
    let distance = |d: usize, i: usize, j: usize| -> f64 {
        point(d, i).iter().zip(point(d, n + j)).map(|(a, b)| (a - b).powi(2)).sum()
    };
    let start = Instant::now();
    let plan = match d {
        Some(d) => transport::plan(a, b, &|i, j| distance(d, i, j))?,
        None => transport::plan(a, b, &|i, j| values[i * m + j])?,
    };
    let seconds = start.elapsed().as_secs_f64();
    let (flows, peak) = (plan.flows.len(), loden::memory::peak());
    println!("{{\"cost\": {:e}, \"flows\": {flows}, \"seconds\": {seconds}, \"peak_bytes\": {peak}}}", plan.cost);
    Ok(())
}
