//! Measures a woven sample of 512 x 512 points for a few views and all lights of the Bonn goniometer. Prints one JSON
//! line per finish and run; a path is one sample of one texel for one pair of directions.
//!
//! If `LODEN_BENCH_FIELD` names a folder, the field is written there as `heights.f32` (y, x; in periods, row 0 at the
//! bottom) and `finish.f32` (y, x, 8 numbers) for the peer.

use std::time::Instant;

use glam::Vec3;
use loden::acquire::{Finish, HeightField, Options, acquire, named};
use loden::direction::DirectionSet;
use loden::params::Values;
use loden::progress::Silent;

const OPTIONS: Options = Options { size: 256, spp: 8, depth: 4, seed: 1 };
const RUNS: usize = 3;

fn main() {
    let sample = named("twill").expect("a built-in sample");
    let field = sample.build(&Values::defaults(sample.params()), 512, 1).expect("defaults build");
    if let Some(folder) = std::env::var_os("LODEN_BENCH_FIELD").map(std::path::PathBuf::from) {
        std::fs::create_dir_all(&folder).expect("a folder that can be made");
        let write = |name, bytes| std::fs::write(folder.join(name), bytes).expect("a folder that can be written");
        write("heights.f32", bytemuck::cast_slice(field.heights()));
        write("finish.f32", bytemuck::cast_slice(field.finish()));
    }
    let matt = field.finish().iter().map(|f| Finish::matt(Vec3::from(f.albedo))).collect();
    let matt = HeightField::new(field.grid(), field.heights().to_vec(), matt).expect("a valid field");
    let views = DirectionSet::from_degrees(vec![[0.0, 0.0], [60.0, 54.0]]).expect("valid directions");
    let lights = DirectionSet::bonn81();
    for _ in 0..RUNS {
        for (finish, field) in [("matt", &matt), ("coated", &field)] {
            let start = Instant::now();
            let (mut sum, mut count) = (0.0, 0);
            acquire(field, &views, &lights, &OPTIONS, &Silent, &mut |_, images| {
                sum += images.iter().map(|&v| f64::from(v)).sum::<f64>();
                count += images.len();
                Ok(())
            })
            .expect("valid options");
            let seconds = start.elapsed().as_secs_f64();
            let paths = count as f64 / 3.0 * f64::from(OPTIONS.spp);
            println!(
                "{{\"bench\":\"goniometer\",\"finish\":\"{finish}\",\"seconds\":{seconds:.3},\"paths_per_s\":{:.0},\"mean\":{:.5}}}",
                paths / seconds,
                sum / count as f64
            );
        }
    }
}
