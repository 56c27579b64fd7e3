//! Measured materials: read, compress, compare, evaluate and render BTFs and BRDFs.
//!
//! ```
#![doc = include_str!("../examples/01_open_and_evaluate.rs")]
//! ```
//!
//! [`guide`] has seven such programs: open, compress, make a codec, rearrange planes, render, fit, edit.
//!
//! The modules stand in data-flow order: [`import`] and [`acquire`] give a [`btf::BtfSource`] (images), a
//! [`codec`] makes it small, [`metric`] says what that cost, a [`material::Material`] evaluates it for any
//! directions, and [`render`] and [`export`] never ask where it came from. [`synth`] makes it larger,
//! [`generate`] makes new ones.
//!
//! The library has no terminal, no asynchronous code and no global state: progress and cancellation go
//! through [`progress::Progress`], every failure is an [`Error`].

// what only a feature that is switched off would use
#![cfg_attr(not(feature = "default"), allow(dead_code))]

#[cfg(feature = "acquire")]
pub mod acquire;
pub mod btf;
pub mod codec;
pub mod color;
pub mod direction;
mod error;
#[cfg(feature = "export")]
pub mod export;
mod factor;
pub mod fit;
#[cfg(feature = "generate")]
pub mod generate;
#[cfg(doc)]
pub mod guide;
#[cfg(feature = "import-raw")]
pub mod import;
mod input;
#[cfg(feature = "job")]
pub mod job;
#[cfg(feature = "library")]
pub mod library;
pub mod material;
pub mod memory;
pub mod metric;
pub mod model;
pub mod output;
pub mod params;
#[cfg(feature = "picture")]
pub mod picture;
#[cfg(feature = "plot")]
pub mod plot;
pub mod progress;
mod random;
#[cfg(feature = "rectify")]
pub mod rectify;
#[cfg(feature = "render")]
pub mod render;
#[cfg(feature = "renderers")]
pub mod renderers;
pub mod separable;
mod simd;
pub mod stages;
pub mod standard;
#[cfg(feature = "synth")]
pub mod synth;

pub use error::{Error, Result};
pub use glam;
