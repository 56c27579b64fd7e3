//! Rays.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A half line.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ray {
    /// Start point.
    pub origin: Vec3,
    /// Unit vector.
    pub direction: Vec3,
}
