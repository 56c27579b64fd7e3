//! Six short programs that show how the library is used.
//!
//! They are the files of `crates/loden/examples` and run as they are: `cargo run --release --example 05_render`.
//!
//! # Open and evaluate
//!
//! A `.loden` file is opened by its [codec](crate::codec) as a [`CompressedBtf`](crate::codec::CompressedBtf): a
//! [source](crate::btf::BtfSource) of decoded images, and a [`Material`](crate::material::Material) that is evaluated
//! without decoding them. Directions are unit vectors away from the surface, in the frame x = tangent, y = bitangent,
//! z = normal.
//!
//! ```
#![doc = include_str!("../examples/01_open_and_evaluate.rs")]
//! ```
//!
//! # Compress to a size
//!
//! Every codec declares its [parameters](mod@crate::params) in a table. With a [`Goal`](crate::codec::Goal) of a size or
//! an error, those that are not given are searched for.
//!
//! ```
#![doc = include_str!("../examples/02_compress_to_a_size.rs")]
//! ```
//!
//! # Render
//!
//! The studio is a scene with one object, a floor and one light. [`render::Scene`](crate::render::Scene) is the
//! general form, and [`render::scene_file`](crate::render::scene_file) reads scenes from files.
//!
//! ```
#![doc = include_str!("../examples/05_render.rs")]
//! ```
//!
//! # Fit
//!
//! A fit searches the parameters of a [model](crate::model) within the bounds of its table. Several models fitted to
//! the same data can be ranked by their relative error.
//!
//! ```
#![doc = include_str!("../examples/06_fit.rs")]
//! ```
