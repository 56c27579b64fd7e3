//! Matrix factorisations, clustering, and the kernels below them.

pub mod global;
pub mod kmeans;
pub mod linalg;
pub mod local;
pub mod median_cut;
pub mod moments;
pub mod principal;
pub mod products;
pub mod project;
pub mod stream;
pub mod tile;
pub mod tree;
