//! All integration tests as one program: it is linked once, and its tests share the processors.

mod cli;
mod common;
mod demo;
mod generate;
mod help;
mod memory;
mod outputs;
mod products;
mod provenance;
