//! Measures a sample for a few pairs of directions and writes raw arrays for other programs to read.
//!
//! `dump_acquire OUT_DIR [key=value ...]` writes little-endian `images.f32` (view, light, y, x, rgb), `coverage.f32` (view, y,
//! x, rgb), and the sample: of height fields `heights.f32` (y, x; in periods, row 0 at the bottom) and `finish.f32` (y, x,
//! albedo rgb, roughness, f0 rgb, 0); of solids `positions.f32`, `normals.f32`, `uvs.f32`, `albedo.f32` and `triangles.u32`.
//! Keys: sample, grid, size, spp, depth, seed, `paths-seed` (of the measurement alone), `finish` (own, matt, or metal with the
//! roughness behind a colon, of solids along and across: metal:0.2,0.5), `views` and `lights` (theta,phi in degrees, pairs
//! separated by spaces; or bonn81), `object` (the file of the sample mesh), and the parameters of the sample.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::Instant;

use glam::Vec3;
use loden::acquire::{Finish, HeightField, Options, Paint, Solid, Specimen, acquire, coverage, mesh, named, yarn};
use loden::direction::DirectionSet;
use loden::params::{Params, Values};
use loden::progress::Silent;
use loden::{Error, Result};

fn directions(text: &str) -> Result<DirectionSet> {
    if let Some(set) = DirectionSet::named(text) {
        return Ok(set);
    }
    let number = |t: &str| t.parse().map_err(|_| Error::parameter("directions", format!("found {t:?}")));
    let pair = |t: &str| match t.split_once(',') {
        Some((theta, phi)) => Ok([number(theta)?, number(phi)?]),
        None => Err(Error::parameter("directions", format!("found {t:?}, expected theta,phi"))),
    };
    DirectionSet::from_degrees(text.split_whitespace().map(pair).collect::<Result<_>>()?)
}

/// The field with every finish replaced, if `word` asks for it.
fn finished(field: HeightField, word: &str) -> Result<HeightField> {
    let replace: Box<dyn Fn(&Finish) -> Finish> = match word.split_once(':') {
        Some(("metal", alpha)) => {
            let alpha = alpha.parse().map_err(|_| Error::parameter("finish", "the roughness is not a number"))?;
            Box::new(move |_| Finish::metal(Vec3::ONE, alpha))
        }
        _ if word == "matt" => Box::new(|f| Finish::matt(Vec3::from(f.albedo))),
        _ => return Ok(field),
    };
    HeightField::new(field.grid(), field.heights().to_vec(), field.finish().iter().map(replace).collect())
}

fn painted(mut solid: Solid, word: &str) -> Result<Solid> {
    let paint = match word.split_once(':') {
        Some(("metal", alphas)) => {
            let number = |t: &str| t.parse().map_err(|_| Error::parameter("finish", "the roughness is not a number"));
            let (along, across) = alphas.split_once(',').unwrap_or((alphas, alphas));
            Paint::plain(Vec3::ZERO, 1.0, [number(along)?, number(across)?])
        }
        _ if word == "matt" => Paint::plain(Vec3::ONE, 0.0, [1.0; 2]),
        _ => return Ok(solid),
    };
    for own in &mut solid.paints {
        let albedo = if word == "matt" { own.albedo } else { paint.albedo };
        *own = Paint { albedo, texture: own.texture.take(), ..paint.clone() };
    }
    Ok(solid)
}

fn write<T: bytemuck::NoUninit>(path: &Path, values: &[T]) -> Result<()> {
    fs::write(path, bytemuck::cast_slice(values)).map_err(Error::io(path))
}

fn write_field(out: &Path, field: &HeightField) -> Result<()> {
    write(&out.join("heights.f32"), field.heights())?;
    write(&out.join("finish.f32"), field.finish())
}

fn write_solid(out: &Path, solid: &Solid) -> Result<()> {
    for (name, list) in [("positions", &solid.positions), ("normals", &solid.normals), ("albedo", &solid.albedo)] {
        write(&out.join(format!("{name}.f32")), list)?;
    }
    write(&out.join("uvs.f32"), &solid.uvs)?;
    write(&out.join("triangles.u32"), &solid.triangles)
}

fn run() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().ok_or_else(|| Error::parameter("OUT_DIR", "missing"))?;
    let out = Path::new(&out);
    let mut keys: BTreeMap<String, String> =
        arguments.filter_map(|a| a.split_once('=').map(|(k, v)| (k.into(), v.into()))).collect();
    let mut take = |key: &str, default: &str| keys.remove(key).unwrap_or_else(|| default.into());

    let (name, object) = (take("sample", "twill"), take("object", ""));
    let grid = take("grid", "512").parse().map_err(|_| Error::parameter("grid", "not a number"))?;
    let (finish, views, lights) = (take("finish", "own"), take("views", "0,0"), take("lights", "30,45"));
    let mut options = Values::defaults(Options::TABLE);
    for param in Options::TABLE {
        options.set(param.name, &take(param.name, param.default))?;
    }
    let mut options = Options::from_values(&options)?;
    let paths_seed = take("paths-seed", &options.seed.to_string());
    let seed = std::mem::replace(
        &mut options.seed,
        paths_seed.parse().map_err(|_| Error::parameter("paths-seed", "not a number"))?,
    );
    let rest = keys.iter().map(|(k, v)| (k.as_str(), v.as_str()));
    let (views, lights) = (directions(&views)?, directions(&lights)?);
    fs::create_dir_all(out).map_err(Error::io(out))?;
    match name.as_str() {
        "yarn" | "mesh" => {
            let solid = if name == "yarn" {
                yarn::build(&yarn::Options::from_values(&Values::new(yarn::Options::TABLE, rest)?)?, seed)?
            } else {
                let values = Values::new(mesh::Options::TABLE, rest)?;
                mesh::build(object.as_ref(), None, &mesh::Options::from_values(&values)?)?.0
            };
            let solid = painted(solid, &finish)?;
            measure(&solid, [&views, &lights], &options, out)?;
            write_solid(out, &solid)
        }
        _ => {
            let sample = named(&name).ok_or_else(|| Error::parameter("sample", format!("found {name:?}")))?;
            let field = finished(sample.build(&Values::new(sample.params(), rest)?, grid, seed)?, &finish)?;
            measure(&field, [&views, &lights], &options, out)?;
            write_field(out, &field)
        }
    }
}

fn measure<'a>(
    sample: impl Into<Specimen<'a>>,
    [views, lights]: [&DirectionSet; 2],
    options: &Options,
    out: &Path,
) -> Result<()> {
    let (mut images, mut covered) = (Vec::new(), Vec::new());
    let (start, sample) = (Instant::now(), sample.into());
    acquire(sample, views, lights, options, &Silent, &mut |_, view| {
        images.extend(view);
        Ok(())
    })?;
    let seconds = start.elapsed().as_secs_f64();
    let paths = images.len() as f64 / 3.0 * f64::from(options.spp);
    println!("{{\"seconds\": {seconds:.3}, \"paths_per_s\": {:.0}}}", paths / seconds);
    coverage(sample, views, options, &Silent, &mut |_, view| {
        covered.extend(view);
        Ok(())
    })?;
    write(&out.join("coverage.f32"), &covered)?;
    write(&out.join("images.f32"), &images)
}

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(2);
    }
}
