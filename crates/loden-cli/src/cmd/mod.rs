//! One file per command.

mod acquire;
mod brdf;
mod compare;
mod completions;
mod compress;
mod convert;
mod decompress;
mod demo;
mod edit;
mod eval;
mod export;
mod factor;
mod fit;
mod generate;
mod info;
mod library;
mod list;
mod man;
mod page;
mod rectify;
mod render;
mod shard;
mod sheet;
#[cfg(feature = "studio")]
mod studio;
mod sweep;
mod synthesize;

use clap::Subcommand;

use crate::terminal::Terminal;

/// Every command.
#[derive(Subcommand)]
pub enum Command {
    /// Show what the program does, on one material, as a web page
    ///
    /// Takes a measurement, or simulates a woven twill; compresses it with several numbers of components, measures the
    /// errors, renders it, and writes a self-contained page about all of that.
    Demo(demo::Demo),
    /// Measure a built-in sample, a height map, a mesh or woven yarns with the virtual goniometer
    ///
    /// A sample is a model: a periodic height field, or triangles with overhangs and holes. Its reflectance is path-traced for
    /// every pair of view and light, with shadowing, masking and interreflection.
    Acquire(acquire::Acquire),
    /// Make a BTF from raw photographs of a sample in a marker frame
    ///
    /// Merges exposures, corrects lens distortion, finds the frame in every photograph and resamples the sample inside
    /// it.
    Rectify(rectify::Rectify),
    /// Describe a BTF, a BRDF or a compressed material
    ///
    /// Prints the format, directions, conventions and where they come from, the range of values, and what is missing.
    Info(info::Info),
    /// Compress a BTF into a .loden file
    ///
    /// Encodes with the given parameters, or searches for those that meet a goal (--max-error, --bytes or --quality).
    /// The error is measured over all images and stored in the file.
    Compress(compress::Compress),
    /// Compress a BTF by many processes, such as an array of batch jobs
    ///
    /// A job is a folder that all processes share. `plan` begins it; then, stage by stage, `run` runs the tasks and `next`
    /// combines their results. The file is the same as that of `loden compress`, byte for byte.
    Shard(shard::Shard),
    /// Write the images of a compressed BTF, or one image for any pair of directions
    Decompress(decompress::Decompress),
    /// Measure the error and size of compressed materials
    ///
    /// Errors are over all texels, channels and images, in the encoding of the images, as fractions of 255: 0.035 is
    /// 8.9 grey levels.
    Compare(compare::Compare),
    /// Compress a BTF by every method and write a page about errors, sizes, times and memory
    Sweep(sweep::Sweep),
    /// Convert a BTF or a BRDF to another format
    ///
    /// Says what the format cannot hold, reads the output again and prints how far it is from the source.
    Convert(convert::Convert),
    /// Write a compressed material as a plug-in for another renderer
    ///
    /// The plug-in evaluates the planes and tables of the file, so it shows what `loden render` shows. The folder also has
    /// a scene and instructions.
    Export(export::Export),
    /// Evaluate a material at directions listed in a CSV file
    Eval(eval::Eval),
    /// Render an object wearing a material, or a scene
    Render(render::Render),
    /// Fit analytic models to a BRDF and rank them by error
    Fit(fit::Fit),
    /// Factor a BRDF into small tables
    Factor(factor::Factor),
    /// Make a material or a picture larger than its sample
    ///
    /// Rearranges texels by a map of sources, so values stay what was measured, and one map serves all planes of a
    /// material and other pictures of the sample. The result is a material like any other.
    Synthesize(synthesize::Synthesize),
    /// Make a new material from others
    ///
    /// The pattern of one with the reflectance of another. `loden edit` changes one by itself.
    Generate(generate::Generate),
    /// Change colour, gloss or contrast of a material, or of parts of it
    ///
    /// The diffuse part and the highlights of every row are separated first, so a new colour leaves highlights the colour of
    /// the light. The changes are recorded in the file; `loden info` shows them.
    Edit(edit::Edit),
    /// Look at materials in a browser: directions, texels, compression, 3D view
    ///
    /// Serves a page on this machine alone. It shows the images of a measurement for directions picked with the mouse, what
    /// compression does to them, and materials on objects; long work runs as jobs that can be cancelled.
    #[cfg(feature = "studio")]
    Studio(studio::Studio),
    /// Keep materials in a folder: originals, compressed forms, checksums
    Library(library::Library),
    /// List formats, codecs, models and the like with their parameters
    List(list::List),
    /// List analytic models; evaluate and plot BRDFs
    Brdf(brdf::Brdf),
    /// Print a completion script for a shell
    Completions(completions::Completions),
    /// Print manual pages
    Man(man::Man),
}

impl Command {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self {
            Self::Demo(command) => command.run(terminal),
            Self::Acquire(command) => command.run(terminal),
            Self::Rectify(command) => command.run(terminal),
            Self::Info(command) => command.run(terminal),
            Self::Compress(command) => command.run(terminal),
            Self::Shard(command) => command.run(terminal),
            Self::Decompress(command) => command.run(terminal),
            Self::Compare(command) => command.run(terminal),
            Self::Sweep(command) => command.run(terminal),
            Self::Convert(command) => command.run(terminal),
            Self::Export(command) => command.run(terminal),
            Self::Eval(command) => command.run(terminal),
            Self::Render(command) => command.run(terminal),
            Self::Fit(command) => command.run(terminal),
            Self::Factor(command) => command.run(terminal),
            Self::Synthesize(command) => command.run(terminal),
            Self::Generate(command) => command.run(terminal),
            Self::Edit(command) => command.run(terminal),
            #[cfg(feature = "studio")]
            Self::Studio(command) => command.run(terminal),
            Self::Library(command) => command.run(terminal),
            Self::List(command) => command.run(terminal),
            Self::Brdf(command) => command.run(terminal),
            Self::Completions(command) => command.run(terminal),
            Self::Man(command) => command.run(terminal),
        }
    }
}
