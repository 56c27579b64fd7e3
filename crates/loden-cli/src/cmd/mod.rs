//! One file per command.

mod acquire;
mod brdf;
mod compare;
mod compress;
mod convert;
mod decompress;
mod demo;
mod eval;
mod factor;
mod fit;
mod info;
mod library;
mod page;
mod rectify;
mod render;
mod sheet;
mod sweep;

use clap::Subcommand;

use crate::terminal::Terminal;

/// Every command.
#[derive(Subcommand)]
pub enum Command {
    /// Show what the program does: measure or read a material, compress it, compare, render, and write a page about it.
    Demo(demo::Demo),
    /// Measure a built-in sample, or your own height map, with the virtual goniometer.
    Acquire(acquire::Acquire),
    /// Make a BTF from raw photographs of a sample in a marker frame.
    Rectify(rectify::Rectify),
    /// Say what a BTF, a BRDF or a compressed material is.
    Info(info::Info),
    /// Compress a measured material.
    Compress(compress::Compress),
    /// Write the images of a compressed material, or one image for any pair of directions.
    Decompress(decompress::Decompress),
    /// Say how far compressed materials are from the measurement, and what they cost.
    Compare(compare::Compare),
    /// Compress a measurement by every method, and write a page about bytes, errors, time and memory.
    Sweep(sweep::Sweep),
    /// Convert a measurement to another form: .zip, folder or raw array.
    Convert(convert::Convert),
    /// Evaluate a material at directions listed in a file.
    Eval(eval::Eval),
    /// Render an object wearing a measured or compressed material, or a scene from a file.
    Render(render::Render),
    /// Fit analytic models to a measured BRDF and rank them.
    Fit(fit::Fit),
    /// Factor a BRDF into small tables.
    Factor(factor::Factor),
    /// Keep materials in a folder: originals, compressed forms, metrics, checksums.
    Library(library::Library),
    /// Analytic BRDFs, and pictures of any BRDF.
    Brdf(brdf::Brdf),
}

impl Command {
    pub fn run(self, terminal: &Terminal) -> anyhow::Result<()> {
        match self {
            Self::Demo(command) => command.run(terminal),
            Self::Acquire(command) => command.run(terminal),
            Self::Rectify(command) => command.run(terminal),
            Self::Info(command) => command.run(terminal),
            Self::Compress(command) => command.run(terminal),
            Self::Decompress(command) => command.run(terminal),
            Self::Compare(command) => command.run(terminal),
            Self::Sweep(command) => command.run(terminal),
            Self::Convert(command) => command.run(terminal),
            Self::Eval(command) => command.run(terminal),
            Self::Render(command) => command.run(terminal),
            Self::Fit(command) => command.run(terminal),
            Self::Factor(command) => command.run(terminal),
            Self::Library(command) => command.run(terminal),
            Self::Brdf(command) => command.run(terminal),
        }
    }
}
