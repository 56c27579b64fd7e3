//! Seven short programs that show how the library is used.
//!
//! They are the files of `crates/loden/examples` and run as they are: `cargo run --release --example 05_render`.
//!
//! # 1 Open and evaluate
//!
//! An open `.loden` file is a [`CompressedBtf`](crate::codec::CompressedBtf): a [source](crate::btf::BtfSource) of
//! decoded images, and a [`Material`](crate::material::Material) that is evaluated without decoding them. Directions
//! are unit vectors away from the surface, in the frame x = tangent, y = bitangent, z = normal.
//!
//! ```
#![doc = include_str!("../examples/01_open_and_evaluate.rs")]
//! ```
//!
//! # 2 Compress to a size
//!
//! Every codec declares its [parameters](mod@crate::params) in a table. With a [`Goal`](crate::codec::Goal) of a size or
//! an error, those that are not given are searched for.
//!
//! ```
#![doc = include_str!("../examples/02_compress_to_a_size.rs")]
//! ```
//!
//! # 3 Make a codec
//!
//! A compressed BTF consists of planes over texels, tables over directions, and a
//! [recipe](crate::codec::parts::Recipe) that turns them into values. Any code that makes such parts is a codec: they
//! can be stored, decoded, evaluated and rendered. A codec with parameters, goals and a name on the command line also
//! implements the trait [`Codec`](crate::codec::Codec).
//!
//! ```
#![doc = include_str!("../examples/03_make_a_codec.rs")]
//! ```
//!
//! # 4 Rearrange planes
//!
//! The parts of an open file can be read, changed and stored again. Nothing is decoded, and the same code serves every
//! codec.
//!
//! ```
#![doc = include_str!("../examples/04_rearrange_planes.rs")]
//! ```
//!
//! # 5 Render
//!
//! The studio is a scene with one object, a floor and one light. [`render::Scene`](crate::render::Scene) is the
//! general form, and [`render::scene_file`](crate::render::scene_file) reads scenes from files.
//!
//! ```
#![doc = include_str!("../examples/05_render.rs")]
//! ```
//!
//! # 6 Fit
//!
//! A fit searches the parameters of a [model](crate::model) within the bounds of its table. Several models fitted to
//! the same data can be ranked by their relative error.
//!
//! ```
#![doc = include_str!("../examples/06_fit.rs")]
//! ```
//!
//! # 7 Edit
//!
//! A clustered material is an index image and rows. [`generate`](crate::generate) changes rows, puts those of one
//! material on the pattern of another, and mixes two.
//!
//! ```
#![doc = include_str!("../examples/07_edit.rs")]
//! ```
