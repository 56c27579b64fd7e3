//! Degenerate materials through every registry: the right numbers or an error that names what is wrong, never a panic
//! and never a number that is not finite.

mod brdfs;
mod btfs;
mod family;
mod syntheses;
