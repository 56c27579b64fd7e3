//! Pictures of the reflectance of whatever a user names.

use std::path::{Path, PathBuf};

use super::open::label;
use super::{open_brdf, open_brdfs};
use crate::material::Material;
use crate::output::{create_folder, write_file};
use crate::params::Given;
use crate::picture::Picture;
use crate::progress::Progress;
use crate::{Error, Result, plot as draw};

/// Draws `polar.svg`, `albedo.svg` and a `hemisphere-N.png` for each of the BRDFs, named as for [`open_brdf`], into
/// `folder`. The light comes from the polar angles `lights` in degrees; a hemisphere is `size` pixels high. Gives the
/// files.
///
/// # Errors
/// [`Error::Parameter`] for a light that is not above the surface; what opening and writing give.
pub fn plot(
    sources: &[PathBuf],
    folder: &Path,
    lights: &[f32],
    size: usize,
    options: &Given,
    progress: &dyn Progress,
) -> Result<Vec<PathBuf>> {
    if let Some(light) = lights.iter().find(|theta| !(0.0..90.0).contains(*theta)) {
        return Err(Error::parameter("lights", format!("found {light}, expected degrees from 0 to below 90")));
    }
    let brdfs = sources.iter().map(|source| open_brdf(source, options, progress)).collect::<Result<Vec<_>>>()?;
    create_folder(folder)?;
    let named: Vec<draw::NamedMaterial> =
        brdfs.iter().map(|(label, brdf)| (label.as_str(), brdf.as_ref() as &dyn Material)).collect();
    let mut files = Vec::new();
    for (name, svg) in [("polar.svg", draw::polar(&named, lights)), ("albedo.svg", draw::albedo(&named))] {
        files.push(folder.join(name));
        write_file(folder.join(name), |out| out.write_all(svg.as_bytes()))?;
    }
    for (k, (_, brdf)) in named.iter().enumerate() {
        let path = folder.join(format!("hemisphere-{}.png", k + 1));
        draw::hemisphere(*brdf, lights, size).write_noted(&path, progress.command())?;
        files.push(path);
    }
    Ok(files)
}

/// Draws spheres of `size` pixels with their names, `columns` in a row, of BRDFs named as for [`open_brdfs`]. Gives the picture and the
/// number of spheres.
///
/// # Errors
/// What opening gives; as [`crate::plot::spheres`].
pub fn spheres(
    sources: &[PathBuf],
    size: usize,
    columns: usize,
    options: &Given,
    progress: &dyn Progress,
) -> Result<(Picture, usize)> {
    let mut brdfs = Vec::new();
    for source in sources {
        let all = open_brdfs(source, options, progress)?;
        let (name, several) = (label(source), all.len() > 1);
        let name = |k: usize| if several { format!("{name} {}", k + 1) } else { name.clone() };
        brdfs.extend(all.into_iter().enumerate().map(|(k, brdf)| (name(k), brdf)));
    }
    let named: Vec<_> = brdfs.iter().map(|(name, brdf)| (name.as_str(), brdf.as_ref() as &dyn Material)).collect();
    Ok((draw::named_spheres(&named, size, columns, progress)?, brdfs.len()))
}
