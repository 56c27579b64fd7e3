//! Compressed materials as plug-ins of other renderers.
//!
//! Every renderer gets a folder with its plug-in, the material's tables, and instructions. A plug-in evaluates the recipe
//! of the material ([`crate::codec::parts`]) and never asks which codec made it, so a new codec needs no change here.

mod closest;
mod glsl;
mod gltf;
mod materialx;
mod mitsuba;
mod osl;
mod renderman;
pub mod scene;
mod shader;
pub mod single;
mod tables;
mod three;
mod wgsl;

use std::path::Path;

use crate::codec::CompressedBtf;
use crate::codec::parts::Expr;
use crate::material::Material;
use crate::params::{Param, Values};
use crate::progress::Progress;
use crate::{Error, Result};

/// A renderer that materials are exported to.
pub trait Renderer: Sync {
    /// Its name on the command line.
    fn name(&self) -> &'static str;

    /// One sentence for users.
    fn doc(&self) -> &'static str;

    /// Parameter table of its options.
    fn params(&self) -> &'static [Param] {
        &[]
    }

    /// The renderer with these options; `None` if it has none.
    ///
    /// # Errors
    /// [`Error::Parameter`].
    fn with(&self, _params: &Values) -> Result<Option<Box<dyn Renderer>>> {
        Ok(None)
    }

    /// Whether scenes are exported, too.
    fn takes_scenes(&self) -> bool {
        false
    }

    /// Writes shader and textures of the material called `name` into an existing folder, and returns the request that assigns the material in
    /// a scene in RIB. `opened_as` is what loden opens instead.
    ///
    /// # Errors
    /// As [`Self::write`]; [`Error::Unsupported`] if the renderer takes no scenes.
    fn surface(&self, name: &str, material: &CompressedBtf, opened_as: &str, folder: &Path) -> Result<String> {
        let _ = (name, opened_as, folder);
        Err(Error::unsupported(material.path(), format!("{} takes materials, not scenes", self.name())))
    }

    /// Why the material cannot be exported; checked before anything is written.
    ///
    /// # Errors
    /// [`Error::Unsupported`].
    fn check(&self, name: &Path, material: &CompressedBtf) -> Result<()>;

    /// Writes the files of the material called `name` into an existing folder. If the renderer can only show an approximation, returns it.
    ///
    /// # Errors
    /// Errors of reading the material; [`Error::Io`]; [`Error::Cancelled`].
    fn write(
        &self,
        name: &str,
        material: &CompressedBtf,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Option<Box<dyn Material>>>;
}

/// Name of the file that describes the others.
pub const MANIFEST: &str = "material.json";

/// All renderers.
pub const RENDERERS: &[&dyn Renderer] = &[
    &mitsuba::Mitsuba,
    &wgsl::Wgsl,
    &glsl::Glsl,
    &three::Three,
    &osl::Osl,
    &renderman::DEFAULT,
    &gltf::Gltf,
    &materialx::MaterialX,
];

/// The renderer with a name.
///
/// # Errors
/// [`Error::Parameter`].
pub fn by_name(name: &str) -> Result<&'static dyn Renderer> {
    let known = || RENDERERS.iter().map(|renderer| renderer.name()).collect::<Vec<_>>().join(", ");
    let missing = || Error::parameter("to", format!("found {name:?}, expected one of {}", known()));
    RENDERERS.iter().copied().find(|renderer| renderer.name() == name).ok_or_else(missing)
}

/// The analytic model that an expression contains, if any.
fn model_in(value: &Expr) -> Option<&str> {
    match value {
        Expr::Model { name, .. } => Some(name),
        Expr::Sum(terms) | Expr::Product(terms) => terms.iter().find_map(model_in),
        Expr::Channels(channels) => channels.iter().find_map(model_in),
        Expr::Shift { value, .. } => model_in(value),
        Expr::Table { .. } | Expr::Dot { .. } | Expr::Network { .. } => None,
    }
}

/// Checks that an expression has no network and no parallax, which no renderer knows.
///
/// # Errors
/// [`Error::Unsupported`].
fn check_known(path: &Path, value: &Expr) -> Result<()> {
    match value {
        Expr::Network { .. } | Expr::Shift { .. } => {
            let problem = "its texels are evaluated by a neural network or shifted by a height, which exported materials cannot do; compress the BTF by another method";
            Err(Error::unsupported(path, problem))
        }
        Expr::Sum(terms) | Expr::Product(terms) => terms.iter().try_for_each(|term| check_known(path, term)),
        Expr::Channels(channels) => channels.iter().try_for_each(|channel| check_known(path, channel)),
        Expr::Model { .. } | Expr::Table { .. } | Expr::Dot { .. } => Ok(()),
    }
}
