//! Edits of a material of rows: the time until an image of the edited material is decoded.
//!
//! `LODEN_BENCH_ROWS=FILE.loden cargo bench --bench generate`, where FILE is compressed by `kmeans`, `median-cut` or `tsvq`.
//! Prints JSON lines. With `LODEN_BENCH_REPEAT`, each measurement is the fastest of that many.

mod measure;

use std::sync::Arc;

use loden::btf::BtfSource;
use loden::codec::{self, Decoded};
use loden::generate::{self, Edit, Rows, Selection};
use measure::{Outcome, fastest, peak_rss};
use serde_json::json;

fn main() -> Outcome<()> {
    let Some(path) = std::env::var_os("LODEN_BENCH_ROWS") else {
        println!("skipped: LODEN_BENCH_ROWS does not name a material of rows");
        return Ok(());
    };
    let repeat: usize = std::env::var("LODEN_BENCH_REPEAT").ok().and_then(|n| n.parse().ok()).unwrap_or(10);
    let rows = Rows::new(codec::open(path)?.parts().clone())?.ok_or("the material has no rows")?;
    let edit = Edit { gloss: 1.5, recolor: Some("hue=90".parse()?), ..Edit::default() };
    for (work, selection) in [("edit one row", Selection::Rows(vec![0])), ("edit all rows", Selection::All)] {
        let (seconds, processor) = fastest(repeat, || {
            let decoded = Decoded::new(Arc::new(generate::edit(&rows, &selection, &edit)?))?;
            let mut image = vec![0.0; decoded.meta().image_len()];
            decoded.decode(0, 0..1, &mut image)?;
            Ok(())
        })?;
        let row =
            json!({"work": work, "seconds": seconds, "processor_seconds": processor, "peak_rss_bytes": peak_rss()});
        println!("{row}");
    }
    Ok(())
}
