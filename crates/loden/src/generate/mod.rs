//! New materials from old ones.
//!
//! [`transport`] says which part of one material corresponds to which of another.

pub mod transport;
