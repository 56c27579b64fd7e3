//! Measure a built-in sample and compress it to a given size.

use loden::acquire::{self, Options};
use loden::codec::{self, Finish, Goal};
use loden::direction::DirectionSet;
use loden::params::Values;
use loden::progress::Silent;

fn main() -> loden::Result<()> {
    // any `BtfSource` will do: `loden::import::open` reads those of files
    let twill = acquire::named("twill").expect("a built-in sample");
    let field = twill.build(&Values::defaults(twill.params()), 128, 0)?;
    let options = Options { size: 32, spp: 1, ..Options::default() };
    let source = acquire::measure(&field, &DirectionSet::bonn81(), &options, &Silent)?;

    let klt = codec::by_name("klt")?;
    let params = Values::new(klt.params(), [("components", "24")])?;
    let goal = Goal::Bytes(60_000);
    let finish = Finish { measure: true, lossless: None };
    let path = std::env::temp_dir().join("loden-example-twill.loden");
    let outcome = codec::compress(klt, &source, &params, goal, finish, &path, &Silent)?;

    let error = outcome.error.expect("it was measured");
    println!("{} bytes after {} trials, mean error {:.4}", outcome.bytes, outcome.trials, error.mean_abs_error);
    assert!(outcome.bytes <= 60_000);
    Ok(())
}
