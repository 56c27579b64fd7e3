//! Decodes every image of the archive `LODEN_BENCH_ZIP`. Prints one JSON line.

use std::time::Instant;

use loden::import;
use rayon::prelude::*;

fn main() {
    let Some(path) = std::env::var_os("LODEN_BENCH_ZIP") else {
        eprintln!("skipped: LODEN_BENCH_ZIP does not name an archive");
        return;
    };
    for _ in 0..3 {
        let start = Instant::now();
        let source = import::open(&path, &Default::default()).expect("the archive opens");
        let opened = start.elapsed().as_secs_f64();
        let numbers: usize = (0..source.meta().views.len())
            .into_par_iter()
            .map(|view| source.view(view).expect("its images decode").len())
            .sum();
        let seconds = start.elapsed().as_secs_f64();
        println!("{{\"bench\":\"import\",\"seconds\":{seconds:.3},\"open_s\":{opened:.3},\"numbers\":{numbers}}}");
    }
}
