//! Small networks over features of texels, which follow the parallax of a height.

pub mod lanes;
pub mod layers;
pub mod place;
