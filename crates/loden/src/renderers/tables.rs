//! What every plug-in needs as files: planes, tables, interpolation between directions, and sampling.

use std::fs;
use std::path::Path;

use glam::Vec3;

use crate::btf::BtfMeta;
use crate::codec::CompressedBtf;
use crate::codec::parts::{Numbers, npy, whole_plane};
use crate::color::luminance;
use crate::direction::{DirectionSet, Interpolator, Scheme, TriangleTables};
use crate::material::angles::{Angles, texel_centre};
use crate::material::lobes::Lobes;
use crate::material::{Material, Point};
use crate::output::failed;
use crate::{Error, Result};

/// Cells have 16-bit numbers; this one stands for none.
const NONE: u16 = u16::MAX;

/// The triangulation of a direction set.
///
/// # Errors
/// [`Error::Unsupported`] if the directions do not surround the normal, or are too many.
pub(super) fn triangulated(path: &Path, kind: &str, set: &DirectionSet) -> Result<TriangleTables> {
    let refuse = |problem: &str| Error::unsupported(path, format!("its {kind} {problem}"));
    let tables = Interpolator::new(set, Scheme::Triangles)?.tables();
    let tables = tables.ok_or_else(|| refuse("do not surround the normal, which shaders need for interpolation"))?;
    if tables.corners.len() >= usize::from(NONE) {
        return Err(refuse("are more than the plug-in can interpolate"));
    }
    Ok(tables)
}

/// Checks that the directions of a material can be interpolated by tables.
///
/// # Errors
/// [`Error::Unsupported`] for a BTF with its own list of pairs, and as [`triangulated`].
pub(super) fn check_directions(path: &Path, meta: &BtfMeta) -> Result<()> {
    if meta.is_listed() {
        let problem = "it has its own list of pairs; exports interpolate only between views and lights of a full grid";
        return Err(Error::unsupported(path, problem));
    }
    triangulated(path, "views", &meta.views)?;
    triangulated(path, "lights", &meta.lights).map(drop)
}

/// Writes planes and tables as they are stored: `plane-NAME.npy` of shape (y, x, number), after a dimension of views if
/// each view has its own numbers, and `table-NAME.npy` in the shape of its axes.
pub(super) fn write_parts(material: &CompressedBtf, folder: &Path) -> Result<()> {
    let (parts, meta) = (material.parts(), material.meta());
    let recipe = parts.recipe();
    for (k, spec) in recipe.planes.iter().enumerate() {
        let mut shape = if spec.per_view() { vec![meta.views.len()] } else { Vec::new() };
        shape.extend([meta.height, meta.width, spec.count()]);
        put(folder, &format!("plane-{}", spec.name), &whole_plane(&**parts, k)?, &shape)?;
    }
    for (k, spec) in recipe.tables.iter().enumerate() {
        put(folder, &format!("table-{}", spec.name), &parts.table(k)?, &spec.tensor(meta).shape)?;
    }
    Ok(())
}

/// Writes the interpolation between directions: `KIND-start.npy` (y, x), `-corners` (cell, corner), `-matrix` (cell, row,
/// column), `-neighbours` (cell, corner), and `-cosines` of the samples.
pub(super) fn write_directions(kind: &str, set: &DirectionSet, tables: &TriangleTables, folder: &Path) -> Result<()> {
    let cells = tables.corners.len();
    let put = |name: &str, numbers: Numbers, shape: &[usize]| put(folder, &format!("{kind}-{name}"), &numbers, shape);
    let side = tables.start.len().isqrt();
    let short = |all: &[[u32; 3]]| all.iter().flatten().map(|&k| u16::try_from(k).unwrap_or(NONE)).collect::<Vec<_>>();
    put("start", Numbers::Index(tables.start.clone().into()), &[side, side])?;
    put("corners", Numbers::Index(short(&tables.corners).into()), &[cells, 3])?;
    put("neighbours", Numbers::Index(short(&tables.neighbours).into()), &[cells, 3])?;
    put("matrix", Numbers::F32(tables.rows.concat().into()), &[cells, 3, 3])?;
    let cosines: Vec<f32> = set.directions().iter().map(|w| w.z).collect();
    put("cosines", Numbers::F32(cosines.into()), &[set.len()])
}

/// Writes the histograms that directions are drawn from: `lobes-index.npy` (y, x), the cluster of each texel, and
/// `lobes-cumulated.npy` (cluster, view, cell).
pub(super) fn write_lobes(meta: &BtfMeta, material: &dyn Material, folder: &Path) -> Result<()> {
    let angles = Angles::new(meta, Scheme::Triangles)?;
    let values = |view: usize, lights: &[usize], texels: &[usize]| luminances(meta, material, view, lights, texels);
    let lobes = Lobes::new(meta, &angles, &values)?;
    let ([columns, rows], index, cumulated) = lobes.tables();
    let cells = cumulated.len() / meta.views.len();
    let clusters = 1 + usize::from(index.iter().copied().max().unwrap_or(0));
    put(folder, "lobes-index", &Numbers::U8(index.to_vec().into()), &[rows, columns])?;
    let shape = [clusters, meta.views.len(), cells / clusters];
    put(folder, "lobes-cumulated", &Numbers::F32(cumulated.to_vec().into()), &shape)
}

/// Luminances of apparent values at sampled pairs of a view, (light, texel).
fn luminances(
    meta: &BtfMeta,
    material: &dyn Material,
    view: usize,
    lights: &[usize],
    texels: &[usize],
) -> Result<Vec<f32>> {
    let wo = meta.views.directions()[view];
    let point = |&texel: &usize| Point { uv: texel_centre(texel, meta.width, meta.height), wo };
    let points: Vec<Point> = texels.iter().map(point).collect();
    let mut values = vec![Vec3::ZERO; points.len()];
    let mut found = Vec::with_capacity(lights.len() * texels.len());
    for &light in lights {
        material.apparent_many(&points, &vec![meta.lights.directions()[light]; points.len()], &mut values);
        found.extend(values.iter().map(|value| luminance(value.to_array())));
    }
    material.check()?;
    Ok(found)
}

fn put(folder: &Path, name: &str, numbers: &Numbers, shape: &[usize]) -> Result<()> {
    let path = folder.join(format!("{name}.npy"));
    fs::write(&path, npy::write(numbers, shape)).map_err(failed(&path))
}
